// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "fit/explain/model/results.hpp"
#include "fit/explain/model/widths.hpp"
#include "fit/explain/reduction/reduce.hpp"
#include "fit/explain/reduction/seen_edges.hpp"

namespace fit::explain::model {

/// The beams beside one edge while stage and targets stood as they were, and what they say of the angle over
/// which the farther surface takes over. The edge's place is a nuisance of each such stand, integrated over:
/// whatever moves it (mount, target, stage, placement) shows as beams that see one surface or the other,
/// never as a beam that sees both.
struct Transition {
  int capture = 0;
  int edge = 0;  ///< Its id (scene.hpp).
  Circumstances at;
  std::vector<Beside> beams;
  double scattered_deg2 = 0;  ///< Mean square of how far samples' angles lie beside their beam's.

  /// By the shares of the farther surface: the standard deviation of the beams' angles.
  [[nodiscard]] WidthLikelihood width() const;
  /// Samples of beams that may meet both surfaces.
  struct Shared {
    double between = 0;  ///< On neither, but between them.
    double samples = 0;  ///< In all.
  };
  /// None beside a surface that stands elsewhere than predicted.
  [[nodiscard]] Shared shared() const;
  /// Where the fewest samples are of the wrong surface, from where the bench has the edge.
  [[nodiscard]] double crossing_deg() const;
  /// Where beams that wide have the edge, from where the bench has it.
  [[nodiscard]] double place_deg(double variance_deg2) const;
};

/// All edges of a session with beams on both sides.
[[nodiscard]] std::vector<Transition> transitions(const Reduced& reduced);

/// An edge while its target is not placed anew: its id, the target that may be, and where along the rail.
using PlacedEdge = std::tuple<int, std::optional<std::string>, double>;
[[nodiscard]] PlacedEdge placed(const Reduced& reduced, const Transition& transition);

/// What they say of the width over which the farther surface takes over: every one given those before of the
/// same edge, which stands at one place (edge_place.hpp).
[[nodiscard]] std::vector<WidthRow> widths_of(const Reduced& reduced, const std::vector<Transition>& all);

/// Shares of the farther surface along the angle from every edge: as recorded, and as beams of those widths
/// have them.
[[nodiscard]] SpreadCurve shares_along(const std::vector<Transition>& all, const Eigen::VectorXd& before_deg2,
                                       const Eigen::VectorXd& after_deg2);

}  // namespace fit::explain::model
