// SPDX-License-Identifier: MIT
#include "fit/explain/scene/scene.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

namespace fit::explain {
namespace {

Eigen::Vector2d turned(const Eigen::Vector2d& v, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * v.x() - s * v.y(), s * v.x() + c * v.y()};
}

Eigen::Vector2d quarter(const Eigen::Vector2d& v) { return {-v.y(), v.x()}; }

/// What the numbers of the mount and of targets are, in the order of Freedom::Of.
struct MountRow {
  const char* in_words;
  double Nuisance::*value;
  Estimate Mount::*stated;
};
constexpr MountRow mount_rows[] = {{"x", &Nuisance::x_mm, &Mount::x_mm},
                                   {"y", &Nuisance::y_mm, &Mount::y_mm},
                                   {"yaw", &Nuisance::yaw_rad, &Mount::yaw_rad}};
const MountRow& mount_row(const Freedom& freedom) { return mount_rows[static_cast<std::size_t>(freedom.of)]; }

struct TargetRow {
  const char* in_words;
  std::vector<double> Nuisance::*value;
  double Target::*u;  ///< Null: of the round shape.
  double Hit::*per;
};
constexpr TargetRow target_rows[] = {{"offset", &Nuisance::offset_mm, &Target::u_mm, &Hit::per_out},
                                     {"orientation", &Nuisance::turn_rad, &Target::u_rad, &Hit::per_turn},
                                     {"offset aside", &Nuisance::aside_mm, &Target::u_mm, &Hit::per_aside},
                                     {"radius", &Nuisance::thicker_mm, nullptr, &Hit::per_thicker}};
const TargetRow& target_row(const Freedom& freedom) {
  return target_rows[static_cast<std::size_t>(freedom.of) - std::size(mount_rows)];
}

}  // namespace

const char* Freedom::in_words() const {
  return target < 0 ? mount_row(*this).in_words : target_row(*this).in_words;
}

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
  using Of = Freedom::Of;
  std::vector<Freedom> list{{Of::mount_x}, {Of::mount_y}, {Of::mount_yaw}};
  for (std::size_t i = 0; i < bench.targets.size(); ++i) {
    const auto target = static_cast<int>(i);
    list.push_back({Of::offset, target});
    if (bench.targets[i].round) {
      list.push_back({Of::aside, target});
      list.push_back({Of::radius, target});
    } else {
      list.push_back({Of::turn, target});
    }
  }
  return list;
}

Nuisance::Nuisance(const Bench& bench)
    : x_mm(bench.lidar.mount.x_mm.value),
      y_mm(bench.lidar.mount.y_mm.value),
      yaw_rad(bench.lidar.mount.yaw_rad.value),
      offset_mm(bench.targets.size(), 0.0),
      turn_rad(bench.targets.size(), 0.0),
      aside_mm(bench.targets.size(), 0.0),
      thicker_mm(bench.targets.size(), 0.0),
      freedoms_(freedoms_of(bench)) {}

double& Nuisance::value(const Freedom& freedom) {
  return freedom.target < 0 ? this->*mount_row(freedom).value
                            : (this->*target_row(freedom).value)[static_cast<std::size_t>(freedom.target)];
}

Eigen::VectorXd Nuisance::as_vector() const {
  Nuisance own = *this;
  Eigen::VectorXd v(static_cast<Eigen::Index>(freedoms_.size()));
  for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = own.value(freedoms_[static_cast<std::size_t>(i)]);
  return v;
}

void Nuisance::set(const Eigen::VectorXd& v) {
  for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(freedoms_.size()); ++i)
    value(freedoms_[static_cast<std::size_t>(i)]) = v[i];
}

Eigen::VectorXd Nuisance::prior_sigma(const Bench& bench) {
  const std::vector<Freedom> freedoms = freedoms_of(bench);
  Eigen::VectorXd v(static_cast<Eigen::Index>(freedoms.size()));
  for (std::size_t i = 0; i < freedoms.size(); ++i) {
    const Freedom& freedom = freedoms[i];
    double& u = v[static_cast<Eigen::Index>(i)];
    if (freedom.target < 0) {
      u = (bench.lidar.mount.*mount_row(freedom).stated).u;
      continue;
    }
    const Target& target = bench.target_at(freedom.target);
    u = freedom.of == Freedom::Of::radius ? target.round->u_radius_mm : target.*target_row(freedom).u;
  }
  return v;
}

double Sight::per(const Freedom& freedom, double stage_rad) const {
  if (freedom.target >= 0) return freedom.target == target ? this->*target_row(freedom).per : 0;
  const double c = std::cos(stage_rad), s = std::sin(stage_rad);
  switch (freedom.of) {
    case Freedom::Of::mount_x:
      return -(normal.x() * c + normal.y() * s) / cosine;
    case Freedom::Of::mount_y:
      return -(-normal.x() * s + normal.y() * c) / cosine;
    default:
      return beam_lever_mm;
  }
}

double Sight::shift(const Effect& effect) const {
  return effect.range_mm + beam_lever() * effect.beam_rad + stage_lever() * effect.stage_rad -
         normal.dot(effect.origin_mm) / cos_incidence();
}

namespace {

std::vector<Stands> stands_in(const Bench& bench, const Nuisance& nuisance, const CaptureInfo& capture,
                              const Absent& absent) {
  std::vector<Stands> list(bench.targets.size());
  for (std::size_t i = 0; i < list.size(); ++i) {
    const Target& target = bench.targets[i];
    Stands& s = list[i];
    const bool about_it = capture.target && *capture.target == target.name;
    s.moved = about_it && capture.target_shift_mm != 0;
    s.out_mm = nuisance.offset_mm[i] + (about_it ? capture.target_shift_mm : 0);
    s.turn_rad = nuisance.turn_rad[i];
    s.aside_mm = nuisance.aside_mm[i];
    s.thicker_mm = nuisance.thicker_mm[i];
    s.reflectance = reflectance_in(capture, target);
    s.absent = absent.contains(static_cast<int>(i));
  }
  return list;
}

}  // namespace

Scene::Scene(const Bench& bench, const Nuisance& nuisance, const CaptureInfo& capture, const Absent& absent)
    : x_mm_(nuisance.x_mm),
      y_mm_(nuisance.y_mm),
      yaw_rad_(nuisance.yaw_rad),
      scene_(bench, stands_in(bench, nuisance, capture, absent)) {}

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
  sight.beam_lever_mm = sight.range_mm * std::tan(sight.incidence_rad);
  sight.stage_lever_mm = sight.beam_lever_mm - sight.normal.dot(quarter(sight.origin)) / sight.cosine;
  return sight;
}

}  // namespace

Sight Scene::look(double stage_rad, double beam_rad, const Effect& effect) const {
  const Sight sight = aim(stage_rad, beam_rad, effect);
  return met(sight, scene_.look(sight.origin, sight.bearing_rad));
}

Sight Scene::look_at(int target, double stage_rad, double beam_rad, const Effect& effect) const {
  const Sight sight = aim(stage_rad, beam_rad, effect);
  return met(sight, scene_.look_at(target, sight.origin, sight.bearing_rad));
}

std::vector<Edge> Scene::edges(double stage_rad, const Effect& effect) const {
  return scene_.edges(aim(stage_rad, 0, effect).origin);
}

void Scene::describe(const Sight& sight, const std::vector<Edge>& edges, Circumstances& c) const {
  scene_.describe(sight.origin, sight.bearing_rad, sight, edges, c);
}

}  // namespace fit::explain
