// SPDX-License-Identifier: MIT
#include "fit/deskew.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <numeric>
#include <random>
#include <unordered_map>

#include "fit/dense.hpp"
#include "fit/median.hpp"

namespace fit {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

Path path_of_captures(const Recording& recording) {
  std::vector<TimedPose> poses;
  const auto& captures = recording.captures();
  for (std::size_t i = 0; i < captures.size(); ++i) {
    double first_s = 0, last_s = 0;
    bool any = false;
    recording.for_each_scan(i, [&](const ScanView& scan) {
      last_s = static_cast<double>(scan.host_us) * 1e-6;
      if (!any) first_s = last_s;
      any = true;
    });
    const CaptureInfo& capture = captures[i];
    const double started = static_cast<double>(capture.started_us) * 1e-6;
    // A little more on both sides: clocks may be offset.
    constexpr double margin_s = 0.1;
    for (const double t : {first_s - margin_s, last_s + 1 / recording.bench().lidar.scan_hz + margin_s})
      if (any) poses.push_back({t, {0, 0, capture.stage_rad + capture.stage_rate_rad_s * (t - started)}});
  }
  // A turn of more than half a circle between two poses needs poses in between.
  std::vector<TimedPose> dense;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (i > 0 && i % 2 == 1) {
      const TimedPose &a = poses[i - 1], &b = poses[i];
      const double turn = b.pose.heading_rad - a.pose.heading_rad;
      const int pieces = 1 + static_cast<int>(std::abs(turn));
      for (int k = 1; k < pieces; ++k) {
        const double share = static_cast<double>(k) / pieces;
        dense.push_back(
            {a.time_s + share * (b.time_s - a.time_s), {0, 0, a.pose.heading_rad + share * turn}});
      }
    }
    dense.push_back(poses[i]);
  }
  return Path(std::move(dense));
}

}  // namespace

Sweep sweep_of(const ScanView& scan, const CaptureInfo& capture, const LidarGeometry& lidar) {
  Sweep sweep;
  sweep.begin_s = static_cast<double>(scan.host_us) * 1e-6;
  const std::size_t beams = scan.range_mm.size();
  const BeamAngles angles(lidar, capture, scan.geometry);
  const double step = angles.step_rad();
  double duration = lidar.beam_time_s(static_cast<double>(capture.cluster) * static_cast<double>(beams));
  if (scan.geometry) {
    duration = scan.geometry->scan_s.value_or(std::abs(step) * static_cast<double>(beams) /
                                              (2 * pi * lidar.scan_hz));
  } else {
    sweep.begin_s += lidar.beam_time_s(capture.step_of(0));
  }
  sweep.duration_s = duration;
  sweep.points.reserve(beams);
  for (std::size_t k = 0; k < beams; ++k) {
    const double range = scan.range_mm[k];
    if (range < 20 || range > 64000) continue;
    const double angle = angles.at_rad(k);
    sweep.points.push_back({{range * std::cos(angle), range * std::sin(angle)},
                            static_cast<double>(k) / static_cast<double>(beams),
                            static_cast<std::uint32_t>(k)});
  }
  return sweep;
}

Carrier carrier_of(const Recording& recording) {
  std::vector<TimedPose> odometry, stage;
  for (const TrackPose& pose : recording.track()) {
    const double t = static_cast<double>(pose.host_us) * 1e-6;
    if (pose.x_mm && pose.y_mm && pose.heading_rad)
      odometry.push_back({t, {*pose.x_mm, *pose.y_mm, *pose.heading_rad}});
    if (pose.stage_rad) stage.push_back({t, {0, 0, *pose.stage_rad}});
  }
  if (odometry.size() >= 2) return {Path(std::move(odometry)), true};
  const bool rates = std::ranges::any_of(recording.captures(), is_turning);
  if (!rates && stage.size() >= 2) return {Path(std::move(stage)), false};
  return {path_of_captures(recording), false};
}

