// SPDX-License-Identifier: MIT
#include "fit/wall.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "fit/angle.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"
#include "rig/fitting/result_document.hpp"

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

fit::Estimate widened(const fit::Estimate& estimate, double u) {
  return {estimate.value, std::hypot(estimate.u, u)};
}

void add_values(json& out, const fit::WallFit& fit, const fit::Bench& bench) {
  const double stage_u = u_of_stage_deg(fit, bench);
  const fit::Estimate angle = widened(degrees(joint(fit, 0)), stage_u);
  const double board_u = fit.walls[0].u_rad * fit::deg_per_rad;
  json& values = out["values"];
  values.push_back(result_value("mounting_angle_deg",
                                "Mounting angle against the front wall, at stage angle 0", angle, "deg"));
  values.push_back(result_value("radius_mm", "Distance of the lidar from the axis", fit.radius_mm, "mm"));
  values.push_back(result_value("direction_deg", "Direction of that offset, at stage angle 0",
                                widened(degrees(fit.direction_rad), stage_u), "deg"));
  values.push_back(result_value("mount_x_mm", "Lidar on the stage, x", joint(fit, 1), "mm"));
  values.push_back(result_value("mount_y_mm", "Lidar on the stage, y", joint(fit, 2), "mm"));
  values.push_back(result_value("mount_yaw_deg",
                                "Lidar on the stage, yaw (with the front board's orientation)",
                                {angle.value, std::hypot(angle.u, board_u)}, "deg"));
  values.push_back(result_value("front_mm", "Front wall from the axis", joint(fit, 3), "mm"));
  values.push_back(result_value("side_mm", "Side wall from the axis", joint(fit, 4), "mm"));
  const double corner =
      fit::wrap_angle(fit.walls[1].line.normal_rad - fit.walls[0].line.normal_rad) * fit::deg_per_rad;
  const fit::Estimate bend = degrees(joint(fit, 5));
  values.push_back(result_value("corner_deg", "Angle from the front wall to the side wall",
                                {corner + bend.value, bend.u}, "deg"));
  values.push_back(
      plain_value("range_noise_mm", "Standard deviation of one range", fit.range_noise_mm, "mm"));
  json matrix = json::array();
  const double scale[] = {fit::deg_per_rad, 1, 1, 1, 1, fit::deg_per_rad};
  for (int i = 0; i < 6; ++i) {
    json row = json::array();
    for (int k = 0; k < 6; ++k)
      row.push_back(scale[i] * scale[k] * fit.covariance(i, k) + (i == 0 && k == 0 ? stage_u * stage_u : 0));
    matrix.push_back(row);
  }
  out["covariance"] = {
      {"names", {"mounting_angle_deg", "mount_x_mm", "mount_y_mm", "front_mm", "side_mm", "corner_deg"}},
      {"matrix", matrix}};
  out["budget"] = {
      budget_line("ranges, mounting angle", "A", degrees(joint(fit, 0)).u, "deg"),
      budget_line("resolution of the stage (rectangular; bench file), angles", "B", stage_u, "deg"),
      budget_line("ranges, distance from the axis", "A", fit.radius_mm.u, "mm"),
      budget_line("orientation of the front board (bench), yaw only", "B", board_u, "deg")};
}

void add_ways(json& out, const fit::WallFit& fit) {
  json rows = json::array();
  const auto row = [&](const std::string& way, const fit::Estimate& radius, const fit::Estimate& direction,
                       std::size_t points, std::size_t inliers) {
    const fit::Estimate d = degrees(direction);
    const bool circle = radius.value > 0;
    rows.push_back({way, circle ? json(radius.value) : json(nullptr), circle ? json(radius.u) : json(nullptr),
                    number_or_null(d.value), d.u > 0 ? json(d.u) : json(nullptr), points, inliers});
  };
  row("joint least squares of all beams", fit.radius_mm, fit.direction_rad, fit.beams, fit.beams);
  for (const fit::WallCircle& way : fit.ways)
    row(way.way, way.radius_mm, way.direction_rad, way.points, way.inliers);
  out["tables"].push_back({{"title", "The offset by each way"},
                           {"columns",
                            {"way", unit_column("radius", "mm"), unit_column("u", "mm"),
                             unit_column("direction", "deg"), unit_column("u", "deg"), "points", "used"}},
                           {"rows", rows}});
  json angles = json::array();
  const fit::Estimate own = degrees(joint(fit, 0)), patent = degrees(fit.patent_angle_rad);
  angles.push_back({"joint least squares of all beams", own.value, own.u, fit.means.size()});
  if (fit.repeats > 0)
    angles.push_back(
        {"patent: mean slope of the front wall at stage angle 0", patent.value, patent.u, fit.repeats});
  out["tables"].push_back(
      {{"title", "The mounting angle by each way"},
       {"columns", {"way", unit_column("angle", "deg"), unit_column("u", "deg"), "captures"}},
       {"rows", angles}});
}

void add_sights(json& out, const fit::WallFit& fit) {
  json rows = json::array();
  for (const fit::WallSight& sight : fit.means) {
    json row = {sight.stage_rad * fit::deg_per_rad};
    for (const auto& wall : sight.walls) {
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
    for (const fit::WallSight& sight : fit.means) {
      if (!sight.walls[j]) continue;
      x.push_back(sight.stage_rad * fit::deg_per_rad);
      y.push_back(sight.walls[j]->line.distance_mm - fit.joint[3 + j]);
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
        "The patent's mounting angle asks for at least three captures at stage angle 0; there are " +
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
        "of all beams, n . (R(stage) (m + rho u(yaw + beam))) = D, weighted by incidence; the patent's ways "
        "(slope of the front wall at stage angle 0; circle through the lidar's positions, RANSAC with 20 "
        "then "
        "10 mm, from both walls or from single square beams) stand beside.");
    add_values(out, fit, bench);
    out["use"].push_back(
        "x, y and yaw of the lidar on the stage are the bench file's lidar.mount: at stage angle theta the "
        "lidar's optical centre is at R(theta) (x, y) from the axis, and its beam at 0 deg points to theta "
        "+ yaw. x lies along the stage's zero direction, y to the left of it, seen from above; angles grow "
        "counter-clockwise.");
    add_ways(out, fit);
    add_sights(out, fit);
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
