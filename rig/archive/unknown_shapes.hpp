// SPDX-License-Identifier: MIT
#pragma once

#include <span>
#include <string>
#include <vector>

#include "rig/archive/session_record.hpp"

namespace rig {

/// Physics without a name that several sessions show alike: by coordinate, form and size.
struct UnknownShape {
  std::string coordinate, observable, channel, form;
  std::vector<const SessionRecord*> sessions;  ///< The first is the most typical.
  std::vector<double> at, curve;               ///< Their mean, in mm or deg; empty where it is no curve.
  double size = 0;  ///< Root mean square of the curve, or the largest figure of its words.
  [[nodiscard]] std::vector<std::string> serials() const;
};

/// Puts the sessions with unknown physics together. Two curves are one shape if they correlate by 0.8 over
/// the coordinate that both have, without their means, and differ by less than a factor of two; what is no
/// curve, if words, coordinate and observable are the same and the figures differ by less than that. Largest
/// groups first.
[[nodiscard]] std::vector<UnknownShape> unknown_shapes(std::span<const SessionRecord> archive);

}  // namespace rig