std::vector<Vector2d> deskew(const Sweep& sweep, const Path& path, const Pose2& lidar,
                             const SweepTiming& timing, double reference_share) {
  const Pose2 back = (path.at(timing.path_time(sweep, reference_share)) * lidar).inverse();
  std::vector<Vector2d> points;
  points.reserve(sweep.points.size());
  for (const SweptPoint& p : sweep.points)
    points.push_back(back * (path.at(timing.path_time(sweep, p.share)) * (lidar * p.at_mm)));
  return points;
}

// --- time offset ------------------------------------------------------------------------------------------

namespace {

/// Where the path puts the points of a sweep; of dense sweeps some 400 evenly spread ones.
std::vector<Vector2d> placed(const Sweep& sweep, const Path& path, const Pose2& lidar,
                             const SweepTiming& timing) {
  std::vector<Vector2d> points;
  const std::size_t stride = 1 + sweep.points.size() / 400;
  points.reserve(sweep.points.size() / stride + 1);
  for (std::size_t i = 0; i < sweep.points.size(); i += stride) {
    const SweptPoint& p = sweep.points[i];
    points.push_back(path.at(timing.path_time(sweep, p.share)) * (lidar * p.at_mm));
  }
  return points;
}

/// Mean squared distance (capped) of one sweep's points from another sweep's surfaces.
double disagreement(const Sweep& a, const Sweep& b, const Path& path, const Pose2& lidar,
                    const SweepTiming& timing) {
  constexpr double cap_mm = 100, reach_mm = 250;
  const PointCloud reference(orient_sweep(placed(a, path, lidar, timing)));
  double sum = 0;
  std::size_t count = 0;
  for (const Vector2d& at : placed(b, path, lidar, timing)) {
    const OrientedPoint* near = reference.nearest(at, reach_mm);
    if (!near || near->normal.isZero()) continue;
    const double error = std::min(cap_mm, std::abs(near->normal.dot(at - near->at_mm)));
    sum += error * error;
    ++count;
  }
  return count < 10 ? cap_mm * cap_mm : sum / static_cast<double>(count);
}

struct SweepPair {
  std::size_t first = 0, second = 0;
};

/// Speed of the lidar, turning as seen at two metres.
Vector3d speed_at(const Path& path, const Pose2& lidar, double time_s) {
  constexpr double h = 0.05;
  const Pose2 a = path.at(time_s - h) * lidar, b = path.at(time_s + h) * lidar;
  return Vector3d(b.x_mm - a.x_mm, b.y_mm - a.y_mm, 2000 * (b.heading_rad - a.heading_rad)) / (2 * h);
}

bool covered(const Sweep& sweep, const Path& path) {
  return sweep.begin_s >= path.begin_s() && sweep.time_s(1) <= path.end_s();
}

/// Pairs of sweeps between which the motion differs most: they tell the offset best. Across a gap of a path
/// that drifts nothing is compared.
std::vector<SweepPair> telling_pairs(std::span<const Sweep> sweeps, const Path& path, const Pose2& lidar,
                                     bool drifts) {
  constexpr std::size_t apart = 4, most = 600;
  std::vector<std::pair<double, SweepPair>> ranked;
  std::vector<Vector3d> speed;
  for (const Sweep& sweep : sweeps) speed.push_back(speed_at(path, lidar, sweep.time_s(0.5)));
  const auto add = [&](std::size_t i, std::size_t j) {
    if (covered(sweeps[i], path) && covered(sweeps[j], path))
      ranked.push_back({-(speed[j] - speed[i]).norm() - 0.3 * speed[i].norm(), {i, j}});
  };
  for (std::size_t i = 0; i + apart < sweeps.size(); ++i)
    if (sweeps[i + apart].begin_s - sweeps[i].begin_s < 3 * apart * std::max(0.02, sweeps[i].duration_s))
      add(i, i + apart);
  const std::size_t stride = 1 + sweeps.size() / 200;
  for (std::size_t i = 0; !drifts && i < sweeps.size(); i += stride) {
    std::size_t best = i;
    for (std::size_t j = i + 1; j < sweeps.size(); ++j) {
      const double turned = path.at(sweeps[j].begin_s).heading_rad - path.at(sweeps[i].begin_s).heading_rad;
      if (std::abs(wrap_angle(turned)) < 0.2 &&
          (speed[j] - speed[i]).norm() > (speed[best] - speed[i]).norm() + 1e-9)
        best = j;
    }
    if (best != i) add(i, best);
  }
  std::ranges::sort(ranked, {}, [](const auto& entry) { return entry.first; });
  std::vector<SweepPair> pairs;
  for (std::size_t k = 0; k < std::min(most, ranked.size()); ++k) pairs.push_back(ranked[k].second);
  return pairs;
}

/// Place of the minimum of a sampled curve, by a parabola through the points around it; at an end of the grid
/// that end.
double minimum_of(const std::vector<double>& at, const std::vector<double>& value) {
  const auto i = static_cast<std::size_t>(std::min_element(value.begin(), value.end()) - value.begin());
  if (i < 2 || i + 2 >= value.size()) return at[i];
  const double bend = value[i + 2] - 2 * value[i] + value[i - 2];
  if (!(bend > 0)) return at[i];
  const double step = 2 * (at[1] - at[0]);
  return at[i] - std::clamp(0.5 * step * (value[i + 2] - value[i - 2]) / bend, -step, step);
}

/// One row of scores a pair of sweeps, one column an offset.
using Scores = std::vector<std::vector<double>>;

std::vector<double> total_of(const Scores& scores, const std::vector<std::size_t>& rows) {
  std::vector<double> total(scores.front().size(), 0.0);
  for (const std::size_t row : rows)
    for (std::size_t k = 0; k < total.size(); ++k) total[k] += scores[row][k];
  return total;
}

double resampled_u(const Scores& scores, const std::vector<double>& tried) {
  std::mt19937 random(1);
  std::uniform_int_distribution<std::size_t> pick(0, scores.size() - 1);
  double sum = 0, squares = 0;
  const int rounds = 200;
  for (int round = 0; round < rounds; ++round) {
    std::vector<std::size_t> rows(scores.size());
    for (std::size_t& row : rows) row = pick(random);
    const double best = minimum_of(tried, total_of(scores, rows));
    sum += best;
    squares += best * best;
  }
  const double mean = sum / rounds;
  return std::sqrt(std::max(0.0, squares / rounds - mean * mean));
}

}  // namespace

