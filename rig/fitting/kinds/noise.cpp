// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "fit/numeric/angle.hpp"
#include "fit/numeric/median.hpp"
#include "fit/range/beam_statistics.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/one_lidar.hpp"
#include "rig/fitting/result_document.hpp"
#include "rig/fitting/uncertainty_budget.hpp"
#include "rig/session/step_in_words.hpp"

namespace rig::fittings {
namespace {

using nlohmann::json;

/// Standard uncertainty of the median of normal numbers, from their own spread; of a few, whose spread says
/// little, `of_few`.
double u_of_median(const std::vector<double>& values, double of_few) {
  if (values.size() < 8) return of_few;
  const double middle = fit::median_or_nan(values);
  std::vector<double> off;
  for (const double value : values) off.push_back(std::abs(value - middle));
  const double spread = std::sqrt(1 / fit::median_of_normal_squares) * fit::median_or_nan(std::move(off));
  return std::sqrt(fit::pi / 2) * spread / std::sqrt(static_cast<double>(values.size()));
}

/// A sample standard deviation of n samples lies below the true one more often than above it: its median over
/// many beams is low by this factor (Wilson and Hilferty's median of chi-square).
double median_bias(long n) { return std::pow(1 - 2 / (9.0 * static_cast<double>(n - 1)), 1.5); }

// --- which sessions belong together --------------------------------------------------------------------

/// What sessions must have in common for their noise to be one, in words.
struct Scope {
  std::string pattern, targets;
};

Scope scope_of(const SessionStore& session) {
  const fit::Bench bench = session.recording()->bench();
  Scope out;
  char text[120];
  std::snprintf(text, sizeof text, "%d beams of %.4g deg at %.4g Hz",
                bench.lidar.steps - bench.lidar.first_step, bench.lidar.step_rad * fit::deg_per_rad,
                bench.lidar.scan_hz);
  out.pattern = text;
  for (const fit::Target& target : bench.targets) {
    std::snprintf(text, sizeof text, " from (%.4g, %.4g) to (%.4g, %.4g) mm", target.from_mm.x(),
                  target.from_mm.y(), target.to_mm.x(), target.to_mm.y());
    out.targets += (out.targets.empty() ? "" : ", ") + target.name + text;
  }
  return out;
}

void demand_one_scope(const std::vector<FitSource>& sources) {
  demand_one_lidar(sources, "noise");
  const Scope first = scope_of(*sources.front().session);
  for (const FitSource& source : sources) {
    const Scope other = scope_of(*source.session);
    const auto demand = [&](const char* what, const std::string& a, const std::string& b) {
      if (a == b) return;
      const auto said = [](const std::string& text) { return text.empty() ? "nothing" : text; };
      throw UsageError("the noise of " + sources.front().path + " and " + source.path +
                       " cannot be fitted together: their " + what + " differ (" + said(a) + "; " + said(b) +
                       "). Fit each session by itself, and compare them with 'rig compare'.");
    };
    demand("scan patterns", first.pattern, other.pattern);
    demand("targets", first.targets, other.targets);
  }
}

// --- which captures are at rest ------------------------------------------------------------------------

/// Whether odometry or a stage's track says that the lidar was carried about meanwhile.
bool carried(const fit::Recording& recording, std::int64_t from_us, std::int64_t to_us) {
  constexpr double still_mm = 5, still_rad = 0.2 * fit::rad_per_deg;
  const fit::TrackPose* first = nullptr;
  for (const fit::TrackPose& pose : recording.track()) {
    if (pose.host_us < from_us || pose.host_us > to_us) continue;
    if (!first) first = &pose;
    const auto moved = [](const std::optional<double>& a, const std::optional<double>& b) {
      return a && b ? *b - *a : 0;
    };
    const double way = std::hypot(moved(first->x_mm, pose.x_mm), moved(first->y_mm, pose.y_mm));
    const double turn = std::max(std::abs(fit::wrap_angle(moved(first->heading_rad, pose.heading_rad))),
                                 std::abs(fit::wrap_angle(moved(first->stage_rad, pose.stage_rad))));
    if (way > still_mm || turn > still_rad) return true;
  }
  return false;
}

/// Whether most beams wander over the scene: far, and slowly against the rate of the scans, as no noise does.
bool wanders(const fit::BeamStatistics& beams) {
  constexpr double far_mm = 30, slow = 0.9;
  int judged = 0, wandering = 0;
  for (std::size_t k = 0; k < beams.beams(); ++k) {
    if (beams.count(k) < 20) continue;
    ++judged;
    wandering += beams.variance_mm2(k) > far_mm * far_mm && beams.correlation(k) > slow;
  }
  return 2 * wandering > judged;
}

/// The captures of one step, which may be hundreds: one row.
struct StepCaptures {
  std::string step;
  std::size_t count = 0;
  double least_deg = 0, most_deg = 0;
  long scans = 0;
  int beams = 0;
  std::vector<double> sigma_mm;
};

/// What all captures at rest hold.
struct Sampled {
  std::vector<StepCaptures> steps;
  std::vector<double> range_mm, sigma_mm, correlation;  ///< One a beam and capture.
  long values = 0, ranges = 0, moving = 0;

