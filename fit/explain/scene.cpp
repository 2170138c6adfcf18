// SPDX-License-Identifier: MIT
#include "fit/explain/scene.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fit::explain {
namespace {

constexpr double joined_within_mm = 5;   // ends of targets closer than this form a corner
constexpr double joined_reach_mm = 150;  // how far past a corner a wall may be met, at least
constexpr double nearest_echo_mm = 1;

Eigen::Vector2d turned(const Eigen::Vector2d& v, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * v.x() - s * v.y(), s * v.x() + c * v.y()};
}

Eigen::Vector2d quarter(const Eigen::Vector2d& v) { return {-v.y(), v.x()}; }

}  // namespace

Effect effect_of(const std::vector<Active>& at_work, const Circumstances& at) {
  Effect sum;
  for (const Active& active : at_work)
    if (!active.mechanism->displaces && (active.target < 0 || active.target == at.target))
      sum += active.mechanism->act(at, active.values);
  return sum;
}

double reflectance_in(const CaptureInfo& capture, const Target& target) {
  const bool about_it = capture.target && *capture.target == target.name;
  return about_it && capture.reflectance ? *capture.reflectance : target.reflectance.value_or(0.5);
}

double echo_power(const CaptureInfo& capture, const Bench& bench, const Sight& sight) {
  const Target& target = bench.targets[static_cast<std::size_t>(sight.target)];
  return reflectance_in(capture, target) * sight.cos_incidence() * 1e6 / (sight.range_mm * sight.range_mm);
}

Nuisance::Nuisance(const Bench& bench)
    : x_mm(bench.lidar.mount.x_mm.value),
      y_mm(bench.lidar.mount.y_mm.value),
      yaw_rad(bench.lidar.mount.yaw_rad.value),
      offset_mm(bench.targets.size(), 0.0),
      turn_rad(bench.targets.size(), 0.0) {}

Eigen::VectorXd Nuisance::as_vector() const {
  Eigen::VectorXd v(3 + 2 * static_cast<Eigen::Index>(offset_mm.size()));
  v[0] = x_mm;
  v[1] = y_mm;
  v[2] = yaw_rad;
  for (std::size_t i = 0; i < offset_mm.size(); ++i) {
    v[3 + 2 * static_cast<Eigen::Index>(i)] = offset_mm[i];
    v[4 + 2 * static_cast<Eigen::Index>(i)] = turn_rad[i];
  }
  return v;
}

void Nuisance::set(const Eigen::VectorXd& v) {
  x_mm = v[0];
  y_mm = v[1];
  yaw_rad = v[2];
  for (std::size_t i = 0; i < offset_mm.size(); ++i) {
    offset_mm[i] = v[3 + 2 * static_cast<Eigen::Index>(i)];
    turn_rad[i] = v[4 + 2 * static_cast<Eigen::Index>(i)];
  }
}

Eigen::VectorXd Nuisance::prior_sigma(const Bench& bench) {
  Eigen::VectorXd v(3 + 2 * static_cast<Eigen::Index>(bench.targets.size()));
  v[0] = bench.lidar.mount.x_mm.u;
  v[1] = bench.lidar.mount.y_mm.u;
  v[2] = bench.lidar.mount.yaw_rad.u;
  for (std::size_t i = 0; i < bench.targets.size(); ++i) {
    v[3 + 2 * static_cast<Eigen::Index>(i)] = bench.targets[i].u_mm;
    v[4 + 2 * static_cast<Eigen::Index>(i)] = bench.targets[i].u_rad;
  }
  return v;
}

double Sight::shift(const Effect& effect) const {
  return effect.range_mm + beam_lever() * effect.beam_rad + stage_lever() * effect.stage_rad -
         normal.dot(effect.origin_mm) / cos_incidence();
}

