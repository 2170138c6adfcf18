// SPDX-License-Identifier: MIT
#include "rig/export/correction_export.hpp"

namespace rig::exporters {
namespace {

class CorrectionFile : public Exporter {
 public:
  std::string format() const override { return "correction"; }
  std::string describes() const override {
    return "a range correction as JSON (correction/1), for rig apply and archives";
  }
  bool accepts_files() const override { return true; }
  void write(const ExportSource& source, const std::string& output) const override {
    write_text(output, fit::to_json_text(read_for_export(source).correction));
  }
};

}  // namespace

std::unique_ptr<Exporter> make_correction() { return std::make_unique<CorrectionFile>(); }

}  // namespace rig::exporters
