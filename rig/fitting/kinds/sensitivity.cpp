// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "fit/numeric/angle.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/edge_source.hpp"
#include "rig/fitting/result_document.hpp"
#include "rig/fitting/uncertainty_budget.hpp"

namespace rig::fittings {
namespace {

using fit::EdgeStop;
using nlohmann::json;

const char* name_of(EdgeStop::State state) {
  switch (state) {
    case EdgeStop::State::front:
      return "smooth, target";
    case EdgeStop::State::jitter:
      return "jitter";
    default:
      return "smooth, behind";
  }
}

double share(long part, long whole) { return static_cast<double>(part) / static_cast<double>(whole); }

json stops_table(const fit::EdgeCrossing& crossing) {
  json rows = json::array();
  for (const EdgeStop& stop : crossing.stops)
    rows.push_back({stop.stage_rad * fit::deg_per_rad, stop.n, stop.mean_mm, stop.sd_mm,
                    share(stop.back, stop.n),
                    share(stop.n - (stop.n - stop.outside_front) - (stop.n - stop.outside_back), stop.n),
                    name_of(stop.state)});
  // The paper's table has the jittering stops and one smooth stop on either side; a few more do no harm.
  std::size_t first = rows.size(), last = 0;
  for (std::size_t i = 0; i < crossing.stops.size(); ++i)
    if (crossing.stops[i].state == EdgeStop::State::jitter) first = std::min(first, i), last = i;
  if (first < rows.size()) {
    const std::size_t from = first > 5 ? first - 5 : 0, to = std::min(rows.size(), last + 6);
    rows = json(std::vector<json>(rows.begin() + static_cast<std::ptrdiff_t>(from),
                                  rows.begin() + static_cast<std::ptrdiff_t>(to)));
  }
  return {{"title", "Stops about the edge"},
          {"columns",
           {{{"name", "stage"}, {"unit", "deg"}},
            "samples",
            {{"name", "mean range"}, {"unit", "mm"}},
            {{"name", "standard deviation"}, {"unit", "mm"}},
            "share behind",
            "share between",
            "state"}},
          {"rows", rows}};
}

json response_plot(const fit::EdgeCrossing& crossing) {
  json plot = new_plot("Share of samples that see behind the edge", "stage angle (deg)", "share");
  std::vector<double> x, y, u, line_x, line_y;
  const double edge = crossing.response.edge_rad.value, window = crossing.response.window_rad.value;
  for (const EdgeStop& stop : crossing.stops) {
    if (std::abs(stop.stage_rad - edge) > 4 * window + 3 * crossing.step_rad) continue;
    const double p = share(stop.back, stop.n);
    x.push_back(stop.stage_rad * fit::deg_per_rad);
    y.push_back(p);
    u.push_back(
        std::sqrt(std::max(p * (1 - p), 1.0 / static_cast<double>(stop.n)) / static_cast<double>(stop.n)));
  }
  for (int i = -100; i <= 100; ++i) {
    const double along = (crossing.right ? -1 : 1) * i / 50.0;
    line_x.push_back((edge + i / 50.0 * window) * fit::deg_per_rad);
    line_y.push_back(fit::share_behind(along, crossing.response.ramp_probability > 0.5));
  }
  add_series(plot, "measured", "errorbars", x, y, u);
  add_series(plot, "response", "line", line_x, line_y);
  return plot;
}

/// Mean of the windows of all crossings that know it well, weighted; widened when they disagree.
struct JointWindow {
  fit::Estimate rad;
  double freedom = Contribution::many;
};
JointWindow joint_window(const std::vector<SourcedCrossing>& crossings) {
  double best = 1e9, weights = 0, sum = 0, chi2 = 0;
  int used = 0;
  for (const auto& sourced : crossings) best = std::min(best, sourced.crossing.response.window_rad.u);
  const auto good = [&](const fit::EdgeResponse& response) { return response.window_rad.u <= 3 * best; };
  for (const auto& [crossing, recording] : crossings) {
    if (!good(crossing.response)) continue;
    const double w = 1 / (crossing.response.window_rad.u * crossing.response.window_rad.u);
    weights += w, sum += w * crossing.response.window_rad.value, ++used;
  }
  const double mean = sum / weights;
  for (const auto& [crossing, recording] : crossings)
    if (good(crossing.response))
      chi2 += std::pow((crossing.response.window_rad.value - mean) / crossing.response.window_rad.u, 2);
  const double widen = used > 1 ? std::sqrt(std::max(1.0, chi2 / (used - 1))) : 1;
  return {{mean, widen / std::sqrt(weights)}, widen > 1 ? used - 1 : Contribution::many};
}

/// What the stage may do to its angle at one place.
void add_stage_angle(UncertaintyBudget& budget, const fit::Bench& bench, double stage_rad, int approach) {
  budget.add({.source = "resolution of the stage (bench file)",
              .distribution = "rectangular",
              .u = u_of_resolution(bench.stage_resolution_rad) * fit::deg_per_rad});
  using fit::DeviceAccuracy;
  const double deg = stage_rad * fit::deg_per_rad;
  for (const fit::AccuracyLine& line : fit::accuracy_in_words(fit::accuracy_of(bench))) {
    if (line.member == &DeviceAccuracy::stage_scale) budget.add(line, line.u * deg);
    if (line.member == &DeviceAccuracy::stage_eccentricity_rad)
      budget.add(line, line.u / std::numbers::sqrt2);
    if (line.member == &DeviceAccuracy::stage_backlash_rad) budget.add(line, line.u / 2 * std::abs(approach));
    if (line.member == &DeviceAccuracy::stage_position_rad) budget.add(line, line.u);
  }
}

/// Difference of the edge's stage angle between the two directions of approach: the play of the stage.
void add_backlash(json& out, const std::vector<SourcedCrossing>& crossings, double u_resolution_rad) {
  for (const auto& a : crossings)
    for (const auto& b : crossings) {
      if (a.crossing.step != b.crossing.step || a.crossing.right != b.crossing.right) continue;
      if (a.crossing.approach != 1 || b.crossing.approach != -1) continue;
      const auto &up = a.crossing.response.edge_rad, &down = b.crossing.response.edge_rad;
      out["values"].push_back(
          result_value("backlash_deg", "Edge reached from below minus from above (backlash of the stage)",
                       {(up.value - down.value) * fit::deg_per_rad,
                        std::hypot(up.u, down.u, std::numbers::sqrt2 * u_resolution_rad) * fit::deg_per_rad},
                       "deg"));
      return;
    }
}

class Sensitivity : public Fitting {
 public:
  std::string kind() const override { return "sensitivity"; }
  std::string describes() const override {
    return "angular sensitivity: the edge transition width, within which a beam sees sometimes one surface, "
           "sometimes the other";
  }
  std::vector<std::string> values() const override {
    return {"window_deg", "window_counted_deg", "edge_deg", "backlash_deg", "gap_mm"};
  }
  std::vector<FitOption> options() const override { return edge_options(); }

