// SPDX-License-Identifier: MIT
#include "sim/simple_engine.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <tuple>

namespace sim {
namespace {

double determinant(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

/// As std::lround does, without its call, for what is at least 0.5 and less than 2^32.
std::uint32_t rounded(double value) { return static_cast<std::uint32_t>(value + 0.5); }

Eigen::Vector2d direction_vector(double angle) { return {std::cos(angle), std::sin(angle)}; }

/// Turns vectors by angles that differ little from one to the next: by series then, to the last digit but
/// one.
class Turning {
 public:
  void turn_to(double angle) {
    double by = angle - reference_;
    if (!(std::abs(by) < furthest)) {
      reference_ = angle;
      at_reference_ = direction_vector(angle);
      by = 0;
    }
    const double square = by * by;
    const double sine = by * (1 - square * (1.0 / 6) * (1 - square * (1.0 / 20) * (1 - square * (1.0 / 42))));
    const double cosine =
        1 - square * 0.5 * (1 - square * (1.0 / 12) * (1 - square * (1.0 / 30) * (1 - square * (1.0 / 56))));
    turn_ = {at_reference_.x() * cosine - at_reference_.y() * sine,
             at_reference_.y() * cosine + at_reference_.x() * sine};
  }
  [[nodiscard]] Eigen::Vector2d operator()(const Eigen::Vector2d& v) const {
    return {turn_.x() * v.x() - turn_.y() * v.y(), turn_.y() * v.x() + turn_.x() * v.y()};
  }

 private:
  static constexpr double furthest = 0.02;
  double reference_ = std::numeric_limits<double>::quiet_NaN();
  Eigen::Vector2d at_reference_ = {1, 0}, turn_ = {1, 0};
};

}  // namespace

SimpleOptions simple_options(const fit::Bench& bench) {
  SimpleOptions options;
  if (const auto* noise = bench.knows("range-noise"); noise && noise->parameters.contains("sigma_mm"))
    options.sigma_mm = noise->parameters.at("sigma_mm").value;
  const auto& sim = bench.document.section("sim");
  options.sigma_mm = sim.value("sigma_mm", options.sigma_mm);
  options.edge_window_rad =
      sim.value("edge_window_deg", options.edge_window_rad * fit::deg_per_rad) * fit::rad_per_deg;
  options.intensity_at_reference = sim.value("intensity_at_reference", options.intensity_at_reference);
  options.intensity_falloff_mm = sim.value("intensity_falloff_mm", options.intensity_falloff_mm);
  options.relative_intensity_noise = sim.value("relative_intensity_noise", options.relative_intensity_noise);
  options.min_range_mm = sim.value("min_range_mm", options.min_range_mm);
  options.max_range_mm = sim.value("max_range_mm", options.max_range_mm);
  return options;
}

SimpleEngine::SimpleEngine(fit::Bench bench, SimpleOptions options, std::uint64_t seed)
    : bench_(std::move(bench)),
      options_(options),
      seed_(seed),
      random_(seed),
      per_falloff_(1 / options.intensity_falloff_mm) {
  for (int step = 0; step < bench_.lidar.steps; ++step)
    beam_rays_.push_back(direction_vector(bench_.lidar.mount.yaw_rad.value + bench_.lidar.beam_angle(step)));
  build_walls();
}

void SimpleEngine::set_scene(const SceneState& scene) {
  changes_[scene.target] = scene;
  build_walls();
}

void SimpleEngine::build_walls() {
  walls_.clear();
  posts_.clear();
  for (const fit::Target& target : bench_.targets) {
    const auto change = changes_.find(target.name);
    Eigen::Vector2d shift = Eigen::Vector2d::Zero();
    double reflectance = target.reflectance.value_or(0.8);
    if (change != changes_.end()) {
      shift = target.outward_normal() * change->second.target_shift_mm;
      if (change->second.reflectance >= 0) reflectance = change->second.reflectance;
    }
    const double brightness = reflectance * (1 + std::pow(200 * per_falloff_, 2));
    if (target.round) {
      posts_.push_back({target.round->centre_mm + shift, target.round->radius_mm, brightness});
      continue;
    }
    const Eigen::Vector2d along = target.to_mm - target.from_mm;
    walls_.push_back({target.from_mm + shift, along, along.norm(), brightness / along.norm()});
  }
  prepared_for_ = std::numeric_limits<double>::quiet_NaN();
}

SimpleEngine::Hit SimpleEngine::cast(const Eigen::Vector2d& origin, double direction, int* surface) const {
  const Eigen::Vector2d ray = direction_vector(direction);
  double nearest = std::numeric_limits<double>::infinity(), brightness = 0, facing_it = 0;
  *surface = -1;
  for (std::size_t i = 0; i < walls_.size(); ++i) {
    const double facing = determinant(ray, walls_[i].along);
    if (std::abs(facing) < 1e-12) continue;
    const Eigen::Vector2d to_wall = walls_[i].from - origin;
    const double range = determinant(to_wall, walls_[i].along) / facing,
                 place = determinant(to_wall, ray) / facing;
    if (range > 0 && range < nearest && place >= 0 && place <= 1) {
      nearest = range, brightness = walls_[i].brightness, facing_it = facing;
      *surface = static_cast<int>(i);
    }
  }
  for (std::size_t i = 0; i < posts_.size(); ++i) {
    const Eigen::Vector2d to_centre = posts_[i].centre - origin;
    const double aside = determinant(ray, to_centre) / posts_[i].radius_mm;
    if (std::abs(aside) >= 1) continue;
    const double cos_incidence = std::sqrt(1 - aside * aside),
                 range = ray.dot(to_centre) - posts_[i].radius_mm * cos_incidence;
    if (range > 0 && range < nearest) {
      nearest = range, brightness = posts_[i].brightness, facing_it = cos_incidence;
      *surface = static_cast<int>(walls_.size() + i);
    }
  }
  return *surface < 0 ? Hit{} : hit(brightness, nearest, facing_it);
}

SimpleEngine::Hit SimpleEngine::hit(double brightness, double range_mm, double facing) const {
  const double over_falloff = range_mm * per_falloff_;
  const double echo = std::abs(facing) * brightness / (1 + over_falloff * over_falloff);
  return {static_cast<float>(range_mm),
          static_cast<float>(options_.intensity_at_reference * std::min(echo, 1.0))};
}

/// Two more rays, half a window to either side, tell whether an edge lies within the window, and a bisection
/// where.
SimpleEngine::BeamHits SimpleEngine::trace(const Eigen::Vector2d& origin, double direction) const {
  const double half = options_.edge_window_rad / 2;
  int middle = -1, left = -1, right = -1;
  BeamHits hits{cast(origin, direction, &middle), {}, 0};
  if (half <= 0) return hits;
  const Hit to_left = cast(origin, direction + half, &left),
            to_right = cast(origin, direction - half, &right);
  if (left == middle && right == middle) return hits;
  const bool edge_on_left = left != middle;
  const int here = middle;
  double inside = 0, outside = edge_on_left ? half : -half;
  for (int i = 0; i < 30; ++i) {
    const double between = (inside + outside) / 2;
    int seen = -1;
    std::ignore = cast(origin, direction + between, &seen);
    (seen == here ? inside : outside) = between;
  }
  hits.back = edge_on_left ? to_left : to_right;
  // At the edge either surface is seen half of the time; half a window away, always the same one.
  hits.back_probability =
      static_cast<float>(std::clamp(0.5 - std::abs(inside) / options_.edge_window_rad, 0.0, 0.5));
  return hits;
}

void SimpleEngine::prepare(double stage_rad) {
  if (stage_rad == prepared_for_) return;
  const fit::LidarGeometry& lidar = bench_.lidar;
  const Eigen::Vector2d origin =
      Eigen::Rotation2Dd(stage_rad) * Eigen::Vector2d(lidar.mount.x_mm.value, lidar.mount.y_mm.value);
  beam_hits_.resize(static_cast<std::size_t>(lidar.steps));
  for (int step = 0; step < lidar.steps; ++step)
    beam_hits_[static_cast<std::size_t>(step)] =
        trace(origin, stage_rad + lidar.mount.yaw_rad.value + lidar.beam_angle(step));
  prepared_for_ = stage_rad;
}

inline std::uint32_t SimpleEngine::measure(const BeamHits& hits, Random& random,
                                           std::uint32_t& intensity) const {
  const bool back =
      hits.back_probability > 0 && random.uniform() < static_cast<double>(hits.back_probability);
  const Hit& hit = back ? hits.back : hits.front;
  intensity = 0;
  if (hit.range_mm <= 0 || static_cast<double>(hit.range_mm) > options_.max_range_mm) return no_echo;
  const double range = static_cast<double>(hit.range_mm) + options_.sigma_mm * random.normal();
  const double counts =
      static_cast<double>(hit.intensity) * (1 + options_.relative_intensity_noise * random.normal());
  intensity = rounded(std::clamp(counts, 1.0, 65535.0));
  if (range < options_.min_range_mm) return too_near;
  return rounded(std::max(range, 0.0));
}

void SimpleEngine::scan(double scan_s, const std::function<StageMoment(double)>& stage_at,
                        std::span<std::uint32_t> range_mm, std::span<std::uint32_t> intensity) {
  const fit::LidarGeometry& lidar = bench_.lidar;
  const StageMoment start = stage_at(scan_s), end = stage_at(scan_s + lidar.beam_time_s(lidar.steps));
  if (options_.repeatable) {
    const auto place = static_cast<std::uint64_t>(std::llround(start.angle_rad * 1e7));
    random_ = Random(seed_ ^ place * 0x9e3779b97f4a7c15 ^ ++scan_in_stream_ * 0xbf58476d1ce4e5b9);
  }
  if (start.angle_rad == end.angle_rad)
    prepare(start.angle_rad);
  else
    prepare_turning(scan_s, stage_at);
  Random random = random_;  // a copy of one's own stays in registers
  for (std::size_t i = 0; i < range_mm.size(); ++i)
    range_mm[i] = measure(beam_hits_[i], random, intensity[i]);
  random_ = random;
}

// --- a turning stage ---------------------------------------------------------------------------------------

SimpleEngine::Aspect SimpleEngine::aspect(const Fan& fan, const Wall& wall) {
  const Eigen::Vector2d to_wall = wall.from - fan.origin;
  const double depth = determinant(to_wall, wall.along), side = determinant(to_wall, fan.ray),
               facing = determinant(fan.ray, wall.along);
  const double distance = std::abs(to_wall.x()) + std::abs(to_wall.y()) + fan.shift_mm;
  const double sign = depth < 0 ? -1 : 1;
  return {sign * depth,
          sign * side,
          sign * facing,
          fan.shift_mm * wall.length,
          fan.shift_mm + distance * fan.spread_rad,
          wall.length * fan.spread_rad};
}

bool SimpleEngine::Aspect::may_meet() const {
  const bool in_front =
      facing > -doubt_facing && side >= -doubt_side && side <= facing + doubt_facing + doubt_side;
  if (depth > doubt_depth) return in_front;
  // The origin may lie on either side of the wall.
  return in_front ||
         (facing < doubt_facing && side <= doubt_side && side >= facing - doubt_facing - doubt_side);
}

bool SimpleEngine::Aspect::all_meet() const {
  return depth > doubt_depth && facing > doubt_facing && side > doubt_side &&
         side < facing - doubt_facing - doubt_side;
}

/// Where both are met, this one is farther away.
bool SimpleEngine::Aspect::all_behind(const Aspect& other) const {
  return (depth - doubt_depth) * (other.facing - other.doubt_facing) >
         (other.depth + other.doubt_depth) * (facing + doubt_facing);
}

void SimpleEngine::find_candidates(const Fan& fan) {
  candidates_.clear();
  for (const Wall& wall : walls_)
    if (aspect(fan, wall).may_meet()) candidates_.push_back(&wall);
  post_near_ = std::ranges::any_of(posts_, [&](const Post& post) { return may_meet(fan, post); });
}

bool SimpleEngine::may_meet(const Fan& fan, const Post& post) {
  const Eigen::Vector2d to_centre = post.centre - fan.origin;
  return std::abs(determinant(fan.ray, to_centre)) <=
         post.radius_mm + fan.shift_mm + fan.spread_rad * (to_centre.lpNorm<1>() + fan.shift_mm);
}

/// What all rays of the fan see alike, from the middle one; nothing when they do not, or it takes a closer
/// look to tell.
std::optional<SimpleEngine::Hit> SimpleEngine::trace_away_from_edges(const Fan& fan) const {
  if (post_near_) return std::nullopt;
  const Wall* met = nullptr;
  Aspect of_met{};
  for (const Wall* wall : candidates_) {
    const Aspect now = aspect(fan, *wall);
    if (!now.may_meet() || (met && now.all_behind(of_met))) continue;
    if (!now.all_meet() || (met && !of_met.all_behind(now))) return std::nullopt;
    met = wall;
    of_met = now;
  }
  if (!met) return Hit{};
  return hit(met->brightness, of_met.depth / of_met.facing, of_met.facing);
}

/// Every beam is fired from where the stage is at that beam's own time. Few walls are near the direction of a
/// few neighbouring beams, and few beams near an edge: the others need one ray.
void SimpleEngine::prepare_turning(double scan_s, const std::function<StageMoment(double)>& stage_at) {
  constexpr std::size_t together = 32;
  const fit::LidarGeometry& lidar = bench_.lidar;
  const Eigen::Vector2d mount(lidar.mount.x_mm.value, lidar.mount.y_mm.value);
  const double half_window = std::max(0.0, options_.edge_window_rad / 2) + 1e-9;
  beam_hits_.resize(beam_rays_.size());
  prepared_for_ = std::numeric_limits<double>::quiet_NaN();
  Turning turning;
  for (std::size_t begin = 0; begin < beam_hits_.size(); begin += together) {
    const std::size_t count = std::min(together, beam_hits_.size() - begin);
    double stage[together];
    for (std::size_t i = 0; i < count; ++i)
      stage[i] = stage_at(scan_s + lidar.beam_time_s(static_cast<double>(begin + i))).angle_rad;
    const auto [least, most] = std::minmax_element(stage, stage + count);
    const double turned = *most - *least;
    turning.turn_to(stage[0]);
    find_candidates({turning(mount), turning(beam_rays_[begin + count / 2]),
                     static_cast<double>(together / 2) * std::abs(lidar.step_rad) + turned + half_window,
                     mount.lpNorm<1>() * turned});
    for (std::size_t i = 0; i < count; ++i) {
      turning.turn_to(stage[i]);
      const Eigen::Vector2d origin = turning(mount);
      const auto plain = trace_away_from_edges({origin, turning(beam_rays_[begin + i]), half_window, 0});
      beam_hits_[begin + i] = plain ? BeamHits{*plain, {}, 0}
                                    : trace(origin, stage[i] + lidar.mount.yaw_rad.value +
                                                        lidar.beam_angle(static_cast<double>(begin + i)));
    }
  }
}

}  // namespace sim
