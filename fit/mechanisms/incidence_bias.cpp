// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A slanted wall stretches the pulse (Soudarissanane et al. 2009); even in the incidence angle. The footprint
// is as deep as it is wide times the tangent: D tan i. D grows with the range as far as the beam diverges,
// and a spot that is not round turns with the mirror: of 16 x 2.5 mrad (UST-10LX manual) the long side lies
// in the scan plane ahead, the short one at 90 deg. The echo is the pulse and this depth in quadrature:
// s = sqrt(1 + (D tan i / p)^2) times as long as the pulse, p, and as many times weaker. A Gaussian one
// crosses a threshold T of its peak P at s sqrt(2 ln(P / (T s))) before its middle (the waveform of Laconte
// et al. 2019): with L = 1 / ln(P / T), the trigger moves by p (s sqrt(1 - L ln s) - 1). That is a square
// while D tan i is shorter than the pulse, and a line beyond, which bends back where the echo nears the
// threshold.
Mechanism make_incidence_bias() {
  Mechanism m;
  m.id = "incidence-bias";
  m.cause = "a slanted wall stretches the pulse and shifts its trigger";
  m.coordinate = Coordinate::incidence;
  m.formula_error = 0.1;
  m.parameters = {{.name = "amplitude_mm", .typical = 4},  // at 45 deg of incidence, 2 m ahead
                  // the share of D^2 there that grows with the range
                  even_shape("divergence", 0, 1, 3).generalising(),
                  // D at a beam angle of 90 deg over D ahead
                  log_shape("width_at_side", 0.1, 10, 3).generalising(1),
                  // (D / p)^2 at 45 deg
                  even_shape("stretch", 0, 1, 2).generalising(),
                  // L = 1 / ln(P / T)
                  even_shape("trigger", 0, 1, 2).generalising()};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    constexpr double reference_mm = 2000;
    const double slope = std::tan(std::min(std::abs(c.incidence_rad), 85 * rad_per_deg)),
                 far = 1 - p[1] + p[1] * std::pow(c.range_mm / reference_mm, 2),
                 turned = std::pow(std::cos(c.beam_rad), 2) + std::pow(p[2] * std::sin(c.beam_rad), 2),
                 depth2 = far * turned * slope * slope, length = std::sqrt(1 + p[3] * depth2),
                 lost = std::min(1.0, p[4] * std::log(length)), front = std::sqrt(1 - lost),
                 // (length - 1) and lost over the stretch, with their limits without any
        longer = depth2 / (1 + length), later = p[3] > 0 ? lost / p[3] : p[4] * depth2 / 2;
    return Effect{.range_mm = p[0] * (longer * front - later / (1 + front)) / (0.5 - p[4] / 4)};
  };
  m.says = [](const Finding& f) {
    const Estimate a = f.at("amplitude_mm");
    return "Slanted walls read " + std::string(a.value > 0 ? "long" : "short") + ": " +
           with_uncertainty({std::abs(a.value), a.u}, "mm") +
           " at 45 deg of incidence, 2 m ahead, growing with the square of its tangent" +
           (f.at("divergence").value > 0.5 ? " and with the distance, as the beam widens." : ".");
  };
  m.looks_like = {"crosstalk"};  // of the own surface, from hardly beyond the spot
  m.separate = "tilt the target and compare with a darker target square on";
  return m;
}

}  // namespace fit::mechanisms
