// SPDX-License-Identifier: MIT
#include "sim/model_scene.hpp"

#include <algorithm>
#include <cmath>

namespace sim {
namespace {

constexpr double meeting_mm = 40;  // ends of targets so close to where their lines cross form a corner
constexpr double shallow_mm = 5;   // not an edge

Eigen::Vector2d ray_of(double bearing) { return {std::cos(bearing), std::sin(bearing)}; }
double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

}  // namespace

ModelScene::ModelScene(const fit::Bench& bench)
    : bench_(bench), shift_(bench.targets.size(), 0), reflectance_(bench.targets.size(), -1) {
  build();
}

void ModelScene::set(const SceneState& state) {
  for (std::size_t i = 0; i < bench_.targets.size(); ++i) {
    if (bench_.targets[i].name != state.target) continue;
    shift_[i] = state.target_shift_mm;
    reflectance_[i] = state.reflectance;
  }
  build();
}

void ModelScene::build() {
  walls_.clear();
  for (std::size_t i = 0; i < bench_.targets.size(); ++i) {
    const fit::Target& target = bench_.targets[i];
    Wall wall;
    wall.outward = target.outward_normal();
    wall.from = target.from_mm + shift_[i] * wall.outward;
    wall.to = target.to_mm + shift_[i] * wall.outward;
    wall.along = (wall.to - wall.from).normalized();
    wall.reflectance = reflectance_[i] >= 0 ? reflectance_[i] : target.reflectance.value_or(0.5);
    walls_.push_back(wall);
  }
  for (std::size_t i = 0; i < walls_.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (shift_[i] == 0 && shift_[j] == 0) join(walls_[i], walls_[j]);
    }
  }
  for (Wall& wall : walls_) wall.length = (wall.to - wall.from).norm();
}

/// Walls whose ends nearly meet form a corner where their lines cross: a bench whose walls were shifted and
/// turned by a fit has neither gaps nor overhangs there.
void ModelScene::join(Wall& one, Wall& other) {
  const double facing = cross(one.along, other.along);
  if (std::abs(facing) < 0.15) return;
  const Eigen::Vector2d corner = one.from + cross(other.from - one.from, other.along) / facing * one.along;
  for (auto [end, joined] : {std::pair{&one.from, &one.joined_from}, std::pair{&one.to, &one.joined_to}}) {
    for (auto [other_end, other_joined] :
         {std::pair{&other.from, &other.joined_from}, std::pair{&other.to, &other.joined_to}}) {
      if ((corner - *end).norm() > meeting_mm || (corner - *other_end).norm() > meeting_mm) continue;
      *end = *other_end = corner;
      *joined = *other_joined = true;
    }
  }
}

ModelScene::Hit ModelScene::cast(const Eigen::Vector2d& origin, double bearing) const {
  const Eigen::Vector2d ray = ray_of(bearing);
  Hit nearest;
  for (std::size_t i = 0; i < walls_.size(); ++i) {
    const Wall& wall = walls_[i];
    const double facing = cross(ray, wall.along);
    if (std::abs(facing) < 1e-9) continue;
    const Eigen::Vector2d to_wall = wall.from - origin;
    const double range = cross(to_wall, wall.along) / facing, place = cross(to_wall, ray) / facing;
    if (range <= 0 || (nearest.target >= 0 && range >= nearest.range_mm)) continue;
    if (place < 0 || place > wall.length) continue;
    nearest = {static_cast<int>(i), range};
  }
  return nearest;
}

double ModelScene::plane_mm(int target, const Eigen::Vector2d& origin, double bearing) const {
  const Wall& wall = walls_[static_cast<std::size_t>(target)];
  const double facing = cross(ray_of(bearing), wall.along);
  if (std::abs(facing) < 0.02) return 0;
  return std::max(0.0, cross(wall.from - origin, wall.along) / facing);
}

