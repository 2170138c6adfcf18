// SPDX-License-Identifier: MIT
#include "fit/centre.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>

#include "fit/number_format.hpp"
#include "fit/selection.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/edge_source.hpp"
#include "rig/fitting/result_document.hpp"

namespace rig::fittings {
namespace {

using nlohmann::json;
using Samples = std::vector<fit::Sample>;

/// The samples of some beams in one capture, by lidar step.
std::map<int, Samples> samples_of(const fit::Recording& recording, std::size_t index, int from_step,
                                  int to_step) {
  const fit::CaptureInfo& capture = recording.captures()[index];
  std::map<int, Samples> out;
  recording.for_each_scan(index, [&](const fit::ScanView& scan) {
    for (std::size_t k = 0; k < scan.range_mm.size(); ++k) {
      const int step = capture.first_step + static_cast<int>(k) * capture.cluster;
      if (step < from_step || step > to_step) continue;
      out[step].push_back(
          {scan.range_mm[k], k < scan.intensity.size() ? scan.intensity[k] : std::uint16_t{0}});
    }
  });
  return out;
}

/// One position of the stage: the sight of the edge by the full data, and by the paper's way.
struct Position {
  fit::CentrePoint point;        ///< At the edge itself.
  fit::CentrePoint paper_point;  ///< At the last smooth stop, from the most frequent intensity.
  fit::SelectedMean paper, robust;
  double u_edge_rad = 0, u_resolution_rad = 0, u_certificate_rad = 0;  ///< Parts of point.u_angle_rad.
  std::size_t capture = 0;
  const SourcedCrossing* source = nullptr;
};

/// The stop with most samples on the target alone; of equals the one nearest to the edge.
const fit::EdgeStop* best_smooth_stop(const fit::EdgeCrossing& crossing) {
  const fit::EdgeStop* best = nullptr;
  const auto distance = [&](const fit::EdgeStop& stop) {
    return std::abs(stop.stage_rad - crossing.response.edge_rad.value);
  };
  for (const fit::EdgeStop& stop : crossing.stops) {
    if (stop.state != fit::EdgeStop::State::front || distance(stop) > 0.5 * fit::rad_per_deg) continue;
    if (!best || stop.n > best->n || (stop.n == best->n && distance(stop) < distance(*best))) best = &stop;
  }
  return best;
}

/// How the range changes along the target, from the beams next to the edge; mm per radian of beam angle.
double slope_of(const std::map<int, Samples>& beams, const fit::LidarGeometry& lidar, double near_mm) {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (const auto& [step, samples] : beams) {
    const fit::SelectedMean mean = fit::select_robust(samples);
    if (mean.kept < 10 || std::abs(mean.mean_mm - near_mm) > 60) continue;
    const double a = lidar.beam_angle(step);
    n += 1, x += a, y += mean.mean_mm, xx += a * a, xy += a * mean.mean_mm;
  }
  const double spread = n * xx - x * x;
  return n >= 3 && spread > 0 ? (n * xy - x * y) / spread : 0;
}

/// Samples carry the mean of a run of scans: with 10 or more, correlation is measured and the mean is robust.
Position position_of(const SourcedCrossing& sourced, const fit::EdgeStop& stop) {
  const fit::EdgeCrossing& crossing = sourced.crossing;
  const fit::LidarGeometry& lidar = sourced.recording->bench().lidar;
  const int inward = crossing.right ? 1 : -1, reach = 6 * inward;
  const auto beams =
      samples_of(*sourced.recording, stop.capture, std::min(crossing.step, crossing.step + reach),
                 std::max(crossing.step, crossing.step + reach));
  Position position;
  position.capture = stop.capture;
  position.source = &sourced;
  position.robust = fit::select_robust(beams.at(crossing.step));
  position.paper = fit::select_most_frequent(beams.at(crossing.step));
  const double slope = slope_of(beams, lidar, position.robust.mean_mm);
  const double inside_rad = stop.stage_rad - crossing.response.edge_rad.value;
  position.point.stage_rad = crossing.response.edge_rad.value;
  position.point.beam_rad = crossing.beam_rad;
  position.point.range_mm = position.robust.mean_mm - slope * inside_rad;
  position.point.u_range_mm = std::hypot(position.robust.u_mm, slope * crossing.response.edge_rad.u);
  position.u_edge_rad = crossing.response.edge_rad.u;
  position.u_resolution_rad = u_of_resolution(sourced.recording->bench().stage_resolution_rad);
  position.paper_point = position.point;
  position.paper_point.stage_rad = stop.stage_rad;
  position.paper_point.range_mm = position.paper.mean_mm;
  position.paper_point.u_range_mm = position.paper.u_mm;
  // The paper's point lies anywhere within one step of the stage from the end of the window.
  position.paper_point.u_angle_rad = std::max(crossing.step_rad / std::sqrt(12.0), 1e-7);
  return position;
}

/// One position for each place where the stage stood: of crossings by neighbouring beams, the one whose
/// capture is longest.
std::vector<Position> positions_of(const EdgeSource& source, bool right, double worst_rad) {
  std::vector<Position> positions;
  for (const SourcedCrossing& sourced : source.crossings) {
    if (sourced.crossing.right != right || sourced.crossing.response.edge_rad.u > worst_rad) continue;
    const fit::EdgeStop* stop = best_smooth_stop(sourced.crossing);
    if (!stop) continue;
    const auto same_place = std::ranges::find_if(positions, [&](const Position& position) {
      return std::abs(position.point.stage_rad - sourced.crossing.response.edge_rad.value) <
             5 * fit::rad_per_deg;
    });
    if (same_place == positions.end())
      positions.push_back(position_of(sourced, *stop));
    else if (same_place->robust.samples < stop->n)
      *same_place = position_of(sourced, *stop);
  }
  std::ranges::sort(positions, {}, &Position::capture);
  return positions;
}

bool more_on_the_right(const EdgeSource& source) {
  long right = 0, left = 0;
  for (const auto& sourced : source.crossings) ++(sourced.crossing.right ? right : left);
  return right >= left;
}

std::vector<double> ellipse_axis(const Eigen::Vector2d& centre, const Eigen::Matrix2d& covariance, int axis) {
  const Eigen::LLT<Eigen::Matrix2d> root(covariance);
  std::vector<double> out;
  for (int i = 0; i <= 90; ++i) {
    const double a = 4 * fit::rad_per_deg * i;
    const Eigen::Vector2d offset = root.matrixL() * Eigen::Vector2d(std::cos(a), std::sin(a));
    out.push_back(centre(axis) + 2.486 * offset(axis));  // 95.45 % of a two-dimensional normal distribution.
  }
  return out;
}

std::string label(std::size_t first, std::size_t second) {
  return std::to_string(first + 1) + "-" + std::to_string(second + 1);
}

/// The board's line in one capture, if enough of it is in view.
std::optional<fit::BoardLine> line_of(const Position& position) {
  const fit::EdgeCrossing& crossing = position.source->crossing;
  const fit::Recording& recording = *position.source->recording;
  const fit::LidarGeometry& lidar = recording.bench().lidar;
  const int inward = crossing.right ? 1 : -1;
  const auto beams = samples_of(recording, position.capture, 0, lidar.steps);
  std::vector<Eigen::Vector2d> points;
  double previous = position.robust.mean_mm, variance = 0;
  for (int step = crossing.step + inward; beams.contains(step); step += inward) {
    const fit::SelectedMean mean = fit::select_robust(beams.at(step));
    if (mean.kept < 10 || std::abs(mean.mean_mm - previous) > 40) break;
    previous = mean.mean_mm;
    const double a = lidar.beam_angle(step);
    points.emplace_back(mean.mean_mm * std::cos(a), mean.mean_mm * std::sin(a));
    variance += mean.u_mm * mean.u_mm;
  }
  if (points.size() < 44) return std::nullopt;
  for (int i = 0; i < 4; ++i) points.pop_back();  // The far end may be an edge as well.
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const auto& point : points) mean += point / static_cast<double>(points.size());
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  for (const auto& point : points) scatter += (point - mean) * (point - mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(scatter);
  Eigen::Vector2d normal = axes.eigenvectors().col(0);
  if (normal.dot(mean) < 0) normal = -normal;
  const double n = static_cast<double>(points.size()), rms = std::sqrt(axes.eigenvalues()(0) / (n - 2));
  // The distance is that of the foot of the perpendicular, which may lie outside the points.
  const double lever = std::abs(Eigen::Vector2d(-normal.y(), normal.x()).dot(mean));
  const double u_mean = std::max(rms, std::sqrt(variance / n)) / std::sqrt(n);
  const double u_tilt = u_mean * std::sqrt(n / axes.eigenvalues()(1)) * lever;
  return fit::BoardLine{recording.captures()[position.capture].stage_rad, std::atan2(normal.y(), normal.x()),
                        normal.dot(mean), std::hypot(u_mean, u_tilt), static_cast<long>(points.size())};
}

class Centre : public Fitting {
 public:
  std::string kind() const override { return "centre"; }
  std::string describes() const override {
    return "where the stage's axis is in the lidar's frame, from one edge seen from several angles";
  }
  std::vector<FitOption> options() const override {
    auto all = edge_options();
    all.push_back({.name = "worst_edge_deg",
                   .unit = "deg",
                   .min = 1e-6,
                   .max = 10,
                   .otherwise = 0.01,
                   .about = "edges whose stage angle is less certain (standard uncertainty) are left out"});
    all.push_back({.name = "stage_u_deg",
                   .unit = "deg",
                   .min = 0,
                   .max = 10,
                   .otherwise = 0.0,
                   .about = "standard uncertainty of every stage angle, from its certificate"});
    return all;
  }

