// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Intensity follows K rho^a cos(i)^b / r^n behind a compressing receiver (fit/bench/radiometer.hpp), which
// benches state under this name. As an effect of its own it is a change of that law, each size alone or with
// others.
Mechanism make_radiometry() {
  Mechanism m;
  m.id = "radiometry";
  m.cause = "the echo's strength follows another law than the bench file says";
  m.observable = Observable::intensity;
  m.coordinate = Coordinate::intensity;
  m.corrects_a_statement = true;
  m.sizes_apart = true;
  m.formula_error = 0;  // but of how a receiver bends
  m.parameters = {{.name = "log_gain", .typical = 0.5},
                  {.name = "range_exponent", .typical = 0.5},
                  {.name = "response_exponent", .typical = 0.3},
                  {.name = "incidence_exponent", .typical = 0.3},
                  {.name = "reflectance_exponent", .typical = 0.3},
                  {.name = "overlap", .typical = 0.3},
                  {.name = "compression", .typical = 0.3},
                  {.name = "curvature", .typical = 0.05, .any_curve = true}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double r = std::max(1.0, c.range_mm) / 1000, cosine = std::log(std::max(0.02, c.cos_incidence)),
                 grey = std::log(std::max(1e-3, c.reflectance));
    const auto fewer = [](double by) { return std::log1p(std::max(-0.9, by)); };
    return Effect{
        .log_echo = p[0] - p[1] * std::log(r) + p[2] * (grey + cosine - 2 * std::log(r)) + p[3] * cosine +
                    p[4] * grey - (p[5] == 0 ? 0 : fewer(p[5] * 0.25 / (r * r))),
        .log_intensity = -(p[6] == 0 ? 0 : 0.5 * fewer(p[6] * std::pow(c.intensity / 1000, 2))) +
                         (p[7] == 0 ? 0 : p[7] * std::pow(std::log(std::max(1.0, c.intensity) / 300), 2))};
  };
  m.says = [](const Finding& f) {
    const std::pair<const char*, const char*> changes[] = {
        {"log_gain", "they are stronger everywhere, in the logarithm by "},
        {"range_exponent", "they fade with a power of the range that is larger by "},
        {"response_exponent", "the receiver answers an echo with a power of it that is larger by "},
        {"incidence_exponent", "the power of the incidence's cosine is larger by "},
        {"reflectance_exponent", "the power of the reflectance is larger by "},
        {"overlap", "at 500 mm the detector misses a part of the spot that is larger by "},
        {"compression", "the receiver saturates, by 1000 counts' square more by "},
        {"curvature",
         "the receiver bends by the square of the logarithm of the counts over 300, and so much: "}};
    std::string says;
    for (const auto& [name, words] : changes)
      if (const auto found = f.parameters.find(name); found != f.parameters.end())
        says += (says.empty() ? "" : "; ") + std::string(words) + with_uncertainty(found->second, "");
    return "Echoes follow another law of intensity than the bench file says: " + says + ".";
  };
  m.separate = "look at one target at several distances, and several greys at one distance";
  return m;
}

}  // namespace fit::mechanisms
