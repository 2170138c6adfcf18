// SPDX-License-Identifier: MIT
#include "fit/explain/scene/fitted_room.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "fit/explain/scene/scene.hpp"

namespace fit::explain {
namespace {

constexpr int scans_at_rest = 20;            // fewer say too little about noise
constexpr std::int64_t around_us = 300'000;  // at rest: still before and after
constexpr double still_mm = 2, still_rad = 0.3 * rad_per_deg;
constexpr int beams_of_wall = 8;
constexpr double unsteady_mm = 15, unsteady_share = 0.02;
constexpr double wall_mm = 250, flat_mm = 15, jump_share = 0.08;

struct Place {
  double x = 0, y = 0, heading = 0;
  bool known = false;
};

/// Where the carrier is, by the nearest pose before.
Place place_at(const std::vector<TrackPose>& track, std::int64_t us) {
  Place place;
  const auto after = std::ranges::upper_bound(track, us, {}, &TrackPose::host_us);
  for (auto pose = after; pose != track.begin();) {
    --pose;
    if (!pose->x_mm || !pose->y_mm || !pose->heading_rad) continue;
    return {*pose->x_mm, *pose->y_mm, *pose->heading_rad, true};
  }
  return place;
}

bool at_rest(const std::vector<TrackPose>& track, std::int64_t us) {
  const Place before = place_at(track, us - around_us), after = place_at(track, us + around_us);
  if (!before.known || !after.known) return true;
  return std::hypot(after.x - before.x, after.y - before.y) < still_mm &&
         std::abs(wrap_angle(after.heading - before.heading)) < still_rad;
}

struct Line {
  Eigen::Vector2d middle, along;
  double off_mm = 0;  ///< Largest distance of a point.
};

Line line_through(const std::vector<Eigen::Vector2d>& points, std::size_t first, std::size_t last) {
  Line line{Eigen::Vector2d::Zero(), Eigen::Vector2d::UnitX()};
  const auto n = static_cast<double>(last - first);
  for (std::size_t i = first; i < last; ++i) line.middle += points[i] / n;
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
  for (std::size_t i = first; i < last; ++i) {
    const Eigen::Vector2d d = points[i] - line.middle;
    spread += d * d.transpose();
  }
  line.along = Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(spread).eigenvectors().col(1);
  if (line.along.dot(points[last - 1] - points[first]) < 0) line.along = -line.along;
  for (std::size_t i = first; i < last; ++i) {
    const Eigen::Vector2d d = points[i] - line.middle;
    line.off_mm = std::max(line.off_mm, std::abs(d.x() * line.along.y() - d.y() * line.along.x()));
  }
  return line;
}

/// Splits a run of neighbouring points where it bends, and keeps what is flat and long.
void split(const std::vector<Eigen::Vector2d>& points, std::size_t first, std::size_t last,
           std::vector<Target>& walls) {
  if (last < first + beams_of_wall) return;
  const Line line = line_through(points, first, last);
  if (line.off_mm > flat_mm) {
    // The corner is where the chord between the ends is farthest away.
    const Eigen::Vector2d chord = (points[last - 1] - points[first]).normalized();
    std::size_t corner = (first + last) / 2;
    double most = 0;
    for (std::size_t i = first + 1; i + 1 < last; ++i) {
      const Eigen::Vector2d d = points[i] - points[first];
      const double off = std::abs(d.x() * chord.y() - d.y() * chord.x());
      if (off > most) most = off, corner = i;
    }
    split(points, first, corner, walls);
    split(points, corner + 1, last, walls);
    return;
  }
  const double from = line.along.dot(points[first] - line.middle),
               to = line.along.dot(points[last - 1] - line.middle);
  if (to - from < wall_mm) return;
  Target& wall = walls.emplace_back();
  wall.from_mm = line.middle + from * line.along;
  wall.to_mm = line.middle + to * line.along;
  wall.u_mm = 20;  // fitted anew with every suspect
  wall.u_rad = 2 * rad_per_deg;
}

/// The median range of a direction; none of an edge, a person, a curtain: nothing that stands still.
std::optional<double> steady_range(std::vector<float> values) {
  const auto place = [&](std::size_t number) { return values.begin() + static_cast<std::ptrdiff_t>(number); };
  const auto middle = place(values.size() / 2), most = place(values.size() * 3 / 4);
  std::ranges::nth_element(values, middle);
  const float range = *middle;
  for (float& v : values) v = std::abs(v - range);
  std::ranges::nth_element(values, most);
  return *most > unsteady_mm + unsteady_share * static_cast<double>(range) ? std::nullopt
                                                                           : std::optional<double>(range);
}

}  // namespace

Carried carried(const Recording& recording) {
  Carried sum;
  const TrackPose* before = nullptr;
  for (const TrackPose& pose : recording.track()) {
    if (!pose.x_mm || !pose.y_mm || !pose.heading_rad) continue;
    ++sum.poses;
    if (before) {
      sum.path_mm += std::hypot(*pose.x_mm - *before->x_mm, *pose.y_mm - *before->y_mm);
      sum.turned_rad += std::abs(wrap_angle(*pose.heading_rad - *before->heading_rad));
    }
    before = &pose;
  }
  return sum;
}

FittedRoom::FittedRoom(const Recording& own) : own_(own), bench_(own.bench()), moved_(carried(own).moved()) {
  std::vector<std::vector<std::string>> names;
  for (const Standstill& standstill : standstills()) {
    std::vector<Target> walls = walls_of(standstill);
    if (walls.empty()) continue;
    CaptureInfo info = own.captures()[standstill.capture];
    info.started_us = standstill.first_us;
    standstills_.push_back(standstill);
    captures_.push_back(info);
    names.emplace_back();
    for (Target& wall : walls) {
      wall.name = "wall " + std::to_string(bench_.targets.size() + 1);
      names.back().push_back(wall.name);
      bench_.targets.push_back(wall);
    }
  }
  if (captures_.empty())
    throw std::invalid_argument(
        std::string("the bench has no targets, and the recording shows no flat wall ") +
        (moved_ ? "while its lidar stands still" : "either") +
        ". Describe the walls or boards under 'targets' and give the bench with --bench (`rig new bench` "
        "writes a "
        "commented one to start from); for a wall at a known distance, import with --true-mm");
  for (std::size_t c = 0; c < captures_.size(); ++c) {
    absent_.emplace_back();
    for (std::size_t other = 0; other < captures_.size(); ++other)
      if (other != c) absent_.back().insert(names[other].begin(), names[other].end());
  }
}

std::vector<FittedRoom::Standstill> FittedRoom::standstills() const {
  std::vector<TrackPose> track = own_.track();
  std::ranges::stable_sort(track, {}, &TrackPose::host_us);
  std::vector<Standstill> list;
  for (std::size_t c = 0; c < own_.captures().size(); ++c) {
    if (is_turning(own_.captures()[c])) continue;
    bool resting = false;
    own_.for_each_scan(c, [&](const ScanView& scan) {
      const bool rests = at_rest(track, scan.host_us);
      if (rests && !resting) list.push_back({c, scan.host_us, scan.host_us, 0});
      resting = rests;
      if (!rests) return;
      list.back().last_us = scan.host_us;
      ++list.back().scans;
    });
  }
  std::erase_if(list, [](const Standstill& s) { return s.scans < scans_at_rest; });
  return list;
}

void FittedRoom::walk(const Standstill& standstill, const std::function<void(const ScanView&)>& visit) const {
  own_.for_each_scan(standstill.capture, [&](const ScanView& scan) {
    if (scan.host_us >= standstill.first_us && scan.host_us <= standstill.last_us) visit(scan);
  });
}

FittedRoom::Ranges FittedRoom::ranges_of(const Standstill& standstill) const {
  const CaptureInfo& info = own_.captures()[standstill.capture];
  std::optional<Ranges> ranges;
  walk(standstill, [&](const ScanView& scan) {
    const BeamAngles angles(bench_.lidar, info, scan.geometry);
    if (!ranges) ranges.emplace(AngleGrid(angles.first_rad(), angles.step_rad()));
    for (std::size_t k = 0; k < scan.range_mm.size(); ++k)
      if (scan.range_mm[k] >= 22)
        ranges->list[ranges->grid.column_of(angles.at_rad(k))].push_back(scan.range_mm[k]);
  });
  return ranges.value_or(Ranges(AngleGrid(0, 2 * pi)));
}

std::vector<Target> FittedRoom::walls_of(const Standstill& standstill) const {
  const CaptureInfo& info = own_.captures()[standstill.capture];
  const Mount& mount = bench_.lidar.mount;
  const Ranges seen = ranges_of(standstill);
  const std::vector<std::vector<float>>& ranges = seen.list;
  const auto is_seen = [&](std::size_t direction) {
    return static_cast<int>(ranges[direction].size()) * 2 >= standstill.scans;
  };
  const double c = std::cos(info.stage_rad), s = std::sin(info.stage_rad);
  const Eigen::Vector2d origin(c * mount.x_mm.value - s * mount.y_mm.value,
                               s * mount.x_mm.value + c * mount.y_mm.value);
  std::vector<Target> walls;
  std::vector<Eigen::Vector2d> points;
  double before = 0;  // the range of the last one
  const auto finish = [&] {
    split(points, 0, points.size(), walls);
    points.clear();
  };
  // Twice around from a gap, so that a wall where the circle is cut is seen whole once.
  std::size_t gap = 0;
  while (gap < ranges.size() && is_seen(gap)) ++gap;
  for (std::size_t step = 0; step < ranges.size(); ++step) {
    const std::size_t i = (gap + step) % ranges.size();
    if (!is_seen(i)) {
      // One lost direction does not end a wall, a sector does.
      if (!is_seen((i + 1) % ranges.size())) finish();
      continue;
    }
    const std::optional<double> range = steady_range(ranges[i]);
    if (!range) {
      finish();
      continue;
    }
    const double bearing = info.stage_rad + mount.yaw_rad.value + seen.grid.middle_rad(i);
    if (!points.empty() && std::abs(*range - before) > jump_share * *range + 20) finish();
    points.emplace_back(origin + *range * Eigen::Vector2d(std::cos(bearing), std::sin(bearing)));
    before = *range;
  }
  finish();
  return walls;
}

void FittedRoom::for_each_scan(std::size_t index, const std::function<void(const ScanView&)>& visit) const {
  walk(standstills_[index], visit);
}

std::string FittedRoom::note() const {
  int scans = 0;
  for (const Standstill& standstill : standstills_) scans += standstill.scans;
  return "The bench has no targets: " + std::to_string(bench_.targets.size()) +
         " flat walls were fitted to the recording itself" +
         (moved_ ? ", to " + std::to_string(scans) + " scans in " + std::to_string(standstills_.size()) +
                       " stretches at rest; what was recorded on the move is not used"
                 : std::string()) +
         ". Noise, echoes and memory are explained; an error that all walls share moves the walls instead "
         "and is not "
         "seen.";
}

}  // namespace fit::explain
