// SPDX-License-Identifier: MIT
#include "fit/range/wall.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "fit/numeric/angle.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"
#include "rig/fitting/result_document.hpp"
#include "rig/fitting/uncertainty_budget.hpp"
#include "rig/json_fields.hpp"

namespace rig::fittings {
namespace {

using nlohmann::json;

fit::Estimate degrees(const fit::Estimate& rad) {
  return {rad.value * fit::deg_per_rad, rad.u * fit::deg_per_rad};
}

fit::Estimate joint(const fit::WallFit& fit, int i) {
  return {fit.joint[i], std::sqrt(std::max(0.0, fit.covariance(i, i)))};
}

json unit_column(const char* name, const char* unit) { return {{"name", name}, {"unit", unit}}; }

/// Of a mean over all captures, each at a stage angle of its own.
double u_of_stage_deg(const fit::WallFit& fit, const fit::Bench& bench) {
  return u_of_resolution(bench.stage_resolution_rad) * fit::deg_per_rad /
         std::sqrt(static_cast<double>(fit.means.size()));
}

using Vector6 = Eigen::Matrix<double, 6, 1>;

/// Budget of a quantity that changes by `slope` with the joint parameters.
UncertaintyBudget budget_of(const fit::WallFit& fit, const Vector6& slope, const std::string& name,
                            const std::string& label, const std::string& unit) {
  UncertaintyBudget out(name, label, unit);
  const double noise = std::max(0.0, slope.dot(fit.from_noise * slope));
  out.add({.source = "noise of the ranges",
           .kind = 'A',
           .distribution = "normal",
           .u = std::sqrt(noise),
           .freedom = std::max(1.0, static_cast<double>(fit.beams) - 6)});
  // A line of its own: few captures say how much they scatter, and many beams how noisy they are.
  if (const double more = slope.dot(fit.from_ranges * slope) - noise; more > 0)
    out.add({.source = "scatter between captures beyond that",
             .kind = 'A',
             .distribution = "Student",
             .u = std::sqrt(more),
             .freedom = fit.capture_freedom});
  // Sine and cosine, or several curves, of one deviation are one line.
  for (std::size_t k = 0; k < fit.effects.size(); ++k) {
    double square = 0;
    bool first = true;
    for (std::size_t j = 0; j < fit.effects.size(); ++j) {
      if (fit.effects[j].line.member != fit.effects[k].line.member) continue;
      first = first && j >= k;
      square += std::pow(slope.dot(fit.effects[j].share), 2);
    }
    if (first) out.add(fit.effects[k].line, std::sqrt(square));
  }
  return out;
}

/// The joint fit measures the stage against the lidar; what it learnt of a deviation is a value of its own.
void add_self_check(json& out, const fit::WallFit& fit) {
  for (const fit::WallEffect& effect : fit.effects) {
    if (effect.line.member != &fit::DeviceAccuracy::stage_scale) continue;
    if (effect.found.u > 0.5) {
      out["undetermined"].push_back("the scale of the stage: these captures do not determine it");
      return;
    }
    const double percent = 100 * effect.line.u;
    out["values"].push_back(result_value("stage_scale_error_percent",
                                         "Self-check: the stage turns farther than commanded by",
                                         {percent * effect.found.value, percent * effect.found.u}, "%"));
    if (std::abs(effect.found.value) > 3)
      out["contradictions"].push_back(
          "The stage's scale is off by more than the bench file's u_scale allows");
  }
}

/// Of the six values of the joint fit; `angle_u`: that of the mounting angle with its parts from the stage,
/// degrees.
json covariance_of_values(const fit::WallFit& fit, double angle_u) {
  json matrix = json::array();
  const double scale[] = {fit::deg_per_rad, 1, 1, 1, 1, fit::deg_per_rad};
  for (int i = 0; i < 6; ++i) {
    json row = json::array();
    for (int k = 0; k < 6; ++k)
      row.push_back(
          scale[i] * scale[k] * fit.covariance(i, k) +
          (i == 0 && k == 0 ? std::pow(angle_u, 2) - std::pow(scale[0], 2) * fit.covariance(0, 0) : 0));
    matrix.push_back(row);
  }
  return {{"names", {"mounting_angle_deg", "mount_x_mm", "mount_y_mm", "front_mm", "side_mm", "corner_deg"}},
          {"matrix", matrix}};
}

void add_values(json& out, const fit::WallFit& fit, const fit::Bench& bench) {
  const double stage_u = u_of_stage_deg(fit, bench);
  const double board_u = fit.walls[0].u_rad * fit::deg_per_rad;
  const auto angle_part = [&](UncertaintyBudget& budget) {
    budget.add({.source = "resolution of the stage (bench file)",
                .distribution = "rectangular",
                .u = stage_u,
                .input_u = u_of_resolution(bench.stage_resolution_rad) * fit::deg_per_rad,
                .input_unit = "deg"});
    const fit::DeviceAccuracy accuracy = fit::accuracy_of(bench);
    for (const fit::AccuracyLine& line : fit::accuracy_in_words(accuracy))
      if (line.member == &fit::DeviceAccuracy::stage_position_rad)
        budget.add(line, line.u / std::sqrt(static_cast<double>(fit.means.size())));
  };
  const auto slope_of = [](int parameter, double scale) { return Vector6(Vector6::Unit(parameter) * scale); };
  const Eigen::Vector2d m = fit.joint.segment<2>(1);
  const double radius = std::max(1e-9, m.norm());
  Vector6 radial = Vector6::Zero(), around = Vector6::Zero();
  radial.segment<2>(1) = m / radius;
  around.segment<2>(1) = Eigen::Vector2d(-m.y(), m.x()) / (radius * radius) * fit::deg_per_rad;
  const auto mm = [&](const Vector6& slope, double value, const char* name, const char* label) {
    budget_of(fit, slope, name, label, "mm").publish(out, value);
  };
  UncertaintyBudget angle = budget_of(fit, slope_of(0, fit::deg_per_rad), "mounting_angle_deg",
                                      "Mounting angle against the front wall, at stage angle 0", "deg");
  angle_part(angle);
  const double angle_deg = fit.joint[0] * fit::deg_per_rad;
  angle.publish(out, angle_deg);
  mm(radial, fit.radius_mm.value, "radius_mm", "Distance of the lidar from the axis");
  UncertaintyBudget direction =
      budget_of(fit, around, "direction_deg", "Direction of that offset, at stage angle 0", "deg");
  angle_part(direction);
  direction.add(
      {.source = "orientation of the front board (bench file)", .distribution = "normal", .u = board_u});
  direction.publish(out, fit.direction_rad.value * fit::deg_per_rad);
  for (const int axis : {0, 1}) {
    UncertaintyBudget place = budget_of(fit, slope_of(1 + axis, 1), axis == 0 ? "mount_x_mm" : "mount_y_mm",
                                        axis == 0 ? "Lidar on the stage, x" : "Lidar on the stage, y", "mm");
    place.add({.source = "orientation of the front board (bench file)",
               .distribution = "normal",
               .u = fit.walls[0].u_rad * std::abs(m[1 - axis]),
               .input_u = board_u,
               .input_unit = "deg"});
    place.publish(out, m[axis]);
  }
  UncertaintyBudget yaw = budget_of(fit, slope_of(0, fit::deg_per_rad), "mount_yaw_deg",
                                    "Lidar on the stage, yaw (with the front board's orientation)", "deg");
  angle_part(yaw);
  yaw.add({.source = "orientation of the front board (bench file)", .distribution = "normal", .u = board_u});
  yaw.publish(out, angle_deg);
  mm(slope_of(3, 1), fit.joint[3], "front_mm", "Distance of the front wall from the axis");
  mm(slope_of(4, 1), fit.joint[4], "side_mm", "Distance of the side wall from the axis");
  const double corner =
      fit::wrap_angle(fit.walls[1].line.normal_rad - fit.walls[0].line.normal_rad) * fit::deg_per_rad;
  budget_of(fit, slope_of(5, fit::deg_per_rad), "corner_deg", "Angle from the front wall to the side wall",
            "deg")
      .publish(out, corner + fit.joint[5] * fit::deg_per_rad);
  add_self_check(out, fit);
  out["values"].push_back(
      plain_value("range_noise_mm", "Standard deviation of one range", fit.range_noise_mm, "mm"));
  out["covariance"] = covariance_of_values(fit, angle.u());
}

/// Not a number where the result has none.
double u_stated(const json& out, const std::string& name) {
  for (const json& value : out.at("values"))
    if (value.at("name") == name) return number_of(value, "u");
  return std::nan("");
}

/// Standard uncertainty of a quantity by the joint fit: from the ranges, and what all methods share.
struct PartsOfU {
  double ranges = 0, shared = 0;
};

/// All methods share everything in a value's budget but noise and scatter of the ranges.
struct SharedByMethods {
  PartsOfU radius_mm, direction_deg, angle_deg;
  SharedByMethods(const json& out, const fit::WallFit& fit) {
    const Eigen::Vector2d m = fit.joint.segment<2>(1);
    const double radius = std::max(1e-9, m.norm());
    const auto parts = [&](const char* name, const Vector6& slope) {
      const double square = std::max(0.0, slope.dot(fit.from_ranges * slope)),
                   beyond = std::pow(u_stated(out, name), 2) - square;
      return PartsOfU{std::sqrt(square), beyond < 0 ? 0 : std::sqrt(beyond)};
    };
    Vector6 radial = Vector6::Zero(), around = Vector6::Zero();
    radial.segment<2>(1) = m / radius;
    around.segment<2>(1) = Eigen::Vector2d(-m.y(), m.x()) / (radius * radius) * fit::deg_per_rad;
    radius_mm = parts("radius_mm", radial);
    direction_deg = parts("direction_deg", around);
    angle_deg = parts("mounting_angle_deg", Vector6::Unit(0) * fit::deg_per_rad);
  }
};

/// Nothing where the method's own u is not known.
fit::Estimate with(const fit::Estimate& own, const PartsOfU& parts) {
  return {own.value, own.u > 0 ? std::hypot(own.u, parts.shared) : 0};
}

/// Simpler methods beside the joint fit. What the devices and boards do to both alike is no difference: each
/// has the u that its ranges give it.
void compare_simpler(json& out, const fit::WallFit& fit) {
  const SharedByMethods parts(out, fit);
  const double k = fit::coverage_factor(fit.capture_freedom);
  if (fit.repeats >= 3)
    compare_methods(out, "Mounting angle by the ranges alone",
                    {"from all beams together", {degrees(joint(fit, 0)).value, parts.angle_deg.ranges}, k},
                    {"from the slope of the front wall at stage angle 0", degrees(fit.patent_angle_rad)},
                    "deg");
  for (const fit::WallCircle& way : fit.ways)
    if (way.radius_mm.u > 0 && way.way.starts_with("both walls") && way.way.ends_with("geometric circle"))
      compare_methods(out, "Distance of the lidar from the axis by the ranges alone",
                      {"from all beams together", {fit.radius_mm.value, parts.radius_mm.ranges}, k},
                      {"from a circle through its positions", way.radius_mm}, "mm");
}

/// A wall that does not stand where the bench file says.
void compare_with_bench(json& out, const fit::WallFit& fit, const fit::Bench& bench) {
  for (const int j : {0, 1}) {
    const fit::Target* target = bench.target(fit.walls[j].name);
    if (!target || target->u_mm <= 0) continue;
    const double off = fit.joint[3 + j] - fit.walls[j].line.distance_mm;
    const double u = std::hypot(std::sqrt(fit.covariance(3 + j, 3 + j)), target->u_mm);
    if (std::abs(off) <= 3 * u) continue;
    char text[200];
    std::snprintf(text, sizeof text,
                  "'%s' is seen %.1f mm from where the bench file puts it, %.1f standard uncertainties.",
                  target->name.c_str(), std::abs(off), std::abs(off) / u);
    out["contradictions"].push_back(text);
  }
}

void add_ways(json& out, const fit::WallFit& fit) {
  json rows = json::array();
  const SharedByMethods shared(out, fit);
  const auto row = [&](const std::string& way, const fit::Estimate& radius, const fit::Estimate& d,
                       std::size_t points, std::size_t inliers) {
    const bool circle = radius.value > 0;
    rows.push_back({way, circle ? json(radius.value) : json(nullptr),
                    circle && radius.u > 0 ? number_or_null(radius.u) : json(nullptr),
                    number_or_null(d.value), d.u > 0 ? number_or_null(d.u) : json(nullptr), points, inliers});
  };
  row("joint least squares of all beams", {fit.radius_mm.value, u_stated(out, "radius_mm")},
      {degrees(fit.direction_rad).value, u_stated(out, "direction_deg")}, fit.beams, fit.beams);
  for (const fit::WallCircle& way : fit.ways)
    row(way.way, with(way.radius_mm, shared.radius_mm),
        with(degrees(way.direction_rad), shared.direction_deg), way.points, way.inliers);
  out["tables"].push_back({{"title", "The offset by each method (u: standard uncertainty)"},
                           {"columns",
                            {"way", unit_column("radius", "mm"), unit_column("u", "mm"),
                             unit_column("direction", "deg"), unit_column("u", "deg"), "points", "used"}},
                           {"rows", rows}});
  json angles = json::array();
  const fit::Estimate own = degrees(joint(fit, 0)), patent = degrees(fit.patent_angle_rad);
  angles.push_back({"joint least squares of all beams", own.value,
                    number_or_null(u_stated(out, "mounting_angle_deg")), fit.means.size()});
  if (fit.repeats > 0)
    angles.push_back({"patent: mean slope of the front wall at stage angle 0", patent.value,
                      number_or_null(with(patent, shared.angle_deg).u), fit.repeats});
  out["tables"].push_back(
      {{"title", "The mounting angle by each method"},
       {"columns", {"way", unit_column("angle", "deg"), unit_column("u", "deg"), "captures"}},
       {"rows", angles}});
}

void add_observations(json& out, const fit::WallFit& fit) {
  json rows = json::array();
  for (const fit::WallObservation& observation : fit.measured) {
    json row = {observation.stage_rad * fit::deg_per_rad};
    for (const auto& wall : observation.walls) {
      row.push_back(wall ? json(wall->line.normal_rad * fit::deg_per_rad) : json(nullptr));
      row.push_back(wall ? json(wall->line.distance_mm) : json(nullptr));
      row.push_back(wall ? json(wall->points) : json(0));
    }
    rows.push_back(row);
  }
  out["tables"].push_back({{"title", "The walls in the lidar's frame, from the mean of each capture"},
                           {"columns",
                            {unit_column("stage", "deg"), unit_column("front wall's normal", "deg"),
                             unit_column("distance", "mm"), "beams", unit_column("side wall's normal", "deg"),
                             unit_column("distance", "mm"), "beams"}},
                           {"rows", rows}});
}

void add_plots(json& out, const fit::WallFit& fit) {
  json path = new_plot("The lidar in the wall frame", "minus distance from the front wall (mm)",
                       "minus distance from the side wall (mm)");
  path["equal_axes"] = true;
  const auto series = [&](const char* name, const std::vector<Eigen::Vector2d>& points) {
    std::vector<double> x, y;
    const std::size_t stride = 1 + points.size() / 1500;
    for (std::size_t i = 0; i < points.size(); i += stride)
      x.push_back(points[i].x()), y.push_back(points[i].y());
    add_series(path, name, "points", x, y);
  };
  series("single square beams", fit.single_beam);
  series("both walls in every scan", fit.trajectory);
  for (const fit::WallCircle& way : fit.ways) {
    if (!way.circle || !way.way.ends_with("geometric circle") || way.way.starts_with("patent")) continue;
    std::vector<double> x, y;
    for (int i = 0; i <= 120; ++i) {
      const double a = fit::pi * i / 60;
      x.push_back(way.circle->circle.centre.x() + way.circle->circle.radius * std::cos(a));
      y.push_back(way.circle->circle.centre.y() + way.circle->circle.radius * std::sin(a));
    }
    add_series(path, "geometric circle", "line", x, y);
  }
  out["plots"].push_back(path);
  json distance = new_plot("Distance of the walls as the stage turns", "stage angle (deg)",
                           "distance minus that of the axis (mm)");
  for (const int j : {0, 1}) {
    std::vector<double> x, y;
    for (const fit::WallObservation& observation : fit.means) {
      if (!observation.walls[j]) continue;
      x.push_back(observation.stage_rad * fit::deg_per_rad);
      y.push_back(observation.walls[j]->line.distance_mm - fit.joint[3 + j]);
    }
    add_series(distance, fit.walls[j].name, "points", x, y);
    x.clear(), y.clear();
    for (int deg = -180; deg <= 180; deg += 3) {
      const double normal = fit.walls[j].line.normal_rad + (j == 1 ? fit.joint[5] : 0);
      x.push_back(deg);
      y.push_back(-fit.radius_mm.value * std::cos(deg * fit::rad_per_deg + fit.direction_rad.value - normal));
    }
    add_series(distance, fit.walls[j].name + ", joint fit", "line", x, y);
  }
  out["plots"].push_back(distance);
}

void add_remarks(json& out, const fit::WallFit& fit) {
  char text[300];
  for (const std::string& note : fit.notes) out["notes"].push_back(note);
  if (fit.repeats < 3)
    out["notes"].push_back(
        "The patent's mounting angle needs at least three captures at stage angle 0; there are " +
        std::to_string(fit.repeats) + ".");
  if (fit.capture_inflation > 1.5) {
    std::snprintf(
        text, sizeof text,
        "Captures scatter more than their beams (up to %.1f times): errors of the stage's angle or of "
        "single beams. The uncertainties contain that.",
        fit.capture_inflation);
    out["notes"].push_back(text);
  }
  const double bend = fit.joint[5], u = std::hypot(std::sqrt(fit.covariance(5, 5)),
                                                   std::hypot(fit.walls[0].u_rad, fit.walls[1].u_rad));
  if (std::abs(bend) > 3 * u && fit.walls[0].u_rad > 0) {
    std::snprintf(
        text, sizeof text,
        "The corner is %.3f deg off what the bench says, %.1f standard uncertainties: check the boards "
        "with a square, or the lidar's ranges (rig fit range).",
        bend * fit::deg_per_rad, std::abs(bend) / u);
    out["notes"].push_back(text);
  }
  if (fit.radius_mm.value < 3 * fit.radius_mm.u)
    out["undetermined"].push_back(
        "The direction of the offset: the lidar is so near the axis that its distance is hardly more than "
        "its "
        "uncertainty.");
}

class Wall : public Fitting {
 public:
  std::string kind() const override { return "wall"; }
  std::string describes() const override {
    return "mounting angle and offset of the lidar, from a right-angled corner seen while the stage turns";
  }
  std::vector<std::string> values() const override {
    return {"mounting_angle_deg", "radius_mm", "direction_deg", "mount_x_mm", "mount_y_mm",
            "mount_yaw_deg",      "front_mm",  "side_mm",       "corner_deg", "stage_scale_error_percent",
            "range_noise_mm"};
  }
  std::vector<FitOption> options() const override {
    using Type = FitOption::Type;
    return {{.name = "front", .type = Type::text, .about = "board in front; without it, the bench's first"},
            {.name = "side",
             .type = Type::text,
             .about = "board square to it; without it, the bench's next square one"},
            {.name = "tolerance_mm",
             .unit = "mm",
             .min = 1,
             .max = 500,
             .otherwise = fit::WallOptions().tolerance_mm,
             .about = "distance from a wall within which points belong to it"}};
  }

