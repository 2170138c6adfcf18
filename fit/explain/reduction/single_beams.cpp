// SPDX-License-Identifier: MIT
#include <numeric>
#include <stdexcept>

#include "fit/explain/reduction/left_out.hpp"

namespace fit::explain {
namespace {

constexpr const char* why =
    "the lidar merged neighbouring steps there and sent the nearest range of each cluster, which is shorter "
    "than what single beams measure. Record with 'cluster: 1' what is to be explained";

std::size_t left_out(const std::vector<SelectedCaptures>& recordings) {
  return std::accumulate(recordings.begin(), recordings.end(), std::size_t{0},
                         [](std::size_t sum, const SelectedCaptures& one) { return sum + one.left_out(); });
}

}  // namespace

std::vector<SelectedCaptures> single_beams(const std::vector<const Recording*>& recordings) {
  std::vector<SelectedCaptures> out;
  std::size_t kept = 0;
  for (const Recording* recording : recordings) {
    const auto is_single = [&](std::size_t i) { return recording->captures()[i].cluster <= 1; };
    kept += out.emplace_back(*recording, is_single).captures().size();
  }
  if (kept == 0 && left_out(out) > 0)
    throw std::invalid_argument("every capture was recorded in clusters: " + std::string(why));
  return out;
}

std::string note_on_clusters(const std::vector<SelectedCaptures>& recordings) {
  const std::size_t count = left_out(recordings);
  if (count == 0) return {};
  return std::to_string(count) + (count == 1 ? " capture was" : " captures were") +
         " left out: " + std::string(why) + ".";
}

}  // namespace fit::explain