std::vector<ModelScene::Edge> ModelScene::edges(const Eigen::Vector2d& origin) const {
  constexpr double aside = 1e-5;
  std::vector<Edge> found;
  for (std::size_t i = 0; i < walls_.size(); ++i) {
    for (const Eigen::Vector2d& end : {walls_[i].from, walls_[i].to}) {
      const Eigen::Vector2d way = end - origin;
      const double bearing = std::atan2(way.y(), way.x());
      const Hit low = cast(origin, bearing - aside), high = cast(origin, bearing + aside);
      if (low.target == high.target) continue;
      const bool near_is_low = low.target >= 0 && (high.target < 0 || low.range_mm < high.range_mm);
      const Hit& near = near_is_low ? low : high;
      const Hit& far = near_is_low ? high : low;
      if (near.target != static_cast<int>(i)) continue;
      if (far.target >= 0 && far.range_mm - near.range_mm < shallow_mm) continue;
      found.push_back({bearing, near.range_mm, far.target < 0 ? 0 : far.range_mm, near_is_low ? -1 : 1,
                       near.target, far.target});
    }
  }
  return found;
}

const ModelScene::Edge* ModelScene::nearest_edge(const std::vector<Edge>& edges, double bearing) const {
  const auto away = [bearing](const Edge& edge) {
    return std::abs(fit::wrap_angle(bearing - edge.bearing_rad));
  };
  const auto nearest = std::ranges::min_element(edges, {}, away);
  return nearest == edges.end() ? nullptr : &*nearest;
}

fit::Circumstances ModelScene::describe(const Eigen::Vector2d& origin, double bearing, const Hit& hit,
                                        const std::vector<Edge>& edges) const {
  const Wall& wall = walls_[static_cast<std::size_t>(hit.target)];
  const Eigen::Vector2d ray = ray_of(bearing);
  fit::Circumstances c;
  c.range_mm = hit.range_mm;
  c.bearing_rad = bearing;
  c.target = hit.target;
  c.normal = wall.outward.dot(ray) >= 0 ? wall.outward : Eigen::Vector2d(-wall.outward);
  c.incidence_rad = std::atan2(cross(c.normal, ray), c.normal.dot(ray));
  c.cos_incidence = std::max(0.02, std::cos(c.incidence_rad));
  c.half_length_mm = wall.length / 2;
  c.along_sign = cross(c.normal, wall.along) >= 0 ? 1 : -1;
  c.along_mm = wall.along.dot(origin + hit.range_mm * ray - wall.from) - wall.length / 2;
  if (wall.joined_from) c.corner_mm = std::min(c.corner_mm, c.half_length_mm + c.along_mm);
  if (wall.joined_to) c.corner_mm = std::min(c.corner_mm, c.half_length_mm - c.along_mm);
  if (const Edge* edge = nearest_edge(edges, bearing)) {
    c.edge_rad = fit::wrap_angle(bearing - edge->bearing_rad) * edge->near_side;
    c.gap_mm = edge->far_mm > 0 ? edge->far_mm - edge->near_mm : 0;
    if (std::abs(c.edge_rad) < 1.2 * fit::rad_per_deg && c.gap_mm > 0) c.pull_mm = pull(origin, bearing, hit);
  }
  return c;
}

double ModelScene::reflectance(int target) const {
  return walls_[static_cast<std::size_t>(target)].reflectance;
}

double ModelScene::cos_incidence(int target, double bearing) const {
  return std::abs(walls_[static_cast<std::size_t>(target)].outward.dot(ray_of(bearing)));
}

double ModelScene::power(const Hit& hit, double bearing) const {
  return reflectance(hit.target) * cos_incidence(hit.target, bearing) * 1e6 / (hit.range_mm * hit.range_mm);
}

/// Stray light of other surfaces within a degree (fit/mechanisms/crosstalk.cpp: a halo of 0.7 deg).
double ModelScene::pull(const Eigen::Vector2d& origin, double bearing, const Hit& own) const {
  constexpr double step = 0.25 * fit::rad_per_deg, halo = 0.7 * fit::rad_per_deg, merged_mm = 500;
  double sum = 0;
  for (const int side : {-4, -3, -2, -1, 1, 2, 3, 4}) {
    const double angle = side * step;
    const Hit other = cast(origin, bearing + angle);
    const double gap = other.range_mm - own.range_mm;
    if (other.target < 0 || other.target == own.target || std::abs(gap) > merged_mm) continue;
    sum += power(other, bearing + angle) / power(own, bearing) * gap / (1 + angle * angle / (halo * halo));
  }
  return sum;
}

}  // namespace sim