  json run(const std::vector<FitSource>& sources, const FitOptions& options) const override {
    std::vector<std::unique_ptr<fit::Recording>> held;
    std::vector<const fit::Recording*> recordings;
    for (const FitSource& source : sources) {
      held.push_back(source.session->recording());
      recordings.push_back(held.back().get());
    }
    fit::WallOptions how;
    how.front = options.text("front");
    how.side = options.text("side");
    how.tolerance_mm = options.number("tolerance_mm");
    how.accuracy = fit::accuracy_of(recordings.front()->bench());
    try {
      return document(fit::fit_wall(recordings, how), recordings.front()->bench());
    } catch (const std::invalid_argument& error) {
      throw MeasurementError(std::string(error.what()) + ".");
    }
  }

 private:
  static json document(const fit::WallFit& fit, const fit::Bench& bench) {
    json out = new_result(
        "wall",
        "Right-angle wall calibration after a patent on mobile robots: both walls are found by RANSAC and "
        "fitted by "
        "least squares. Mounting angle, offset, walls and the corner's angle come from one joint "
        "least-squares fit "
        "of all beams, n . (R(stage) (m + rho u(yaw + beam))) = D, weighted by incidence; the patent's "
        "methods (slope of the front wall at stage angle 0; circle through the lidar's positions, RANSAC "
        "with 20 "
        "then "
        "10 mm, from both walls or from single square beams) are given for comparison.");
    add_values(out, fit, bench);
    out["use"].push_back(
        "x, y and yaw of the lidar on the stage are the bench file's lidar.mount: at stage angle theta the "
        "lidar's optical centre is at R(theta) (x, y) from the axis, and its beam at 0 deg points to theta "
        "+ yaw. x lies along the stage's zero direction, y to the left of it, seen from above; angles grow "
        "counter-clockwise.");
    compare_simpler(out, fit);
    compare_with_bench(out, fit, bench);
    add_ways(out, fit);
    add_observations(out, fit);
    add_plots(out, fit);
    add_remarks(out, fit);
    out["data"] = {{"captures", fit.means.size()},
                   {"beams", fit.beams},
                   {"capture_inflation", fit.capture_inflation},
                   {"walls", {fit.walls[0].name, fit.walls[1].name}}};
    return out;
  }
};

}  // namespace

std::unique_ptr<Fitting> make_wall() { return std::make_unique<Wall>(); }

}  // namespace rig::fittings
