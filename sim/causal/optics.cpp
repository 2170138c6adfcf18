// SPDX-License-Identifier: MIT
#include "sim/causal/optics.hpp"

#include <algorithm>
#include <cmath>

namespace sim::causal {
namespace {

Eigen::Vector2d turned(const Eigen::Vector2d& ray, double angle) {
  const double c = 1 - angle * angle / 2;
  return {c * ray.x() - angle * ray.y(), angle * ray.x() + c * ray.y()};
}

}  // namespace

Optics::Optics(const World& world, const Scene& scene) : world_(world), scene_(scene) {
  // A Gaussian spot whose stated width is where the power has fallen to 1/e^2; equal steps across it.
  const auto fill = [](std::vector<SubRay>& rays, int count) {
    double sum = 0;
    for (int i = 0; i < count; ++i) {
      const double place = 1.5 * (-1 + (2.0 * i + 1) / count);
      rays.push_back({place, std::exp(-2 * place * place)});
      sum += rays.back().weight;
    }
    for (SubRay& ray : rays) ray.weight /= sum;
  };
  fill(few_, 5);
  fill(many_, 41);
}

double Optics::width(double device_angle) const {
  return std::hypot(world_.beam.long_rad * std::cos(device_angle),
                    world_.beam.short_rad * std::sin(device_angle));
}

double Optics::overlap(double range) const {
  const double near = world_.receiver.overlap_mm;
  const double part = range * range / (range * range + near * near);
  return part * part;
}

double Optics::delay_ns(double range, double rise) const {
  double path = rise == 0 ? range : range / std::sqrt(1 - rise * rise);
  if (world_.receiver.parallax_mm != 0) path = (path + std::hypot(path, world_.receiver.parallax_mm)) / 2;
  return path * (1 + world_.air.index_error) / light_mm_per_ns;
}

void Optics::trace(const Beam& beam, std::vector<Echo>& echoes) const {
  echoes.clear();
  const double half = width(beam.device) / 2, aperture = world_.beam.aperture_mm / 2;
  const Eigen::Vector2d ray(std::cos(beam.bearing), std::sin(beam.bearing));
  const Eigen::Vector2d across(-ray.y(), ray.x());
  const Eigen::Vector2d origin = beam.origin + world_.beam.aside_mm * across;
  const auto trace = [&](double place) {
    return scene_.trace(origin + place * aperture * across, turned(ray, place * half));
  };
  const Hit middle = trace(0), left = trace(1.5), right = trace(-1.5);
  const bool plain = middle.surface == left.surface && middle.surface == right.surface;
  if (plain && middle.surface < 0) return;
  if (!plain ||
      !scene_.material(scene_.surfaces()[static_cast<std::size_t>(middle.surface)]).stripes.empty()) {
    for (const SubRay& sub : many_) {
      add(beam, turned(ray, sub.place * half), trace(sub.place), sub.weight,
          origin + sub.place * aperture * across, echoes);
    }
  } else {
    // All on one flat piece: the ranges follow from the plane alone.
    const Surface& surface = scene_.surfaces()[static_cast<std::size_t>(middle.surface)];
    const double ahead = surface.offset - surface.normal.dot(origin);
    const double facing = surface.normal.dot(ray), aside = surface.normal.dot(across);
    for (const SubRay& sub : few_) {
      const double angle = sub.place * half;
      const double range =
          (ahead - sub.place * aperture * aside) / (facing * (1 - angle * angle / 2) + angle * aside);
      add(beam, ray, {middle.surface, range}, sub.weight, origin, echoes);
    }
  }
  std::ranges::sort(echoes, {}, &Echo::t_ns);
}

void Optics::add(const Beam& beam, const Eigen::Vector2d& ray, const Hit& hit, double weight,
                 const Eigen::Vector2d& from, std::vector<Echo>& echoes) const {
  if (hit.surface < 0) return;
  const Surface& surface = scene_.surfaces()[static_cast<std::size_t>(hit.surface)];
  const Material& made = scene_.material(surface);
  const double facing = std::abs(surface.normal.dot(ray));
  double diffuse = made.reflectance;
  if (!made.stripes.empty()) {
    diffuse = scene_.reflectance(surface, surface.along.dot(from + hit.range * ray - surface.from));
  }
  double answer = diffuse * facing;
  if (made.specular > 0) {
    const double off = std::acos(std::min(1.0, facing)) / made.specular_width;
    answer += diffuse * made.specular * std::exp(-off * off);
  }
  // A wall out of plumb is nearer or farther where the beam has risen to.
  double range = hit.range;
  if (made.plumb_tan != 0 && beam.rise != 0)
    range += beam.rise * hit.range * made.plumb_tan / std::max(0.05, facing);
  const double passed = (1 - beam.loss) * (1 - beam.loss);
  const double power = weight * passed * answer * overlap(range) * 1e6 / (range * range);
  echoes.push_back({delay_ns(range, beam.rise), power * (1 - made.gloss), &made.pulse});
  if (made.gloss > 0) glossy(ray, hit, weight * passed, from, made.gloss, echoes);
}

void Optics::glossy(const Eigen::Vector2d& ray, const Hit& hit, double weight, const Eigen::Vector2d& from,
                    double share, std::vector<Echo>& echoes) const {
  const Surface& mirror = scene_.surfaces()[static_cast<std::size_t>(hit.surface)];
  const Eigen::Vector2d onward = ray - 2 * mirror.normal.dot(ray) * mirror.normal;
  const Eigen::Vector2d place = from + hit.range * ray;
  const Hit second = scene_.trace(place, onward, hit.surface);
  if (second.surface < 0) return;
  const Surface& other = scene_.surfaces()[static_cast<std::size_t>(second.surface)];
  const Material& made = scene_.material(other);
  const double path = hit.range + second.range;
  const double answer = made.reflectance * std::abs(other.normal.dot(onward));
  echoes.push_back({delay_ns(path, 0), weight * share * share * answer * overlap(path) * 1e6 / (path * path),
                    &made.pulse});
}

}  // namespace sim::causal
