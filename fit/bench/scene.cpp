// SPDX-License-Identifier: MIT
#include "fit/bench/scene.hpp"

#include <algorithm>
#include <cmath>

namespace fit {
namespace {

using Eigen::Vector2d;

constexpr double meeting_mm = 40;  // ends so close to where their lines cross form a corner
constexpr double touching_mm = 5;  // an end so close to another wall begins there
constexpr double parallel = 0.1;   // sine of the angle below which two lines cross nowhere in particular
constexpr double nearest_echo_mm = 1;
constexpr double shallow_mm = 5;  // not an edge
constexpr double leak_mm = 1e-3;  // no ray passes between two walls that meet
constexpr double grazing = 0.02;  // least cosine of an incidence

Vector2d turned(const Vector2d& v, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * v.x() - s * v.y(), s * v.x() + c * v.y()};
}
Vector2d quarter_turned(const Vector2d& v) { return {-v.y(), v.x()}; }
double cross(const Vector2d& a, const Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }
Vector2d ray_of(double bearing) { return {std::cos(bearing), std::sin(bearing)}; }

/// A straight line with a middle.
struct Line {
  Vector2d middle, along;
};

/// Where a line is crossed by another, along from its middle.
double crossing(const Line& own, const Line& other) {
  return cross(other.middle - own.middle, other.along) / cross(own.along, other.along);
}

Line stated_line(const Target& target) {
  return {(target.from_mm + target.to_mm) / 2, (target.to_mm - target.from_mm).normalized()};
}

/// Fills in what follows from the surface's normal where it is met.
void set_normal(const Vector2d& normal, const Vector2d& ray, Hit& hit) {
  hit.normal = normal;
  hit.cosine = std::max(grazing, normal.dot(ray));
  hit.incidence_rad = std::atan2(quarter_turned(normal).dot(ray), hit.cosine);
}

constexpr double halo_reach_rad = 1.2 * rad_per_deg;

/// Of the plane that a beam and all beside it meet, if they meet one.
std::optional<double> slope_of_plane(const Hit& own, const Circumstances& c) {
  return c.alone ? std::optional(std::tan(own.incidence_rad)) : std::nullopt;
}

}  // namespace

Scene::Scene(const Bench& bench, const std::vector<Stands>& stands) {
  surfaces_.reserve(bench.targets.size());
  for (std::size_t i = 0; i < bench.targets.size(); ++i) {
    const Target& target = bench.targets[i];
    const Stands now = stands.empty() ? Stands{} : stands[i];
    Surface s;
    s.outward = target.outward_normal();
    s.reflectance = now.reflectance.value_or(target.reflectance.value_or(0.5));
    s.absent = now.absent;
    if (target.round) {
      s.radius_mm = std::max(nearest_echo_mm, target.round->radius_mm + now.thicker_mm);
      s.along = quarter_turned(s.outward);
      s.middle = target.round->centre_mm + now.out_mm * s.outward + now.aside_mm * s.along;
      s.half_mm = s.radius_mm * pi / 2;
    } else {
      s.half_mm = (target.to_mm - target.from_mm).norm() / 2;
      s.along = turned((target.to_mm - target.from_mm).normalized(), now.turn_rad);
      s.middle = (target.from_mm + target.to_mm) / 2 + now.out_mm * s.outward;
      s.outward = turned(s.outward, now.turn_rad);
    }
    s.from_mm = -s.half_mm;
    s.to_mm = s.half_mm;
    surfaces_.push_back(std::move(s));
  }
  join(bench, stands);
}

