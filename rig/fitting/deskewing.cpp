// SPDX-License-Identifier: MIT
#include "rig/fitting/deskewing.hpp"

#include <SQLiteCpp/SQLiteCpp.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>

#include "fit/deskew.hpp"
#include "fit/mechanism.hpp"
#include "fit/shape_at_rest.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/result_document.hpp"

namespace rig {
namespace {

using Eigen::Vector2d;
using nlohmann::json;
using Points = std::vector<Vector2d>;

/// A scan with what is needed to write it again.
struct ScanOfSession {
  std::int64_t capture = 0, seq = 0, host_us = 0;
  double stage_rate_deg_s = 0;
  bool turning = false;
  std::size_t beams = 0;
  fit::Sweep sweep;
};

std::vector<ScanOfSession> read_scans(const fit::Recording& recording, int most_per_capture) {
  std::vector<ScanOfSession> scans;
  for (std::size_t i = 0; i < recording.captures().size(); ++i) {
    const fit::CaptureInfo& capture = recording.captures()[i];
    int count = 0;
    recording.for_each_scan(i, [&](const fit::ScanView& scan) {
      if (most_per_capture > 0 && ++count > most_per_capture) return;
      scans.push_back({capture.id, scan.seq, scan.host_us, capture.stage_rate_rad_s * fit::deg_per_rad,
                       fit::is_turning(capture), scan.range_mm.size(),
                       fit::sweep_of(scan, capture, recording.bench().lidar)});
    });
  }
  std::stable_sort(scans.begin(), scans.end(), [](const ScanOfSession& a, const ScanOfSession& b) {
    return a.sweep.begin_s < b.sweep.begin_s;
  });
  return scans;
}

/// One way to place and correct the scans of a session.
struct Way {
  std::string name, label;
  Points map;           ///< All points of all scans in the map.
  double local_mm = 0;  ///< Mean thickness within windows of some scans: no drift, only distortion.
  fit::Crispness crispness;

  /// Judges windows of 20 scans, then the whole.
  void judge(const std::vector<std::size_t>& scan_ends) {
    double sum = 0;
    int windows = 0;
    constexpr std::size_t length = 20;
    for (std::size_t first = 0; first + length <= scan_ends.size(); first += length) {
      const std::size_t from = first == 0 ? 0 : scan_ends[first - 1], to = scan_ends[first + length - 1];
      const auto window = fit::crispness({map.data() + from, to - from}, 150, 400);
      if (window.judged < 20) continue;
      sum += window.mean_thickness_mm;
      ++windows;
    }
    local_mm = windows > 0 ? sum / windows : std::nan("");
    crispness = fit::crispness(map);
  }
};

/// How far one scan's points are from the reference, rms in mm, by each way of correcting it; NaN: not
/// judged.
struct Distances {
  double before = std::nan(""), by_path = std::nan(""), fused = std::nan("");
};

/// How far scans at one stage rate depart from the scene as seen at rest, mm, one value a scan.
struct Departures {
  std::vector<double> before, by_stage, fused;
};

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

/// Everything between reading and writing.
class Deskewing::Work {
 public:
  Work(const DeskewOptions& options, const fit::Recording& recording, const std::string& name)
      : options_(options),
        carrier_(fit::carrier_of(recording)),
        path_(carrier_.path),
        scans_(read_scans(recording, options.scans_per_capture)) {
    const fit::Mount& mount = recording.bench().lidar.mount;
    lidar_ = {mount.x_mm.value, mount.y_mm.value, mount.yaw_rad.value};
    if (scans_.empty()) throw MeasurementError(name + " holds no scans.");
    if (path_.poses().size() < 2)
      throw MeasurementError(name +
                             " does not say how the lidar moved: it has neither odometry nor a stage track. "
                             "Import the recording with its odometry (rig import).");
    if (std::ranges::none_of(scans_, [&](const ScanOfSession& scan) { return moving(scan.sweep); }))
      throw MeasurementError(name +
                             ": by its path the lidar stood still during every scan, so there is no motion "
                             "distortion to remove.");
    find_timing();
  }