  json run(const std::vector<FitSource>& sources, const FitOptions& options) const override {
    const EdgeSource source = read_edges(sources, options);
    const auto best_window = [](const SourcedCrossing& a, const SourcedCrossing& b) {
      const bool counted_a = a.crossing.counted.has_value(), counted_b = b.crossing.counted.has_value();
      if (counted_a != counted_b) return counted_a;
      return a.crossing.response.window_rad.u < b.crossing.response.window_rad.u;
    };
    const fit::EdgeCrossing& best =
        std::min_element(source.crossings.begin(), source.crossings.end(), best_window)->crossing;
    json out = new_result(
        "sensitivity",
        "Angular sensitivity after Zhao et al., experiment A4: a beam at a target's edge is followed while "
        "the "
        "stage turns in small steps. A stop jitters when more samples leave the surface's gate than chance "
        "allows (binomial test, 1 in 1,000). Edge and window are the posterior mean and standard deviation "
        "of "
        "a straight or a Gaussian response, whichever the data favour.");
    add_values(out, source, best);
    out["tables"].push_back(stops_table(best));
    out["tables"].push_back(crossings_table(source.crossings));
    out["plots"].push_back(response_plot(best));
    for (const std::string& what : source.contradictions) out["contradictions"].push_back(what);
    add_remarks(out, best);
    return out;
  }