/// Which targets meet is said by the bench file; where, by how they stand.
void Scene::join(const Bench& bench, const std::vector<Stands>& stands) {
  const auto may_join = [&](std::size_t i) {
    return !surfaces_[i].absent && !surfaces_[i].is_round() && (stands.empty() || !stands[i].moved);
  };
  /// The end of a wall goes to a place on its own half.
  const auto end_at = [&](std::size_t i, double side, double at_mm) {
    Surface& s = surfaces_[i];
    if (at_mm * side <= 0) return side * s.half_mm;
    double& end = side > 0 ? s.to_mm : s.from_mm;
    const bool first = end == side * s.half_mm;
    if (first || at_mm * side > end * side) end = at_mm;
    return at_mm;
  };
  for (std::size_t i = 0; i < surfaces_.size(); ++i) {
    if (!may_join(i)) continue;
    const Line one = stated_line(bench.targets[i]);
    for (std::size_t j = 0; j < i; ++j) {
      if (!may_join(j)) continue;
      const Line other = stated_line(bench.targets[j]);
      const double one_half = surfaces_[i].half_mm, other_half = surfaces_[j].half_mm;
      if ((one.middle - other.middle).norm() > one_half + other_half + 2 * meeting_mm) continue;
      const Line one_now{surfaces_[i].middle, surfaces_[i].along},
          other_now{surfaces_[j].middle, surfaces_[j].along};
      if (std::abs(cross(one.along, other.along)) < parallel) {  // one goes on where the other ends
        for (const double side : {-1.0, 1.0})
          for (const double other_side : {-1.0, 1.0}) {
            const Vector2d end = one.middle + side * one_half * one.along,
                           other_end = other.middle + other_side * other_half * other.along;
            if ((end - other_end).norm() > touching_mm) continue;
            const Vector2d end_now = one_now.middle + side * one_half * one_now.along,
                           other_end_now = other_now.middle + other_side * other_half * other_now.along;
            const Vector2d meet = (end_now + other_end_now) / 2;
            const double at = end_at(i, side, one_now.along.dot(meet - one_now.middle)),
                         other_at = end_at(j, other_side, other_now.along.dot(meet - other_now.middle));
            surfaces_[i].joints.push_back({static_cast<int>(j), at, -other_side * other_now.along});
            surfaces_[j].joints.push_back({static_cast<int>(i), other_at, -side * one_now.along});
          }
        continue;
      }
      const double stated = crossing(one, other), other_stated = crossing(other, one);
      const double from_end = std::abs(std::abs(stated) - one_half),
                   other_from_end = std::abs(std::abs(other_stated) - other_half);
      const double side = stated > 0 ? 1 : -1, other_side = other_stated > 0 ? 1 : -1;
      const bool is_corner = from_end <= meeting_mm && other_from_end <= meeting_mm,
                 begins_there = from_end <= touching_mm && std::abs(other_stated) < other_half - meeting_mm,
                 other_begins = other_from_end <= touching_mm && std::abs(stated) < one_half - meeting_mm;
      if (!is_corner && !begins_there && !other_begins) continue;
      const bool cross_now = std::abs(cross(one_now.along, other_now.along)) >= parallel;
      double at = cross_now ? crossing(one_now, other_now) : side * one_half,
             other_at = cross_now ? crossing(other_now, one_now) : other_side * other_half;
      if (is_corner || begins_there) at = end_at(i, side, at);
      if (is_corner || other_begins) other_at = end_at(j, other_side, other_at);
      const Vector2d nowhere = Vector2d::Zero();
      surfaces_[i].joints.push_back(
          {static_cast<int>(j), at, begins_there ? nowhere : -other_side * other_now.along});
      surfaces_[j].joints.push_back(
          {static_cast<int>(i), other_at, other_begins ? nowhere : -side * one_now.along});
    }
  }
}

bool Scene::begins_there(int other, int one, double at_mm) const {
  return std::ranges::any_of(of(one).joints, [&](const Joint& joint) {
    return joint.other == other && std::abs(joint.at_mm - at_mm) < shallow_mm;
  });
}

