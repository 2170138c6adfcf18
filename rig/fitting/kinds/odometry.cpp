// SPDX-License-Identifier: MIT
#include "fit/odometry.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "fit/drive.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"
#include "rig/fitting/result_document.hpp"

namespace rig::fittings {
namespace {

using nlohmann::json;

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
    values.push_back(result_value(p.name, p.label, {p.scale * fit.robot.vector()[i], u}, p.unit));
  }
  return values;
}

json covariance_of(const Eigen::Matrix<double, 6, 6>& covariance) {
  json names = json::array(), matrix = json::array();
  for (int i = 0; i < 6; ++i) {
    names.push_back(parameters[i].name);
    json row = json::array();
    for (int k = 0; k < 6; ++k)
      row.push_back(number_or_null(parameters[i].scale * parameters[k].scale * covariance(i, k)));
    matrix.push_back(row);
  }
  return {{"names", names}, {"matrix", matrix}};
}

json rounds_table(const fit::OdometryFit& fit) {
  json rows = json::array();
  for (std::size_t i = 0; i < fit.rounds.size(); ++i) {
    const fit::OdometryRound& round = fit.rounds[i];
    json row = {i, round.samples};
    for (int k = 0; k < 6; ++k) row.push_back(number_or_null(parameters[k].scale * round.robot.vector()[k]));
    for (int k = 0; k < 3; ++k)
      row.push_back(number_or_null(round.residual_rms[k] * (k == 2 ? fit::deg_per_rad : 1)));
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
      y.push_back(number_or_null(e[2] * fit::deg_per_rad));
    }
    series.push_back({{"name", used ? "used" : "dropped"}, {"style", "points"}, {"x", x}, {"y", y}});
  }
  return {{"title", "Heading: scan match minus odometry"},
          {"x_label", "sample"},
          {"y_label", "difference (deg)"},
          {"series", series}};
}

/// What the operator, or the recording, says the robot is like.
struct Nominal {
  std::optional<double> values[6];
  std::string source;
};

Nominal nominal_of(const FitSource& source, const FitOptions& options) {
  Nominal nominal;
  nominal.values[0] = nominal.values[1] = options.maybe_number("wheel_radius_mm");
  nominal.values[2] = options.maybe_number("separation_mm");
  const auto told = source.session ? source.session->get("lidar_on_robot") : std::nullopt;
  const json place = told ? json::parse(*told, nullptr, false) : json();
  if (place.is_object()) {
    nominal.values[3] = place.value("x_mm", 0.0);
    nominal.values[4] = place.value("y_mm", 0.0);
    nominal.values[5] = place.value("yaw_deg", 0.0);
  }
  return nominal;
}

/// `authors`: what others found or the maker says, with standard uncertainties where known.
json comparison(const std::string& title, const char* whose, const fit::OdometryFit& fit,
                const std::optional<double> (&theirs)[6], const std::optional<double> (&their_u)[6]) {
  json rows = json::array();
  for (int i = 0; i < 6; ++i) {
    if (!theirs[i]) continue;
    const Parameter& p = parameters[i];
    const double value = p.scale * fit.robot.vector()[i], u = p.scale * std::sqrt(fit.covariance(i, i));
    const double judge = their_u[i].value_or(u);
    json row = {std::string(p.label) + ", " + p.unit, number_or_null(value), number_or_null(u), *theirs[i]};
    row.push_back(their_u[i] ? json(*their_u[i]) : json(nullptr));
    row.push_back(number_or_null(value - *theirs[i]));
    row.push_back(number_or_null((value - *theirs[i]) / judge));
    row.push_back(their_u[i]
                      ? number_or_null(p.scale * std::sqrt(fit.first_round_covariance(i, i)) / *their_u[i])
                      : json(nullptr));
    rows.push_back(row);
  }
  return {{"title", title},
          {"columns",
           {"parameter", "value", "u", whose, "its u", "difference", "difference in u",
            "ratio of u, outliers counted alike"}},
          {"rows", rows}};
}

/// X_results.json beside X.tuple, as the public programs of Censi et al. write it.
std::optional<json> published_table(const std::string& path, const fit::OdometryFit& fit) {
  const std::filesystem::path file(path);
  const std::string beside = (file.parent_path() / (file.stem().string() + "_results.json")).string();
  std::ifstream in(beside);
  if (!in) return std::nullopt;
  const json published = json::parse(in, nullptr, false);
  try {
    const std::optional<double> theirs[6] = {
        500 * published.at("l_diam").get<double>(), 500 * published.at("r_diam").get<double>(),
        1000 * published.at("axle").get<double>(),  1000 * published.at("l_x").get<double>(),
        1000 * published.at("l_y").get<double>(),   fit::deg_per_rad * published.at("l_theta").get<double>()};
    std::optional<double> their_u[6];
    for (std::size_t i = 0; i < 6; ++i) {
      const double u = std::sqrt(published.at("covariance").at(i).at(i).get<double>());
      their_u[i] = i < 5 ? 1000 * u : fit::deg_per_rad * u;
    }
    return comparison(
        "Against the published calibration (" + std::filesystem::path(beside).filename().string() + ")",
        "published", fit, theirs, their_u);
  } catch (const json::exception&) {
    return std::nullopt;
  }
}

