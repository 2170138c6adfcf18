// SPDX-License-Identifier: MIT
#include "fit/odometry.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"
#include "rig/fitting.hpp"

namespace rig::fittings {
namespace {

using nlohmann::json;

json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }

struct Parameter {
  const char *name, *label, *unit;
  double scale;  ///< From the inside unit.
};
constexpr Parameter parameters[] = {{"left_radius_mm", "Left wheel's radius", "mm", 1},
                                    {"right_radius_mm", "Right wheel's radius", "mm", 1},
                                    {"separation_mm", "Wheel separation", "mm", 1},
                                    {"lidar_x_mm", "Lidar on the robot, x", "mm", 1},
                                    {"lidar_y_mm", "Lidar on the robot, y", "mm", 1},
                                    {"lidar_yaw_deg", "Lidar on the robot, yaw", "deg", fit::deg_per_rad}};

/// One object a line: T in s, phi_l and phi_r in rad/s, sm = [x m, y m, theta rad] (the format of Censi's
/// public programs).
std::vector<fit::WheelSample> read_tuples(const std::string& path) {
  std::ifstream in(path);
  if (!in) throw UsageError(path + " cannot be opened. Check the name and the permissions.");
  std::vector<fit::WheelSample> samples;
  try {
    while (in >> std::ws && !in.eof()) {
      json line;
      in >> line;
      const json& match = line.at("sm");
      samples.push_back({line.at("T"),
                         line.at("phi_l"),
                         line.at("phi_r"),
                         {1000 * match.at(0).get<double>(), 1000 * match.at(1).get<double>(), match.at(2)}});
    }
  } catch (const json::exception& error) {
    throw UsageError(path + ", object " + std::to_string(samples.size() + 1) + ": " + error.what() +
                     ". A tuple file holds objects like {\"T\": 0.8, \"phi_l\": 0.49, \"phi_r\": -0.51, "
                     "\"sm\": [0.001, -0.0005, -0.18]}: s, rad/s, rad/s, and the scan match in m, m, rad.");
  }
  return samples;
}

json values_of(const fit::OdometryFit& fit) {
  json values = json::array();
  for (int i = 0; i < 6; ++i) {
    const Parameter& p = parameters[i];
    const double u = p.scale * std::sqrt(fit.covariance(i, i));
    values.push_back({{"name", p.name},
                      {"label", p.label},
                      {"value", number(p.scale * fit.robot.vector()[i])},
                      {"u", number(u)},
                      {"unit", p.unit},
                      {"k", 2},
                      {"U", number(2 * u)}});
  }
  return values;
}

json covariance_of(const Eigen::Matrix<double, 6, 6>& covariance) {
  json names = json::array(), matrix = json::array();
  for (int i = 0; i < 6; ++i) {
    names.push_back(parameters[i].name);
    json row = json::array();
    for (int k = 0; k < 6; ++k)
      row.push_back(number(parameters[i].scale * parameters[k].scale * covariance(i, k)));
    matrix.push_back(row);
  }
  return {{"names", names}, {"matrix", matrix}};
}

json rounds_table(const fit::OdometryFit& fit) {
  json rows = json::array();
  for (std::size_t i = 0; i < fit.rounds.size(); ++i) {
    const fit::OdometryRound& round = fit.rounds[i];
    json row = {i, round.samples};
    for (int k = 0; k < 6; ++k) row.push_back(number(parameters[k].scale * round.robot.vector()[k]));
    for (int k = 0; k < 3; ++k)
      row.push_back(number(round.residual_rms[k] * (k == 2 ? fit::deg_per_rad : 1)));
    rows.push_back(row);
  }
  json columns = {"round", "samples"};
  for (const Parameter& p : parameters) columns.push_back({{"name", p.label}, {"unit", p.unit}});
  columns.push_back({{"name", "residual along"}, {"unit", "mm"}});
  columns.push_back({{"name", "residual across"}, {"unit", "mm"}});
  columns.push_back({{"name", "residual of heading"}, {"unit", "deg"}});
  return {{"title", "Rounds of dropping the worst samples"}, {"columns", columns}, {"rows", rows}};
}

json motion_table(const fit::MotionShares& motion) {
  json table = {{"title", "How the robot moved"},
                {"columns", {"motion", {{"name", "share"}, {"unit", "%"}}}},
                {"rows", json::array()}};
  table["rows"].push_back({"still", 100 * motion.still});
  table["rows"].push_back({"straight", 100 * motion.straight});
  table["rows"].push_back({"turning on the spot", 100 * motion.on_the_spot});
  table["rows"].push_back({"curve", 100 * motion.curve});
  return table;
}

json residual_plot(const fit::OdometryFit& fit, const std::vector<fit::WheelSample>& samples) {
  json series = json::array();
  for (const bool used : {true, false}) {
    json x = json::array(), y = json::array();
    for (std::size_t k = 0; k < samples.size(); ++k) {
      if (fit.used[k] != used) continue;
      const Eigen::Vector3d e = fit::odometry_residual(fit.robot, samples[k]);
      x.push_back(k);
      y.push_back(number(e[2] * fit::deg_per_rad));
    }
    series.push_back({{"name", used ? "used" : "dropped"}, {"style", "points"}, {"x", x}, {"y", y}});
  }
  return {{"title", "Heading: scan match minus odometry"},
          {"x_label", "sample"},
          {"y_label", "difference (deg)"},
          {"series", series}};
}

class Odometry : public Fitting {
 public:
  std::string kind() const override { return "odometry"; }
  std::string describes() const override {
    return "wheel radii, wheel separation and the lidar's pose on the robot, from wheels and scan matches";
  }
  bool accepts_files() const override { return true; }
  std::vector<std::pair<std::string, std::string>> options() const override {
    return {{"rounds", "how often the worst samples are dropped (4)"},
            {"outlier_share", "share of the samples dropped in each round (0.01)"},
            {"refine", "maximum likelihood over all six after the closed form (false)"}};
  }

