// SPDX-License-Identifier: MIT
#include "rig/fitting/edge_source.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>

#include "fit/bench/json_position.hpp"
#include "rig/errors.hpp"

namespace rig {
namespace {

std::string target_of(const std::vector<std::unique_ptr<fit::Recording>>& recordings,
                      const FitOptions& options) {
  if (options.has("target")) return options.text("target");
  std::map<std::string, int> votes;
  for (const auto& recording : recordings)
    for (const fit::CaptureInfo& capture : recording->captures())
      if (capture.target) ++votes[*capture.target];
  const auto most =
      std::ranges::max_element(votes, [](const auto& a, const auto& b) { return a.second < b.second; });
  return most == votes.end() ? std::string() : most->first;
}

std::string degrees(double rad) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f", rad * fit::deg_per_rad);
  return text;
}

/// The target's end on that side, as seen from the axis (right: the clockwise one).
Eigen::Vector2d end_of(const fit::Target& target, bool right) {
  const double turn = target.from_mm.x() * target.to_mm.y() - target.from_mm.y() * target.to_mm.x();
  return (turn > 0) == right ? target.from_mm : target.to_mm;
}

/// How far the crossing's bearing is from where the bench says the target ends.
double off_bench(const SourcedCrossing& sourced, const fit::Target& target) {
  const fit::EdgeCrossing& crossing = sourced.crossing;
  const Eigen::Vector2d end = end_of(target, crossing.right);
  const fit::Mount& mount = sourced.recording->bench().lidar.mount;
  const double stage = crossing.response.edge_rad.value;
  const Eigen::Vector2d origin(std::cos(stage) * mount.x_mm.value - std::sin(stage) * mount.y_mm.value,
                               std::sin(stage) * mount.x_mm.value + std::cos(stage) * mount.y_mm.value);
  const Eigen::Vector2d ray = end - origin;
  return std::abs(
      fit::wrap_angle(stage + mount.yaw_rad.value + crossing.beam_rad - std::atan2(ray.y(), ray.x())));
}

/// Keeps the crossings that are where the bench says; if there are none, keeps all and says so.
void compare_with_bench(EdgeSource& source) {
  if (source.target.empty() || source.crossings.empty()) return;
  const fit::Target* target = source.recordings.front()->bench().target(source.target);
  if (!target) return;
  const auto far = [&](const SourcedCrossing& sourced) {
    return off_bench(sourced, *target) > 3 * fit::rad_per_deg;
  };
  if (std::ranges::all_of(source.crossings, far)) {
    const SourcedCrossing& best = source.crossings.front();
    source.contradictions.push_back("The captures contradict the bench file: the best edge seen is " +
                                    degrees(off_bench(best, *target)) + " deg away from the end of '" +
                                    source.target +
                                    "'. Measure the target's place again, or check the mount's yaw.");
    return;
  }
  std::erase_if(source.crossings, far);
}

/// A target that was named must stand in some bench file.
void demand_known_target(const EdgeSource& source) {
  std::vector<std::string> names;
  std::string list;
  for (const auto& recording : source.recordings)
    for (const fit::Target& target : recording->bench().targets) {
      if (target.name == source.target) return;
      if (std::ranges::count(names, target.name) > 0) continue;
      names.push_back(target.name);
      list += (list.empty() ? "" : ", ") + target.name;
    }
  throw UsageError("the bench file has no target '" + source.target + "'" +
                   fit::ending_with_guess(fit::nearest_word(source.target, names)) +
                   " It has: " + (list.empty() ? "none" : list));
}

[[noreturn]] void explain_absence(const EdgeSource& source, const fit::EdgeOptions& options) {
  long captures = 0, standing = 0;
  for (const auto& recording : source.recordings)
    for (const fit::CaptureInfo& capture : recording->captures()) {
      ++captures;
      standing += !fit::is_turning(capture) &&
                  (!options.target || !capture.target || *capture.target == *options.target);
    }
  throw MeasurementError(
      "no beam passes an edge" + (source.target.empty() ? std::string() : " of '" + source.target + "'") +
      " in the session (captures: " + std::to_string(captures) +
      ", with the stage at rest and about that "
      "target: " +
      std::to_string(standing) + "): at least two neighbouring stops, no more than " +
      degrees(options.least_gap_rad) +
      " deg apart, must show the target and what is behind it. Sweep the stage over the edge (the find-edge "
      "and sweep steps do), and check that something stands at least 50 mm behind the target or nothing at "
      "all.");
}

}  // namespace

std::vector<FitOption> edge_options() {
  return {{.name = "target",
           .type = FitOption::Type::text,
           .about = "target whose edge is followed; without it, the one most captures are about"},
          {.name = "edge",
           .type = FitOption::Type::choice,
           .choices = {"right", "left"},
           .about = "end of the target, as the lidar sees it; without it, both"}};
}

EdgeSource read_edges(const std::vector<FitSource>& sources, const FitOptions& options) {
  EdgeSource source;
  for (const FitSource& file : sources) {
    source.recordings.push_back(file.session->recording());
    source.names.push_back(std::filesystem::path(file.path).filename().string());
  }
  source.target = target_of(source.recordings, options);
  fit::EdgeOptions edge;
  if (!source.target.empty()) edge.target = source.target;
  if (options.has("target") && !source.target.empty()) demand_known_target(source);
  if (options.has("edge")) edge.right = options.text("edge") == "right";
  for (const auto& recording : source.recordings)
    for (fit::EdgeCrossing& crossing : fit::find_edge_crossings(*recording, edge))
      source.crossings.push_back({std::move(crossing), recording.get()});
  if (source.crossings.empty()) explain_absence(source, edge);
  std::ranges::stable_sort(source.crossings, {},
                           [](const SourcedCrossing& c) { return c.crossing.response.edge_rad.u; });
  compare_with_bench(source);
  return source;
}

}  // namespace rig
