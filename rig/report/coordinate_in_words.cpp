// SPDX-License-Identifier: MIT
#include "rig/report/coordinate_in_words.hpp"

#include <map>

namespace rig {

CoordinateWords coordinate_in_words(const std::string& id) {
  static const std::map<std::string, CoordinateWords> words = {
      {"beam_deg", {"beam angle", "deg"}},
      {"stage_deg", {"stage angle", "deg"}},
      {"range_mm", {"range", "mm"}},
      {"intensity", {"intensity", "counts"}},
      {"incidence_deg", {"angle of incidence", "deg"}},
      {"edge_distance_deg", {"angle from the nearest edge", "deg"}},
      {"time_s", {"time", "s"}},
      {"temperature_c", {"temperature", "\u00b0C"}},
      {"approach", {"sign of the last move", ""}},
      {"stage_rate_deg_s", {"stage rate", "deg/s"}},
      {"range_rate", {"range rate", ""}},
      {"scan_seq", {"scan number", ""}},
      {"target", {"target", ""}},
      {"corner_mm", {"distance from the nearest inner corner", "mm"}},
      {"along_mm", {"position along the target", "mm"}}};
  const auto known = words.find(id);
  return known == words.end() ? CoordinateWords{id, ""} : known->second;
}

std::string observable_in_words(const std::string& id) {
  static const std::map<std::string, std::string> words = {
      {"range-mean", "mean of the ranges"},
      {"range-variance", "scatter of the ranges"},
      {"range-distribution", "shape of the ranges' distribution"},
      {"intensity", "intensity"},
      {"dropout", "dropouts"},
      {"time-correlation", "ranges of successive scans, which depend on each other"}};
  const auto word = words.find(id);
  return word == words.end() ? id : word->second;
}

}  // namespace rig
