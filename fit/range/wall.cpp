// SPDX-License-Identifier: MIT
#include "fit/range/wall.hpp"

#include <algorithm>
#include <stdexcept>

#include "fit/numeric/angle.hpp"
#include "fit/range/wall_parts.hpp"

namespace fit {

WallFit fit_wall(const std::vector<const Recording*>& recordings, const WallOptions& options) {
  using namespace wall_parts;
  WallFit fit;
  std::vector<Station> stations;
  std::size_t moving = 0, shifted = 0;
  for (const Recording* recording : recordings)
    for (std::size_t i = 0; i < recording->captures().size(); ++i) {
      const CaptureInfo& capture = recording->captures()[i];
      if (is_turning(capture)) {
        ++moving;
      } else if (capture.target_shift_mm != 0) {
        ++shifted;
      } else {
        stations.push_back(read_station(*recording, i, options.scans_per_capture));
      }
    }
  if (moving + shifted > 0)
    fit.notes.push_back(std::to_string(moving + shifted) +
                        " captures were left out: the stage turned, or a board was shifted.");
  if (stations.empty() || recordings.empty())
    throw std::invalid_argument("There is no capture with the stage at rest");
  const Bench& bench = recordings.front()->bench();
  const auto nearest = std::ranges::min_element(
      stations, {}, [](const Station& s) { return std::abs(wrap_angle(s.stage_rad)); });
  find_walls(bench, *nearest, options, fit);
  const double yaw = bench.lidar.mount.yaw_rad.value;
  for (Station& station : stations) assign(station, fit.walls, yaw, options);
  check_turned(stations);
  fit_joint(stations, yaw, bench.lidar.mount, options.accuracy, fit);
  fit_patent(stations, fit);
  return fit;
}

}  // namespace fit