bool Scene::crosses(const Surface& s, const Vector2d& origin, const Vector2d& ray, bool anyway, Hit& hit) {
  if (!s.is_round()) {
    const double facing = s.outward.dot(ray);
    if (std::abs(facing) < 1e-4) return false;
    hit.range_mm = s.outward.dot(s.middle - origin) / facing;
    if (hit.range_mm <= nearest_echo_mm) return false;
    hit.along_mm = s.along.dot(origin + hit.range_mm * ray - s.middle);
    return anyway || (hit.along_mm >= s.from_mm - leak_mm && hit.along_mm <= s.to_mm + leak_mm);
  }
  const Vector2d way = s.middle - origin;
  const double nearest = way.dot(ray),
               left2 = nearest * nearest - way.squaredNorm() + s.radius_mm * s.radius_mm;
  if (nearest <= nearest_echo_mm || way.norm() <= s.radius_mm || (left2 < 0 && !anyway)) return false;
  hit.range_mm = nearest - std::sqrt(std::max(0.0, left2));
  return true;
}

void Scene::fill_in(const Surface& s, const Vector2d& origin, const Vector2d& ray, Hit& hit) {
  if (s.is_round()) {
    const Vector2d normal = (s.middle - origin - hit.range_mm * ray).normalized();
    hit.along_mm = -s.radius_mm * std::atan2(cross(s.outward, normal), s.outward.dot(normal));
    set_normal(normal, ray, hit);
    hit.per_aside = normal.dot(s.along) / hit.cosine;
    hit.per_thicker = -1 / hit.cosine;
  } else {
    const Vector2d normal = s.outward.dot(ray) < 0 ? Vector2d(-s.outward) : s.outward;
    hit.along_sign = quarter_turned(normal).dot(s.along) >= 0 ? 1 : -1;
    set_normal(normal, ray, hit);
    hit.per_turn = hit.along_mm * normal.dot(quarter_turned(s.along)) / hit.cosine;
  }
  hit.per_out = hit.normal.dot(s.outward) / hit.cosine;
}

Hit Scene::look(const Vector2d& origin, double bearing) const {
  const Vector2d ray = ray_of(bearing);
  Hit nearest, hit;
  for (std::size_t i = 0; i < surfaces_.size(); ++i) {
    if (surfaces_[i].absent || !crosses(surfaces_[i], origin, ray, false, hit)) continue;
    if (nearest.target >= 0 && hit.range_mm >= nearest.range_mm) continue;
    nearest.range_mm = hit.range_mm;
    nearest.along_mm = hit.along_mm;
    nearest.target = static_cast<int>(i);
  }
  if (nearest.target >= 0) fill_in(of(nearest.target), origin, ray, nearest);
  return nearest;
}

Hit Scene::look_at(int target, const Vector2d& origin, double bearing) const {
  const Surface& s = of(target);
  const Vector2d ray = ray_of(bearing);
  Hit hit;
  if (!crosses(s, origin, ray, true, hit)) return hit;
  hit.target = target;
  fill_in(s, origin, ray, hit);
  return hit;
}

std::vector<Edge> Scene::edges(const Vector2d& origin) const {
  constexpr double aside = 1e-5;
  std::vector<Edge> found;
  const auto look_for = [&](int target, int end, double at_mm, double bearing) {
    const Hit low = look(origin, bearing - aside), high = look(origin, bearing + aside);
    if (low.target == high.target) return;
    const bool near_is_low = low.target >= 0 && (high.target < 0 || low.range_mm < high.range_mm);
    const Hit &near = near_is_low ? low : high, &far = near_is_low ? high : low;
    if (near.target != target) return;
    if (far.target >= 0 &&
        (far.range_mm - near.range_mm < shallow_mm || begins_there(far.target, target, at_mm)))
      return;
    found.push_back({wrap_angle(bearing), near.range_mm, far.target < 0 ? 0 : far.range_mm, 2 * target + end,
                     near_is_low ? -1 : 1, near.target, far.target});
  };
  for (std::size_t i = 0; i < surfaces_.size(); ++i) {
    const Surface& s = surfaces_[i];
    if (s.absent) continue;
    const auto target = static_cast<int>(i);
    if (s.is_round()) {
      const Vector2d way = s.middle - origin;
      if (way.norm() <= s.radius_mm) continue;
      const double bearing = std::atan2(way.y(), way.x()), half = std::asin(s.radius_mm / way.norm());
      look_for(target, 0, s.from_mm, bearing - half);
      look_for(target, 1, s.to_mm, bearing + half);
      continue;
    }
    for (const int end : {0, 1}) {
      const double at_mm = end == 0 ? s.from_mm : s.to_mm;
      const Vector2d way = s.middle + at_mm * s.along - origin;
      look_for(target, end, at_mm, std::atan2(way.y(), way.x()));
    }
  }
  return found;
}

