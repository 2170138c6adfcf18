// SPDX-License-Identifier: MIT
#include "fit/explain/scene/scene.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fit::explain {
namespace {

Eigen::Vector2d turned(const Eigen::Vector2d& v, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * v.x() - s * v.y(), s * v.x() + c * v.y()};
}

Eigen::Vector2d quarter(const Eigen::Vector2d& v) { return {-v.y(), v.x()}; }

}  // namespace

Effect effect_of(const std::vector<Active>& at_work, const Circumstances& at) {
  Effect sum;
  for (const Active& active : at_work) {
    if (active.mechanism->displaces || (active.target >= 0 && active.target != at.target)) continue;
    // What depends on something that the recording does not say (an intensity, a temperature) says nothing.
    const Effect one = active.mechanism->act(at, active.values);
    if (std::isfinite(one.range_mm + one.beam_rad + one.stage_rad + one.origin_mm.sum() + one.variance_mm2))
      sum += one;
  }
  return sum;
}

double reflectance_in(const CaptureInfo& capture, const Target& target) {
  const bool about_it = capture.target && *capture.target == target.name;
  return about_it && capture.reflectance ? *capture.reflectance : target.reflectance.value_or(0.5);
}

std::vector<Freedom> freedoms_of(const Bench& bench) {
  const Mount& mount = bench.lidar.mount;
  std::vector<Freedom> list{{"x", false, mount.x_mm.u, &Nuisance::x_mm},
                            {"y", false, mount.y_mm.u, &Nuisance::y_mm},
                            {"yaw", true, mount.yaw_rad.u, &Nuisance::yaw_rad}};
  for (int i = 0; i < static_cast<int>(bench.targets.size()); ++i) {
    const Target& t = bench.target_at(i);
    const auto add = [&](const char* in_words, bool is_angle, double u, double Displacement::*value,
                         double Hit::*per) {
      list.push_back({in_words, is_angle, u, {}, i, value, per});
    };
    add("offset", false, t.u_mm, &Displacement::out_mm, &Hit::per_out);
    if (t.round) {
      add("offset aside", false, t.u_mm, &Displacement::aside_mm, &Hit::per_aside);
      add("radius", false, t.round->u_radius_mm, &Displacement::thicker_mm, &Hit::per_thicker);
    } else {
      add("orientation", true, t.u_rad, &Displacement::turn_rad, &Hit::per_turn);
    }
  }
  return list;
}

Nuisance::Nuisance(const Bench& bench)
    : x_mm(bench.lidar.mount.x_mm.value),
      y_mm(bench.lidar.mount.y_mm.value),
      yaw_rad(bench.lidar.mount.yaw_rad.value),
      targets(bench.targets.size()),
      freedoms_(freedoms_of(bench)) {}

double& Nuisance::value(const Freedom& freedom) {
  return freedom.of_mount ? this->*freedom.of_mount
                          : targets[static_cast<std::size_t>(freedom.target)].*freedom.of_target;
}

Eigen::VectorXd Nuisance::as_vector() const {
  Nuisance own = *this;
  Eigen::VectorXd v(static_cast<Eigen::Index>(freedoms_.size()));
  std::ranges::transform(freedoms_, v.begin(), [&](const Freedom& freedom) { return own.value(freedom); });
  return v;
}

void Nuisance::set(const Eigen::VectorXd& values) {
  const double* next = values.data();
  for (const Freedom& freedom : freedoms_) value(freedom) = *next++;
}

Eigen::VectorXd Nuisance::prior_sigma(const Bench& bench) {
  const std::vector<Freedom> freedoms = freedoms_of(bench);
  Eigen::VectorXd v(static_cast<Eigen::Index>(freedoms.size()));
  std::ranges::transform(freedoms, v.begin(), &Freedom::u);
  return v;
}

double Sight::per(const Freedom& freedom, double stage_rad) const {
  if (!freedom.of_mount) return freedom.target == target ? this->*freedom.per : 0;
  const double c = std::cos(stage_rad), s = std::sin(stage_rad);
  if (freedom.of_mount == &Nuisance::x_mm) return -(normal.x() * c + normal.y() * s) / cosine;
  if (freedom.of_mount == &Nuisance::y_mm) return -(-normal.x() * s + normal.y() * c) / cosine;
  return beam_sensitivity_mm;
}

double Sight::shift(const Effect& effect) const {
  return effect.range_mm + beam_sensitivity() * effect.beam_rad + stage_sensitivity() * effect.stage_rad -
         normal.dot(effect.origin_mm) / cos_incidence();
}

namespace {

std::vector<Stands> stands_in(const Bench& bench, const Nuisance& nuisance, const CaptureInfo& capture,
                              const Absent& absent) {
  std::vector<Stands> list(bench.targets.size());
  for (std::size_t i = 0; i < list.size(); ++i) {
    const Target& target = bench.targets[i];
    Stands& s = list[i];
    static_cast<Displacement&>(s) = nuisance.targets[i];
    const bool about_it = capture.target && *capture.target == target.name;
    s.moved = about_it && capture.target_shift_mm != 0;
    if (about_it) s.out_mm += capture.target_shift_mm;
    s.reflectance = reflectance_in(capture, target);
    s.absent = absent.contains(static_cast<int>(i));
  }
  return list;
}

}  // namespace

Scene::Scene(const Bench& bench, const Nuisance& nuisance, const CaptureInfo& capture, const Absent& absent)
    : fit::Scene(bench, stands_in(bench, nuisance, capture, absent)),
      x_mm_(nuisance.x_mm),
      y_mm_(nuisance.y_mm),
      yaw_rad_(nuisance.yaw_rad) {}

Sight Scene::aim(double stage_rad, double beam_rad, const Effect& effect) const {
  const double stage = stage_rad + effect.stage_rad;
  Sight sight;
  sight.origin = turned({x_mm_, y_mm_}, stage) + effect.origin_mm;
  sight.bearing_rad = stage + yaw_rad_ + beam_rad + effect.beam_rad;
  return sight;
}

namespace {

Sight met(Sight sight, const Hit& hit) {
  static_cast<Hit&>(sight) = hit;
  if (hit.target < 0) return sight;
  sight.beam_sensitivity_mm = sight.range_mm * std::tan(sight.incidence_rad);
  sight.stage_sensitivity_mm =
      sight.beam_sensitivity_mm - sight.normal.dot(quarter(sight.origin)) / sight.cosine;
  return sight;
}

}  // namespace

Sight Scene::look(double stage_rad, double beam_rad, const Effect& effect) const {
  const Sight sight = aim(stage_rad, beam_rad, effect);
  return met(sight, fit::Scene::look(sight.origin, sight.bearing_rad));
}

Sight Scene::look_at(int target, double stage_rad, double beam_rad, const Effect& effect) const {
  const Sight sight = aim(stage_rad, beam_rad, effect);
  return met(sight, fit::Scene::look_at(target, sight.origin, sight.bearing_rad));
}

std::vector<Edge> Scene::edges(double stage_rad, const Effect& effect) const {
  return fit::Scene::edges(aim(stage_rad, 0, effect).origin);
}

void Scene::describe(const Sight& sight, const std::vector<Edge>& edges, Circumstances& c) const {
  fit::Scene::describe(sight.origin, sight.bearing_rad, sight, edges, c);
}

}  // namespace fit::explain
