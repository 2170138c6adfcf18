// SPDX-License-Identifier: MIT
#pragma once

#include <string>

namespace rig {

/// A coordinate of an explanation for people: "beam_deg" is "beam angle" in "deg". One that is not known
/// stays as it is.
struct CoordinateWords {
  std::string name, unit;  ///< Unit: empty for what has none.
  /// "beam angle (deg)".
  [[nodiscard]] std::string with_unit() const { return unit.empty() ? name : name + " (" + unit + ")"; }
};
[[nodiscard]] CoordinateWords coordinate_in_words(const std::string& id);

/// What kind of reading a difference shows in: "range-variance" is "scatter of the ranges".
[[nodiscard]] std::string observable_in_words(const std::string& id);

}  // namespace rig
