// SPDX-License-Identifier: MIT
#include "rig/export/correction_export.hpp"

namespace rig::exporters {
namespace {

class CHeader : public Exporter {
 public:
  std::string format() const override { return "c-header"; }
  std::string describes() const override { return "a range correction as a C99 header without dependencies"; }
  bool accepts_files() const override { return true; }
  void write(const ExportSource& source, const std::string& output) const override {
    write_text(output, c_header(read_for_export(source)));
  }
};

}  // namespace

std::unique_ptr<Exporter> make_c_header() { return std::make_unique<CHeader>(); }

}  // namespace rig::exporters