double Scene::to_corner_mm(const Hit& hit) const {
  constexpr double straight = 1e-3;
  double nearest = std::numeric_limits<double>::infinity();
  for (const Joint& joint : of(hit.target).joints)
    if (joint.away.isZero() || hit.normal.dot(joint.away) < -straight)
      nearest = std::min(nearest, std::abs(hit.along_mm - joint.at_mm));
  return nearest;
}

double Scene::to_joint_mm(const Hit& hit) const {
  double nearest = std::numeric_limits<double>::infinity();
  for (const Joint& joint : of(hit.target).joints)
    nearest = std::min(nearest, std::abs(hit.along_mm - joint.at_mm));
  return nearest;
}

double Scene::power(const Hit& hit) const {
  return of(hit.target).reflectance * std::cos(hit.incidence_rad) * 1e6 / (hit.range_mm * hit.range_mm);
}

bool Scene::fills(const Hit& own, double bearing, const Edge* edge) const {
  const Surface& s = of(own.target);
  if (s.is_round() || (edge && std::abs(wrap_angle(bearing - edge->bearing_rad)) < halo_reach_rad))
    return false;
  const double slope = std::tan(own.incidence_rad), aside = std::tan(halo_reach_rad);
  if (std::abs(slope) * aside > 0.9) return false;  // grazing
  // By the law of sines, from where the beam meets it.
  const double way_mm = own.range_mm * aside / std::cos(own.incidence_rad),
               up_mm = way_mm / (1 - slope * aside) * own.along_sign,
               down_mm = -way_mm / (1 + slope * aside) * own.along_sign;
  return own.along_mm + std::min(up_mm, down_mm) >= s.from_mm &&
         own.along_mm + std::max(up_mm, down_mm) <= s.to_mm;
}

/// Stray light from directions within a degree, weighted by its angular distance; a sum over angles, whatever
/// the beams' spacing (fit/mechanisms/crosstalk.cpp).
void Scene::describe_pull(const Vector2d& origin, double bearing, const Hit& own, Circumstances& c) const {
  constexpr double merged_mm = 500, front_mm = 150;
  static const std::vector<Aside> halo = asides(0.25 * rad_per_deg, 1.0 * rad_per_deg, halos_rad,
                                                [](double of_half) { return std::exp2(-of_half * of_half); });
  c.pull_mm = c.pull_apart_mm = c.pull_front_mm = {};
  const std::optional<double> slope = slope_of_plane(own, c);
  for (const Aside& aside : halo) {
    const std::optional<Beside> there = beside(origin, bearing, own, aside, slope);
    if (!there) continue;
    const double gap = there->range_mm - own.range_mm, near = std::clamp(gap, -front_mm, front_mm);
    const bool is_apart = std::abs(gap) > merged_mm;
    for (std::size_t k = 0; k < halos_rad.size(); ++k) {
      const double share = there->light * aside.weights[k];
      (is_apart ? c.pull_apart_mm : c.pull_mm)[k] += share * std::clamp(gap, -merged_mm, merged_mm);
      if (!is_apart) c.pull_front_mm[k] -= share * near * near / front_mm;
    }
  }
}