  json run(const std::vector<FitSource>& sources, const json& options) const override {
    std::vector<fit::WheelSample> samples;
    for (const FitSource& source : sources) {
      if (source.session)
        throw UsageError(source.path + " is a session: this calibration reads tuple files so far.");
      const auto more = read_tuples(source.path);
      samples.insert(samples.end(), more.begin(), more.end());
    }
    fit::OdometryOptions how;
    how.rounds = std::clamp(options.value("rounds", how.rounds), 0, 50);
    how.outlier_share = std::clamp(options.value("outlier_share", how.outlier_share), 0.0, 0.5);
    how.refine = options.value("refine", how.refine);
    if (samples.size() < 20)
      throw MeasurementError("Only " + std::to_string(samples.size()) +
                             " samples: at least 20 are needed, and some hundreds for a good result.");
    return document(fit::fit_odometry(samples, how), samples);
  }

 private:
  static json document(const fit::OdometryFit& fit, const std::vector<fit::WheelSample>& samples) {
    json out = {{"schema", "result/1"}, {"kind", "odometry"}};
    out["method"] =
        "Simultaneous calibration of odometry and lidar pose after Censi, Franchi, Marchionni and Oriolo "
        "(IEEE T-RO 2013): turning gains of the wheels by weighted linear least squares, then wheel "
        "separation and lidar pose from a constrained quadratic form in closed form; the worst samples are "
        "dropped in rounds. Covariance: inverse Fisher information with the noise of the samples kept, "
        "corrected for the dropping.";
    out["values"] = values_of(fit);
    out["covariance"] = covariance_of(fit.covariance);
    out["tables"] = {rounds_table(fit), motion_table(fit.motion)};
    out["plots"] = {residual_plot(fit, samples)};
    const auto used = static_cast<std::size_t>(std::count(fit.used.begin(), fit.used.end(), true));
    out["notes"] = {std::to_string(used) + " of " + std::to_string(samples.size()) + " samples were used."};
    out["undetermined"] = fit.undetermined;
    out["data"] = {
        {"first_round_covariance", covariance_of(fit.first_round_covariance)},
        {"noise", {{"along_mm", fit.noise[0]}, {"across_mm", fit.noise[1]}, {"heading_rad", fit.noise[2]}}}};
    return out;
  }
};

}  // namespace

std::unique_ptr<Fitting> make_odometry() { return std::make_unique<Odometry>(); }

}  // namespace rig::fittings
