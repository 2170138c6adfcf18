// SPDX-License-Identifier: MIT
#include "fit/range/centre.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>

#include "fit/numeric/dense.hpp"
#include "fit/numeric/distributions.hpp"
#include "fit/numeric/number_format.hpp"
#include "fit/range/selection.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/centre_positions.hpp"
#include "rig/fitting/edge_source.hpp"
#include "rig/fitting/result_document.hpp"
#include "rig/fitting/uncertainty_budget.hpp"

namespace rig::fittings {
namespace {

using nlohmann::json;
using namespace centre_parts;

bool more_on_the_right(const EdgeSource& source) {
  long right = 0, left = 0;
  for (const auto& sourced : source.crossings) ++(sourced.crossing.right ? right : left);
  return right >= left;
}

std::vector<double> ellipse_axis(const Eigen::Vector2d& centre, const Eigen::Matrix2d& covariance, int axis) {
  const Eigen::Matrix2d root = fit::dense::cholesky(covariance);
  std::vector<double> out;
  for (int i = 0; i <= 90; ++i) {
    const double a = 4 * fit::rad_per_deg * i;
    const Eigen::Vector2d offset = root * Eigen::Vector2d(std::cos(a), std::sin(a));
    out.push_back(centre(axis) + 2.486 * offset(axis));  // 95.45 % of a two-dimensional normal distribution.
  }
  return out;
}

std::string label(std::size_t first, std::size_t second) {
  return std::to_string(first + 1) + "-" + std::to_string(second + 1);
}

class Centre : public Fitting {
 public:
  std::string kind() const override { return "centre"; }
  std::string describes() const override {
    return "where the stage's axis is in the lidar's frame, from one edge seen from several angles";
  }
  std::vector<std::string> values() const override {
    return {"centre_x_mm", "centre_y_mm", "centre_distance_mm", "positions"};
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
          "the rotation centre needs one edge seen from at least two stage angles that are 5 deg apart (four "
          "are better); the session has " +
          std::to_string(positions.size()) + " with the edge found to " +
          fit::format_exactly(options.number("worst_edge_deg")) + " deg among " +
          std::to_string(source.crossings.size()) +
          " crossings. Run find-edge with beams that are farther apart (beam_deg), or give --option "
          "worst_edge_deg=...");
    const fit::DeviceAccuracy accuracy = fit::accuracy_of(source.recordings.front()->bench());
    const double u_stage =
        std::hypot(options.number("stage_u_deg") * fit::rad_per_deg, accuracy.stage_position_rad.u);
    std::vector<fit::CentrePoint> points, paper_points;
    for (Position& position : positions) {
      position.u_certificate_rad = u_stage;
      position.point.u_angle_rad =
          std::hypot(position.u_edge_rad, position.u_resolution_rad, position.u_certificate_rad);
      fit::CentrePoint& paper = position.paper_point;
      paper.u_angle_rad =
          std::hypot(paper.u_angle_rad, position.u_resolution_rad, position.u_certificate_rad);
      points.push_back(position.point), paper_points.push_back(paper);
    }
    try {
      const CommonEffects common = effects_on(positions, accuracy);
      const fit::CentreFit all = fit::fit_centre(points, common.effects);
      json out = document(source, positions, paper_points, all, common, accuracy, right);
      compare_recordings(out, source, positions, points, accuracy);
      return out;
    } catch (const std::invalid_argument& error) {
      throw MeasurementError(std::string(error.what()) + ". Turn the stage further between positions.");
    }
  }