  void run() {
    for (const ScanOfSession& scan : scans_) {
      count_ += scan.sweep.points.size();
      ends_.push_back(count_);
    }
    distances_.resize(scans_.size());
    look_at_rest();
    by_odometry();
    if (options_.fuse) by_fusion();
    for (Way& way : ways_) way.judge(ends_);
  }

  [[nodiscard]] json document() const;
  void write(const std::string& file) const;

 private:
  void find_timing();
  void by_odometry();
  void by_fusion();
  [[nodiscard]] double path_begin(const fit::Sweep& sweep) const { return sweep.begin_s + timing_.offset_s; }
  void look_at_rest();
  [[nodiscard]] bool moving(const fit::Sweep& sweep) const;
  [[nodiscard]] std::vector<fit::ShapeAtRest::Scan> standing_about(const fit::Pose2& pose) const;
  void read_reference(const fit::Recording& reference);
  void add_reference(json& out) const;
  void compare_with_rest(std::size_t scan, std::vector<double> Departures::*way, double Distances::*distance,
                         const Points& points);
  [[nodiscard]] std::string speeds_in_words() const;
  void add_crispness(json& out) const;
  void add_timing(json& out) const;
  void add_shapes(json& out) const;
  void add_plots(json& out) const;
  void add_notes(json& out) const;

