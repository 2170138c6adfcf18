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

constexpr std::uint32_t too_near = 4, no_echo = 65533;

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

/// As std::lround does, without its call, for what is at least 0.5 and less than 2^32.
std::uint32_t rounded(double value) { return static_cast<std::uint32_t>(value + 0.5); }

Eigen::Vector2d direction_vector(double angle) { return {std::cos(angle), std::sin(angle)}; }

}  // namespace

SimpleOptions simple_options(const fit::Bench& bench) {
  SimpleOptions options;
  if (const auto* noise = bench.knows("range-noise"); noise && noise->parameters.contains("sigma_mm"))
    options.sigma_mm = noise->parameters.at("sigma_mm").value;
  const auto document = nlohmann::json::parse(bench.document, nullptr, false);
  if (!document.is_object() || !document.contains("sim")) return options;
  const auto& sim = document.at("sim");
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
    : bench_(std::move(bench)), options_(options), seed_(seed), random_(seed) {
  build_walls();
}

void SimpleEngine::set_scene(const SceneState& scene) {
  changes_[scene.target] = scene;
  build_walls();
}

void SimpleEngine::build_walls() {
  walls_.clear();
  for (const fit::Target& target : bench_.targets) {
    const auto change = changes_.find(target.name);
    Eigen::Vector2d shift = Eigen::Vector2d::Zero();
    double reflectance = target.reflectance.value_or(0.8);
    if (change != changes_.end()) {
      shift = target.outward_normal() * change->second.target_shift_mm;
      if (change->second.reflectance >= 0) reflectance = change->second.reflectance;
    }
    walls_.push_back({target.from_mm + shift, target.to_mm - target.from_mm, reflectance});
  }
  prepared_for_ = std::numeric_limits<double>::quiet_NaN();
}

SimpleEngine::Hit SimpleEngine::cast(const Eigen::Vector2d& origin, double direction, int* wall) const {
  const Eigen::Vector2d ray = direction_vector(direction);
  double nearest = std::numeric_limits<double>::infinity();
  int found = -1;
  for (std::size_t i = 0; i < walls_.size(); ++i) {
    const double facing = cross(ray, walls_[i].along);
    if (std::abs(facing) < 1e-12) continue;
    const Eigen::Vector2d to_wall = walls_[i].from - origin;
    const double range = cross(to_wall, walls_[i].along) / facing, place = cross(to_wall, ray) / facing;
    if (range > 0 && range < nearest && place >= 0 && place <= 1) {
      nearest = range;
      found = static_cast<int>(i);
    }
  }
  if (wall) *wall = found;
  if (found < 0) return {};
  const Wall& hit = walls_[static_cast<std::size_t>(found)];
  const double incidence_cosine = std::abs(cross(ray, hit.along)) / hit.along.norm();
  const double falloff = 1 / (1 + std::pow(nearest / options_.intensity_falloff_mm, 2));
  const double reference = 1 / (1 + std::pow(200 / options_.intensity_falloff_mm, 2));
  const double echo = hit.reflectance * incidence_cosine * falloff / reference;
  return {static_cast<float>(nearest),
          static_cast<float>(options_.intensity_at_reference * std::min(echo, 1.0))};
}

/// Two more rays, half a window to either side, tell whether an edge lies within the window, and a bisection
/// where.
SimpleEngine::Sight SimpleEngine::look(const Eigen::Vector2d& origin, double direction) const {
  const double half = options_.edge_window_rad / 2;
  int middle = -1, left = -1, right = -1;
  Sight sight{cast(origin, direction, &middle), {}, 0};
  if (half <= 0) return sight;
  const Hit to_left = cast(origin, direction + half, &left),
            to_right = cast(origin, direction - half, &right);
  if (left == middle && right == middle) return sight;
  const bool edge_on_left = left != middle;
  const int here = middle;
  double inside = 0, outside = edge_on_left ? half : -half;
  for (int i = 0; i < 30; ++i) {
    const double between = (inside + outside) / 2;
    int seen = -1;
    std::ignore = cast(origin, direction + between, &seen);
    (seen == here ? inside : outside) = between;
  }
  sight.back = edge_on_left ? to_left : to_right;
  // At the edge either surface is seen half of the time; half a window away, always the same one.
  sight.back_probability =
      static_cast<float>(std::clamp(0.5 - std::abs(inside) / options_.edge_window_rad, 0.0, 0.5));
  return sight;
}

void SimpleEngine::prepare(double stage_rad) {
  if (stage_rad == prepared_for_) return;
  const fit::LidarGeometry& lidar = bench_.lidar;
  const Eigen::Vector2d origin =
      Eigen::Rotation2Dd(stage_rad) * Eigen::Vector2d(lidar.mount.x_mm.value, lidar.mount.y_mm.value);
  sights_.resize(static_cast<std::size_t>(lidar.steps));
  for (int step = 0; step < lidar.steps; ++step)
    sights_[static_cast<std::size_t>(step)] =
        look(origin, stage_rad + lidar.mount.yaw_rad.value + lidar.beam_angle(step));
  prepared_for_ = stage_rad;
}

inline std::uint32_t SimpleEngine::measure(const Sight& sight, Random& random,
                                           std::uint32_t& intensity) const {
  const bool back =
      sight.back_probability > 0 && random.uniform() < static_cast<double>(sight.back_probability);
  const Hit& hit = back ? sight.back : sight.front;
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
  if (start.angle_rad == end.angle_rad) {
    prepare(start.angle_rad);
    Random random = random_;  // a copy of one's own stays in registers
    for (std::size_t i = 0; i < range_mm.size(); ++i) range_mm[i] = measure(sights_[i], random, intensity[i]);
    random_ = random;
    return;
  }
  // The stage turns: every beam is fired from where the stage is at that beam's own time.
  for (std::size_t i = 0; i < range_mm.size(); ++i) {
    const double stage = stage_at(scan_s + lidar.beam_time_s(static_cast<double>(i))).angle_rad;
    const Eigen::Vector2d origin =
        Eigen::Rotation2Dd(stage) * Eigen::Vector2d(lidar.mount.x_mm.value, lidar.mount.y_mm.value);
    const Sight sight =
        look(origin, stage + lidar.mount.yaw_rad.value + lidar.beam_angle(static_cast<double>(i)));
    range_mm[i] = measure(sight, random_, intensity[i]);
  }
}

}  // namespace sim
