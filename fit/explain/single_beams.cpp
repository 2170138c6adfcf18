// SPDX-License-Identifier: MIT
#include "fit/explain/single_beams.hpp"

#include <numeric>
#include <stdexcept>

namespace fit::explain {
namespace {

constexpr const char* why =
    "the lidar merged neighbouring steps there and sent the nearest range of each cluster, which is shorter "
    "than what single beams measure. Record with 'cluster: 1' what is to be explained";

std::size_t left_out(const std::vector<SingleBeams>& recordings) {
  return std::accumulate(recordings.begin(), recordings.end(), std::size_t{0},
                         [](std::size_t sum, const SingleBeams& one) { return sum + one.left_out(); });
}

}  // namespace

SingleBeams::SingleBeams(const Recording& recording) : Forwarded(recording) {
  const std::vector<CaptureInfo>& all = recording.captures();
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].cluster > 1) continue;
    captures_.push_back(all[i]);
    kept_.push_back(i);
  }
}

std::vector<SingleBeams> single_beams(const std::vector<const Recording*>& recordings) {
  std::vector<SingleBeams> out;
  std::size_t kept = 0;
  for (const Recording* recording : recordings) kept += out.emplace_back(*recording).captures().size();
  if (kept == 0 && left_out(out) > 0)
    throw std::invalid_argument("every capture was recorded in clusters: " + std::string(why));
  return out;
}

std::string note_on_clusters(const std::vector<SingleBeams>& recordings) {
  const std::size_t count = left_out(recordings);
  if (count == 0) return {};
  return std::to_string(count) + (count == 1 ? " capture was" : " captures were") +
         " left out: " + std::string(why) + ".";
}

}  // namespace fit::explain
