// SPDX-License-Identifier: MIT
#include <algorithm>

#include "fit/mechanism.hpp"
#include "fit/weakest_echo.hpp"

namespace fit::mechanisms {

// No echo below the comparator's threshold, whose electronic noise is Gaussian: P = Phi((I_min - I) / w).
// Where a pulse only just reaches it, its flank is flat, and the same noise moves the crossing more: of a
// Gaussian pulse the variance goes with 1 / ln(I / I_min). Within two widths w of the threshold it grows no
// more, because noise that would move the crossing further loses the echo: of d normal about (I - I_min) / w,
// and positive, the variance of sqrt(d) is 0.12 to 0.14 there, a quarter of 1 / 1.9. A receiver whose noise
// is more than half its threshold would take noise for echoes: w is no more than that.
Mechanism make_dropout() {
  Mechanism m;
  m.id = "dropout";
  m.cause = "weak echoes stay below the receiver's threshold";
  m.observable = Observable::dropout;
  m.coordinate = Coordinate::intensity;
  m.formula_error = 0.3;  // of the distance from the threshold: counts are a power of the echo, 0.4 to 1
  m.parameters = {log_shape("intensity_min", weakest_counts, 1500, 20).on(Parameter::Scale::threshold),
                  log_shape("width", 0.05, 300, 12),
                  {.name = "scatter_mm", .typical = 2, .sign = 1}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    constexpr double flattest = 1.9, widest = 0.5;  // widths, and of the threshold
    if (!std::isfinite(c.intensity)) return Effect{};
    const double width = std::min(p[1], widest * p[0]),
                 above = std::max(std::log(std::max(1.0, c.intensity / p[0])), flattest * width / p[0]);
    return Effect{.variance_mm2 = p[2] * p[2] / above,
                  .lost = 0.5 * std::erfc((c.intensity - p[0]) / width / std::sqrt(2.0))};
  };
  m.shows = [](const Finding& f, const Recorded& r) {
    const double hardly_any = f.at("intensity_min").value + 2 * f.at("width").value;
    return std::vector<Interval>{{Coordinate::intensity, r.from, std::clamp(hardly_any, r.from, r.to)}};
  };
  m.says = [](const Finding& f) {
    return "Weak echoes are lost: half of them at " + with_uncertainty(f.at("intensity_min"), "counts") + ".";
  };
  m.separate = "put up a darker surface at the same distance and see whether echoes are lost";
  return m;
}

}  // namespace fit::mechanisms