  void add(const fit::Recording& recording, std::size_t index) {
    const fit::CaptureInfo& capture = recording.captures()[index];
    if (fit::is_turning(capture)) return static_cast<void>(++moving);
    fit::BeamStatistics beams(static_cast<std::size_t>(capture.beams()));
    long shown = 0;
    std::int64_t last_us = capture.started_us;
    recording.for_each_scan(index, [&](const fit::ScanView& scan) {
      beams.add(scan.range_mm);
      shown += static_cast<long>(std::min(beams.beams(), scan.range_mm.size()));
      last_us = scan.host_us;
    });
    if (carried(recording, capture.started_us, last_us) || wanders(beams)) return static_cast<void>(++moving);
    values += shown;
    add_step(capture, beams.scans(), add_beams(beams));
  }

 private:
  double add_beams(const fit::BeamStatistics& beams) {
    std::vector<double> of_capture;
    for (std::size_t k = 0; k < beams.beams(); ++k) {
      const long n = beams.count(k);
      ranges += n;
      if (n < 20) continue;
      of_capture.push_back(std::sqrt(beams.variance_mm2(k)) / median_bias(n));
      range_mm.push_back(beams.mean_mm(k));
      sigma_mm.push_back(of_capture.back());
      correlation.push_back(beams.correlation(k));
    }
    return fit::median_or_nan(std::move(of_capture));
  }

  void add_step(const fit::CaptureInfo& capture, long scans, double sigma) {
    const double deg = capture.stage_rad * fit::deg_per_rad;
    if (steps.empty() || steps.back().step != capture.step || steps.back().beams != capture.beams())
      steps.push_back({capture.step, 0, deg, deg, 0, capture.beams(), {}});
    StepCaptures& here = steps.back();
    ++here.count;
    here.least_deg = std::min(here.least_deg, deg);
    here.most_deg = std::max(here.most_deg, deg);
    here.scans += scans;
    if (std::isfinite(sigma)) here.sigma_mm.push_back(sigma);
  }
};

/// Noise as recorded, without any model: where to look before anything is fitted.
class Noise : public Fitting {
 public:
  std::string kind() const override { return "noise"; }
  std::string describes() const override {
    return "standard deviation, correlation and dropouts of every capture";
  }
  std::vector<std::string> values() const override {
    return {"noise_median_mm", "scan_correlation", "dropout_share"};
  }

  json run(const std::vector<FitSource>& sources, const FitOptions&) const override {
    demand_one_scope(sources);
    Sampled sampled;
    for (const FitSource& source : sources) {
      const auto recording = source.session->recording();
      for (std::size_t i = 0; i < recording->captures().size(); ++i) sampled.add(*recording, i);
    }
    if (sampled.sigma_mm.empty()) explain_absence(sources.front().path, sampled);
    return document(sampled);
  }