Scene::Scene(const Bench& bench, const Nuisance& nuisance, const CaptureInfo& capture, const Absent& absent)
    : nuisance_(nuisance) {
  const auto neighbour = [&](std::size_t own, const Eigen::Vector2d& end) {
    for (std::size_t j = 0; j < bench.targets.size(); ++j) {
      if (j == own || absent.contains(static_cast<int>(j))) continue;
      if ((bench.targets[j].from_mm - end).norm() < joined_within_mm ||
          (bench.targets[j].to_mm - end).norm() < joined_within_mm)
        return static_cast<int>(j);
    }
    return -1;
  };
  for (std::size_t i = 0; i < bench.targets.size(); ++i) {
    const Target& target = bench.targets[i];
    const bool moved = capture.target && *capture.target == target.name;
    const double shift = nuisance.offset_mm[i] + (moved ? capture.target_shift_mm : 0);
    Segment s;
    s.half_mm = (target.to_mm - target.from_mm).norm() / 2;
    const Eigen::Vector2d stated = (target.to_mm - target.from_mm).normalized();
    s.along = turned(stated, nuisance.turn_rad[i]);
    s.middle = (target.from_mm + target.to_mm) / 2 + shift * target.outward_normal();
    s.outward = turned(target.outward_normal(), nuisance.turn_rad[i]);
    s.from = s.middle - s.half_mm * s.along;
    s.to = s.middle + s.half_mm * s.along;
    s.reflectance = reflectance_in(capture, target);
    s.absent = absent.contains(static_cast<int>(i));
    s.moved_mm = std::abs(nuisance.offset_mm[i]) + s.half_mm * std::abs(nuisance.turn_rad[i]);
    s.corner_from_mm = -s.half_mm;
    s.corner_to_mm = s.half_mm;
    if (!moved) {
      s.joined_from = neighbour(i, target.from_mm);
      s.joined_to = neighbour(i, target.to_mm);
    }
    segments_.push_back(s);
  }
  for (Segment& s : segments_) {
    s.corner_from_mm = corner(s, s.joined_from, s.corner_from_mm);
    s.corner_to_mm = corner(s, s.joined_to, s.corner_to_mm);
  }
}

double Scene::corner(const Segment& own, int joined, double stated_mm) const {
  if (joined < 0) return stated_mm;
  const Segment& other = segments_[static_cast<std::size_t>(joined)];
  const double slope = own.along.dot(other.outward);
  if (std::abs(slope) < 0.1) return stated_mm;
  const double at = (other.middle - own.middle).dot(other.outward) / slope;
  return std::abs(at - stated_mm) < reach_past_mm(joined) ? at : stated_mm;
}

double Scene::reach_past_mm(int joined) const {
  constexpr double slanted_corner = 1.5;  // walls need not meet at right angles
  if (joined < 0) return 0;
  return std::max(joined_reach_mm, slanted_corner * segments_[static_cast<std::size_t>(joined)].moved_mm);
}

Sight Scene::aim(double stage_rad, double beam_rad, const Effect& effect) const {
  const double stage = stage_rad + effect.stage_rad;
  Sight sight;
  sight.origin = turned({nuisance_.x_mm, nuisance_.y_mm}, stage) + effect.origin_mm;
  sight.bearing_rad = stage + nuisance_.yaw_rad + beam_rad + effect.beam_rad;
  return sight;
}

bool Scene::meet(std::size_t index, Sight& sight) const {
  const Segment& s = segments_[index];
  const Eigen::Vector2d ray(std::cos(sight.bearing_rad), std::sin(sight.bearing_rad));
  Eigen::Vector2d normal = s.outward;
  double facing = normal.dot(ray);
  if (std::abs(facing) < 1e-4) return false;
  const double distance = normal.dot(s.middle - sight.origin) / facing;
  if (distance <= nearest_echo_mm) return false;
  if (facing < 0) {
    normal = -normal;
    facing = -facing;
  }
  sight.target = static_cast<int>(index);
  sight.range_mm = distance;
  sight.along_mm = s.along.dot(sight.origin + distance * ray - s.middle);
  sight.normal = normal;
  sight.incidence_rad = std::atan2(quarter(normal).dot(ray), facing);
  sight.along_sign = quarter(normal).dot(s.along) >= 0 ? 1 : -1;
  sight.turn_lever = sight.along_mm * normal.dot(quarter(s.along)) / std::max(0.02, facing);
  sight.cosine = std::max(0.02, facing);
  return true;
}

void Scene::finish(Sight& sight) {
  sight.beam_lever_mm = sight.range_mm * std::tan(sight.incidence_rad);
  sight.stage_lever_mm = sight.beam_lever_mm - sight.normal.dot(quarter(sight.origin)) / sight.cosine;
}

Sight Scene::look(double stage_rad, double beam_rad, const Effect& effect) const {
  Sight best = aim(stage_rad, beam_rad, effect);
  double nearest = 1e12;
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    const Segment& s = segments_[i];
    if (s.absent) continue;
    Sight sight = best;
    if (!meet(i, sight) || sight.range_mm >= nearest) continue;
    const double below = reach_past_mm(s.joined_from), above = reach_past_mm(s.joined_to);
    if (sight.along_mm < -s.half_mm - below || sight.along_mm > s.half_mm + above) continue;
    nearest = sight.range_mm;
    best = sight;
  }
  if (best.target >= 0) finish(best);
  return best;
}

