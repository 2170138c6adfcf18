// SPDX-License-Identifier: MIT
#include "fit/range/edge.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <tuple>

#include "fit/bench/accuracy.hpp"
#include "fit/echo.hpp"
#include "fit/numeric/distributions.hpp"

namespace fit {
namespace {

constexpr double no_echo_mm = 65535;  // Sorts behind everything.

/// Ranges of one beam in one capture, counted.
class Histogram {
 public:
  void add(double range_mm) { ++counts_[static_cast<int>(range_mm)], ++n_; }
  [[nodiscard]] long n() const { return n_; }
  [[nodiscard]] double median() const {
    long seen = 0;
    for (const auto& [range, count] : counts_)
      if (2 * (seen += count) >= n_) return range;
    return 0;
  }
  [[nodiscard]] double robust_sigma(double about) const {
    std::map<int, long> deviations;
    for (const auto& [range, count] : counts_)
      deviations[static_cast<int>(std::lround(std::abs(range - about)))] += count;
    long seen = 0;
    for (const auto& [deviation, count] : deviations)
      if (2 * (seen += count) >= n_) return 1.4826 * std::max(0.5, static_cast<double>(deviation));
    return 1;
  }
  [[nodiscard]] long farther_than(double range_mm) const {
    long total = 0;
    for (auto it = counts_.upper_bound(static_cast<int>(std::floor(range_mm))); it != counts_.end(); ++it)
      total += it->second;
    return total;
  }
  [[nodiscard]] long within(double about, double gate) const {
    long total = 0;
    for (const auto& [range, count] : counts_)
      if (std::abs(range - about) <= gate) total += count;
    return total;
  }
  [[nodiscard]] std::pair<double, double> mean_and_sd() const {
    double n = 0, sum = 0, square = 0;
    for (const auto& [range, count] : counts_) {
      if (range >= no_echo_mm) continue;
      const double weight = static_cast<double>(count);
      n += weight, sum += weight * range, square += weight * range * range;
    }
    if (n < 1) return {0, 0};
    return {sum / n, n > 1 ? std::sqrt(std::max(0.0, (square - sum * sum / n) / (n - 1))) : 0};
  }