namespace {

/// The scores of one order of the beams, and where their sum is least.
struct Judged {
  Scores scores;
  std::vector<double> total;
  double offset_s = 0, least = 0;
};

Judged judge(std::span<const Sweep> sweeps, const Path& path, const Pose2& lidar,
             const std::vector<SweepPair>& pairs, const std::vector<double>& tried, bool reversed) {
  Judged out;
  for (const SweepPair& pair : pairs) {
    std::vector<double> row;
    for (const double offset : tried)
      row.push_back(disagreement(sweeps[pair.first], sweeps[pair.second], path, lidar, {offset, reversed}));
    out.scores.push_back(std::move(row));
  }
  std::vector<std::size_t> all(pairs.size());
  std::iota(all.begin(), all.end(), 0);
  out.total = total_of(out.scores, all);
  out.least = std::sqrt(*std::ranges::min_element(out.total) / static_cast<double>(pairs.size()));
  out.offset_s = minimum_of(tried, out.total);
  return out;
}

/// Whether the beams are listed against their order in time, each order at its own best offset: if that is
/// better beyond the scatter of the pairs.
bool clearly_reversed(std::span<const Sweep> sweeps, const Path& path, const Pose2& lidar,
                      const std::vector<SweepPair>& pairs, double forward_s, double reversed_s) {
  double sum = 0, squares = 0;
  for (const SweepPair& pair : pairs) {
    const Sweep &a = sweeps[pair.first], &b = sweeps[pair.second];
    const double gain = disagreement(a, b, path, lidar, {forward_s, false}) -
                        disagreement(a, b, path, lidar, {reversed_s, true});
    sum += gain;
    squares += gain * gain;
  }
  const auto n = static_cast<double>(pairs.size());
  const double mean = sum / n, variance = squares / n - mean * mean;
  return mean > 2 * std::sqrt(std::max(0.0, variance) / n);
}

}  // namespace

