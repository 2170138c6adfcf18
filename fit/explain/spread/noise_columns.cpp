// SPDX-License-Identifier: MIT
#include "fit/explain/spread/noise_columns.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "fit/angle.hpp"
#include "fit/explain/spread/suspects.hpp"

namespace fit::explain::spread {

Column of_intensity(const std::vector<Pool>& pools, double exponent) {
  Column column;
  for (const Pool& p : pools)
    column.push_back(std::isfinite(p.intensity) ? std::pow(1000 / std::max(20.0, p.intensity), exponent) : 0);
  return column;
}

Column of_light(const std::vector<Pool>& pools, double centre_deg, double width_deg, double power) {
  Column column;
  for (const Pool& p : pools) {
    const double away = wrap_angle((p.beam_deg - centre_deg) * rad_per_deg) * deg_per_rad / width_deg;
    column.push_back(std::exp(-std::pow(std::abs(away), power) / 2));
  }
  return column;
}

Column between_times(const std::vector<Pool>& pools, Column column, Interval times_s) {
  for (std::size_t i = 0; i < pools.size(); ++i)
    if (pools[i].time_s < times_s.from || pools[i].time_s > times_s.to) column[i] = 0;
  return column;
}

Column of_lever(const std::vector<Pool>& pools) {
  Column column;
  for (const Pool& p : pools) column.push_back(p.lever2);
  return column;
}

bool makes_noise(const Suspect& suspect) {
  return is(suspect, ids::intensity_noise) || is(suspect, ids::sunlight) || is(suspect, ids::angle_jitter) ||
         is(suspect, constant_noise);
}

Column of_suspect(const std::vector<Pool>& pools, const Suspect& suspect) {
  const auto value = [&](const char* name) { return suspect.parameters.at(name).value; };
  if (is(suspect, ids::intensity_noise)) return of_intensity(pools, value("exponent"));
  if (is(suspect, ids::sunlight)) {
    const Column light = of_light(pools, value("centre_deg"), value("width_deg"));
    return suspect.parameters.contains("from_s")
               ? between_times(pools, light, {value("from_s"), value("to_s")})
               : light;
  }
  if (is(suspect, constant_noise)) return Column(pools.size(), 1);
  if (is(suspect, ids::angle_jitter)) return of_lever(pools);
  throw std::logic_error("no noise of single samples: " +
                         (suspect.mechanism ? suspect.mechanism->id : std::string("a suspect without a name")));
}

double size_of(const Suspect& suspect) {
  const auto value = [&](const char* name) { return suspect.parameters.at(name).value; };
  const double size = is(suspect, ids::intensity_noise) ? value("sigma_mm_at_1000_counts")
                      : is(suspect, ids::angle_jitter)  ? value("sigma_deg") * rad_per_deg
                                                        : value("sigma_mm");
  return size * size;
}

}  // namespace fit::explain::spread