 private:
  std::map<int, long> counts_;
  long n_ = 0;
};

constexpr double same_angle_rad = 1e-7;

struct BeamStop {
  std::size_t capture;
  double stage_rad;
  Histogram histogram;
  double median_mm = 0, sigma_mm = 1;
};

/// A surface as a smooth stop shows it.
struct Level {
  double median_mm = 0, gate_mm = 3;
};

Level level_of(const BeamStop& stop) { return {stop.median_mm, std::max(3.0, 5 * stop.sigma_mm)}; }

/// Samples of some stops, and how many of them left the gate of a surface.
struct Pool {
  long outside = 0, n = 0;
  [[nodiscard]] Pool without(const Pool& other) const { return {outside - other.outside, n - other.n}; }
  void add(const Pool& other) { outside += other.outside, n += other.n; }
};

/// Whether chance alone leaves the gate so often with at most that probability. What is known of the
/// surface's own share is what the others counted: a few of them promise little.
bool leaves(const Pool& stop, const Pool& others, double chance) {
  if (stop.outside == 0) return false;
  const auto outside = static_cast<double>(others.outside), n = static_cast<double>(others.n);
  return beta_binomial_at_least(static_cast<double>(stop.n), outside + 1, n - outside + 1,
                                static_cast<double>(stop.outside)) < chance;
}

/// Which stops see one surface only. `stops` are those that mostly see it, from the farthest from the edge to
/// the nearest. Each is held against all other smooth ones together, so that a stop beyond chance neither
/// excuses itself nor hides behind a short one. The first pass trusts what lies farther from the edge.
std::vector<bool> smooth_ones(const std::vector<Pool>& stops, double chance) {
  std::vector<bool> smooth(stops.size(), false);
  Pool pool;
  for (std::size_t i = 0; i < stops.size(); ++i) {
    smooth[i] = i == 0 || !leaves(stops[i], pool, chance);
    if (smooth[i]) pool.add(stops[i]);
  }
  // Ends where nothing changes; stops that change each other in a circle are left as they are.
  for (int round = 0; round < 20; ++round) {
    std::vector<bool> next(stops.size());
    for (std::size_t i = 0; i < stops.size(); ++i) {
      const Pool others = smooth[i] ? pool.without(stops[i]) : pool;
      next[i] = others.n == 0 || !leaves(stops[i], others, chance);
    }
    if (next == smooth) break;
    smooth = std::move(next);
    pool = {};
    for (std::size_t i = 0; i < stops.size(); ++i)
      if (smooth[i]) pool.add(stops[i]);
  }
  return smooth;
}

/// By beam, approach, and where the target stood, in whole micrometres: stops of different places show no
/// edge.
using BeamStops = std::map<std::tuple<int, int, long>, std::vector<BeamStop>>;

BeamStops collect(const Recording& recording, const EdgeOptions& options) {
  BeamStops beams;
  for (std::size_t i = 0; i < recording.captures().size(); ++i) {
    const CaptureInfo& capture = recording.captures()[i];
    if (is_turning(capture)) continue;
    if (options.target && capture.target && *capture.target != *options.target) continue;
    std::vector<Histogram> histograms(static_cast<std::size_t>(capture.beams()));
    recording.for_each_scan(i, [&](const ScanView& scan) {
      for (std::size_t k = 0; k < std::min(histograms.size(), scan.range_mm.size()); ++k)
        histograms[k].add(
            scan.range_mm[k] == 0 || scan.range_mm[k] >= first_error_code_mm ? no_echo_mm : scan.range_mm[k]);
    });
    const double stage = capture.stage_readback_rad.value_or(capture.stage_rad);
    for (std::size_t k = 0; k < histograms.size(); ++k) {
      if (histograms[k].n() < 10) continue;
      const int step = capture.first_step + static_cast<int>(k) * capture.cluster;
      BeamStop stop{i, stage, std::move(histograms[k])};
      stop.median_mm = stop.histogram.median();
      stop.sigma_mm = stop.histogram.robust_sigma(stop.median_mm);
      beams[{step, capture.approach, std::lround(1000 * capture.target_shift_mm)}].push_back(std::move(stop));
    }
  }
  for (auto& [key, stops] : beams)
    std::ranges::sort(stops, {}, [](const BeamStop& stop) { return stop.stage_rad; });
  return beams;
}

bool is_step(const BeamStop& a, const BeamStop& b) {
  const double gap = std::abs(a.median_mm - b.median_mm);
  return gap > 50 && gap > 10 * std::min(a.sigma_mm, b.sigma_mm);
}

/// Stops whose spread is the surface's own noise: at least most of their samples see one surface.
std::vector<std::size_t> calm_stops(const std::vector<BeamStop>& stops) {
  std::vector<double> sigmas;
  for (const BeamStop& stop : stops)
    if (stop.median_mm < no_echo_mm)
      sigmas.push_back(stop.sigma_mm);  // Nothing at all is no surface's noise.
  if (sigmas.empty()) return {};
  const auto quarter = sigmas.begin() + static_cast<std::ptrdiff_t>(sigmas.size() / 4);
  std::nth_element(sigmas.begin(), quarter, sigmas.end());
  std::vector<std::size_t> calm;
  for (std::size_t i = 0; i < stops.size(); ++i)
    if (stops[i].sigma_mm <= 2.5 * *quarter + 1) calm.push_back(i);
  return calm;
}

/// The stops of one beam about one edge; `from` and `to` are indices, the ends on different surfaces.
struct Passage {
  const std::vector<BeamStop>& stops;
  std::size_t from, to;
  double first_mm, last_mm;  ///< Levels at the ends.

