// SPDX-License-Identifier: MIT
// The result `deskew`: values, tables, pictures and notes of what a deskewing computed.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "fit/mechanism.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/deskewing_work.hpp"
#include "rig/fitting/result_document.hpp"

namespace rig {
namespace {

using deskew_parts::Departures;
using deskew_parts::Way;
using nlohmann::json;

/// One way to correct scans, as it is compared with the others.
struct ComparedWay {
  const char* label;
  const char* value_name;  ///< Of its mean at the greatest stage rate.
  std::vector<double> Departures::*values;
};
constexpr std::array<ComparedWay, 3> compared_ways{
    {{"not corrected", "shape_turning_mm", &Departures::before},
     {"by the stage", "shape_by_stage_mm", &Departures::by_stage},
     {"fused", "shape_fused_mm", &Departures::fused}}};

fit::Estimate mean_of(const std::vector<double>& values) {
  double sum = 0, squares = 0;
  for (const double v : values) sum += v;
  const auto n = static_cast<double>(values.size());
  if (values.empty()) return {std::nan(""), 0};
  for (const double v : values) squares += (v - sum / n) * (v - sum / n);
  return {sum / n, n > 1 ? std::sqrt(squares / (n - 1) / n) : 0};
}

/// Mean of a quantity of scans in a row. Neighbours see the same and err alike: the uncertainty is that of
/// the means of ten in a row, where there are enough of them.
fit::Estimate mean_in_a_row(const std::vector<double>& values) {
  constexpr std::size_t row = 10, enough = 5;
  if (values.size() < row * enough) return mean_of(values);
  std::vector<double> means;
  for (std::size_t i = 0; i + row <= values.size(); i += row)
    means.push_back(mean_of({values.begin() + static_cast<std::ptrdiff_t>(i),
                             values.begin() + static_cast<std::ptrdiff_t>(i + row)})
                        .value);
  return {mean_of(values).value, mean_of(means).u};
}

json new_map(const std::string& title) {
  json plot = new_plot(title, "x (mm)", "y (mm)");
  plot["equal_axes"] = true;
  return plot;
}

json picture(const Way& way) {
  std::vector<double> x, y;
  const std::size_t stride = std::max<std::size_t>(1, way.map.size() / 15'000);
  for (std::size_t i = 0; i < way.map.size(); i += stride) {
    x.push_back(std::round(way.map[i].x()));
    y.push_back(std::round(way.map[i].y()));
  }
  json plot = new_map("Map: " + way.label);
  add_series(plot, way.label, "points", x, y);
  return plot;
}

json path_plot(const fit::Path& before, const std::vector<fit::TimedPose>& after) {
  json plot = new_map("Path");
  const auto add = [&](const char* name, const std::vector<fit::TimedPose>& poses) {
    std::vector<double> x, y;
    const std::size_t stride = std::max<std::size_t>(1, poses.size() / 3000);
    for (std::size_t i = 0; i < poses.size(); i += stride) {
      x.push_back(poses[i].pose.x_mm);
      y.push_back(poses[i].pose.y_mm);
    }
    add_series(plot, name, "line", x, y);
  };
  add("odometry", before.poses());
  if (!after.empty()) add("fused", after);
  return plot;
}

void add_mean_distance(json& out, const char* name, const std::string& of_what,
                       const std::vector<double>& values) {
  const fit::Estimate mean = mean_of(values);
  if (!std::isfinite(mean.value)) return;
  out["values"].push_back(result_value(name, "Distance from the scene, " + of_what, mean, "mm"));
  out["budget"].push_back(
      budget_line("distance from the scene, " + of_what + ": scatter from scan to scan", "A", mean.u, "mm"));
}

}  // namespace

std::string Deskewing::Work::speeds_in_words() const {
  char text[300];
  std::snprintf(text, sizeof text,
                "Within one scan the lidar turned by at most %.2f deg and moved by at most %.0f mm: at 2 m a "
                "point is displaced by up to %.0f mm.",
                sharpest_turn_rad_ * fit::deg_per_rad, longest_way_mm_,
                longest_way_mm_ + 2000 * sharpest_turn_rad_);
  return text;
}

/// Table, plot and values of the scans' shapes against the scene at rest.
void Deskewing::Work::add_shapes(json& out) const {
  if (departures_.empty()) return;
  const char* const title = "Distance of a scan's points from the scene as seen at rest";
  json columns = {{{"name", "stage rate"}, {"unit", "deg/s"}}, "scans"}, rows = json::array();
  for (const auto& [rate, departures] : departures_) {
    json row = {number_or_null(rate), departures.before.size()};
    for (const ComparedWay& way : compared_ways)
      row.push_back(number_or_null(mean_of(departures.*way.values).value));
    rows.push_back(std::move(row));
  }
  json plot = new_plot(title, "stage rate (deg/s)", "rms distance (mm)");
  for (const ComparedWay& way : compared_ways) {
    columns.push_back({{"name", way.label}, {"unit", "mm"}, {"decimals", 2}});
    std::vector<double> rates, means;
    for (const auto& [rate, departures] : departures_) {
      if ((departures.*way.values).empty()) continue;
      rates.push_back(rate);
      means.push_back(mean_of(departures.*way.values).value);
    }
    if (!rates.empty()) add_series(plot, way.label, "line", rates, means);
  }
  out["tables"].push_back({{"title", title}, {"columns", columns}, {"rows", rows}});
  out["plots"].push_back(std::move(plot));
  if (departures_.contains(0))
    add_mean_distance(out, "shape_at_rest_mm", "at rest", departures_.at(0).before);
  const auto slower = [](const auto& a, const auto& b) { return std::abs(a.first) < std::abs(b.first); };
  const auto& [rate, fastest] = *std::ranges::max_element(departures_, slower);
  const std::string turning = ", at " + fit::rounded(rate, 3) + " deg/s";
  for (const ComparedWay& way : compared_ways)
    add_mean_distance(out, way.value_name, way.label + turning, fastest.*way.values);
}

/// The scans taken in motion against the reference: each way, and what it gains scan by scan.
void Deskewing::Work::add_reference(json& out) const {
  if (!options_.reference) return;
  std::vector<double> before, by_path, fused, gain, still, number;
  for (std::size_t i = 0; i < scans_.size(); ++i) {
    const Distances& at = distances_[i];
    const bool judged =
        std::isfinite(at.before) && std::isfinite(at.by_path) && (!options_.fuse || std::isfinite(at.fused));
    if (!judged) continue;
    if (!moving(scans_[i].sweep)) {
      still.push_back(at.before);
      continue;
    }
    number.push_back(static_cast<double>(i + 1));
    before.push_back(at.before), by_path.push_back(at.by_path);
    if (options_.fuse) fused.push_back(at.fused);
    gain.push_back(at.before - (options_.fuse ? at.fused : at.by_path));
  }
  if (before.size() < 2)
    throw MeasurementError(
        "no scan that was taken in motion fits the reference '" + options_.reference->text() +
        "': it must show the same scene in the same frame (stage axis, or odometry's origin), at least 50 "
        "points of it within 60 mm. Check the reference, or the bench file's mount");
  json plot = new_plot("Distance of each scan from the reference at rest", "scan", "rms distance (mm)");
  const auto add = [&](const char* name, const std::string& label, const std::vector<double>& values) {
    if (values.empty()) return;
    const fit::Estimate mean = mean_in_a_row(values);
    out["values"].push_back(result_value(name, label, mean, "mm"));
    out["budget"].push_back(budget_line(label + ": scatter from scan to scan", "A", mean.u, "mm"));
  };
  add("reference_before_mm", "Distance from the reference, scans as recorded", before);
  add("reference_by_path_mm", "Distance from the reference, corrected by the path", by_path);
  add("reference_fused_mm", "Distance from the reference, fused", fused);
  add("reference_gain_mm", "Reduction of that distance by the correction, per scan", gain);
  add("reference_at_rest_mm", "Distance from the reference, scans at rest", still);
  add_series(plot, "not corrected", "points", number, before);
  add_series(plot, "by the path", "points", number, by_path);
  if (options_.fuse) add_series(plot, "fused", "points", number, fused);
  out["plots"].push_back(std::move(plot));
  out["notes"].push_back("Judged against the reference " + options_.reference->text() + ": " +
                         std::to_string(before.size()) + " of " + std::to_string(scans_.size()) +
                         " scans were taken in motion and show enough of it. Each scan is aligned with it, "
                         "so that only its shape counts; what is left at rest is the noise of one scan.");
}

void Deskewing::Work::add_crispness(json& out) const {
  json rows = json::array();
  for (const Way& way : ways_) {
    const fit::Crispness& whole = way.crispness;
    rows.push_back({way.label, number_or_null(way.local_mm), number_or_null(whole.mean_thickness_mm),
                    number_or_null(whole.thickness_mm), number_or_null(whole.entropy)});
    out["values"].push_back(plain_value("thickness_" + way.name + "_mm", "Mean wall thickness, " + way.label,
                                        std::round(100 * whole.mean_thickness_mm) / 100, "mm"));
  }
  out["tables"].push_back({{"title", "Sharpness of the map"},
                           {"columns",
                            {"scans placed by",
                             {{"name", "wall thickness within 20 scans"}, {"unit", "mm"}},
                             {{"name", "mean wall thickness, whole map"}, {"unit", "mm"}},
                             {{"name", "median wall thickness, whole map"}, {"unit", "mm"}},
                             {{"name", "entropy"}, {"unit", "nat"}}}},
                           {"rows", rows}});
}

void Deskewing::Work::add_timing(json& out) const {
  const char *const name = "time_offset_ms", *const label = "Path time minus scan time";
  const double offset_ms = 1e3 * timing_.offset_s;
  const bool estimated = !options_.offset_ms && estimate_.determined;
  out["values"].push_back(estimated ? result_value(name, label, {offset_ms, 1e3 * estimate_.offset_s.u}, "ms")
                                    : plain_value(name, label, offset_ms, "ms"));
  if (estimated)
    out["budget"].push_back(
        budget_line("time offset: pairs of scans (resampled)", "A", 1e3 * estimate_.offset_s.u, "ms"));
  if (!options_.offset_ms && !estimated)
    out["undetermined"].push_back(
        "The time offset between scans and path: the motion changes too little to show it. 0 was used.");
}

void Deskewing::Work::add_plots(json& out) const {
  json& plots = out["plots"];
  for (const Way& way : ways_)
    if (way.name != "rigid") plots.push_back(picture(way));
  plots.push_back(path_plot(path_, fused_path_));
  if (estimate_.tried_s.empty() || estimate_.score_mm.empty()) return;
  std::vector<double> tried_ms;
  for (const double s : estimate_.tried_s) tried_ms.push_back(1e3 * s);
  json plot = new_plot("Disagreement of scans against time offset", "path time minus scan time (ms)",
                       "disagreement (mm)");
  add_series(plot, "scans", "line", tried_ms, estimate_.score_mm);
  plots.push_back(std::move(plot));
}

void Deskewing::Work::add_notes(json& out) const {
  json& notes = out["notes"];
  notes.push_back(speeds_in_words());
  if (timing_.reversed)
    notes.push_back(
        "The beams are listed against the order in which they were taken (judged by the agreement of "
        "the scans).");
  if (!options_.fuse) return;
  char text[200];
  std::snprintf(text, sizeof text, "%zu of %zu scans were matched, in %.2f ms each.", matched_, scans_.size(),
                fusion_ms_ / static_cast<double>(scans_.size()));
  notes.push_back(text);
  if (weakest_ < 0.02)
    notes.push_back(
        "Some scans constrain the pose poorly in one direction (a corridor): there the odometry decides.");
}

json Deskewing::Work::document() const {
  json out = new_result(
      "deskew",
      "Every beam is placed by the odometry (or stage track) interpolated at its own time; the fusion "
      "matches each scan to the map of those before by point-to-line ICP with robust weights, distributes "
      "the odometry's error linearly over the beams and repeats until it converges (after Wang et al.). Wall "
      "thickness: standard deviation of the points across the wall they lie on, within 150 mm.");
  add_crispness(out);
  add_timing(out);
  add_shapes(out);
  add_reference(out);
  add_plots(out);
  add_notes(out);
  out["data"] = {{"scans", scans_.size()},
                 {"points", count_},
                 {"reversed", timing_.reversed},
                 {"disagreement_mm", number_or_null(estimate_.disagreement_mm)},
                 {"disagreement_other_order_mm", number_or_null(estimate_.disagreement_other_mm)},
                 {"fusion_ms_per_scan", fusion_ms_ / static_cast<double>(scans_.size())}};
  return out;
}

}  // namespace rig
