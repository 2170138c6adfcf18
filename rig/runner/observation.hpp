// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <utility>

namespace rig {

/// What the rig sees of its bench, and whether it is what was requested.
struct Observation {
  explicit Observation(bool good_ = true, std::string text_ = "") : good(good_), text(std::move(text_)) {}
  bool good;
  std::string text;
  std::optional<double> to_go_mm, intensity;  ///< Of a target.
  bool in_view = true;
};

}  // namespace rig
