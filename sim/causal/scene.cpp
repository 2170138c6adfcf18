// SPDX-License-Identifier: MIT
#include "sim/causal/scene.hpp"

#include <cmath>

namespace sim::causal {

Scene::Scene(const World& world)
    : world_(world), shift_(world.bench.targets.size(), 0), reflectance_(world.bench.targets.size(), -1) {
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

void Scene::build() {
  surfaces_.clear();
  materials_.clear();
  for (std::size_t i = 0; i < world_.bench.targets.size(); ++i) {
    const fit::Target& stated = world_.bench.targets[i];
    const auto found = world_.targets.find(stated.name);
    const TargetTruth truth = found == world_.targets.end() ? TargetTruth{} : found->second;
    double reflectance = stated.reflectance.value_or(0.5);
    if (truth.reflectance >= 0) reflectance = truth.reflectance;
    if (reflectance_[i] >= 0) reflectance = reflectance_[i];
    materials_.push_back({reflectance, std::tan(truth.plumb_rad), truth.gloss, truth.specular,
                          truth.specular_width_rad, truth.stripes,
                          Pulse(world_.pulse.shape, world_.pulse.rise_ns, truth.depth_mm / light_mm_per_ns)});

    const Eigen::Vector2d outward = stated.outward_normal();
    const Eigen::Vector2d chord = stated.to_mm - stated.from_mm;
    const double length = chord.norm(), angle = std::atan2(chord.y(), chord.x()) + truth.tilt_rad;
    const Eigen::Vector2d along(std::cos(angle), std::sin(angle));
    const Eigen::Vector2d middle =
        (stated.from_mm + stated.to_mm) / 2 + (shift_[i] + truth.offset_mm) * outward;
    const int pieces = truth.sagitta_mm == 0 ? 1 : 16;
    const auto bent = [&](double x) -> Eigen::Vector2d {
      const double u = 2 * x / length;
      return middle + x * along + truth.sagitta_mm * (1 - u * u) * outward;
    };
    for (int piece = 0; piece < pieces; ++piece) {
      const double x0 = -length / 2 + length * piece / pieces,
                   x1 = -length / 2 + length * (piece + 1) / pieces;
      Surface surface;
      surface.from = bent(x0);
      const Eigen::Vector2d to = bent(x1);
      surface.length = (to - surface.from).norm();
      surface.along = (to - surface.from) / surface.length;
      surface.normal = Eigen::Vector2d(-surface.along.y(), surface.along.x());
      surface.offset = surface.normal.dot(surface.from);
      surface.start_mm = x0;
      surface.material = i;
      surfaces_.push_back(surface);
    }
  }
}

Hit Scene::trace(const Eigen::Vector2d& origin, const Eigen::Vector2d& ray, int except) const {
  Hit hit;
  for (std::size_t i = 0; i < surfaces_.size(); ++i) {
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