  [[nodiscard]] bool rising() const { return last_mm > first_mm; }
  [[nodiscard]] bool like_first(std::size_t i) const {
    return std::abs(stops[i].median_mm - first_mm) < std::abs(first_mm - last_mm) / 4;
  }
  [[nodiscard]] bool like_last(std::size_t i) const {
    return std::abs(stops[i].median_mm - last_mm) < std::abs(first_mm - last_mm) / 4;
  }
  /// The level of the first or last surface at stop i: a slanted surface's range drifts from stop to stop, so
  /// the nearest stop that shows it is asked.
  [[nodiscard]] double level_mm(std::size_t i, bool first) const {
    const auto shows = [&](std::size_t j) { return first ? like_first(j) : like_last(j); };
    for (std::size_t j = i;; first ? --j : ++j) {
      if (shows(j)) return stops[j].median_mm;
      if (j == (first ? from : to)) return first ? first_mm : last_mm;
    }
  }
};

/// Widens a passage to the stops around it that still show the same two surfaces.
void widen(Passage& passage, double reach_rad) {
  const auto& stops = passage.stops;
  const double first_rad = stops[passage.from].stage_rad, last_rad = stops[passage.to].stage_rad;
  while (passage.from > 0 && first_rad - stops[passage.from - 1].stage_rad < reach_rad &&
         passage.like_first(passage.from - 1))
    --passage.from;
  while (passage.to + 1 < stops.size() && stops[passage.to + 1].stage_rad - last_rad < reach_rad &&
         passage.like_last(passage.to + 1))
    ++passage.to;
}

EdgeCrossing crossing_of(const Passage& passage, const EdgeOptions& options) {
  const bool rising = passage.rising();
  const Level front = level_of(passage.stops[rising ? passage.from : passage.to]);
  const Level back = level_of(passage.stops[rising ? passage.to : passage.from]);
  EdgeCrossing crossing;
  crossing.right = !rising;
  crossing.front_mm = std::min(passage.first_mm, passage.last_mm);
  crossing.back_mm = back.median_mm >= no_echo_mm ? 0 : std::max(passage.first_mm, passage.last_mm);
  for (std::size_t i = passage.from; i <= passage.to; ++i) {
    const BeamStop& stop = passage.stops[i];
    const double front_mm = passage.level_mm(i, rising), back_mm = passage.level_mm(i, !rising);
    const double between = back_mm >= no_echo_mm ? front_mm + 20 * front.gate_mm : (front_mm + back_mm) / 2;
    EdgeStop out;
    out.capture = stop.capture, out.stage_rad = stop.stage_rad, out.n = stop.histogram.n();
    out.back = stop.histogram.farther_than(between);
    out.outside_front = out.n - stop.histogram.within(front_mm, front.gate_mm);
    out.outside_back = out.n - stop.histogram.within(back_mm, back.gate_mm);
    std::tie(out.mean_mm, out.sd_mm) = stop.histogram.mean_and_sd();
    out.state = EdgeStop::State::jitter;
    crossing.stops.push_back(out);
  }
  for (const bool in_front : {true, false}) {
    std::vector<std::size_t> mostly;
    std::vector<Pool> pools;
    for (std::size_t i = 0; i < crossing.stops.size(); ++i) {
      const EdgeStop& stop = crossing.stops[i];
      const long outside = in_front ? stop.outside_front : stop.outside_back;
      if (2 * outside < stop.n) mostly.push_back(i), pools.push_back({outside, stop.n});
    }
    // From the end of the passage that shows this surface towards the edge.
    if (in_front != rising) std::ranges::reverse(mostly), std::ranges::reverse(pools);
    const std::vector<bool> smooth = smooth_ones(pools, options.chance);
    for (std::size_t j = 0; j < mostly.size(); ++j)
      // Within both gates it is in front, as was found first.
      if (smooth[j] && crossing.stops[mostly[j]].state == EdgeStop::State::jitter)
        crossing.stops[mostly[j]].state = in_front ? EdgeStop::State::front : EdgeStop::State::back;
  }
  return crossing;
}

/// Keeps what belongs to the edge: the jittering stops and a few smooth ones on each side.
void trim(EdgeCrossing& crossing, const EdgeOptions& options) {
  auto& stops = crossing.stops;
  double first = 1e9, last = -1e9;
  for (std::size_t i = 0; i < stops.size(); ++i) {
    if (stops[i].state == EdgeStop::State::jitter) {
      first = std::min(first, stops[i].stage_rad);
      last = std::max(last, stops[i].stage_rad);
    }
    if (i > 0 && stops[i].state != stops[i - 1].state) {
      first = std::min(first, stops[i].stage_rad);
      last = std::max(last, stops[i - 1].stage_rad);
    }
  }
  if (first > last) std::swap(first, last);
  std::erase_if(stops, [&](const EdgeStop& stop) {
    return stop.stage_rad < first - options.reach_rad || stop.stage_rad > last + options.reach_rad;
  });
  double least = 1e9;
  for (std::size_t i = 1; i < stops.size(); ++i)
    if (stops[i].stage_rad > first - 1e-3 && stops[i].stage_rad < last + 1e-3 &&
        stops[i].stage_rad - stops[i - 1].stage_rad > same_angle_rad)
      least = std::min(least, stops[i].stage_rad - stops[i - 1].stage_rad);
  crossing.step_rad = least < 1e9 ? least : 0;
}

/// Counts the window in stops of one series. Nothing where it was not passed evenly from a smooth stop of one
/// surface to a smooth stop of the other: what jitters between two of one surface does so by chance.
std::optional<CountedWindow> count_window(const std::vector<EdgeStop>& series) {
  const auto jitters = [](const EdgeStop& stop) { return stop.state == EdgeStop::State::jitter; };
  const auto first = std::ranges::find_if(series, jitters);
  const auto behind = std::find_if(series.rbegin(), series.rend(), jitters).base();
  if (first == series.begin() || first == series.end() || behind == series.end()) return std::nullopt;
  if ((first - 1)->state == behind->state) return std::nullopt;
  std::vector<double> gaps;
  for (auto stop = first; stop != behind + 1; ++stop)
    if (const double gap = stop->stage_rad - (stop - 1)->stage_rad; gap > same_angle_rad) gaps.push_back(gap);
  if (gaps.empty()) return std::nullopt;
  // A readback rounds each angle: their mean spacing is nearest to the step.
  const double step_rad = std::accumulate(gaps.begin(), gaps.end(), 0.0) / static_cast<double>(gaps.size());
  if (std::ranges::max(gaps) > 1.2 * step_rad) return std::nullopt;
  return CountedWindow{first->stage_rad, (behind - 1)->stage_rad, step_rad};
}

/// The search for an edge stops where it likes, also between the stops of the sweep that follows: each step
/// of the procedure is counted by itself.
std::optional<CountedWindow> finest_count(const EdgeCrossing& crossing, const Recording& recording) {
  std::map<std::string, std::vector<EdgeStop>> series;
  for (const EdgeStop& stop : crossing.stops) series[recording.captures()[stop.capture].step].push_back(stop);
  std::optional<CountedWindow> finest;
  for (const auto& [step, stops] : series)
    if (const auto counted = count_window(stops);
        counted && (!finest || counted->step_rad < finest->step_rad))
      finest = counted;
  return finest;
}

/// Distance between the last stop wholly in front and the first wholly behind.
double bracket(const EdgeCrossing& crossing) {
  double front = -1e9, back = 1e9;
  for (const EdgeStop& stop : crossing.stops) {
    const double along = crossing.right ? -stop.stage_rad : stop.stage_rad;
    if (stop.state == EdgeStop::State::front) front = std::max(front, along);
    if (stop.state == EdgeStop::State::back) back = std::min(back, along);
  }
  return back - front;
}

}  // namespace

std::vector<EdgeCrossing> find_edge_crossings(const Recording& recording, const EdgeOptions& options) {
  std::vector<EdgeCrossing> crossings;
  const Bench& bench = recording.bench();
  const double u_stop_rad =
      std::hypot(bench.stage_resolution_rad / std::sqrt(12.0), accuracy_of(bench).stage_position_rad.u);
  for (const auto& [key, stops] : collect(recording, options)) {
    const std::vector<std::size_t> calm = calm_stops(stops);
    for (std::size_t c = 0; c + 1 < calm.size(); ++c) {
      const BeamStop &before = stops[calm[c]], &after = stops[calm[c + 1]];
      const double apart_rad = after.stage_rad - before.stage_rad;  // At one angle the scene has changed.
      if (!is_step(before, after) || apart_rad > options.reach_rad || apart_rad < same_angle_rad) continue;
      Passage passage{stops, calm[c], calm[c + 1], before.median_mm, after.median_mm};
      if (options.right && *options.right == passage.rising()) continue;
      widen(passage, options.reach_rad);
      EdgeCrossing crossing = crossing_of(passage, options);
      crossing.step = std::get<0>(key);
      crossing.beam_rad = bench.lidar.beam_angle(crossing.step);
      crossing.approach = std::get<1>(key);
      trim(crossing, options);
      crossing.counted = finest_count(crossing, recording);
      const double width = bracket(crossing);
      if (width > options.least_gap_rad || width < 0) continue;
      crossing.response = fit_edge_response(crossing.stops, passage.rising(), u_stop_rad);
      crossings.push_back(std::move(crossing));
    }
  }
  std::ranges::sort(crossings, {}, [](const EdgeCrossing& c) { return c.response.edge_rad.u; });
  return crossings;
}

}  // namespace fit
