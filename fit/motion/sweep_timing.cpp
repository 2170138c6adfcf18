// SPDX-License-Identifier: MIT
#include "fit/motion/sweep_timing.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "fit/motion/icp.hpp"
#include "fit/numeric/angle.hpp"

namespace fit {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

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

}  // namespace fit