 private:
  static json document(const EdgeSource& source, const std::vector<Position>& positions,
                       const std::vector<fit::CentrePoint>& paper_points, const fit::CentreFit& all,
                       const CommonEffects& common, const fit::DeviceAccuracy& accuracy, bool right) {
    json out = new_result(
        "centre",
        "Rotation centre after Zhao et al., experiment A5 (triangle method, formula corrected): the " +
            std::string(right ? "right" : "left") +
            " edge of the target is one physical point, seen by one beam at each stage angle. The result is "
            "the generalised least-squares centre of all positions, p_i = R(-stage_i) p + c, with the edge's "
            "stage angle from the share of jittering samples and the range from all samples; the paper's "
            "pairwise triangles from the most frequent intensity are given for comparison.");
    add_values(out, all, positions, common);
    out["use"].push_back(how_to_use(all.centre));
    add_tables(out, positions, all);
    const std::vector<fit::CentrePair> pairs = add_pairs(out, paper_points, common.effects);
    const auto lines = add_board_lines(out, positions, accuracy);
    if (lines) compare(out, all, *lines);
    add_plot(out, all, pairs, lines);
    for (const std::string& what : source.contradictions) out["contradictions"].push_back(what);
    add_remarks(out, all, source);
    return out;
  }

  /// The centre that one recording gives by itself.
  struct OwnCentre {
    std::string name;
    fit::CentreFit fit;
  };

  /// Nothing of recordings that do not determine one.
  static std::vector<OwnCentre> own_centres(const EdgeSource& source, const std::vector<Position>& positions,
                                            const std::vector<fit::CentrePoint>& points,
                                            const fit::DeviceAccuracy& accuracy) {
    std::vector<OwnCentre> out;
    for (std::size_t r = 0; r < source.recordings.size(); ++r) {
      std::vector<Position> own;
      std::vector<fit::CentrePoint> sights;
      for (std::size_t i = 0; i < positions.size(); ++i)
        if (positions[i].source->recording == source.recordings[r].get())
          own.push_back(positions[i]), sights.push_back(points[i]);
      try {
        out.push_back({source.names[r], fit::fit_centre(sights, effects_on(own, accuracy).effects)});
      } catch (const std::invalid_argument&) {
      }
    }
    return out;
  }