TimingEstimate estimate_timing(std::span<const Sweep> sweeps, const Path& path, const Pose2& lidar,
                               const TimingOptions& options) {
  TimingEstimate estimate;
  estimate.timing.reversed = options.reversed.value_or(false);
  const auto pairs = telling_pairs(sweeps, path, lidar, options.drifts);
  if (pairs.size() < 5) return estimate;
  const int half = options.steps;
  for (int k = -half; k <= half; ++k)
    estimate.tried_s.push_back(options.about_s + options.widest_s * k / half);
  const std::vector<SweepPair> most_telling(pairs.begin(),
                                            pairs.begin() + std::min<std::ptrdiff_t>(60, std::ssize(pairs)));
  Judged best = judge(sweeps, path, lidar, most_telling, estimate.tried_s, estimate.timing.reversed);
  if (!options.reversed) {
    Judged other = judge(sweeps, path, lidar, most_telling, estimate.tried_s, true);
    estimate.timing.reversed = clearly_reversed(sweeps, path, lidar, pairs, best.offset_s, other.offset_s);
    if (estimate.timing.reversed) std::swap(best, other);
    estimate.disagreement_other_mm = other.least;
  }
  estimate.timing.offset_s = best.offset_s;
  estimate.offset_s = {best.offset_s, resampled_u(best.scores, estimate.tried_s)};
  for (const double value : best.total)
    estimate.score_mm.push_back(std::sqrt(value / static_cast<double>(most_telling.size())));
  estimate.disagreement_mm = best.least;
  estimate.determined = estimate.offset_s.u < 0.1 * options.widest_s &&
                        std::abs(estimate.timing.offset_s - options.about_s) < 0.95 * options.widest_s;
  return estimate;
}

// --- fusion -----------------------------------------------------------------------------------------------

struct Fusion::Map {
  explicit Map(double cell) : cell_mm(cell) {}

  /// The first points of a cell stay: a map that drifts with what is added to it would hide the drift.
  void add(std::span<const Vector2d> sweep) {
    for (const OrientedPoint& point : orient_sweep(sweep)) {
      const auto ix = static_cast<std::int64_t>(std::floor(point.at_mm.x() / cell_mm));
      const auto iy = static_cast<std::int64_t>(std::floor(point.at_mm.y() / cell_mm));
      int& held = cells[(ix << 32) ^ (iy & 0xffffffff)];
      if (held >= 3 || point.normal.isZero()) continue;
      ++held;
      points.push_back(point);
    }
    cloud = PointCloud(points);
  }

  double cell_mm;
  std::unordered_map<std::int64_t, int> cells;
  std::vector<OrientedPoint> points;
  PointCloud cloud;
};

Fusion::Fusion(Path path, const Pose2& lidar, FusionOptions options)
    : path_(std::move(path)),
      lidar_(lidar),
      carried_covariance_(Vector3d(1, 1, 1e-6).asDiagonal()),
      options_(options),
      map_(std::make_unique<Map>(options.cell_mm)) {}

Fusion::~Fusion() = default;

const PointCloud& Fusion::map() const { return map_->cloud; }