  json run(const std::vector<FitSource>& sources, const FitOptions& options) const override {
    const EdgeSource source = read_edges(sources, options);
    const bool right = more_on_the_right(source);
    auto positions = positions_of(source, right, options.number("worst_edge_deg") * fit::rad_per_deg);
    if (positions.size() < 2)
      throw MeasurementError(
          "the rotation centre needs one edge seen from at least two stage angles (four "
          "are better); the session has " +
          std::to_string(positions.size()) + " with the edge found to 0.01 deg among " +
          std::to_string(source.crossings.size()) +
          " crossings. Run find-edge at more stage angles, or give --option "
          "worst_edge_deg=...");
    const double u_stage = options.number("stage_u_deg") * fit::rad_per_deg;
    std::vector<fit::CentrePoint> points, paper_points;
    for (Position& position : positions) {
      position.u_certificate_rad = u_stage;
      position.point.u_angle_rad =
          std::hypot(position.u_edge_rad, position.u_resolution_rad, position.u_certificate_rad);
      points.push_back(position.point), paper_points.push_back(position.paper_point);
    }
    try {
      const fit::CentreFit all = fit::fit_centre(points);
      return document(source, positions, points, paper_points, all, right);
    } catch (const std::invalid_argument& error) {
      throw MeasurementError(std::string(error.what()) + ". Turn the stage further between positions.");
    }
  }

