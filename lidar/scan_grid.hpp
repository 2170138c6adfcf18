// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <vector>

namespace lidar {

/// Finds when scans began, far below the millisecond of their stamps.
///
/// A lidar's motor turns evenly, so scans begin at start + k * period, and each stamp is the floor of one of
/// these. All pairs (start, period) that agree with every stamp so far form a convex polygon; each new stamp
/// cuts a strip out of it, and its centre of mass is the best guess of both. Snapping scans to an even grid
/// is urg_stamped's idea (SEQSENSE); keeping the whole set of possible grids is ours, and gives the
/// uncertainty with it. A motor whose speed wanders makes the polygon empty now and then: it is then widened
/// by as much as is missing, and that much wandering is allowed for from there on.
class ScanGrid {
 public:
  /// Start of a scan on the lidar's own clock, and its standard uncertainty, milliseconds.
  struct Start {
    double device_ms, u_ms;
  };

  explicit ScanGrid(double nominal_period_ms);

  /// The next scan's stamp, wraps undone. Scans may be missing in between.
  Start add(std::uint64_t stamp_ms);
  /// Forgets all but the nominal period: the timer started again.
  void restart();
  /// From now on stamps are whole multiples of so many milliseconds, plus a constant: 1 unless set
  /// otherwise. Begins anew when that changes.
  void set_step(double step_ms);

  [[nodiscard]] double period_ms() const { return centre_.period; }

 private:
  struct Point {
    double start;   ///< Of the scan that the polygon was last brought to, behind its stamp, ms.
    double period;  ///< ms
    [[nodiscard]] double later(double turns, double gap_ms) const { return start + turns * period - gap_ms; }
  };

  void begin(std::uint64_t stamp_ms);
  void advance(double gap_ms);
  void rebase();
  void widen(double start, double period);
  void cut(double bound, double sign);
  bool drop_side();
  void summarise();

  double nominal_period_ms_, step_ms_ = 1;
  bool begun_ = false;
  std::uint64_t stamp_ms_ = 0;
  std::vector<Point> polygon_, scratch_;  ///< Corners, anticlockwise.
  double turns_ = 0, gap_ms_ = 0;         ///< From that scan to the newest.
  Point centre_{};
  double start_variance_ = 0, period_variance_ = 0, covariance_ = 0;
  double since_widened_ms_ = 0;
  double start_wander_ms_, period_wander_ms_;  ///< Allowed for each second.
};

}  // namespace lidar
