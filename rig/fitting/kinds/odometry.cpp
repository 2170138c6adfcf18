// SPDX-License-Identifier: MIT
#include "fit/odometry.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "fit/drive.hpp"
#include "fit/number_format.hpp"
#include "fit/odometry_runs.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"
#include "rig/fitting/result_document.hpp"

namespace rig::fittings {
namespace {

using nlohmann::json;

using Parameters = std::array<fit::Steering::Parameter, 6>;

Parameters parameters_of(const fit::Steering& steering) {
  return {steering.parameters[0],
          steering.parameters[1],
          steering.parameters[2],
          {"lidar_x_mm", "Lidar on the robot, x", "mm"},
          {"lidar_y_mm", "Lidar on the robot, y", "mm"},
          {"lidar_yaw_deg", "Lidar on the robot, yaw", "deg", fit::deg_per_rad}};
}

const fit::Steering& steering_of(const fit::RobotGeometry& robot) {
  return robot.steering ? *robot.steering : fit::differential();
}

/// The samples of some tuple files, every file a run.
struct Tuples {
  std::vector<fit::WheelSample> samples;
  std::vector<std::string> runs;
  bool timed = true;  ///< Every sample says when it began.
};

/// One object a line: T in s, phi_l and phi_r in rad/s, sm = [x m, y m, theta rad] (the format of Censi's
/// public programs), perhaps t in s, when it began. Of a tricycle: phi in rad/s and steer in rad.
void read_tuples(const std::string& path, const fit::Steering& steering, Tuples& out) {
  std::ifstream in(path);
  if (!in) throw UsageError(path + " cannot be opened. Check the name and the permissions.");
  const bool tricycle = steering.id == "tricycle";
  std::size_t object = 0;
  double last_s = -1e300;
  const auto demand = [&](bool good, const std::string& what) {
    if (!good) throw UsageError(path + ", object " + std::to_string(object) + ": " + what);
  };
  try {
    while (in >> std::ws && !in.eof()) {
      ++object;
      json line;
      in >> line;
      const json& match = line.at("sm");
      fit::WheelSample sample;
      sample.interval_s = line.at("T");
      demand(sample.interval_s > 0, "T is not above 0. It is the time, s, from one scan to the next.");
      if (tricycle) {
        sample.left_rad_s = line.at("phi");
        sample.pieces = {{sample.left_rad_s * sample.interval_s, line.at("steer").get<double>()}};
      } else {
        sample.left_rad_s = line.at("phi_l");
        sample.right_rad_s = line.at("phi_r");
      }
      sample.match = {1000 * match.at(0).get<double>(), 1000 * match.at(1).get<double>(), match.at(2)};
      sample.run = out.runs.size();
      if (line.contains("t")) {
        sample.begin_s = line.at("t");
        demand(sample.begin_s > last_s, "t does not grow. Every file is one drive, in order of time.");
        last_s = sample.begin_s;
      } else {
        out.timed = false;
      }
      out.samples.push_back(std::move(sample));
    }
  } catch (const json::exception& error) {
    demand(false, std::string(error.what()) +
                      (tricycle ? ". A tuple file of a tricycle holds objects like {\"T\": 0.8, \"phi\": 4.9, \"steer\": "
                                  "-0.1, \"sm\": [0.2, -0.001, -0.02]}: s, rad/s, rad, and the scan match in m, m, rad."
                                : ". A tuple file holds objects like {\"T\": 0.8, \"phi_l\": 0.49, \"phi_r\": -0.51, "
                                  "\"sm\": [0.001, -0.0005, -0.18]}: s, rad/s, rad/s, and the scan match in m, m, rad."));
  }
  out.runs.push_back(std::filesystem::path(path).filename().string());
}

json values_of(const fit::OdometryFit& fit) {
  const Parameters parameters = parameters_of(steering_of(fit.robot));
  json values = json::array();
  for (int i = 0; i < 6; ++i) {
    const auto& p = parameters[static_cast<std::size_t>(i)];
    const double u = p.scale * std::sqrt(fit.covariance(i, i));
    values.push_back(result_value(p.name, p.label, {p.scale * fit.robot.vector()[i], u}, p.unit));
  }
  return values;
}

json covariance_of(const Eigen::Matrix<double, 6, 6>& covariance, const Parameters& parameters) {
  json names = json::array(), matrix = json::array();
  for (std::size_t i = 0; i < 6; ++i) {
    names.push_back(parameters[i].name);
    json row = json::array();
    for (std::size_t k = 0; k < 6; ++k)
      row.push_back(number_or_null(parameters[i].scale * parameters[k].scale *
                                   covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k))));
    matrix.push_back(row);
  }
  return {{"names", names}, {"matrix", matrix}};
}

