// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "fit/angle.hpp"
#include "fit/beam_statistics.hpp"
#include "fit/median.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"
#include "rig/fitting/result_document.hpp"

namespace rig::fittings {
namespace {

using nlohmann::json;

double median_of(std::vector<double> values) {
  return values.empty() ? std::nan("") : fit::median_of(std::move(values));
}

/// Noise as recorded, without any model: where to look before anything is fitted.
class Noise : public Fitting {
 public:
  std::string kind() const override { return "noise"; }
  std::string describes() const override {
    return "standard deviation, correlation and dropouts of every capture";
  }

  json run(const std::vector<FitSource>& sources, const json&) const override {
    const auto recording = sources.front().session->recording();
    std::vector<StepCaptures> captures;
    std::vector<double> range, sigma, sigmas, correlations;
    long values = 0, ranges = 0, turning = 0;
    for (std::size_t i = 0; i < recording->captures().size(); ++i) {
      const fit::CaptureInfo& capture = recording->captures()[i];
      // While the stage turns, a beam's range changes because it meets another place.
      if (fit::is_turning(capture)) {
        ++turning;
        continue;
      }
      fit::BeamStatistics beams(static_cast<std::size_t>(capture.beams()));
      recording->for_each_scan(i, [&](const fit::ScanView& scan) {
        beams.add(scan.range_mm);
        values += static_cast<long>(std::min(beams.beams(), scan.range_mm.size()));
      });
      std::vector<double> of_capture;
      for (std::size_t k = 0; k < beams.beams(); ++k) {
        ranges += beams.count(k);
        if (beams.count(k) < 20) continue;
        range.push_back(beams.mean_mm(k));
        sigma.push_back(std::sqrt(beams.variance_mm2(k)));
        of_capture.push_back(sigma.back());
        sigmas.push_back(sigma.back());
        correlations.push_back(beams.correlation(k));
      }
      add_capture(captures, capture, beams.scans(), median_of(of_capture));
    }
    if (sigmas.empty())
      throw MeasurementError(
          "no beam of " + sources.front().path +
          " has 20 valid samples in one capture at rest: capture more scans at each position");
    json out = document(rows_of(captures), range, sigma, median_of(sigmas), median_of(correlations), values,
                        values - ranges);
    if (turning > 0)
      out["notes"].push_back("Captures of a turning stage are left out: " + std::to_string(turning) + ".");
    return out;
  }

 private:
  /// The captures of one step, which may be hundreds: one row.
  struct StepCaptures {
    std::string step;
    std::size_t count = 0;
    double least_deg = 0, most_deg = 0;
    long scans = 0;
    int beams = 0;
    std::vector<double> sigma_mm;
  };

  static void add_capture(std::vector<StepCaptures>& all, const fit::CaptureInfo& capture, long scans,
                          double sigma_mm) {
    const double deg = capture.stage_rad * fit::deg_per_rad;
    if (all.empty() || all.back().step != capture.step || all.back().beams != capture.beams())
      all.push_back({capture.step, 0, deg, deg, 0, capture.beams(), {}});
    StepCaptures& here = all.back();
    ++here.count;
    here.least_deg = std::min(here.least_deg, deg);
    here.most_deg = std::max(here.most_deg, deg);
    here.scans += scans;
    if (std::isfinite(sigma_mm)) here.sigma_mm.push_back(sigma_mm);
  }

  static json rows_of(const std::vector<StepCaptures>& all) {
    json rows = json::array();
    for (const StepCaptures& step : all)
      rows.push_back({step.step, step.count, step.least_deg, step.most_deg, step.scans, step.beams,
                      number_or_null(median_of(step.sigma_mm))});
    return rows;
  }

  static json document(const json& rows, const std::vector<double>& range, const std::vector<double>& sigma,
                       double typical, double correlation, long values, long none) {
    json out = new_result("noise",
                          "Sample standard deviation of each beam within each capture and the correlation of "
                          "one scan with the next; no model.");
    const double u = typical / std::sqrt(2.0 * static_cast<double>(sigma.size()));
    // A median of estimates is 1.25 times as uncertain as their mean; a share has a beta posterior (flat
    // prior).
    const auto samples = static_cast<double>(values), lost = static_cast<double>(none);
    const double u_correlation = 1.2533 / std::sqrt(std::max(1.0, samples - lost));
    const double u_share = std::sqrt((lost + 1) * (samples - lost + 1) / (samples + 3)) / (samples + 2);
    const double share = values ? lost / samples : 0.0;
    out["values"] = {result_value("noise_median_mm", "Standard deviation, median beam", {typical, u}, "mm"),
                     result_value("scan_correlation", "Correlation of neighbouring scans, median beam",
                                  {correlation, u_correlation}, ""),
                     result_value("dropout_share", "Share of samples without echo", {share, u_share}, "")};
    out["tables"] = {{{"title", "Captures"},
                      {"columns",
                       {"step",
                        "captures",
                        {{"name", "stage from"}, {"unit", "deg"}, {"decimals", 2}},
                        {{"name", "to"}, {"unit", "deg"}, {"decimals", 2}},
                        "scans",
                        "beams",
                        {{"name", "median standard deviation"}, {"unit", "mm"}}}},
                      {"rows", rows}}};
    json plot = new_plot("Noise against range", "mean range (mm)", "standard deviation (mm)");
    add_series(plot, "beams", "points", range, sigma);
    out["plots"].push_back(std::move(plot));
    if (std::abs(correlation) > 0.1)
      out["notes"].push_back(
          "Neighbouring scans are correlated: means are less certain than their number of samples says.");
    return out;
  }
};

}  // namespace

std::unique_ptr<Fitting> make_noise() { return std::make_unique<Noise>(); }

}  // namespace rig::fittings
