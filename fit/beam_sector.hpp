// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>

#include "fit/mechanism.hpp"

/// What mechanisms share that act in a sector of beams: its middle, the parameter `centre_deg`, its
/// standard width, `width_deg`, and how sharply it ends.
namespace fit {

/// Looked for at so many places around the lidar.
[[nodiscard]] inline Parameter centre_of_sector(int starts = 37) {
  return even_shape("centre_deg", -135, 135, starts);
}

[[nodiscard]] inline Parameter width_of_sector() {
  return log_shape("width_deg", 3, 50, 4).on(Parameter::Scale::width);
}

/// How far a direction lies from the middle, deg.
[[nodiscard]] inline double deg_from_centre(double direction_rad, double centre_deg) {
  return wrap_angle(direction_rad - centre_deg * rad_per_deg) * deg_per_rad;
}

/// How far a beam does, in widths of the sector.
[[nodiscard]] inline double widths_from_centre(const Circumstances& c, double centre_deg, double width_deg) {
  return deg_from_centre(c.beam_rad, centre_deg) / width_deg;
}

/// How a sector ends: softly, as a bell does (2), or the more sharply the larger it is.
[[nodiscard]] inline Parameter ends_of_sector(const char* name) {
  return log_shape(name, 1.5, 64, 2).generalising(2);
}

/// How much of what is there in the middle there is so many widths away: 0 where it is less than 1e-17.
[[nodiscard]] inline double share_of_sector(double widths, double ends = 2) {
  constexpr double nothing = 80;  // most beams are far away, and powers take time
  const double square = widths * widths;
  if (ends >= 2 && square > nothing) return 0;
  const double power = ends == 2 ? square : std::pow(std::abs(widths), ends);
  return power > nothing ? 0 : std::exp(-power / 2);
}

/// The beams that lie within so many widths of the middle.
[[nodiscard]] inline Interval sector_of(const Finding& f, double widths) {
  const double centre = f.at("centre_deg").value, reach = widths * f.at("width_deg").value;
  return {Coordinate::beam, centre - reach, centre + reach};
}

}  // namespace fit