  DeskewOptions options_;
  fit::Carrier carrier_;
  const fit::Path& path_;
  fit::Pose2 lidar_;
  std::vector<ScanOfSession> scans_;
  fit::SweepTiming timing_;
  fit::TimingEstimate estimate_;
  std::vector<Way> ways_;
  std::vector<std::size_t> ends_;
  std::size_t count_ = 0, matched_ = 0;
  std::vector<fit::Pose2> begins_;           ///< Of the lidar in the map.
  std::vector<fit::TimedPose> fused_path_;   ///< Of the carrier.
  std::vector<Points> corrected_;            ///< Each scan's points in the lidar's frame at its beginning.
  fit::ShapeAtRest at_rest_;                 ///< Of what a stage turned; else empty.
  std::map<double, Departures> departures_;  ///< By stage rate, deg/s.
  std::vector<Distances> distances_;         ///< By scan.
  double fusion_ms_ = 0, weakest_ = 1, sharpest_turn_rad_ = 0, longest_way_mm_ = 0;
};

void Deskewing::Work::find_timing() {
  std::vector<fit::Sweep> sweeps;
  for (const ScanOfSession& scan : scans_) sweeps.push_back(scan.sweep);
  if (!options_.offset_ms) {
    estimate_ = fit::estimate_timing(sweeps, path_, lidar_, {0.2, options_.reversed, carrier_.drifts});
    timing_.reversed = estimate_.timing.reversed;
    if (estimate_.determined) timing_ = estimate_.timing;
  } else {
    timing_.offset_s = *options_.offset_ms * 1e-3;
  }
  if (options_.reversed) timing_.reversed = *options_.reversed;
}

/// Whether the lidar moves by more within the sweep than the noise of any path.
bool Deskewing::Work::moving(const fit::Sweep& sweep) const {
  constexpr double still_mm = 1, still_rad = 0.05 * fit::rad_per_deg;
  const fit::Pose2 begin = path_.at(path_begin(sweep)), end = path_.at(path_begin(sweep) + sweep.duration_s);
  return (end.position() - begin.position()).norm() > still_mm ||
         std::abs(fit::wrap_angle(end.heading_rad - begin.heading_rad)) > still_rad;
}

/// Scans of this recording while its carrier stood about there.
std::vector<fit::ShapeAtRest::Scan> Deskewing::Work::standing_about(const fit::Pose2& pose) const {
  constexpr double about_mm = 50, about_rad = 3 * fit::rad_per_deg;
  std::vector<fit::ShapeAtRest::Scan> standing;
  for (const ScanOfSession& scan : scans_) {
    const fit::Pose2 at = path_.at(path_begin(scan.sweep));
    if (moving(scan.sweep) || (at.position() - pose.position()).norm() > about_mm ||
        std::abs(fit::wrap_angle(at.heading_rad - pose.heading_rad)) > about_rad)
      continue;
    standing.push_back({scan.sweep, at * lidar_});
  }
  return standing;
}

/// The reference's scans at rest, each where its own session says that the lidar was.
void Deskewing::Work::read_reference(const fit::Recording& reference) {
  constexpr int enough = 200;
  const std::vector<ScanOfSession> scans = read_scans(reference, enough);
  const fit::Carrier carrier = fit::carrier_of(reference);
  const fit::Mount& mount = reference.bench().lidar.mount;
  const fit::Pose2 lidar{mount.x_mm.value, mount.y_mm.value, mount.yaw_rad.value};
  std::vector<fit::ShapeAtRest::Scan> resting;
  for (const ScanOfSession& scan : scans)
    if (!scan.turning)
      resting.push_back(
          {scan.sweep, (carrier.path.empty() ? fit::Pose2{} : carrier.path.at(scan.sweep.begin_s)) * lidar});
  at_rest_ = fit::ShapeAtRest(resting);
}

/// A stage says exactly where the lidar is, and at rest no scan is distorted: the truth for those that are.
void Deskewing::Work::look_at_rest() {
  if (options_.reference) {
    if (const fit::Recording* recording = options_.reference->recording())
      read_reference(*recording);
    else
      at_rest_ = fit::ShapeAtRest(standing_about(*options_.reference->pose()));
    if (at_rest_.empty())
      throw MeasurementError("the reference '" + options_.reference->text() +
                             "' has no scan at rest. Record the same scene while the lidar is at rest, or "
                             "give the pose (X_MM,Y_MM,"
                             "HEADING_DEG) at which its carrier stood still during this recording");
    return;
  }
  if (carrier_.drifts || std::ranges::none_of(scans_, &ScanOfSession::turning)) return;
  std::vector<fit::ShapeAtRest::Scan> resting;
  for (const ScanOfSession& scan : scans_)
    if (!scan.turning) resting.push_back({scan.sweep, path_.at(path_begin(scan.sweep)) * lidar_});
  at_rest_ = fit::ShapeAtRest(resting);
}

void Deskewing::Work::compare_with_rest(std::size_t scan, std::vector<double> Departures::*way,
                                        double Distances::*distance, const Points& points) {
  if (at_rest_.empty()) return;
  const double off = at_rest_.distance_of(points, begins_[scan]);
  if (!std::isfinite(off)) return;
  distances_[scan].*distance = off;
  if (!carrier_.drifts) (departures_[scans_[scan].stage_rate_deg_s].*way).push_back(off);
}

void Deskewing::Work::by_odometry() {
  Way raw{"raw", "before (whole scans placed by odometry)", {}, 0, {}};
  Way odometry{"odometry", "odometry at each beam's own time", {}, 0, {}};
  for (const ScanOfSession& scan : scans_) {
    const fit::Pose2 begin = path_.at(path_begin(scan.sweep)) * lidar_;
    const fit::Pose2 end = path_.at(path_begin(scan.sweep) + scan.sweep.duration_s) * lidar_;
    sharpest_turn_rad_ = std::max(sharpest_turn_rad_, std::abs(end.heading_rad - begin.heading_rad));
    longest_way_mm_ = std::max(longest_way_mm_, (end.position() - begin.position()).norm());
    begins_.push_back(begin);
    Points as_listed;
    for (const auto& point : scan.sweep.points) as_listed.push_back(point.at_mm);
    for (const Vector2d& point : as_listed) raw.map.push_back(begin * point);
    compare_with_rest(begins_.size() - 1, &Departures::before, &Distances::before, as_listed);
    // The beginning in time is the reference, whatever the order of the beams.
    corrected_.push_back(fit::deskew(scan.sweep, path_, lidar_, timing_, timing_.reversed ? 1 : 0));
    for (const Vector2d& point : corrected_.back()) odometry.map.push_back(begin * point);
    compare_with_rest(begins_.size() - 1, &Departures::by_stage, &Distances::by_path, corrected_.back());
  }
  ways_.push_back(std::move(raw));
  ways_.push_back(std::move(odometry));
}

void Deskewing::Work::by_fusion() {
  fit::FusionOptions options;
  options.timing = timing_;
  options.odometry_u = options_.odometry_u;
  fit::Fusion fusion(path_, lidar_, options);
  Way rigid{"rigid", "fused poses, scans not corrected", {}, 0, {}};
  Way fused{"fused", "fused", {}, 0, {}};
  const fit::Pose2 carrier = lidar_.inverse();
  const auto started = std::chrono::steady_clock::now();
  std::vector<fit::FusedSweep> results;
  for (const ScanOfSession& scan : scans_) results.push_back(fusion.add(scan.sweep));
  fusion_ms_ = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - started).count();
  for (std::size_t i = 0; i < scans_.size(); ++i) {
    const fit::FusedSweep& at = results[i];
    const fit::Sweep& sweep = scans_[i].sweep;
    matched_ += at.matched;
    if (at.matched) weakest_ = std::min(weakest_, at.observability);
    begins_[i] = at.begin;
    corrected_[i].clear();
    const fit::Pose2 back = at.begin.inverse();
    for (const Vector2d& point : at.map_mm) {
      fused.map.push_back(point);
      corrected_[i].push_back(back * point);
    }
    compare_with_rest(i, &Departures::fused, &Distances::fused, corrected_[i]);
    for (const auto& point : sweep.points) rigid.map.push_back(at.begin * point.at_mm);
    fused_path_.push_back({path_begin(sweep), at.begin * carrier});
    fused_path_.push_back({path_begin(sweep) + sweep.duration_s, at.end * carrier});
  }
  ways_.push_back(std::move(rigid));
  ways_.push_back(std::move(fused));
}

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

void Deskewing::Work::write(const std::string& file) const {
  SQLite::Database database(file, SQLite::OPEN_READWRITE, 5000);
  SQLite::Transaction transaction(database);
  if (!fused_path_.empty()) {
    database.exec("DELETE FROM pose");
    SQLite::Statement pose(database, "INSERT INTO pose(host_us, x_mm, y_mm, heading_deg) VALUES(?, ?, ?, ?)");
    for (const fit::TimedPose& at : fused_path_) {
      pose.reset();
      pose.bind(1, static_cast<std::int64_t>(std::llround(at.time_s * 1e6)));
      pose.bind(2, at.pose.x_mm);
      pose.bind(3, at.pose.y_mm);
      pose.bind(4, at.pose.heading_rad * fit::deg_per_rad);
      pose.exec();
    }
  }
  database.exec("DROP TABLE IF EXISTS deskewed");
  database.exec(
      "CREATE TABLE deskewed(capture INTEGER NOT NULL, seq INTEGER NOT NULL, x_mm REAL, y_mm REAL, "
      "heading_deg REAL, points BLOB NOT NULL, PRIMARY KEY(capture, seq)) WITHOUT ROWID");
  SQLite::Statement insert(database, "INSERT INTO deskewed VALUES(?, ?, ?, ?, ?, ?)");
  for (std::size_t i = 0; i < scans_.size(); ++i) {
    const ScanOfSession& scan = scans_[i];
    std::vector<float> blob(2 * scan.beams, std::numeric_limits<float>::quiet_NaN());
    for (std::size_t k = 0; k < scan.sweep.points.size(); ++k) {
      const std::size_t beam = scan.sweep.points[k].beam;
      blob[2 * beam] = static_cast<float>(corrected_[i][k].x());
      blob[2 * beam + 1] = static_cast<float>(corrected_[i][k].y());
    }
    insert.reset();
    insert.bind(1, scan.capture);
    insert.bind(2, scan.seq);
    insert.bind(3, begins_[i].x_mm);
    insert.bind(4, begins_[i].y_mm);
    insert.bind(5, begins_[i].heading_rad * fit::deg_per_rad);
    insert.bind(6, blob.data(), static_cast<int>(blob.size() * sizeof(float)));
    insert.exec();
  }
  transaction.commit();
}

Deskewing::Deskewing(const DeskewOptions& options, const fit::Recording& recording, const std::string& name)
    : work_(std::make_unique<Work>(options, recording, name)) {
  work_->run();
}
Deskewing::~Deskewing() = default;

json Deskewing::document() const { return work_->document(); }
void Deskewing::write(const std::string& file) const { work_->write(file); }

}  // namespace rig