FusedSweep Fusion::add(const Sweep& sweep) {
  const SweepTiming& timing = options_.timing;
  const Pose2 begin = carried_ * path_.at(sweep.begin_s + timing.offset_s) * lidar_;
  const Pose2 end = carried_ * path_.at(sweep.time_s(1) + timing.offset_s) * lidar_;
  std::vector<SpreadPoint> points;
  points.reserve(sweep.points.size());
  for (const SweptPoint& p : sweep.points)
    points.push_back({carried_ * (path_.at(timing.path_time(sweep, p.share)) * (lidar_ * p.at_mm)),
                      timing.reversed ? 1 - p.share : p.share});

  const double way = (end.position() - begin.position()).norm();
  const double turn = std::abs(end.heading_rad - begin.heading_rad);
  SpreadPrior prior;
  prior.start_covariance = carried_covariance_ + Eigen::Matrix3d(Vector3d(0.25, 0.25, 1e-7).asDiagonal());
  const double u_mm = options_.odometry_u_mm + options_.odometry_u * way;
  prior.growth_u = {u_mm, u_mm, options_.odometry_u_rad + options_.odometry_u * turn};
  const SpreadResult match = map_->points.empty()
                                 ? SpreadResult{}
                                 : match_spread(map_->cloud, points, begin.position(), prior, options_.icp);

  FusedSweep fused;
  fused.matched = match.pairs >= 10;
  SpreadCorrection correction = match.correction;
  correction.pivot = begin.position();
  if (!fused.matched) correction = {begin.position(), Vector3d::Zero(), Vector3d::Zero()};
  fused.noise_mm = match.noise_mm;
  fused.observability = match.observability;
  fused.iterations = match.iterations;
  fused.begin = correction.at(0) * begin;
  fused.end = correction.at(1) * end;
  fused.map_mm.reserve(points.size());
  for (const SpreadPoint& point : points) fused.map_mm.push_back(correction.apply(point));
  carried_ = correction.at(1) * carried_;
  if (fused.matched) carried_covariance_ = match.end_covariance;

  const bool moved =
      !last_keyframe_ ||
      (fused.begin.position() - last_keyframe_->position()).norm() > options_.keyframe_mm ||
      std::abs(wrap_angle(fused.begin.heading_rad - last_keyframe_->heading_rad)) > options_.keyframe_rad;
  if (moved) {
    map_->add(fused.map_mm);
    last_keyframe_ = fused.begin;
  }
  return fused;
}

// --- crispness --------------------------------------------------------------------------------------------

Crispness crispness(std::span<const Vector2d> map, double radius_mm, std::size_t most) {
  // Of a map of many points some say as much about walls as all.
  constexpr std::size_t enough = 50'000;
  const std::size_t thinned = std::max<std::size_t>(1, map.size() / enough);
  std::vector<OrientedPoint> points;
  points.reserve(map.size() / thinned + 1);
  for (std::size_t i = 0; i < map.size(); i += thinned) points.push_back({map[i], Vector2d::Zero()});
  const PointCloud cloud(std::move(points));
  const std::size_t stride = std::max<std::size_t>(1, map.size() / std::max<std::size_t>(1, most));
  std::vector<double> thick;
  double entropy = 0;
  for (std::size_t i = 0; i < map.size(); i += stride) {
    const auto near = cloud.within(map[i], radius_mm);
    if (near.size() < 10) continue;
    Vector2d mean = Vector2d::Zero();
    for (const std::size_t k : near) mean += cloud.points()[k].at_mm - map[i];
    mean /= static_cast<double>(near.size());
    Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
    for (const std::size_t k : near) {
      const Vector2d d = cloud.points()[k].at_mm - map[i] - mean;
      spread += d * d.transpose();
    }
    spread /= static_cast<double>(near.size());
    const Eigen::VectorXd values = dense::symmetric_eigen(spread).values;
    const double across = std::sqrt(std::max(0.25, values[0]));
    const double along = std::sqrt(std::max(0.25, values[1]));
    entropy += std::log(across * along) + std::log(2 * pi * std::exp(1.0));
    if (along > 0.3 * radius_mm) thick.push_back(across);
  }
  Crispness result;
  result.judged = thick.size();
  if (thick.empty()) return result;
  result.entropy = entropy / static_cast<double>((map.size() + stride - 1) / stride);
  result.mean_thickness_mm =
      std::accumulate(thick.begin(), thick.end(), 0.0) / static_cast<double>(thick.size());
  result.thickness_mm = median_of(std::span(thick));
  return result;
}

}  // namespace fit
