// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "fit/explain/reduction/turn_counter.hpp"
#include "fit/explain/scene/angle_grid.hpp"
#include "fit/explain/scene/scene.hpp"

namespace fit::explain::reduction {

constexpr double no_echo_above_mm = 65000, no_echo_below_mm = 22;
/// Whether something came back.
[[nodiscard]] inline bool is_echo(double range_mm) {
  return range_mm >= no_echo_below_mm && range_mm < no_echo_above_mm;
}

/// Stands for a range, mm, where no beam of that scan fell into the column.
constexpr float not_looked = -1;

/// Scans side by side: one column for each beam, or, where scans have their own geometry, for each interval
/// of the beam angle as wide as the beams' spacing.
struct Samples {
  int scans = 0, beams = 0;
  std::vector<float> range, intensity;   ///< mm and counts, scan after scan.
  std::vector<float> aside_rad;          ///< From the column's middle; empty when all beams lie there.
  std::vector<std::uint16_t> raw;        ///< Ranges as they came.
  std::vector<double> beam_rad, beam_s;  ///< Of the columns.
  std::optional<AngleGrid> grid;         ///< Of the columns, where scans have their own geometry.
  std::vector<double> since_start_s;
  std::vector<std::int64_t> seq, turn;

  [[nodiscard]] std::size_t index(int scan, int beam) const {
    return static_cast<std::size_t>(scan) * static_cast<std::size_t>(beams) + static_cast<std::size_t>(beam);
  }
  [[nodiscard]] double at(int scan, int beam) const { return range[index(scan, beam)]; }

  /// As if no beam had looked between these angles.
  void do_not_look(double from_rad, double to_rad);
  /// Joins one more scan of the capture; one that does not fit the columns is left out, and the answer false.
  bool add(const ScanView& scan, const CaptureInfo& capture, TurnCounter& turns);

 private:
  bool add_by_step(const ScanView& scan);
  bool add_by_angle(const ScanView& scan);
};

/// Columns for scans like this one, without scans; where these have their own geometry, one column has its
/// middle there.
[[nodiscard]] Samples columns_for(const ScanView& scan, const CaptureInfo& capture,
                                  const LidarGeometry& lidar, double through_rad);

/// Ranges are brought to the middle of their column, by how the range changes along the target there.
void bring_to_middle(Samples& samples, const Scene& scene, double stage_rad);

}  // namespace fit::explain::reduction