 private:
  static json document(const EdgeSource& source, const std::vector<Position>& positions,
                       const std::vector<fit::CentrePoint>& points,
                       const std::vector<fit::CentrePoint>& paper_points, const fit::CentreFit& all,
                       bool right) {
    json out = new_result(
        "centre",
        "Rotation centre after Zhao et al., experiment A5 (triangle method, formula corrected): the " +
            std::string(right ? "right" : "left") +
            " edge of the target is one physical point, seen by one beam at each stage angle. The result is "
            "the generalised least-squares centre of all positions, p_i = R(-stage_i) p + c, with the edge's "
            "stage angle from the share of jittering samples and the range from all samples; the paper's "
            "pairwise triangles from the most frequent intensity stand beside it.");
    add_values(out, all, positions);
    out["use"].push_back(how_to_use(all.centre));
    add_tables(out, positions, all);
    const std::vector<fit::CentrePair> pairs = add_pairs(out, paper_points);
    const auto lines = add_board_lines(out, positions);
    add_plot(out, all, pairs, lines);
    for (const std::string& note : source.notes) out["notes"].push_back(note);
    add_remarks(out, all, source, points);
    return out;
  }

  static double u_of(const Eigen::Matrix2d& covariance, int i) {
    return std::sqrt(std::max(0.0, covariance(i, i)));
  }

