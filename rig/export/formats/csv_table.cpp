// SPDX-License-Identifier: MIT
#include <algorithm>

#include "rig/export/correction_export.hpp"

namespace rig::exporters {
namespace {

using fit::Correction;

/// Evenly from one end to the other; one value where both are the same.
std::vector<double> grid(double from, double to, int most) {
  const int steps = to > from ? most : 0;
  std::vector<double> at;
  for (int i = 0; i <= steps; ++i) at.push_back(steps > 0 ? from + (to - from) * i / steps : from);
  return at;
}

/// A grid over measured range and intensity, for bilinear interpolation. It covers all that the terms do;
/// where the one reaches farther than the other, the border's error holds, as in Correction::apply().
std::string csv_table(const Correction& c) {
  constexpr int ranges = 200, intensities = 100;
  const std::vector<double> counts =
      c.intensity ? grid(c.intensity->from, c.intensity->to, intensities) : std::vector<double>{0};
  double least = c.zero_mm.value, most = c.zero_mm.value;  // that is left when a term's argument is its own
  if (c.intensity) {
    least = most = c.zero_mm.value + c.intensity->value(counts.front());
    for (const double i : counts) {
      least = std::min(least, c.zero_mm.value + c.intensity->value(i));
      most = std::max(most, c.zero_mm.value + c.intensity->value(i));
    }
  }
  const double one_place = c.reference_mm > 0 ? c.reference_mm : 1000;
  std::string out = "range_mm,intensity,corrected_mm,u_mm\n";
  for (const double shown : grid((c.range ? c.range->from : one_place) + least,
                                 c.range ? c.range->to + most : one_place + least, ranges))
    for (const double i : counts)
      out += real(shown) + "," + (c.intensity ? real(i) : "") + "," + real(c.apply(shown, i).range_mm) + "," +
             real(c.u(shown, i)) + "\n";
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
