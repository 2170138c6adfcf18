// SPDX-License-Identifier: MIT
#include "sim/causal/scene.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

namespace sim::causal {

Scene::Scene(const World& world)
    : world_(world),
      shift_(world.bench.targets.size(), 0),
      reflectance_(world.bench.targets.size(), -1),
      moved_(world.bench.targets.size()) {
  build();
}

void Scene::set(const SceneState& state) {
  for (std::size_t i = 0; i < world_.bench.targets.size(); ++i) {
    if (world_.bench.targets[i].name != state.target) continue;
    shift_[i] = state.target_shift_mm;
    reflectance_[i] = state.reflectance;
  }
  build();
}

/// Flat pieces of a round target, which are as far from its middle as the round is on average; from its far
/// side round to it again.
std::vector<Eigen::Vector2d> Scene::corners_of(const fit::RoundShape& round, const Eigen::Vector2d& outward) {
  constexpr int pieces = 128;  // within 1e-4 of the radius
  constexpr double half = fit::pi / pieces;
  const double corner_mm = round.radius_mm / (1 - half * half / 3);
  std::vector<Eigen::Vector2d> corners;
  for (int k = 0; k <= pieces; ++k)
    corners.emplace_back(round.centre_mm + corner_mm * (Eigen::Rotation2Dd(2 * half * k) * outward));
  return corners;
}

void Scene::add_pieces(const std::vector<Eigen::Vector2d>& corners, double start_mm, std::size_t material) {
  for (std::size_t k = 0; k + 1 < corners.size(); ++k) {
    Surface surface;
    surface.from = corners[k];
    surface.length = (corners[k + 1] - corners[k]).norm();
    surface.along = (corners[k + 1] - corners[k]) / surface.length;
    surface.normal = Eigen::Vector2d(-surface.along.y(), surface.along.x());
    surface.offset = surface.normal.dot(surface.from);
    surface.start_mm = start_mm;
    surface.material = material;
    surfaces_.push_back(surface);
    start_mm += surface.length;
  }
}

void Scene::at(double since_power_on_s) {
  std::vector<bool> moved;
  for (const fit::Target& target : world_.bench.targets) {
    const auto truth = world_.targets.find(target.name);
    moved.push_back(truth != world_.targets.end() && since_power_on_s >= truth->second.moved.from_s &&
                    since_power_on_s <= truth->second.moved.to_s);
  }
  if (moved == moved_) return;
  moved_ = std::move(moved);
  build();
}

void Scene::build() {
  surfaces_.clear();
  bodies_.clear();
  materials_.clear();
  for (std::size_t i = 0; i < world_.bench.targets.size(); ++i) {
    const fit::Target& stated = world_.bench.targets[i];
    const auto found = world_.targets.find(stated.name);
    TargetTruth truth = found == world_.targets.end() ? TargetTruth{} : found->second;
    if (moved_[i]) {
      truth.offset_mm += truth.moved.offset_mm;
      truth.aside_mm += truth.moved.aside_mm;
      truth.tilt_rad += truth.moved.turn_rad;
    }
    double reflectance = stated.reflectance.value_or(0.5);
    if (truth.reflectance >= 0) reflectance = truth.reflectance;
    if (reflectance_[i] >= 0) reflectance = reflectance_[i];
    materials_.push_back({reflectance, std::tan(truth.plumb_rad), truth.gloss, truth.specular,
                          truth.specular_width_rad, truth.stripes,
                          Pulse(world_.pulse.shape, world_.pulse.rise_ns, truth.depth_mm / light_mm_per_ns)});

    const Eigen::Vector2d outward = stated.outward_normal(), moved = (shift_[i] + truth.offset_mm) * outward;
    Body body{surfaces_.size(), 0, (stated.from_mm + stated.to_mm) / 2 + moved,
              std::numeric_limits<double>::infinity()};
    if (stated.round) {
      const double radius_mm = std::max(1.0, stated.round->radius_mm + truth.thicker_mm);
      body.middle =
          stated.round->centre_mm + moved + truth.aside_mm * Eigen::Vector2d(-outward.y(), outward.x());
      body.reach_mm = 1.01 * radius_mm;
      add_pieces(corners_of({body.middle, radius_mm}, outward), -fit::pi * radius_mm, i);
    } else {
      const Eigen::Vector2d chord = stated.to_mm - stated.from_mm;
      const double length = chord.norm(), angle = std::atan2(chord.y(), chord.x()) + truth.tilt_rad;
      const Eigen::Vector2d along(std::cos(angle), std::sin(angle));
      const int pieces = truth.sagitta_mm == 0 ? 1 : 16;
      std::vector<Eigen::Vector2d> corners;
      for (int piece = 0; piece <= pieces; ++piece) {
        const double u = 2.0 * piece / pieces - 1;
        corners.emplace_back(body.middle + u * length / 2 * along + truth.sagitta_mm * (1 - u * u) * outward);
      }
      add_pieces(corners, -length / 2, i);
    }
    body.last = surfaces_.size();
    bodies_.push_back(body);
  }
}

Hit Scene::trace(const Eigen::Vector2d& origin, const Eigen::Vector2d& ray, int except) const {
  Hit hit;
  for (const Body& body : bodies_) {
    const Eigen::Vector2d to_middle = body.middle - origin;
    if (std::abs(ray.x() * to_middle.y() - ray.y() * to_middle.x()) > body.reach_mm) continue;
    for (std::size_t i = body.first; i < body.last; ++i) {
      const Surface& surface = surfaces_[i];
      const double facing = surface.normal.dot(ray);
      const double ahead = surface.offset - surface.normal.dot(origin);
      if (ahead * facing <= 0 || static_cast<int>(i) == except) continue;
      const double range = ahead / facing;
      if (range >= hit.range) continue;
      const double place = surface.along.dot(origin + range * ray - surface.from);
      if (place < 0 || place > surface.length) continue;
      hit = {static_cast<int>(i), range};
    }
  }
  return hit;
}

double Scene::reflectance(const Surface& surface, double place) const {
  const Material& made = materials_[surface.material];
  const double x = surface.start_mm + place;
  for (const TargetTruth::Stripe& stripe : made.stripes) {
    if (x >= stripe.from_mm && x < stripe.to_mm) return stripe.reflectance;
  }
  return made.reflectance;
}

}  // namespace sim::causal
