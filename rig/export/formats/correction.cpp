// SPDX-License-Identifier: MIT
#include "rig/export/correction_export.hpp"

namespace rig::exporters {
namespace {

class CorrectionFile : public CorrectionFormat {
 public:
  std::string format() const override { return "correction"; }
  std::string describes() const override {
    return "a range correction as JSON (correction/1), for rig apply and archives";
  }

 private:
  std::string text_of(const CorrectionExport& what) const override {
    return fit::to_json_text(what.correction);
  }
};

}  // namespace

std::unique_ptr<Exporter> make_correction() { return std::make_unique<CorrectionFile>(); }

}  // namespace rig::exporters