  /// The share of the centre's covariance that comes from one part of the angles' uncertainty.
  static Eigen::Matrix2d share_of(const fit::CentreFit& all, const std::vector<Position>& positions,
                                  double Position::*part) {
    Eigen::Matrix2d sum = Eigen::Matrix2d::Zero();
    for (std::size_t i = 0; i < positions.size(); ++i)
      sum += all.angle_parts[i] * std::pow(positions[i].*part / positions[i].point.u_angle_rad, 2);
    return sum;
  }

  static json budget_of(const fit::CentreFit& all, const std::vector<Position>& positions) {
    const Eigen::Matrix2d edge = share_of(all, positions, &Position::u_edge_rad),
                          resolution = share_of(all, positions, &Position::u_resolution_rad),
                          certificate = share_of(all, positions, &Position::u_certificate_rad);
    json budget = json::array();
    for (const int i : {0, 1}) {
      const std::string axis = i == 0 ? ", x" : ", y";
      budget.push_back(budget_line("range noise" + axis, "A", u_of(all.from_range, i), "mm"));
      budget.push_back(budget_line("angle at which the edge is met" + axis, "A", u_of(edge, i), "mm"));
      budget.push_back(budget_line("resolution of the stage (rectangular; bench file)" + axis, "B",
                                   u_of(resolution, i), "mm"));
      if (positions.front().u_certificate_rad > 0)
        budget.push_back(budget_line("stage angles (certificate)" + axis, "B", u_of(certificate, i), "mm"));
    }
    return budget;
  }

  static std::string how_to_use(const Eigen::Vector2d& centre) {
    const Eigen::Vector2d turned(centre.y(), 1000 - centre.x());  // R(90 deg) ((1000, 0) - centre)
    return "The lidar's frame has its origin at the optical centre, x along the beam at 0 deg and y to the "
           "left of it, seen from above; angles grow counter-clockwise. A point p seen there while the "
           "stage stands at theta is at R(theta) (p - c) from the axis, in the frame of the lidar at stage "
           "angle 0; c is this centre. Example: with the stage at 90 deg, (1000, 0) mm is at (" +
           fit::format_fixed(turned.x(), 1) + ", " + fit::format_fixed(turned.y(), 1) +
           ") mm. Where the lidar looks along the stage's zero, the bench file's mount is minus this centre.";
  }

  static void add_values(json& out, const fit::CentreFit& all, const std::vector<Position>& positions) {
    const auto u = u_of;
    out["values"].push_back(result_value("centre_x_mm", "Rotation centre in the lidar's frame, x",
                                         {all.centre.x(), u(all.covariance, 0)}, "mm"));
    out["values"].push_back(result_value("centre_y_mm", "Rotation centre in the lidar's frame, y",
                                         {all.centre.y(), u(all.covariance, 1)}, "mm"));
    const double distance = all.centre.norm();
    const double u_distance =
        distance > 0 ? std::sqrt(all.centre.dot(all.covariance * all.centre)) / distance : 0;
    out["values"].push_back(result_value("centre_distance_mm",
                                         "Distance of the centre from the lidar's origin",
                                         {distance, u_distance}, "mm"));
    out["values"].push_back(
        plain_value("positions", "Stage angles used", static_cast<double>(positions.size()), ""));
    out["covariance"] = {
        {"names", {"centre_x_mm", "centre_y_mm"}},
        {"matrix",
         {{all.covariance(0, 0), all.covariance(0, 1)}, {all.covariance(1, 0), all.covariance(1, 1)}}}};
    out["budget"] = budget_of(all, positions);
    out["data"] = {{"chi2", all.chi2},
                   {"degrees_of_freedom", all.degrees_of_freedom},
                   {"inflation", all.inflation},
                   {"condition", all.condition},
                   {"point_mm", {all.point.x(), all.point.y()}}};
  }