json drive_table(const fit::DriveFit& drive) {
  json rows = json::array();
  rows.push_back({"pairs of scans matched", drive.samples.size()});
  rows.push_back({"left out: doubtful, or without a hold in one direction", drive.bad_matches});
  rows.push_back({"robot moved, s", drive.moving_s});
  rows.push_back({"robot stood, s", drive.still_s});
  rows.push_back({"match at rest, RMS along, mm", drive.still_noise[0]});
  rows.push_back({"match at rest, RMS across, mm", drive.still_noise[1]});
  rows.push_back({"match at rest, RMS of heading, deg", drive.still_noise[2] * fit::deg_per_rad});
  rows.push_back({"wheels' time minus scans' time, ms", number_or_null(1e3 * drive.offset_s.value)});
  rows.push_back({"its standard uncertainty, ms", number_or_null(1e3 * drive.offset_s.u)});
  rows.push_back({"the same by the agreement of scans with the first path, ms",
                  drive.timing.determined ? json(1e3 * drive.timing.timing.offset_s) : json(nullptr)});
  rows.push_back({"beams listed against their order in time", drive.timing.timing.reversed ? "yes" : "no"});
  return {{"title", "The drive"}, {"columns", {"what", "value"}}, {"rows", rows}};
}

json convergence_table(const fit::DriveFit& drive) {
  json rows = json::array(), columns = {"round"};
  for (const Parameter& p : parameters) columns.push_back({{"name", p.label}, {"unit", p.unit}});
  for (std::size_t i = 0; i < drive.rounds.size(); ++i) {
    json row = {i + 1};
    for (int k = 0; k < 6; ++k)
      row.push_back(number_or_null(parameters[k].scale * drive.rounds[i].vector()[k]));
    rows.push_back(row);
  }
  return {{"title", "Rounds of deskewing, matching and fitting"}, {"columns", columns}, {"rows", rows}};
}

json uncertainty_table(const fit::DriveFit& drive) {
  json rows = json::array();
  for (int i = 0; i < 6; ++i) {
    const Parameter& p = parameters[i];
    rows.push_back({std::string(p.label) + ", " + p.unit,
                    number_or_null(p.scale * std::sqrt(drive.odometry.covariance(i, i))),
                    number_or_null(p.scale * drive.jackknife_u[i])});
  }
  return {{"title", "Standard uncertainties"},
          {"columns",
           {"parameter", "given (the larger)", "leaving out one stretch of the drive after the other"}},
          {"rows", rows}};
}

class Odometry : public Fitting {
 public:
  std::string kind() const override { return "odometry"; }
  std::string describes() const override {
    return "wheel radii, wheel separation and the lidar's pose on the robot, from wheels and scans";
  }
  bool accepts_files() const override { return true; }
  bool accepts_clusters() const override { return true; }
  std::vector<FitOption> options() const override {
    using Type = FitOption::Type;
    const fit::DriveOptions drive;
    return {{.name = "rounds",
             .type = Type::integer,
             .min = 0,
             .max = 50,
             .otherwise = static_cast<double>(drive.fit.rounds),
             .about = "how often the worst samples are dropped"},
            {.name = "outlier_share",
             .min = 0,
             .max = 0.5,
             .about = "share of the samples dropped in each round; without it 0.01, of sessions 0.03"},
            {.name = "refine",
             .type = Type::flag,
             .about = "maximum likelihood over all six after the closed form; without it, of sessions only"},
            {.name = "wheel_radius_mm",
             .unit = "mm",
             .min = 1,
             .max = 10000,
             .about = "nominal wheel radius: to compare with, and to start from without odometry (sessions)"},
            {.name = "separation_mm",
             .unit = "mm",
             .min = 1,
             .max = 100000,
             .about = "nominal wheel separation, likewise"},
            {.name = "least_way_mm",
             .unit = "mm",
             .min = 1,
             .max = 100000,
             .otherwise = drive.least_way_mm,
             .about = "way between two scans that are matched (sessions)"},
            {.name = "least_turn_deg",
             .unit = "deg",
             .min = 0.1,
             .max = 180,
             .otherwise = drive.least_turn_rad * fit::deg_per_rad,
             .about = "or turn between them (sessions)"}};
  }