std::vector<Scene::Aside> Scene::asides(double step_rad, double most_rad,
                                        const std::array<double, 3>& widths_rad, double (*weight)(double)) {
  std::vector<Aside> list;
  const int most = static_cast<int>(std::lround(most_rad / step_rad));
  for (int k = -most; k <= most; ++k) {
    const double angle = k * step_rad;
    Aside aside{angle, std::cos(angle), std::sin(angle)};
    for (std::size_t w = 0; w < widths_rad.size(); ++w) aside.weights[w] = weight(angle / widths_rad[w]);
    list.push_back(aside);
  }
  return list;
}

std::optional<Scene::Beside> Scene::beside(const Vector2d& origin, double bearing, const Hit& own,
                                           const Aside& aside, std::optional<double> slope) const {
  if (aside.angle_rad == 0) return Beside{own.range_mm, 1};
  if (slope) {
    const double nearer = aside.cos - *slope * aside.sin;
    return Beside{own.range_mm / nearer, nearer * nearer * nearer};
  }
  const Hit other = look(origin, bearing + aside.angle_rad);
  if (other.target < 0) return std::nullopt;
  return Beside{other.range_mm, power(other) / power(own)};
}

/// All that a wide beam meets on its side of an edge: beyond is another echo, or none
/// (fit/mechanisms/mixed_pixel.cpp).
void Scene::describe_spread(const Vector2d& origin, double bearing, const Hit& own, const Edge* edge,
                            Circumstances& c) const {
  static const std::vector<Aside> within =
      asides(0.05 * rad_per_deg, 1.2 * rad_per_deg, wide_beams_rad,
             [](double widths) { return std::exp(-widths * widths / 2); });
  const std::optional<double> slope = slope_of_plane(own, c);
  const double to_edge_rad = edge ? wrap_angle(edge->bearing_rad - bearing) : pi;
  std::array<double, 3> light{}, range_mm{};
  for (const Aside& aside : within) {
    if (aside.angle_rad * to_edge_rad > to_edge_rad * to_edge_rad) continue;
    const std::optional<Beside> there = beside(origin, bearing, own, aside, slope);
    if (!there) continue;
    for (std::size_t k = 0; k < light.size(); ++k) {
      const double share = aside.weights[k] * there->light;
      light[k] += share;
      range_mm[k] += share * (there->range_mm - own.range_mm);
    }
  }
  for (std::size_t k = 0; k < light.size(); ++k) c.spread_mm[k] = range_mm[k] / light[k];
}

void Scene::describe_place(double bearing, const Hit& hit, Circumstances& c) const {
  c.range_mm = hit.range_mm;
  c.incidence_rad = hit.incidence_rad;
  c.cos_incidence = hit.cosine;
  c.bearing_rad = bearing;
  c.along_mm = hit.along_mm;
  c.along_sign = hit.along_sign;
  c.normal = hit.normal;
  c.half_length_mm = of(hit.target).half_mm;
  c.corner_mm = to_corner_mm(hit);
}

void Scene::describe(const Vector2d& origin, double bearing, const Hit& hit, const std::vector<Edge>& edges,
                     Circumstances& c) const {
  describe_place(bearing, hit, c);
  c.reflectance = reflectance(hit.target);
  c.target = hit.target;
  c.round = of(hit.target).is_round();
  const Edge* edge = nearest_edge(edges, bearing);
  if (edge) {
    c.edge_rad = wrap_angle(bearing - edge->bearing_rad) * edge->near_side;
    c.gap_mm = edge->far_mm > 0 ? edge->far_mm - edge->near_mm : 0;
  }
  c.alone = fills(hit, bearing, edge);
  describe_pull(origin, bearing, hit, c);
  describe_spread(origin, bearing, hit, edge, c);
}

const Edge* nearest_edge(const std::vector<Edge>& edges, double bearing) {
  const auto away = [bearing](const Edge& edge) { return std::abs(wrap_angle(bearing - edge.bearing_rad)); };
  const auto nearest = std::ranges::min_element(edges, {}, away);
  return nearest == edges.end() ? nullptr : &*nearest;
}

}  // namespace fit