 private:
  [[noreturn]] static void explain_absence(const std::string& path, const Sampled& sampled) {
    if (sampled.moving > 0 && sampled.values == 0)
      throw MeasurementError(
          "the lidar moved during every capture of " + path +
          ": what a beam's range does while the beam moves over the scene is not noise. Capture at rest (the "
          "step 'capture'); of a drive, use a part in which the robot stands still, as a separate recording");
    throw MeasurementError(
        "no beam of " + path +
        " has 20 valid samples in one capture at rest: capture more scans at each position");
  }

  static json document(const Sampled& sampled) {
    json out = new_result("noise",
                          "Sample standard deviation of each beam within each capture and the correlation of "
                          "one scan with the next; no model.");
    add_values(out, sampled);
    out["tables"].push_back(captures_table(sampled));
    json plot = new_plot("Noise against range", "mean range (mm)", "standard deviation (mm)");
    add_series(plot, "beams", "points", sampled.range_mm, sampled.sigma_mm);
    out["plots"].push_back(std::move(plot));
    if (std::abs(fit::median_or_nan(sampled.correlation)) > 0.1)
      out["notes"].push_back(
          "Neighbouring scans are correlated: means are less certain than their number of samples suggests.");
    if (sampled.moving > 0)
      out["notes"].push_back("Captures during which the lidar moved are left out, " +
                             std::to_string(sampled.moving) +
                             " of them: beams that move over the scene show no noise.");
    out["undetermined"].push_back(
        "what the noise comes from: range, intensity and incidence change together from beam to beam. 'rig "
        "explain' tells them apart");
    return out;
  }

  static void add_values(json& out, const Sampled& sampled) {
    const auto ranges = static_cast<double>(sampled.ranges);
    const double sigma = fit::median_or_nan(sampled.sigma_mm),
                 u_sigma = u_of_median(sampled.sigma_mm, sigma / std::sqrt(2 * ranges));
    // The share of lost samples: mean and standard deviation of its beta posterior with a flat prior.
    const auto samples = static_cast<double>(sampled.values), lost = samples - ranges;
    const double share = sampled.values ? lost / samples : 0.0;
    const double u_share = std::sqrt((lost + 1) * (samples - lost + 1) / (samples + 3)) / (samples + 2);
    UncertaintyBudget budget("noise_median_mm", "Standard deviation, median beam", "mm");
    budget.add({.source = "samples of each beam, and differences between beams",
                .kind = 'A',
                .distribution = "normal",
                .u = u_sigma});
    budget.publish(out, sigma);
    out["values"].push_back(result_value(
        "scan_correlation", "Correlation of neighbouring scans, median beam",
        {fit::median_or_nan(sampled.correlation), u_of_median(sampled.correlation, 1 / std::sqrt(ranges))},
        ""));
    out["values"].push_back(
        result_value("dropout_share", "Share of samples without echo", {share, u_share}, ""));
  }

  static json captures_table(const Sampled& sampled) {
    json rows = json::array();
    for (const StepCaptures& step : sampled.steps)
      rows.push_back({step_in_words(step.step), step.count, step.least_deg, step.most_deg, step.scans,
                      step.beams, number_or_null(fit::median_or_nan(step.sigma_mm))});
    return {{"title", "Captures"},
            {"columns",
             {"step",
              "captures",
              {{"name", "stage from"}, {"unit", "deg"}, {"decimals", 2}},
              {{"name", "to"}, {"unit", "deg"}, {"decimals", 2}},
              "scans",
              "beams",
              {{"name", "median standard deviation"}, {"unit", "mm"}, {"decimals", 2}}}},
            {"rows", rows}};
  }
};

}  // namespace

std::unique_ptr<Fitting> make_noise() { return std::make_unique<Noise>(); }

}  // namespace rig::fittings
