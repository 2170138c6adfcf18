// SPDX-License-Identifier: MIT
#include "fit/motion/odometry.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "fit/motion/drive.hpp"
#include "fit/motion/odometry_runs.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"
#include "rig/fitting/odometry_tables.hpp"
#include "rig/fitting/result_document.hpp"
#include "rig/fitting/tuple_file.hpp"

namespace rig::fittings {
namespace {

using namespace odometry_parts;
using nlohmann::json;

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
  const auto stated = source.session ? source.session->get("lidar_on_robot") : std::nullopt;
  const json place = stated ? json::parse(*stated, nullptr, false) : json();
  if (place.is_object()) {
    nominal.values[3] = place.value("x_mm", 0.0);
    nominal.values[4] = place.value("y_mm", 0.0);
    nominal.values[5] = place.value("yaw_deg", 0.0);
  }
  return nominal;
}

class Odometry : public Fitting {
 public:
  std::string kind() const override { return "odometry"; }
  std::string describes() const override {
    return "wheel radii, wheel separation and the lidar's pose on the robot, from wheels and scans";
  }
  std::vector<std::string> values() const override {
    std::vector<std::string> names;
    for (const fit::Steering& steering : fit::all_steerings())
      for (const auto& parameter : parameters_of(steering))
        if (std::ranges::find(names, parameter.name) == names.end()) names.push_back(parameter.name);
    names.push_back("time_offset_ms");
    return names;
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
          "and noise of the watched poses was not told from noise of the motion.");
    say_offset(out, fit.offset, runs.known_offset_s);
    say_slipped_runs(out, fit.runs, tuples.runs);
    out["tables"].insert(out["tables"].begin(), {tuple_uncertainty_table(fit), noise_table(fit)});
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
        " Clocks: the offset at which wheels and matches agree best is taken where it is determined and "
        "differs "
        "from 0. ";
    if (timed)
      text +=
          "All six parameters are then fitted by maximum likelihood, with noise of every watched pose, noise "
          "that adds up on the way, and noise of every tuple by itself, each estimated. ";
    return text +
           "Runs that disagree with the others beyond their scatter are left out. The uncertainty given is "
           "the larger of that and of leaving out one run (of few runs, one segment) after the other, with "
           "Student's factor, with the offset's uncertainty.";
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
