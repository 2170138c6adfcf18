// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <vector>

namespace fit::explain::model {

/// A beam beside an edge: how much of its light is missing.
struct Dimmed {
  double inside_deg = 0;  ///< From where the bench has the edge; positive on the nearer surface.
  int side = 1;           ///< +1: it met the nearer one.
  double log_share = 0, u = 0;  ///< Of the light that its surface usually returns.
  double usual_deg = 0;         ///< Where that was read, as `inside_deg`: some may be missing there as well.
  double by_geometry = 0;  ///< What of it incidence and range make.
  double other = 0;        ///< Logarithm of the other surface's counts over its own surface's.

  [[nodiscard]] bool is_dip(double log) const {
    constexpr double least = 0.1;
    return log < -std::max(least, 5 * u);
  }
};

/// Beams of one capture.
using Dimming = std::vector<Dimmed>;

/// Farther away a beam meets one surface alone.
inline constexpr double light_reach_deg = 1.2;

/// What the light of beams beside one edge says of their width, capture by capture, given that the first one
/// shows a dip. The edge stands in all captures at one place against the bench file's, which is integrated
/// over; stage and fit may have each of them elsewhere by a normal error of unknown size, and now and then by
/// anything. Receivers compress, and tell the light of the echo that they range or of both. Light may be
/// missing for other reasons: rims, stray light past the edge, or anything else.
class EdgeLight {
 public:
  explicit EdgeLight(std::vector<Dimming> captures);
  /// Of every capture, given those before.
  [[nodiscard]] std::vector<double> log_likelihoods(double width_deg) const;

 private:
  std::vector<Dimming> captures_;
  std::vector<double> odd_;  ///< The same where its light is another's doing.
};

}  // namespace fit::explain::model