 private:
  static void add_values(json& out, const EdgeSource& source, const fit::EdgeCrossing& best) {
    const JointWindow joint = joint_window(source.crossings);
    const fit::Bench& bench = source.recordings.front()->bench();
    const fit::DeviceAccuracy accuracy = fit::accuracy_of(bench);
    const double u_resolution_rad = u_of_resolution(source.recordings.front()->bench().stage_resolution_rad);
    const double window_deg = joint.rad.value * fit::deg_per_rad;
    const char* const window_label = "Edge transition width";
    UncertaintyBudget window("window_deg", window_label, "deg");
    window.add({.source = "samples, and scatter of the stops' angles (posterior)",
                .kind = 'A',
                .distribution = std::isfinite(joint.freedom) ? "Student" : "normal",
                .u = joint.rad.u * fit::deg_per_rad,
                .freedom = joint.freedom});
    // Over a window as narrow as this, what repeats once a turn is a slope.
    for (const fit::AccuracyLine& line : fit::accuracy_in_words(accuracy)) {
      if (line.member == &fit::DeviceAccuracy::stage_scale) window.add(line, line.u * window_deg);
      if (line.member == &fit::DeviceAccuracy::stage_eccentricity_rad)
        window.add(line, line.u * line.per_unit / std::numbers::sqrt2 * window_deg);
    }
    window.publish(out, window_deg);
    if (best.counted) {
      const fit::Estimate counted{best.counted->width_rad() * fit::deg_per_rad,
                                  best.counted->step_rad / std::sqrt(6.0) * fit::deg_per_rad};
      out["values"].push_back(result_value(
          "window_counted_deg", "Edge transition width by counting (Zhao et al.)", counted, "deg"));
      compare_methods(
          out, window_label,
          {"by the share of samples", {window_deg, window.u()}, fit::coverage_factor(window.freedom())},
          {"by counting stops", counted}, "deg");
    } else {
      out["undetermined"].push_back(
          "the edge transition width by counting (Zhao et al.): no edge was swept in even steps with a "
          "smooth stop on both sides. Add a sweep of 0.01 deg steps through the edge.");
    }
    UncertaintyBudget edge("edge_deg", "Stage angle at which the beam is on the edge", "deg");
    edge.add({.source = "samples and stops (posterior)",
              .kind = 'A',
              .distribution = "normal",
              .u = best.response.edge_rad.u * fit::deg_per_rad});
    add_stage_angle(edge, bench, best.response.edge_rad.value, best.approach);
    edge.publish(out, best.response.edge_rad.value * fit::deg_per_rad);
    add_backlash(out, source.crossings, u_resolution_rad);
    out["values"].push_back(plain_value(
        "gap_mm", "Depth of the edge", best.back_mm > 0 ? best.back_mm - best.front_mm : std::nan(""), "mm"));
    out["data"] = {{"beam_step", best.step},
                   {"beam_deg", best.beam_rad * fit::deg_per_rad},
                   {"ramp_probability", best.response.ramp_probability},
                   {"dispersion", best.response.dispersion}};
  }

  static json crossings_table(const std::vector<SourcedCrossing>& crossings) {
    json rows = json::array();
    for (const auto& [crossing, recording] : crossings)
      rows.push_back({crossing.beam_rad * fit::deg_per_rad, crossing.right ? "right" : "left",
                      crossing.approach, crossing.response.edge_rad.value * fit::deg_per_rad,
                      crossing.response.edge_rad.u * fit::deg_per_rad,
                      crossing.response.window_rad.value * fit::deg_per_rad,
                      crossing.response.window_rad.u * fit::deg_per_rad, crossing.response.stops_inside});
    return {{"title", "Beams that passed the edge"},
            {"columns",
             {{{"name", "beam"}, {"unit", "deg"}},
              "end",
              "approach",
              {{"name", "edge at stage"}, {"unit", "deg"}, {"decimals", 4}},
              {{"name", "u"}, {"unit", "deg"}},
              {{"name", "window"}, {"unit", "deg"}},
              {{"name", "u"}, {"unit", "deg"}},
              "stops inside"}},
            {"rows", rows}};
  }

  static void add_remarks(json& out, const fit::EdgeCrossing& best) {
    if (best.response.stops_inside < 2)
      out["undetermined"].push_back(
          "the window's width: fewer than two stops lie inside it, so it is only bounded from above. Use a "
          "smaller step of the stage.");
    if (best.response.dispersion > 1)
      out["notes"].push_back(
          "The shares scatter more than chance between stops (chi-square per degree of freedom " +
          fit::format_value(best.response.dispersion, 0) +
          "): the stage does not repeat its angles, or the response is neither straight nor Gaussian. The "
          "uncertainties were widened accordingly.");
    if (best.response.ramp_probability > 0.2 && best.response.ramp_probability < 0.8)
      out["undetermined"].push_back("whether the response is straight or Gaussian");
    if (best.response.ramp_probability <= 0.5)
      out["notes"].push_back("The response is Gaussian: its window is given from 1 % to 99 %.");
  }
};

}  // namespace

std::unique_ptr<Fitting> make_sensitivity() { return std::make_unique<Sensitivity>(); }

}  // namespace rig::fittings