Sight Scene::look_at(int target, double stage_rad, double beam_rad, const Effect& effect) const {
  Sight sight = aim(stage_rad, beam_rad, effect);
  if (meet(static_cast<std::size_t>(target), sight)) finish(sight);
  return sight;
}

std::vector<Edge> Scene::edges(double stage_rad) const {
  const Eigen::Vector2d origin = turned({nuisance_.x_mm, nuisance_.y_mm}, stage_rad);
  constexpr double aside = 2e-4;
  std::vector<Edge> found;
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    if (segments_[i].absent) continue;
    for (const bool start : {true, false}) {
      if ((start ? segments_[i].joined_from : segments_[i].joined_to) >= 0) continue;
      const Eigen::Vector2d end = (start ? segments_[i].from : segments_[i].to) - origin;
      const double bearing = std::atan2(end.y(), end.x());
      const double beam = bearing - stage_rad - nuisance_.yaw_rad;
      const Sight low = look(stage_rad, beam - aside), high = look(stage_rad, beam + aside);
      if (low.target == high.target) continue;
      const bool on_low =
          low.target == static_cast<int>(i) && (high.target < 0 || high.range_mm > low.range_mm);
      const bool on_high =
          high.target == static_cast<int>(i) && (low.target < 0 || low.range_mm > high.range_mm);
      if (!on_low && !on_high) continue;
      const Sight& near = on_low ? low : high;
      const Sight& far = on_low ? high : low;
      found.push_back({bearing, near.range_mm, far.target < 0 ? 0 : far.range_mm,
                       2 * static_cast<int>(i) + (start ? 0 : 1), on_low ? -1 : 1});
    }
  }
  return found;
}

double Scene::echo_power(const Sight& sight) const {
  const double cosine = std::cos(sight.incidence_rad);
  return segments_[static_cast<std::size_t>(sight.target)].reflectance * cosine * 1e6 /
         (sight.range_mm * sight.range_mm);
}

/// Stray light of neighbouring surfaces within a degree, weighted by its angular distance.
double Scene::pull(const Sight& sight, double stage_rad) const {
  const double own = echo_power(sight);
  double sum = 0;
  for (const int side : {-4, -3, -2, -1, 1, 2, 3, 4}) {
    const double angle = side * 0.25 * rad_per_deg;
    const Sight other = look(stage_rad, sight.bearing_rad - stage_rad - nuisance_.yaw_rad + angle);
    if (other.target < 0 || other.target == sight.target) continue;
    const double gap = other.range_mm - sight.range_mm;
    if (std::abs(gap) > 500) continue;
    constexpr double halo = 0.7 * rad_per_deg;
    sum += echo_power(other) / own * gap / (1 + angle * angle / (halo * halo));
  }
  return sum;
}

double Scene::to_corner_mm(const Sight& sight) const {
  const Segment& s = segments_[static_cast<std::size_t>(sight.target)];
  double nearest = std::numeric_limits<double>::infinity();
  if (s.joined_from >= 0) nearest = std::abs(sight.along_mm - s.corner_from_mm);
  if (s.joined_to >= 0) nearest = std::min(nearest, std::abs(sight.along_mm - s.corner_to_mm));
  return nearest;
}

void Scene::describe(const Sight& sight, double stage_rad, const std::vector<Edge>& edges,
                     Circumstances& c) const {
  c.range_mm = sight.range_mm;
  c.incidence_rad = sight.incidence_rad;
  c.cos_incidence = sight.cos_incidence();
  c.bearing_rad = sight.bearing_rad;
  c.target = sight.target;
  c.along_mm = sight.along_mm;
  c.along_sign = sight.along_sign;
  c.normal = sight.normal;
  const Segment& s = segments_[static_cast<std::size_t>(sight.target)];
  c.half_length_mm = s.half_mm;
  c.corner_mm = to_corner_mm(sight);
  for (const Edge& edge : edges) {
    const double away = wrap_angle(sight.bearing_rad - edge.bearing_rad) * edge.near_side;
    if (std::abs(away) >= std::abs(c.edge_rad)) continue;
    c.edge_rad = away;
    c.gap_mm = edge.far_mm > 0 ? edge.far_mm - edge.near_mm : 0;
  }
  if (std::abs(c.edge_rad) < 1.2 * rad_per_deg && c.gap_mm != 0) c.pull_mm = pull(sight, stage_rad);
}

}  // namespace fit::explain
