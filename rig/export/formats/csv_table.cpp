// SPDX-License-Identifier: MIT
#include "rig/export/correction_export.hpp"

namespace rig::exporters {
namespace {

class CsvTable : public Exporter {
 public:
  std::string format() const override { return "csv-table"; }
  std::string describes() const override {
    return "a range correction as a look-up table over range and intensity";
  }
  bool accepts_files() const override { return true; }
  void write(const ExportSource& source, const std::string& output) const override {
    write_text(output, csv_table(read_for_export(source).correction));
  }
};

}  // namespace

std::unique_ptr<Exporter> make_csv_table() { return std::make_unique<CsvTable>(); }

}  // namespace rig::exporters