  static void add_tables(json& out, const std::vector<Position>& positions, const fit::CentreFit& all) {
    json rows = json::array(), selection = json::array();
    for (std::size_t i = 0; i < positions.size(); ++i) {
      const Position& p = positions[i];
      rows.push_back({i + 1, p.point.stage_rad * fit::deg_per_rad, p.point.u_angle_rad * fit::deg_per_rad,
                      p.point.beam_rad * fit::deg_per_rad, p.point.range_mm, p.point.u_range_mm,
                      p.point.position().x(), p.point.position().y(), all.residuals[i].x(),
                      all.residuals[i].y()});
      selection.push_back({i + 1, p.paper.samples, p.paper.rejected.no_echo, p.paper.rejected.abnormal,
                           p.paper.rejected.impulse, p.paper.rejected.other_intensity, p.paper.kept,
                           p.paper.intensity, p.paper.mean_mm, p.paper.u_mm, p.robust.mean_mm, p.robust.u_mm,
                           p.robust.effective});
    }
    out["tables"].push_back({{"title", "The edge seen from each position"},
                             {"columns",
                              {"position",
                               {{"name", "stage"}, {"unit", "deg"}},
                               {{"name", "u"}, {"unit", "deg"}},
                               {{"name", "beam"}, {"unit", "deg"}},
                               {{"name", "range"}, {"unit", "mm"}},
                               {{"name", "u"}, {"unit", "mm"}},
                               {{"name", "x"}, {"unit", "mm"}},
                               {{"name", "y"}, {"unit", "mm"}},
                               {{"name", "residual along"}, {"unit", "mm"}},
                               {{"name", "residual across"}, {"unit", "mm"}}}},
                             {"rows", rows}});
    out["tables"].push_back({{"title", "Selection of samples"},
                             {"columns",
                              {"position",
                               "samples",
                               "no echo",
                               "abnormal",
                               "impulse",
                               "other intensity",
                               "kept",
                               "most frequent intensity",
                               {{"name", "their mean"}, {"unit", "mm"}},
                               {{"name", "u"}, {"unit", "mm"}},
                               {{"name", "robust mean of all"}, {"unit", "mm"}},
                               {{"name", "u"}, {"unit", "mm"}},
                               "independent samples"}},
                             {"rows", selection}});
  }

  /// The paper's table has the consecutive pairs; the others follow.
  static std::vector<fit::CentrePair> add_pairs(json& out, const std::vector<fit::CentrePoint>& points) {
    std::vector<fit::CentrePair> pairs;
    json rows = json::array();
    Eigen::Vector2d mean = Eigen::Vector2d::Zero();
    int consecutive = 0;
    for (std::size_t apart = 1; apart < points.size(); ++apart)
      for (std::size_t i = 0; i + apart < points.size(); ++i) {
        const double turn = points[i + apart].stage_rad - points[i].stage_rad;
        if (std::abs(std::sin(turn / 2)) < 0.01) continue;
        pairs.push_back(fit::centre_of_pair(points, i, i + apart));
        const fit::CentrePair& pair = pairs.back();
        if (apart == 1) mean += pair.centre, ++consecutive;
        rows.push_back({label(i, i + apart), turn * fit::deg_per_rad, pair.centre.x(),
                        std::sqrt(pair.covariance(0, 0)), pair.centre.y(), std::sqrt(pair.covariance(1, 1))});
      }
    if (consecutive > 0)
      rows.push_back({"mean of consecutive pairs (paper)", nullptr, mean.x() / consecutive, nullptr,
                      mean.y() / consecutive, nullptr});
    out["tables"].push_back({{"title", "Pairwise triangles, most frequent intensity (the paper's way)"},
                             {"columns",
                              {"pair",
                               {{"name", "turn"}, {"unit", "deg"}},
                               {{"name", "x"}, {"unit", "mm"}},
                               {{"name", "u(x)"}, {"unit", "mm"}},
                               {{"name", "y"}, {"unit", "mm"}},
                               {{"name", "u(y)"}, {"unit", "mm"}}}},
                             {"rows", rows}});
    return pairs;
  }

  static std::optional<fit::CentreFit> add_board_lines(json& out, const std::vector<Position>& positions) {
    std::vector<fit::BoardLine> lines;
    for (const Position& position : positions)
      if (const auto line = line_of(position)) lines.push_back(*line);
    if (lines.size() < 3) return std::nullopt;
    try {
      const fit::CentreFit centre = fit::fit_centre_from_lines(lines);
      json rows = {{"x", centre.centre.x(), std::sqrt(centre.covariance(0, 0))},
                   {"y", centre.centre.y(), std::sqrt(centre.covariance(1, 1))}};
      out["tables"].push_back(
          {{"title", "Check: centre from the distance of the target's line, without its edge"},
           {"columns", {"coordinate", {{"name", "value"}, {"unit", "mm"}}, {{"name", "u"}, {"unit", "mm"}}}},
           {"rows", rows}});
      return centre;
    } catch (const std::invalid_argument&) {
      return std::nullopt;
    }
  }

