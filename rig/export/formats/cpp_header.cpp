// SPDX-License-Identifier: MIT
#include "rig/export/correction_export.hpp"

namespace rig::exporters {
namespace {

class CppHeader : public Exporter {
 public:
  std::string format() const override { return "cpp-header"; }
  std::string describes() const override {
    return "a range correction as a C++11 header without dependencies, with uncertainty";
  }
  bool accepts_files() const override { return true; }
  void write(const ExportSource& source, const std::string& output) const override {
    write_text(output, cpp_header(read_for_export(source)));
  }
};

}  // namespace

std::unique_ptr<Exporter> make_cpp_header() { return std::make_unique<CppHeader>(); }

}  // namespace rig::exporters
