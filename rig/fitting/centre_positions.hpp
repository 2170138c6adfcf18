// SPDX-License-Identifier: MIT
#pragma once
// What the captures of an edge give for the rotation centre: a position for each stage angle, and the board's
// line.

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "fit/bench/accuracy.hpp"
#include "fit/range/centre.hpp"
#include "fit/range/selection.hpp"
#include "rig/fitting/edge_source.hpp"

namespace rig::centre_parts {

/// One position of the stage: the edge as all data show it, and as the paper's method does.
struct Position {
  fit::CentrePoint point;        ///< At the edge itself.
  fit::CentrePoint paper_point;  ///< At the last smooth stop, from the most frequent intensity.
  fit::SelectedMean paper, robust;
  double u_edge_rad = 0, u_resolution_rad = 0, u_certificate_rad = 0;  ///< Parts of point.u_angle_rad.
  std::size_t capture = 0;
  const SourcedCrossing* source = nullptr;
};

/// One position for each place where the stage stood in a recording: of crossings by neighbouring beams, the
/// one whose capture is longest.
std::vector<Position> positions_of(const EdgeSource& source, bool right, double worst_rad);

/// What the devices may do to all positions alike; `lines` names what each effect belongs to.
struct CommonEffects {
  std::vector<fit::CentreEffect> effects;
  std::vector<fit::AccuracyLine> lines;
};

CommonEffects effects_on(const std::vector<Position>& positions, const fit::DeviceAccuracy& accuracy);

/// A beam's mean on the board.
struct BoardPoint {
  double beam_rad, range_mm, u_mm;
};

/// Least squares through what was seen of the board; `bend`: an error of the beams' angles.
fit::BoardLine line_through(const std::vector<BoardPoint>& seen, double stage_rad,
                            const std::function<double(double beam_rad)>& bend);

/// What was seen of the board in one capture, from its edge inwards; nothing if that is too little.
std::vector<BoardPoint> board_seen(const Position& position);

}  // namespace rig::centre_parts
