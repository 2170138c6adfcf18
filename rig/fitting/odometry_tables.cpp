// SPDX-License-Identifier: MIT
#include "rig/fitting/odometry_tables.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

#include "fit/numeric/number_format.hpp"
#include "rig/fitting/result_document.hpp"

namespace rig::odometry_parts {

using nlohmann::json;

namespace {

json parameter_columns(const char* first, const Parameters& parameters) {
  json columns = {first};
  for (const auto& p : parameters) columns.push_back({{"name", p.label}, {"unit", p.unit}});
  return columns;
}

std::string name_of(const fit::RunVerdict& run, const std::vector<std::string>& names) {
  return names.at(run.run) + (run.segments > 1 ? ", segment " + std::to_string(run.segment + 1) + " of " +
                                                     std::to_string(run.segments)
                                               : "");
}

}  // namespace

Parameters parameters_of(const fit::Steering& steering) {
  return {steering.parameters[0],
          steering.parameters[1],
          steering.parameters[2],
          {"lidar_x_mm", "Lidar on the robot, x", "mm"},
          {"lidar_y_mm", "Lidar on the robot, y", "mm"},
          {"lidar_yaw_deg", "Lidar on the robot, yaw", "deg", fit::deg_per_rad}};
}

const fit::Steering& steering_of(const fit::RobotGeometry& robot) { return fit::steering_of(robot.steering); }

json values_of(const fit::OdometryFit& fit) {
  const Parameters parameters = parameters_of(steering_of(fit.robot));
  json values = json::array();
  for (int i = 0; i < 6; ++i) {
    const auto& p = parameters[static_cast<std::size_t>(i)];
    const double unknown = std::numeric_limits<double>::quiet_NaN();
    const bool known = fit.determined[static_cast<std::size_t>(i)];
    const double value = known ? p.scale * fit.robot.vector()[i] : unknown;
    const double u = known ? p.scale * std::sqrt(fit.covariance(i, i)) : unknown;
    values.push_back(result_value(p.name, p.label, {value, u}, p.unit));
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
      row.push_back(
          number_or_null(parameters[static_cast<std::size_t>(k)].scale * drive.rounds[i].vector()[k]));
    rows.push_back(row);
  }
  return {{"title", "Rounds of deskewing, matching and fitting"}, {"columns", columns}, {"rows", rows}};
}

json uncertainty_table(const fit::DriveFit& drive, double range_scale) {
  const Parameters parameters = parameters_of(fit::differential());
  json rows = json::array();
  for (int i = 0; i < 6; ++i) {
    const auto& p = parameters[static_cast<std::size_t>(i)];
    rows.push_back(
        {p.label + ", " + p.unit, number_or_null(p.scale * std::sqrt(drive.odometry.covariance(i, i))),
         number_or_null(p.scale * drive.jackknife_u[i]), number_or_null(p.scale * std::abs(drive.drift[i])),
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

void say_slipped_runs(json& out, const std::vector<fit::RunVerdict>& runs,
                      const std::vector<std::string>& names) {
  for (const fit::RunVerdict& run : runs)
    if (run.left_out)
      out["notes"].push_back(name_of(run, names) + " was left out: what it says of the robot is " +
                             fit::format_fixed(run.misfit, 1) +
                             " standard deviations from the others. The wheels slipped, or the robot was "
                             "touched.");
}

json runs_table(const fit::RunsFit& fit, const std::vector<std::string>& names) {
  json rows = json::array();
  for (const fit::RunVerdict& run : fit.runs)
    rows.push_back({name_of(run, names), run.samples, number_or_null(1e3 * fit.run_offsets_s.at(run.run)),
                    number_or_null(run.misfit), run.left_out ? "yes" : "no"});
  return {
      {"title", "Runs or their segments: distance from what the others say, in standard deviations (RMS)"},
      {"columns", {"run", "samples", {{"name", "time offset"}, {"unit", "ms"}}, "distance", "left out"}},
      {"rows", rows}};
}

json tuple_uncertainty_table(const fit::RunsFit& fit) {
  const Parameters parameters = parameters_of(steering_of(fit.odometry.robot));
  json rows = json::array();
  for (int i = 0; i < 6; ++i) {
    const auto& p = parameters[static_cast<std::size_t>(i)];
    rows.push_back({p.label + ", " + p.unit,
                    number_or_null(p.scale * std::sqrt(fit.odometry.covariance(i, i))),
                    number_or_null(p.scale * fit.grouped_u[i]), number_or_null(p.scale * fit.offset_u[i])});
  }
  return {{"title", "Standard uncertainties (" + std::to_string(fit.groups) + " groups)"},
          {"columns", {"parameter", "given", "leaving out one group after the other", "by the time offset"}},
          {"rows", rows}};
}

json segments_table(const fit::DriveFit& drive) {
  json rows = json::array();
  for (const fit::RunVerdict& segment : drive.segments)
    rows.push_back(
        {segment.run + 1, segment.samples, number_or_null(segment.misfit), segment.left_out ? "yes" : "no"});
  return {{"title", "Segments of the drive: distance from what the others say, in standard deviations (RMS)"},
          {"columns", {"segment", "pairs", "distance", "left out"}},
          {"rows", rows}};
}

json noise_table(const fit::RunsFit& fit) {
  using Component = fit::MotionNoise::Component;
  const auto row = [&](const std::string& what, double Component::*part, double times) {
    json cells = {what};
    for (std::size_t c = 0; c < 3; ++c)
      cells.push_back(
          number_or_null(std::sqrt(times * (fit.noise.of[c].*part)) * (c == 2 ? fit::deg_per_rad : 1)));
    cells.push_back(nullptr);
    return cells;
  };
  json rows = json::array({row("of every sample by itself", &Component::sample, 1)});
  if (fit.noise.of[0].pose > 0) {  // else no times were given
    rows.push_back(row("of every watched pose", &Component::pose, 1));
    rows.push_back(row("that adds up while a wheel turns once", &Component::walk, 2 * std::numbers::pi));
    rows.push_back({"of the clock between wheels and poses, which lasts " +
                        fit::format_fixed(fit.noise.time_lasts_s, 2) + " s",
                    nullptr, nullptr, nullptr, number_or_null(1e3 * std::sqrt(fit.noise.time))});
  }
  return {{"title", "Noise of the watched motion, standard deviations"},
          {"columns",
           {"noise",
            {{"name", "x"}, {"unit", "mm"}},
            {{"name", "y"}, {"unit", "mm"}},
            {{"name", "heading"}, {"unit", "deg"}},
            {{"name", "time"}, {"unit", "ms"}}}},
          {"rows", rows}};
}

}  // namespace rig::odometry_parts
