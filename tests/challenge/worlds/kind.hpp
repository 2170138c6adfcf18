// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "worlds/device.hpp"

namespace challenge {

using nlohmann::json;

/// What is drawn once for a cause.
struct Shape {
  double a = 0, b = 0, c = 0, d = 0;  ///< Uniform, 0 to 1.
  double sign = 1;
  PowerSpan power;
  std::size_t wall = 0;
};

/// One kind of concealed physics: the keys of a world file that make it, by its strength.
struct Kind {
  std::string id;
  std::vector<std::string> scenes;
  std::function<json(const Session&, const Shape&, double strength)> keys;
  std::function<json(const Session&, const Shape&, double strength)> parameters;  ///< As fit/ names them.
  double largest = 100;  ///< Strength beyond which no device would be.
  bool sized = true;
  bool each_scan = false;
  bool shifts = true;                        ///< Shows in means, which the engine tells.
  std::vector<std::string> also_makes = {};  ///< Other effects of the catalogue that come of the same keys.
};

// The kinds, a file a part of the device.
std::vector<Kind> kinds_of_ranges();
std::vector<Kind> kinds_of_angles();
std::vector<Kind> kinds_of_stage();
std::vector<Kind> kinds_of_targets();
std::vector<Kind> kinds_of_noise();
/// What shows in the intensity.
std::vector<Kind> kinds_of_light();
std::vector<Kind> kinds_outside_the_catalogue();

// What their files have in common.
using S = const Session&;
using D = const Shape&;
inline double phase_deg(double x) { return 360 * x - 180; }
inline double log_between(double x, double low, double high) { return low * std::pow(high / low, x); }
inline const std::string& name_of(const Session& session, const Shape& shape) {
  return session.walls[shape.wall].name;
}
inline json of_target(const Session& session, const Shape& shape, const char* key, double value) {
  return {{"truth", {{"targets", {{name_of(session, shape), {{key, value}}}}}}}};
}
inline json nothing_known(const Session&, const Shape&, double) { return json::object(); }

}  // namespace challenge