  static void add_plot(json& out, const fit::CentreFit& all, const std::vector<fit::CentrePair>& pairs,
                       const std::optional<fit::CentreFit>& lines) {
    json plot = new_plot("Rotation centre in the lidar's frame", "x (mm)", "y (mm)");
    plot["equal_axes"] = true;
    std::vector<double> x, y;
    for (const fit::CentrePair& pair : pairs) x.push_back(pair.centre.x()), y.push_back(pair.centre.y());
    add_series(plot, "pairwise triangles", "points", x, y);
    add_series(plot, "least squares", "points", {all.centre.x()}, {all.centre.y()});
    add_series(plot, "95 % region", "ellipse", ellipse_axis(all.centre, all.covariance, 0),
               ellipse_axis(all.centre, all.covariance, 1));
    if (lines) add_series(plot, "from the target's line", "points", {lines->centre.x()}, {lines->centre.y()});
    out["plots"].push_back(std::move(plot));
  }

  static void add_remarks(json& out, const fit::CentreFit& all, const EdgeSource& source,
                          const std::vector<fit::CentrePoint>& points) {
    if (all.inflation > 1)
      out["notes"].push_back(
          "The positions disagree by more than their uncertainties (chi-square " + fit::format_fixed(all.chi2, 1) +
          " with " + std::to_string(all.degrees_of_freedom) +
          " degrees of freedom); the uncertainty was widened by " + fit::format_fixed(all.inflation, 2) +
          ". Angle errors of lidar or stage are the usual cause: rig explain looks for it.");
    if (all.degrees_of_freedom < 1)
      out["notes"].push_back("Two positions leave nothing to check the result with; use three or more.");
    double worst = std::sqrt(std::max(all.covariance(0, 0), all.covariance(1, 1)));
    if (worst > 2)
      out["notes"].push_back(
          "The stage turned little between the positions, which leaves the centre uncertain "
          "by " +
          fit::format_fixed(worst, 1) + " mm; turn by 90 deg or more in all.");
    compare_with_mount(out, all, source.recordings.front()->bench().lidar.mount);
    const double range = points.front().range_mm;
    out["undetermined"].push_back(
        "a once-a-turn angle error of the lidar's encoder or of the stage: 0.01 deg of it looks like " +
        fit::format_fixed(range * 0.01 * fit::rad_per_deg, 2) +
        " mm of centre, and is not in the uncertainty unless given as stage_u_deg");
  }

  /// The bench knows the mount: the lidar's origin at stage angle 0, seen from the axis.
  static void compare_with_mount(json& out, const fit::CentreFit& all, const fit::Mount& mount) {
    const double c = std::cos(-mount.yaw_rad.value), s = std::sin(-mount.yaw_rad.value);
    const Eigen::Vector2d expected(-(c * mount.x_mm.value - s * mount.y_mm.value),
                                   -(s * mount.x_mm.value + c * mount.y_mm.value));
    const Eigen::Vector2d off = all.centre - expected;
    const double ux = std::hypot(mount.x_mm.u, std::sqrt(all.covariance(0, 0)));
    const double uy = std::hypot(mount.y_mm.u, std::sqrt(all.covariance(1, 1)));
    if (mount.x_mm.u > 0 && mount.y_mm.u > 0 && (std::abs(off.x()) > 4 * ux || std::abs(off.y()) > 4 * uy))
      out["notes"].push_back("The bench file's mount puts the centre at (" + fit::format_fixed(expected.x(), 1) +
                             ", " + fit::format_fixed(expected.y(), 1) +
                             ") mm, which these captures contradict; correct the bench file's mount.");
  }
};

}  // namespace

std::unique_ptr<Fitting> make_centre() { return std::make_unique<Centre>(); }

}  // namespace rig::fittings