json parameter_columns(const char* first, const Parameters& parameters) {
  json columns = {first};
  for (const auto& p : parameters) columns.push_back({{"name", p.label}, {"unit", p.unit}});
  return columns;
}

json rounds_table(const fit::OdometryFit& fit) {
  const Parameters parameters = parameters_of(steering_of(fit.robot));
  json rows = json::array();
  for (std::size_t i = 0; i < fit.rounds.size(); ++i) {
    const fit::OdometryRound& round = fit.rounds[i];
    json row = {i, round.samples};
    for (int k = 0; k < 6; ++k)
      row.push_back(number_or_null(parameters[static_cast<std::size_t>(k)].scale * round.robot.vector()[k]));
    for (int k = 0; k < 3; ++k)
      row.push_back(number_or_null(round.residual_rms[k] * (k == 2 ? fit::deg_per_rad : 1)));
    rows.push_back(row);
  }
  json columns = {"round", "samples"};
  for (const auto& p : parameters) columns.push_back({{"name", p.label}, {"unit", p.unit}});
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
  nominal.values[0] = options.maybe_number("wheel_radius_mm");
  if (options.text("steering") != "tricycle") nominal.values[1] = nominal.values[0];
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
  const Parameters parameters = parameters_of(steering_of(fit.robot));
  json rows = json::array();
  for (int i = 0; i < 6; ++i) {
    if (!theirs[i]) continue;
    const auto& p = parameters[static_cast<std::size_t>(i)];
    const double value = p.scale * fit.robot.vector()[i], u = p.scale * std::sqrt(fit.covariance(i, i));
    const double judge = their_u[i].value_or(u);
    json row = {p.label + ", " + p.unit, number_or_null(value), number_or_null(u), *theirs[i]};
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
  rows.push_back({"left out: doubtful, or poorly constrained in one direction", drive.bad_matches});
  rows.push_back({"beams left out: they see the robot itself", drive.own_beams});
  rows.push_back({"robot moved, s", drive.moving_s});
  rows.push_back({"robot stood, s", drive.still_s});
  rows.push_back({"match at rest, RMS along, mm", drive.still_noise[0]});
  rows.push_back({"match at rest, RMS across, mm", drive.still_noise[1]});
  rows.push_back({"match at rest, RMS of heading, deg", drive.still_noise[2] * fit::deg_per_rad});
  rows.push_back(
      {"time stamps of scans, RMS from even spacing, ms", number_or_null(1e3 * drive.scan_jitter_s)});
  rows.push_back({"time stamps evened out", drive.even_wheels  ? "of scans and wheels"
                                            : drive.even_scans ? "of scans"
                                                               : "no"});
  rows.push_back({"wheels' time minus scans' time, first from consecutive scans, ms",
                  drive.coarse.determined ? json(1e3 * drive.coarse.offset_s.value) : json(nullptr)});
  rows.push_back({"the same, where wheels and matches agree best, ms",
                  number_or_null(1e3 * drive.offset.offset_s.value)});
  rows.push_back({"its standard uncertainty, ms", number_or_null(1e3 * drive.offset.offset_s.u)});
  rows.push_back({"the same by the agreement of scans, ms",
                  drive.timing.determined ? json(1e3 * drive.timing.timing.offset_s) : json(nullptr)});
  rows.push_back({"beams listed against their order in time", drive.timing.timing.reversed ? "yes" : "no"});
  return {{"title", "The drive"}, {"columns", {"what", "value"}}, {"rows", rows}};
}

json drive_lengths_table(const fit::DriveFit& drive) {
  const Parameters parameters = parameters_of(fit::differential());
  json rows = json::array();
  for (const fit::DriveLength& length : drive.lengths) {
    json row = {length.samples, number_or_null(length.way_mm), number_or_null(length.interval_s)};
    for (int k = 0; k < 6; ++k) {
      const double scale = parameters[static_cast<std::size_t>(k)].scale;
      row.push_back(number_or_null(scale * length.values[k]));
      row.push_back(number_or_null(scale * length.u[k]));
    }
    row.push_back(length.taken && !drive.extrapolated ? "yes" : "no");
    rows.push_back(row);
  }
  json columns = {"pairs", {{"name", "way"}, {"unit", "mm"}}, {{"name", "interval"}, {"unit", "s"}}};
  for (const auto& p : parameters) {
    columns.push_back({{"name", p.label}, {"unit", p.unit}});
    columns.push_back("u");
  }
  columns.push_back("taken");
  return {{"title", std::string("Scans matched at several lengths: ") +
                        (drive.extrapolated ? "the values extrapolated to infinite length were taken"
                                            : "the length with the least expected error was taken")},
          {"columns", columns},
          {"rows", rows}};
}

json convergence_table(const fit::DriveFit& drive) {
  const Parameters parameters = parameters_of(fit::differential());
  json rows = json::array(), columns = parameter_columns("round", parameters);
  for (std::size_t i = 0; i < drive.rounds.size(); ++i) {
    json row = {i + 1};
    for (int k = 0; k < 6; ++k)
      row.push_back(number_or_null(parameters[static_cast<std::size_t>(k)].scale * drive.rounds[i].vector()[k]));
    rows.push_back(row);
  }
  return {{"title", "Rounds of deskewing, matching and fitting"}, {"columns", columns}, {"rows", rows}};
}

json uncertainty_table(const fit::DriveFit& drive, double range_scale) {
  const Parameters parameters = parameters_of(fit::differential());
  json rows = json::array();
  for (int i = 0; i < 6; ++i) {
    const auto& p = parameters[static_cast<std::size_t>(i)];
    rows.push_back({p.label + ", " + p.unit,
                    number_or_null(p.scale * std::sqrt(drive.odometry.covariance(i, i))),
                    number_or_null(p.scale * drive.jackknife_u[i]),
                    number_or_null(p.scale * std::abs(drive.drift[i])),
                    i < 5 ? json(p.scale * std::abs(drive.odometry.robot.vector()[i]) * range_scale / std::sqrt(3.0))
                          : json(0)});
  }
  return {{"title", "Standard uncertainties"},
          {"columns",
           {"parameter", "given", "leaving out one segment of the drive after the other",
            "extrapolation to infinite length", "by the lidar's scale"}},
          {"rows", rows}};
}

void say_offset(json& out, const fit::OffsetSearch& offset, const std::optional<double>& known_s) {
  const auto ms = [](double seconds) { return fit::format_fixed(1e3 * seconds, 1) + " ms"; };
  if (known_s) {
    out["notes"].push_back("The wheels' time was taken to be the scans' time plus " + ms(*known_s) +
                           ", as given.");
  } else if (offset.at_bound) {
    out["undetermined"].push_back("The time offset between scans and wheels: within " +
                                  ms(offset.searched_s) + " they agree best at the end of the search, " +
                                  ms(offset.offset_s.value) +
                                  "; the true one may lie beyond, or the motion does not determine it. 0 was "
                                  "used. Give it with the option "
                                  "offset_ms, or drive longer with changing speed.");
  } else if (!offset.determined) {
    out["undetermined"].push_back(
        "The time offset between scans and wheels: the motion changes too little to show it. 0 was used.");
  } else {
    out["values"].push_back(result_value("time_offset_ms", "Wheels' time minus scans' time",
                                         {1e3 * offset.offset_s.value, 1e3 * offset.offset_s.u}, "ms"));
  }
}

std::string name_of(const fit::RunVerdict& run, const std::vector<std::string>& names) {
  return names.at(run.run) + (run.segments > 1 ? ", segment " + std::to_string(run.segment + 1) + " of " +
                                                     std::to_string(run.segments)
                                               : "");
}

void say_slipped_runs(json& out, const std::vector<fit::RunVerdict>& runs,
                      const std::vector<std::string>& names) {
  for (const fit::RunVerdict& run : runs)
    if (run.left_out)
      out["notes"].push_back(name_of(run, names) + " was left out: its residuals are " +
                             fit::format_fixed(run.misfit, 1) +
                             " times the noise of the others. The wheels slipped, or the robot was touched.");
}

json runs_table(const fit::RunsFit& fit, const std::vector<std::string>& names) {
  json rows = json::array();
  for (const fit::RunVerdict& run : fit.runs)
    rows.push_back({name_of(run, names), run.samples, number_or_null(1e3 * fit.run_offsets_s.at(run.run)),
                    number_or_null(run.misfit), run.left_out ? "yes" : "no"});
  return {{"title", "Runs or their segments: RMS of the residuals in units of the noise of those kept"},
          {"columns", {"run", "samples", {{"name", "time offset"}, {"unit", "ms"}}, "residuals", "left out"}},
          {"rows", rows}};
}

json tuple_uncertainty_table(const fit::RunsFit& fit) {
  const Parameters parameters = parameters_of(steering_of(fit.odometry.robot));
  json rows = json::array();
  for (int i = 0; i < 6; ++i) {
    const auto& p = parameters[static_cast<std::size_t>(i)];
    rows.push_back({p.label + ", " + p.unit, number_or_null(p.scale * std::sqrt(fit.odometry.covariance(i, i))),
                    number_or_null(p.scale * std::sqrt(fit.grouped.covariance(i, i))),
                    number_or_null(p.scale * fit.offset_u[i]),
                    number_or_null(p.scale * std::abs(fit.drift[i]))});
  }
  return {{"title", "Standard uncertainties (" + std::to_string(fit.grouped.groups) + " groups)"},
          {"columns",
           {"parameter", "given", "leaving out one group after the other", "by the time offset",
            "change at twice the length"}},
          {"rows", rows}};
}

json segments_table(const fit::DriveFit& drive) {
  json rows = json::array();
  for (const fit::RunVerdict& segment : drive.segments)
    rows.push_back(
        {segment.run + 1, segment.samples, number_or_null(segment.misfit), segment.left_out ? "yes" : "no"});
  return {{"title", "Segments of the drive: RMS of the residuals in units of the noise of those kept"},
          {"columns", {"segment", "pairs", "residuals", "left out"}},
          {"rows", rows}};
}

json lengths_table(const fit::RunsFit& fit) {
  const Parameters parameters = parameters_of(steering_of(fit.odometry.robot));
  json rows = json::array();
  for (const fit::LengthFit& length : fit.lengths) {
    json row = {length.joined, length.samples, number_or_null(length.interval_s), number_or_null(length.way_mm)};
    for (int k = 0; k < 6; ++k)
      row.push_back(number_or_null(parameters[static_cast<std::size_t>(k)].scale * length.values[k]));
    row.push_back(number_or_null(length.worth));
    row.push_back(length.taken ? "yes" : "no");
    rows.push_back(row);
  }
  json columns = {"joined", "samples", {{"name", "interval"}, {"unit", "s"}}, {{"name", "way"}, {"unit", "mm"}}};
  for (const auto& p : parameters) columns.push_back({{"name", p.label}, {"unit", p.unit}});
  columns.push_back("worth");
  columns.push_back("taken");
  return {{"title",
           "Tuples joined into longer segments, and the information in a second of driving (largest: 1)"},
          {"columns", columns},
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
    std::vector<std::string> steerings;
    for (const fit::Steering& steering : fit::all_steerings()) steerings.push_back(steering.id);
    return {{.name = "steering",
             .type = Type::choice,
             .choices = steerings,
             .otherwise = fit::differential().id,
             .about = "how the wheels move the robot (tricycle: tuple files only)"},
            {.name = "offset_ms",
             .unit = "ms",
             .min = -10000,
             .max = 10000,
             .about = "wheels' time minus scans' time; without it, estimated"},
            {.name = "rounds",
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
             .about = "nominal wheel separation (of a tricycle: wheelbase), likewise"},
            {.name = "range_scale_percent",
             .unit = "%",
             .min = 0,
             .max = 50,
             .otherwise = 100 * drive.range_scale,
             .about = "limit of the error of the lidar's scale, from its data sheet (sessions)"},
            {.name = "least_way_mm",
             .unit = "mm",
             .min = 1,
             .max = 100000,
             .otherwise = drive.least_way_mm,
             .about = "distance between two matched scans (sessions)"},
            {.name = "least_turn_deg",
             .unit = "deg",
             .min = 0.1,
             .max = 180,
             .otherwise = drive.least_turn_rad * fit::deg_per_rad,
             .about = "or angle between them (sessions)"}};
  }

  json run(const std::vector<FitSource>& sources, const FitOptions& options) const override {
    const bool session = !sources.empty() && sources.front().session;
    fit::OdometryOptions how;
    how.rounds = options.integer("rounds");
    how.outlier_share = options.maybe_number("outlier_share").value_or(session ? 0.03 : 0.01);
    how.refine = options.maybe_flag("refine").value_or(session);
    how.steering = fit::find_steering(options.text("steering"));
    if (session && sources.size() > 1)
      throw UsageError("One drive at a time: give one session, or tuple files.");
    if (session && how.steering->id != fit::differential().id)
      throw UsageError("A session holds the angles of two driven wheels; the steering " + how.steering->id +
                       " is fitted to tuple files.");
    return session ? from_drive(sources.front(), how, options) : from_tuples(sources, how, options);
  }

 private:
  static json from_tuples(const std::vector<FitSource>& sources, const fit::OdometryOptions& how,
                          const FitOptions& options) {
    Tuples tuples;
    for (const FitSource& source : sources) {
      if (source.session)
        throw UsageError(source.path +
                         " is a session, the first file is not. Give one session, or tuple files.");
      read_tuples(source.path, *how.steering, tuples);
    }
    if (tuples.samples.size() < 20)
      throw MeasurementError("Only " + std::to_string(tuples.samples.size()) +
                             " samples: at least 20 are needed, and some hundreds for a good result.");
    fit::RunsOptions runs;
    runs.fit = how;
    runs.timed = tuples.timed;
    runs.known_offset_s = offset_option(options);
    const fit::RunsFit fit = fit::fit_runs(tuples.samples, runs);
    json out = document(fit.odometry, fit.samples);
    out["method"] = out["method"].get<std::string>() + runs_method(tuples.timed);
    if (!tuples.timed)
      out["notes"].push_back(
          "The tuples do not say when they began (t, s): each was taken to begin when the one before ended, "
          "and neighbours were not joined into longer segments.");
    say_offset(out, fit.offset, runs.known_offset_s);
    say_slipped_runs(out, fit.runs, tuples.runs);
    out["tables"].insert(out["tables"].begin(), {tuple_uncertainty_table(fit), lengths_table(fit)});
    out["tables"].push_back(runs_table(fit, tuples.runs));
    const Nominal nominal = nominal_of(sources.front(), options);
    if (nominal.values[0] || nominal.values[2])
      out["tables"].insert(out["tables"].begin(), comparison("Against the nominal values", "nominal",
                                                             fit.odometry, nominal.values, {}));
    if (const auto table =
            sources.size() == 1 ? published_table(sources.front().path, fit.odometry) : std::nullopt)
      out["tables"].insert(out["tables"].begin(), *table);
    return out;
  }

  static std::optional<double> offset_option(const FitOptions& options) {
    const auto ms = options.maybe_number("offset_ms");
    return ms ? std::optional(*ms / 1000) : std::nullopt;
  }

  static std::string runs_method(bool timed) {
    std::string text =
        " Clocks: the offset at which wheels and matches agree best is taken where it is determined and differs "
        "from 0. ";
    if (timed)
      text +=
          "Neighbouring tuples are joined to the length that gives the most information per second of "
          "driving, and all six "
          "parameters fitted at once. ";
    return text +
           "Runs that fit worse than the others beyond their scatter are left out. The uncertainty given is "
           "the "
           "larger of that and of leaving out one run (of few runs, one segment) after the other, with "
           "Student's factor, with the offset's uncertainty and the change at twice the length.";
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
    drive_options.known_offset_s = offset_option(options);
    drive_options.range_scale = options.number("range_scale_percent") / 100;
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
        "the next round. Scans are matched at several lengths, and the length, or the extrapolation to "
        "infinite length, with the least expected error is taken. Segments of the drive that slipped are "
        "left out. "
        "Uncertainty: leaving out one segment after the other, with Student's factor, the drift with the "
        "length "
        "and the lidar's scale.";
    out["tables"].insert(out["tables"].begin(),
                         {uncertainty_table(drive, drive_options.range_scale), drive_lengths_table(drive),
                          drive_table(drive), convergence_table(drive)});
    out["tables"].push_back(segments_table(drive));
    const bool any = std::ranges::any_of(nominal.values, [](const auto& v) { return v.has_value(); });
    if (any)
      out["tables"].insert(out["tables"].begin(), comparison("Against the nominal values", "nominal",
                                                             drive.odometry, nominal.values, {}));
    say_offset(out, drive.offset, drive_options.known_offset_s);
    const auto slipped = std::ranges::count_if(drive.segments, &fit::RunVerdict::left_out);
    if (slipped > 0)
      out["notes"].push_back(
          std::to_string(slipped) + " of " + std::to_string(drive.segments.size()) +
          " segments of the drive were left out: the wheels slipped there, or scans did not match.");
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
    const Parameters parameters = parameters_of(steering_of(fit.robot));
    out["values"] = values_of(fit);
    out["use"] = {steering_of(fit.robot).use};
    out["covariance"] = covariance_of(fit.covariance, parameters);
    for (int i = 0; i < 6; ++i)
      out["budget"].push_back(
          budget_line(parameters[static_cast<std::size_t>(i)].label + ": scan matches and wheels", "A",
                      parameters[static_cast<std::size_t>(i)].scale * std::sqrt(fit.covariance(i, i)),
                      parameters[static_cast<std::size_t>(i)].unit));
    out["tables"] = {rounds_table(fit), motion_table(fit.motion)};
    out["plots"] = {residual_plot(fit, samples)};
    const auto used = static_cast<std::size_t>(std::count(fit.used.begin(), fit.used.end(), true));
    out["notes"] = {std::to_string(used) + " of " + std::to_string(samples.size()) + " samples were used."};
    out["undetermined"] = fit.undetermined;
    out["data"] = {
        {"first_round_covariance", covariance_of(fit.first_round_covariance, parameters)},
        {"noise", {{"along_mm", fit.noise[0]}, {"across_mm", fit.noise[1]}, {"heading_rad", fit.noise[2]}}}};
    return out;
  }
};

}  // namespace

std::unique_ptr<Fitting> make_odometry() { return std::make_unique<Odometry>(); }

}  // namespace rig::fittings
