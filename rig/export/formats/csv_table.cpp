// SPDX-License-Identifier: MIT
#include "rig/export/correction_export.hpp"

namespace rig::exporters {
namespace {

using fit::Correction;
using fit::CorrectionTerm;

/// A grid over range and intensity, for bilinear interpolation.
std::string csv_table(const Correction& c) {
  std::string out = "range_mm,intensity,corrected_mm,u_mm\n";
  const auto steps = [](const std::optional<CorrectionTerm>& term, int most) {
    std::vector<double> at;
    if (!term) return std::vector<double>{0};
    const int n = term->to > term->from ? most : 0;
    for (int i = 0; i <= n; ++i) at.push_back(n ? term->from + (term->to - term->from) * i / n : term->from);
    return at;
  };
  std::vector<double> ranges = steps(c.range, 200);
  if (!c.range) ranges = {c.reference_mm > 0 ? c.reference_mm : 1000};
  for (const double range : ranges)
    for (const double counts : steps(c.intensity, 100)) {
      // Listed by what the lidar shows: the argument of the range term is what remains after the intensity
      // term.
      const double shown = range + c.zero_mm.value + (c.intensity ? c.intensity->value(counts) : 0);
      out += real(shown) + "," + (c.intensity ? real(counts) : "") + "," +
             real(c.apply(shown, counts).range_mm) + "," + real(c.u(shown, counts)) + "\n";
    }
  return out;
}

class CsvTable : public CorrectionFormat {
 public:
  std::string format() const override { return "csv-table"; }
  std::string describes() const override {
    return "a range correction as a look-up table over range and intensity";
  }

 private:
  std::string text_of(const CorrectionExport& what) const override { return csv_table(what.correction); }
};

}  // namespace

std::unique_ptr<Exporter> make_csv_table() { return std::make_unique<CsvTable>(); }

}  // namespace rig::exporters