  json run(const std::vector<FitSource>& sources, const FitOptions& options) const override {
    const bool session = !sources.empty() && sources.front().session;
    fit::OdometryOptions how;
    how.rounds = options.integer("rounds");
    how.outlier_share = options.maybe_number("outlier_share").value_or(session ? 0.03 : 0.01);
    how.refine = options.maybe_flag("refine").value_or(session);
    if (session && sources.size() > 1)
      throw UsageError("One drive at a time: give one session, or tuple files.");
    return session ? from_drive(sources.front(), how, options) : from_tuples(sources, how);
  }

 private:
  static json from_tuples(const std::vector<FitSource>& sources, const fit::OdometryOptions& how) {
    std::vector<fit::WheelSample> samples;
    for (const FitSource& source : sources) {
      if (source.session)
        throw UsageError(source.path +
                         " is a session, the first file is not. Give one session, or tuple files.");
      const auto more = read_tuples(source.path);
      samples.insert(samples.end(), more.begin(), more.end());
    }
    if (samples.size() < 20)
      throw MeasurementError("Only " + std::to_string(samples.size()) +
                             " samples: at least 20 are needed, and some hundreds for a good result.");
    const fit::OdometryFit fit = fit::fit_odometry(samples, how);
    json out = document(fit, samples);
    if (const auto table = sources.size() == 1 ? published_table(sources.front().path, fit) : std::nullopt)
      out["tables"].insert(out["tables"].begin(), *table);
    return out;
  }

  static json from_drive(const FitSource& source, const fit::OdometryOptions& how,
                         const FitOptions& options) {
    const Nominal nominal = nominal_of(source, options);
    fit::DriveOptions drive_options;
    drive_options.fit = how;
    if (nominal.values[0] && nominal.values[2]) {
      drive_options.guess.left_radius_mm = drive_options.guess.right_radius_mm = *nominal.values[0];
      drive_options.guess.separation_mm = *nominal.values[2];
    }
    drive_options.least_way_mm = options.number("least_way_mm");
    drive_options.least_turn_rad = options.number("least_turn_deg") * fit::rad_per_deg;
    const auto recording = source.session->recording();
    fit::DriveFit drive;
    try {
      drive = fit::fit_drive(*recording, drive_options);
    } catch (const std::invalid_argument& error) {
      throw MeasurementError(source.path + ": " + error.what() + ".");
    }
    json out = document(drive.odometry, drive.samples);
    out["method"] =
        out["method"].get<std::string>() +
        " The samples come from the drive itself: scans are deskewed by the wheels, scans some way apart "
        "matched onto each other both ways by point-to-line ICP, and what is found deskews the scans of "
        "the next round. Where leaving out stretches of the drive "
        "scatters the result more than that, this scatter is the uncertainty given.";
    out["tables"].insert(out["tables"].begin(),
                         {uncertainty_table(drive), drive_table(drive), convergence_table(drive)});
    const bool any = std::ranges::any_of(nominal.values, [](const auto& v) { return v.has_value(); });
    if (any)
      out["tables"].insert(out["tables"].begin(), comparison("Against the nominal values", "nominal",
                                                             drive.odometry, nominal.values, {}));
    if (!std::isfinite(drive.offset_s.value))
      out["undetermined"].push_back(
          "The time offset between scans and wheels: the motion changes too little to show it. 0 was used.");
    return out;
  }

  static json document(const fit::OdometryFit& fit, const std::vector<fit::WheelSample>& samples) {
    json out = new_result(
        "odometry",
        "Simultaneous calibration of odometry and lidar pose after Censi, Franchi, Marchionni and Oriolo "
        "(IEEE T-RO 2013): turning gains of the wheels by weighted linear least squares, then wheel "
        "separation and lidar pose from a constrained quadratic form in closed form; the worst samples are "
        "dropped in rounds. Covariance: inverse Fisher information with the noise of the samples kept, "
        "corrected for the dropping.");
    out["values"] = values_of(fit);
    out["use"] = {
        "The robot's frame has its origin midway between the wheels, x ahead and y to the left; angles "
        "grow counter-clockwise, seen from above. A point p in the lidar's frame (x along its beam at 0 "
        "deg) is at R(yaw) p + (x, y) on the robot. Wheels that turn by a_left and a_right (rad, positive "
        "ahead) drive the robot by (r_left a_left + r_right a_right) / 2 and turn it by (r_right a_right - "
        "r_left a_left) / separation."};
    out["covariance"] = covariance_of(fit.covariance);
    for (int i = 0; i < 6; ++i)
      out["budget"].push_back(budget_line(std::string(parameters[i].label) + ": scan matches and wheels", "A",
                                          parameters[i].scale * std::sqrt(fit.covariance(i, i)),
                                          parameters[i].unit));
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
