// SPDX-License-Identifier: MIT
#include "rig/fitting/deskewing.hpp"

#include <SQLiteCpp/SQLiteCpp.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "fit/mechanism.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/deskewing_work.hpp"

namespace rig {

using Eigen::Vector2d;
using nlohmann::json;

std::vector<deskew_parts::ScanOfSession> deskew_parts::read_scans(const fit::Recording& recording,
                                                                  int most_per_capture) {
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

Deskewing::Work::Work(const DeskewOptions& options, const fit::Recording& recording, const std::string& name)
    : options_(options),
      carrier_(fit::carrier_of(recording)),
      path_(carrier_.path),
      scans_(deskew_parts::read_scans(recording, options.scans_per_capture)) {
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

void Deskewing::Work::run() {
  for (const ScanOfSession& scan : scans_) {
    count_ += scan.sweep.points.size();
    ends_.push_back(count_);
  }
  distances_.resize(scans_.size());
  find_shape_at_rest();
  by_odometry();
  if (options_.fuse) by_fusion();
  for (Way& way : ways_) way.judge(ends_);
}

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
  const std::vector<ScanOfSession> scans = deskew_parts::read_scans(reference, enough);
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
void Deskewing::Work::find_shape_at_rest() {
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