  /// Recordings of one lidar on one stage have one centre: tested for every two of them, falsely doubted in 1
  /// of 1,000 fits. What the devices do to both alike is no difference.
  static void compare_recordings(json& out, const EdgeSource& source, const std::vector<Position>& positions,
                                 const std::vector<fit::CentrePoint>& points,
                                 const fit::DeviceAccuracy& accuracy) {
    if (source.recordings.size() < 2) return;
    const std::vector<OwnCentre> centres = own_centres(source, positions, points, accuracy);
    const double tests = static_cast<double>(centres.size() * (centres.size() - 1)) / 2;
    const auto place = [](const Eigen::Vector2d& at) {
      return "(" + fit::format_fixed(at.x(), 1) + ", " + fit::format_fixed(at.y(), 1) + ") mm";
    };
    for (std::size_t a = 0; a < centres.size(); ++a)
      for (std::size_t b = a + 1; b < centres.size(); ++b) {
        const fit::CentreFit &one = centres[a].fit, &other = centres[b].fit;
        const Eigen::Vector2d off = one.centre - other.centre;
        Eigen::Matrix2d covariance = one.from_range + one.from_angle + other.from_range + other.from_angle;
        for (std::size_t k = 0; k < one.effects.size(); ++k) {
          const Eigen::Vector2d apart = one.effects[k] - other.effects[k];
          covariance += apart * apart.transpose();
        }
        const Eigen::Vector2d weighed = fit::dense::solve_symmetric(covariance, off);
        const double chi2 = off.dot(weighed);
        if (chi2 <= fit::chi_squared_quantile(2, 1 - 1e-3 / tests)) continue;
        out["contradictions"].push_back("The recordings have different centres: " + centres[a].name + " " +
                                        place(one.centre) + ", " + centres[b].name + " " +
                                        place(other.centre) +
                                        ". The lidar was mounted anew between them, or a target moved within "
                                        "one. Calibrate each by itself");
      }
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

  /// Root mean square over the positions.
  static double typical_u_edge_rad(const std::vector<Position>& positions) {
    double square = 0;
    for (const Position& position : positions) square += std::pow(position.u_edge_rad, 2);
    return std::sqrt(square / static_cast<double>(positions.size()));
  }

  /// The budget of the centre along one direction: what each input adds there.
  static UncertaintyBudget budget_of(const fit::CentreFit& all, const std::vector<Position>& positions,
                                     const CommonEffects& common, const Eigen::Vector2d& along,
                                     const std::string& name, const std::string& label) {
    const auto u = [&](const Eigen::Matrix2d& part) {
      return std::sqrt(std::max(0.0, along.dot(part * along)));
    };
    const auto share = [&](double Position::*part) { return u(share_of(all, positions, part)); };
    // Widened by the scatter of few positions, it is known no better than they tell it.
    const double freedom = all.inflation > 1 ? all.degrees_of_freedom : Contribution::many;
    double samples = 0;
    for (const Position& position : positions) samples += std::max(0.0, position.robust.effective - 1);
    UncertaintyBudget out(name, label, "mm");
    out.add({.source = "range noise",
             .kind = 'A',
             .distribution = "normal",
             .u = u(all.from_range),
             .freedom = all.inflation > 1 ? freedom : std::max(1.0, samples)});
    out.add({.source = "angle at which the edge is met",
             .kind = 'A',
             .distribution = "normal",
             .u = share(&Position::u_edge_rad),
             .freedom = freedom,
             .input_u = typical_u_edge_rad(positions) * fit::deg_per_rad,
             .input_unit = "deg"});
    out.add({.source = "resolution of the stage (bench file)",
             .distribution = "rectangular",
             .u = share(&Position::u_resolution_rad),
             .freedom = freedom,
             .input_u = positions.front().u_resolution_rad * fit::deg_per_rad,
             .input_unit = "deg"});
    if (positions.front().u_certificate_rad > 0)
      out.add({.source = "single positions of the stage (bench file, or stage_u_deg)",
               .distribution = "normal",
               .u = share(&Position::u_certificate_rad),
               .freedom = freedom,
               .input_u = positions.front().u_certificate_rad * fit::deg_per_rad,
               .input_unit = "deg"});
    // Sine and cosine, or several curves, of one deviation are one line.
    for (std::size_t k = 0; k < common.lines.size(); ++k) {
      double square = 0;
      bool first = true;
      for (std::size_t j = 0; j < common.lines.size(); ++j) {
        if (common.lines[j].member != common.lines[k].member) continue;
        first = first && j >= k;
        square += std::pow(along.dot(all.effects[j]), 2);
      }
      if (first) out.add(common.lines[k], std::sqrt(square));
    }
    return out;
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

  static void add_values(json& out, const fit::CentreFit& all, const std::vector<Position>& positions,
                         const CommonEffects& common) {
    const auto add = [&](const Eigen::Vector2d& along, double value, const char* name, const char* label) {
      budget_of(all, positions, common, along, name, label).publish(out, value);
    };
    add(Eigen::Vector2d::UnitX(), all.centre.x(), "centre_x_mm", "Rotation centre in the lidar's frame, x");
    add(Eigen::Vector2d::UnitY(), all.centre.y(), "centre_y_mm", "Rotation centre in the lidar's frame, y");
    const double distance = all.centre.norm();
    if (distance > 0)
      add(all.centre / distance, distance, "centre_distance_mm",
          "Distance of the centre from the lidar's origin");
    out["values"].push_back(
        plain_value("positions", "Stage angles used", static_cast<double>(positions.size()), ""));
    out["covariance"] = {
        {"names", {"centre_x_mm", "centre_y_mm"}},
        {"matrix",
         {{all.covariance(0, 0), all.covariance(0, 1)}, {all.covariance(1, 0), all.covariance(1, 1)}}}};
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
  static std::vector<fit::CentrePair> add_pairs(json& out, const std::vector<fit::CentrePoint>& points,
                                                const std::vector<fit::CentreEffect>& effects) {
    std::vector<fit::CentrePair> pairs, consecutive;
    json rows = json::array();
    for (std::size_t apart = 1; apart < points.size(); ++apart)
      for (std::size_t i = 0; i + apart < points.size(); ++i) {
        const double turn = points[i + apart].stage_rad - points[i].stage_rad;
        if (std::abs(std::sin(turn / 2)) < 0.01) continue;
        pairs.push_back(fit::centre_of_pair(points, i, i + apart, effects));
        const fit::CentrePair& pair = pairs.back();
        if (apart == 1) consecutive.push_back(pair);
        rows.push_back({label(i, i + apart), turn * fit::deg_per_rad, pair.centre.x(),
                        std::sqrt(pair.covariance(0, 0)), pair.centre.y(), std::sqrt(pair.covariance(1, 1))});
      }
    if (!consecutive.empty()) {
      const fit::CentreMean mean = fit::mean_of_pairs(points, consecutive, effects);
      rows.push_back({"mean of consecutive pairs (paper)", nullptr, mean.centre.x(), u_of(mean.covariance, 0),
                      mean.centre.y(), u_of(mean.covariance, 1)});
    }
    out["tables"].push_back(
        {{"title",
          "Pairwise triangles, most frequent intensity (the paper's method; u: samples, one step "
          "and the resolution of the stage, and what the budget allows for in the devices)"},
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

  static std::optional<fit::CentreFit> add_board_lines(json& out, const std::vector<Position>& positions,
                                                       const fit::DeviceAccuracy& accuracy) {
    std::vector<fit::BoardLine> lines;
    fit::LineEffect scale{"range scale", {}}, sine{"encoder, sine", {}}, cosine{"encoder, cosine", {}};
    for (const Position& position : positions) {
      const std::vector<BoardPoint> seen = board_seen(position);
      if (seen.empty()) continue;
      const auto bent = [&](const auto& bend) { return line_through(seen, sourced_stage(position), bend); };
      const double u = accuracy.beam_eccentricity_rad.u / std::sqrt(2.0);
      lines.push_back(bent([](double) { return 0.0; }));
      const double distance = lines.back().distance_mm;
      scale.shift_mm.push_back(accuracy.range_scale.u * distance);
      sine.shift_mm.push_back(bent([u](double a) { return u * std::sin(a); }).distance_mm - distance);
      cosine.shift_mm.push_back(bent([u](double a) { return u * std::cos(a); }).distance_mm - distance);
    }
    if (lines.size() < 3) return std::nullopt;
    try {
      const fit::CentreFit centre = fit::fit_centre_from_lines(lines, {scale, sine, cosine});
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

  static double sourced_stage(const Position& position) {
    return position.source->recording->captures()[position.capture].stage_rad;
  }

  static void compare(json& out, const fit::CentreFit& all, const fit::CentreFit& lines) {
    for (const int i : {0, 1})
      compare_methods(out, i == 0 ? "Rotation centre, x" : "Rotation centre, y",
                      {"by the target's edge", {all.centre(i), u_of(all.covariance, i)}},
                      {"by the target's line", {lines.centre(i), u_of(lines.covariance, i)}}, "mm");
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

  static void add_remarks(json& out, const fit::CentreFit& all, const EdgeSource& source) {
    if (all.inflation > 1)
      out["notes"].push_back(
          "The positions disagree by more than their uncertainties (chi-square " +
          fit::format_fixed(all.chi2, 1) + " with " + std::to_string(all.degrees_of_freedom) +
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
      out["contradictions"].push_back(
          "The bench file's mount puts the centre at (" + fit::format_fixed(expected.x(), 1) + ", " +
          fit::format_fixed(expected.y(), 1) +
          ") mm, which these captures contradict; correct the bench file's mount.");
  }
};

}  // namespace

std::unique_ptr<Fitting> make_centre() { return std::make_unique<Centre>(); }

}  // namespace rig::fittings
