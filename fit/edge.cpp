// SPDX-License-Identifier: MIT
#include "fit/edge.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <span>

#include "fit/accuracy.hpp"
#include "fit/distributions.hpp"

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

struct BeamStop {
  std::size_t capture;
  double stage_rad;
  Histogram histogram;
  double median_mm = 0, sigma_mm = 1;
};

/// A surface as smooth stops show it.
struct Level {
  double median_mm = 0, gate_mm = 3, outside = 0;
};

Level level_of(const BeamStop& stop) {
  Level level{stop.median_mm, std::max(3.0, 5 * stop.sigma_mm), 0};
  const auto n = static_cast<double>(stop.histogram.n());
  const auto outside = n - static_cast<double>(stop.histogram.within(level.median_mm, level.gate_mm));
  level.outside = (outside + 1) / (n + 2);  // Rule of succession: a short reference promises nothing.
  return level;
}

bool leaves(long outside, long n, double expected, double chance) {
  if (outside == 0) return false;
  return binomial_at_least(static_cast<double>(n), std::min(expected, 0.5), static_cast<double>(outside)) <
         chance;
}

using BeamStops = std::map<std::pair<int, int>, std::vector<BeamStop>>;  // By beam and approach.

BeamStops collect(const Recording& recording, const EdgeOptions& options) {
  BeamStops beams;
  for (std::size_t i = 0; i < recording.captures().size(); ++i) {
    const CaptureInfo& capture = recording.captures()[i];
    if (is_turning(capture)) continue;
    if (options.target && capture.target && *capture.target != *options.target) continue;
    std::vector<Histogram> histograms(static_cast<std::size_t>(capture.beams()));
    recording.for_each_scan(i, [&](const ScanView& scan) {
      for (std::size_t k = 0; k < std::min(histograms.size(), scan.range_mm.size()); ++k)
        histograms[k].add(scan.range_mm[k] == 0 || scan.range_mm[k] >= 65500 ? no_echo_mm : scan.range_mm[k]);
    });
    const double stage = capture.stage_readback_rad.value_or(capture.stage_rad);
    for (std::size_t k = 0; k < histograms.size(); ++k) {
      if (histograms[k].n() < 10) continue;
      const int step = capture.first_step + static_cast<int>(k) * capture.cluster;
      BeamStop stop{i, stage, std::move(histograms[k])};
      stop.median_mm = stop.histogram.median();
      stop.sigma_mm = stop.histogram.robust_sigma(stop.median_mm);
      beams[{step, capture.approach}].push_back(std::move(stop));
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
    out.state = !leaves(out.outside_front, out.n, front.outside, options.chance) ? EdgeStop::State::front
                : !leaves(out.outside_back, out.n, back.outside, options.chance) ? EdgeStop::State::back
                                                                                 : EdgeStop::State::jitter;
    crossing.stops.push_back(out);
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
        stops[i].stage_rad - stops[i - 1].stage_rad > 1e-7)
      least = std::min(least, stops[i].stage_rad - stops[i - 1].stage_rad);
  crossing.step_rad = least < 1e9 ? least : 0;
  for (const EdgeStop& stop : stops) {
    if (stop.state != EdgeStop::State::jitter) continue;
    if (!crossing.jitter_rad) crossing.jitter_rad = {stop.stage_rad, stop.stage_rad};
    crossing.jitter_rad->second = stop.stage_rad;
  }
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

constexpr std::array<double, 4> strays = {1e-6, 1e-4, 1e-3, 1e-2};
/// The Gaussian's standard deviation is the window over this: from 1 % to 99 %.
constexpr double sigmas_of_window = 4.652696;

/// One shape that the response may have; angles in the direction in which the share grows.
struct Shape {
  double edge = 0, window = 0;
  bool ramp = true;
  /// Share of clean samples that see behind.
  [[nodiscard]] double seen(double along_rad) const {
    const double x = (along_rad - edge) / window;
    return ramp ? std::clamp(0.5 + x, 0.0, 1.0) : std::erfc(-x * sigmas_of_window / std::numbers::sqrt2) / 2;
  }
};

/// Normal quantile and density for a share.
struct NormalPlace {
  explicit NormalPlace(double share)
      : z(student_quantile(std::numeric_limits<double>::infinity(), share)),  // Normal.
        density(std::exp(-z * z / 2) / std::sqrt(2 * std::numbers::pi)) {}
  double z, density;
};

/// What was counted at a stop; what does not depend on the response is computed once.
class Count {
 public:
  Count(double along_rad, double n, double back)
      : along_rad_(along_rad),
        n_(n),
        back_(back),
        log_choose_(std::lgamma(n + 1) - std::lgamma(back + 1) - std::lgamma(n - back + 1)),
        share_((back + 0.5) / (n + 1)),
        u_share_(std::sqrt(share_ * (1 - share_) / n)),
        at_(share_),
        first_(least_mean / n) {
    for (std::size_t k = 0; k < strays.size(); ++k) {
      in_front_[k] = std::exp(log_binomial(strays[k]));
      behind_[k] = std::exp(log_binomial(1 - strays[k]));
    }
  }

  /// Adds the log probabilities for every share of stray samples, of a stop whose angle is exact.
  void add_exact(const Shape& shape, std::array<double, strays.size()>& sums) const {
    const double seen = shape.seen(along_rad_);
    for (std::size_t k = 0; k < strays.size(); ++k)
      sums[k] += log_binomial(strays[k] + (1 - 2 * strays[k]) * seen);
  }
  /// The same of a stop whose angle is anywhere within `half_rad`: the integral of the binomial probability
  /// over it. Where the response is between its ends, the likelihood of the share is taken as normal.
  void add_within(const Shape& shape, double half_rad, std::array<double, strays.size()>& sums) const {
    const double sigma = shape.window / sigmas_of_window, from = along_rad_ - half_rad,
                 to = along_rad_ + half_rad;
    const double place = shape.edge + (shape.ramp ? shape.window * (share_ - 0.5) : sigma * at_.z);
    const double per_share = shape.ramp ? shape.window : sigma / at_.density;
    const double scale = std::numbers::sqrt2 * u_share_ * per_share;
    const double inside = per_share / (n_ + 1) *
                          (std::erf((to - place) / scale) - std::erf((from - place) / scale)) /
                          (4 * half_rad);
    const double end = shape.ramp ? shape.window * (0.5 - least_mean / n_) : -sigma * first_.z;
    const auto part = [&](double rad) { return std::clamp(rad / (2 * half_rad), 0.0, 1.0); };
    const double front = part(shape.edge - end - from), behind = part(to - shape.edge - end);
    for (std::size_t k = 0; k < strays.size(); ++k)
      sums[k] += std::log(std::max(inside + front * in_front_[k] + behind * behind_[k], 1e-300));
  }
  /// Its part of Pearson's chi-square at that response; nothing for a stop that says nothing of it.
  [[nodiscard]] std::optional<double> pearson(const Shape& shape, double stray, double half_rad) const {
    const double seen = shape.seen(along_rad_), p = stray + (1 - 2 * stray) * seen;
    if (n_ * p < 3 || n_ * (1 - p) < 3) return std::nullopt;
    const double of_angle =
        n_ * (shape.seen(along_rad_ + half_rad) - shape.seen(along_rad_ - half_rad)) / std::sqrt(12.0);
    return std::pow(back_ - n_ * p, 2) / (n_ * p * (1 - p) + of_angle * of_angle);
  }

 private:
  static constexpr double least_mean =
      0.7;  ///< Samples of the other surface at which it is as likely as not that one is seen.
  [[nodiscard]] double log_binomial(double share) const {
    return log_choose_ + back_ * std::log(share) + (n_ - back_) * std::log1p(-share);
  }
  double along_rad_, n_, back_, log_choose_, share_, u_share_;
  NormalPlace at_, first_;
  std::array<double, strays.size()> in_front_{}, behind_{};
};

std::vector<Count> counts_of(const std::vector<EdgeStop>& stops, bool rising) {
  std::vector<Count> counts;
  for (const EdgeStop& stop : stops)
    counts.emplace_back(rising ? stop.stage_rad : -stop.stage_rad, static_cast<double>(stop.n),
                        static_cast<double>(stop.back));
  return counts;
}

/// Log likelihood of a shape for every share of stray samples.
std::array<double, strays.size()> log_likelihoods(const std::vector<Count>& counts, const Shape& shape,
                                                  double half_rad) {
  std::array<double, strays.size()> sums{};
  for (const Count& count : counts)
    half_rad > 0 ? count.add_within(shape, half_rad, sums) : count.add_exact(shape, sums);
  return sums;
}

struct Posterior {
  double edge = 0, window = 0, u_edge = 0, u_window = 0, ramp = 0.5;
  Shape best;
  double best_stray = 0;
};

/// Of edges in the direction in which the share grows.
struct Box {
  double edge_from, edge_to, window_from, window_to;
};

/// Half the distance from its mean within which 95.45 % of a quantity lie, as two standard deviations of a
/// normal one do: where stops are few their angles' rectangles show, and two standard deviations hold more.
/// `weights`: of values at even steps, the first at the middle of the first step.
double half_of_95_percent(std::span<const double> weights, double from, double step, double mean) {
  double total = 0, most = 0;
  for (const double weight : weights) total += weight;
  const auto within = [&](double reach) {
    double sum = 0;
    for (std::size_t j = 0; j < weights.size(); ++j) {
      const double low = from + static_cast<double>(j) * step;
      const double part = std::min(low + step, mean + reach) - std::max(low, mean - reach);
      sum += weights[j] * std::clamp(part / step, 0.0, 1.0);
    }
    return sum / total;
  };
  for (double half = 0.5 * static_cast<double>(weights.size()) * step; half > 1e-4 * step; half /= 2)
    if (within(most + half) < 0.9545) most += half;
  return most / 2;
}

/// One pass over a grid; shrinks the box to where the posterior is.
Posterior sum_over(const std::vector<Count>& counts, Box& box, double half_rad, double dispersion) {
  constexpr int cells = 41;
  struct Cell {
    double edge, window, value;
    bool ramp;
    int at_window;
  };
  std::vector<Cell> grid;
  double best = -1e300;
  Posterior out;
  for (int i = 0; i < cells; ++i)
    for (int j = 0; j < cells; ++j)
      for (const bool ramp : {true, false}) {
        const Shape shape{box.edge_from + (i + 0.5) / cells * (box.edge_to - box.edge_from),
                          box.window_from + (j + 0.5) / cells * (box.window_to - box.window_from), ramp};
        const auto likelihoods = log_likelihoods(counts, shape, half_rad);
        for (std::size_t k = 0; k < strays.size(); ++k) {
          const double value = likelihoods[k] / dispersion;
          grid.push_back({shape.edge, shape.window, value, ramp, j});
          if (value <= best) continue;
          best = value;
          out.best = shape, out.best_stray = strays[k];
        }
      }
  double total = 0, edge = 0, window = 0, edge2 = 0, ramp = 0;
  std::array<double, cells> of_window{};
  Box kept{1e9, -1e9, 1e9, -1e9};
  for (const Cell& cell : grid) {
    if (cell.value < best - 18) continue;
    const double weight = std::exp(cell.value - best), e = cell.edge - out.best.edge;
    total += weight, edge += weight * e, edge2 += weight * e * e;
    window += weight * cell.window;
    of_window[static_cast<std::size_t>(cell.at_window)] += weight;
    ramp += cell.ramp ? weight : 0;
    kept = {std::min(kept.edge_from, cell.edge), std::max(kept.edge_to, cell.edge),
            std::min(kept.window_from, cell.window), std::max(kept.window_to, cell.window)};
  }
  out.edge = out.best.edge + edge / total;
  out.u_edge = std::sqrt(std::max(0.0, edge2 / total - edge / total * (edge / total)));
  out.window = window / total;
  out.u_window =
      half_of_95_percent(of_window, box.window_from, (box.window_to - box.window_from) / cells, out.window);
  out.ramp = ramp / total;
  const double dx = 1.5 * (box.edge_to - box.edge_from) / cells,
               dw = 1.5 * (box.window_to - box.window_from) / cells;
  box = {std::max(box.edge_from, kept.edge_from - dx), std::min(box.edge_to, kept.edge_to + dx),
         std::max(box.window_from, kept.window_from - dw), std::min(box.window_to, kept.window_to + dw)};
  return out;
}

Posterior zoom(const std::vector<Count>& counts, Box box, double half_rad, double dispersion) {
  Posterior posterior = sum_over(counts, box, half_rad, dispersion);
  for (int round = 0; round < 6; ++round) {
    const double width = box.edge_to - box.edge_from, height = box.window_to - box.window_from;
    posterior = sum_over(counts, box, half_rad, dispersion);
    if (box.edge_to - box.edge_from > 0.8 * width && box.window_to - box.window_from > 0.8 * height) break;
  }
  return posterior;
}

/// Pearson's chi-square per degree of freedom at the best response, if chance alone would not make it (1 %).
double dispersion_at(const std::vector<Count>& counts, const Posterior& at, double half_rad) {
  double chi2 = 0;
  int informative = 0;
  for (const Count& count : counts) {
    const auto part = count.pearson(at.best, at.best_stray, half_rad);
    if (!part) continue;
    ++informative;
    chi2 += *part;
  }
  const int freedom = informative - 2;
  if (freedom < 1) return 1;
  return chi2 > chi_squared_quantile(freedom, 0.99) ? chi2 / freedom : 1;
}

}  // namespace

EdgeResponse fit_edge_response(const std::vector<EdgeStop>& stops, bool rising, double u_stop_rad) {
  double front = -1e9, back = 1e9;
  int inside = 0;
  for (const EdgeStop& stop : stops) {
    const double along = rising ? stop.stage_rad : -stop.stage_rad;
    if (stop.state == EdgeStop::State::front) front = std::max(front, along);
    if (stop.state == EdgeStop::State::back) back = std::min(back, along);
    inside += stop.state == EdgeStop::State::jitter;
  }
  const double width = std::max(back - front, 1e-5);
  // The likelihood decides; the box only has to hold it: a wide Gaussian's tails reach over smooth stops.
  const double low = std::min(front, back) - width, high = std::max(front, back) + width;
  const Box box{low, high, width / 500, 3 * width};
  const std::vector<Count> counts = counts_of(stops, rising);
  const double half_rad = std::numbers::sqrt3 * u_stop_rad;
  Posterior posterior = zoom(counts, box, half_rad, 1);
  EdgeResponse response;
  response.dispersion = dispersion_at(counts, posterior, half_rad);
  if (response.dispersion > 1) posterior = zoom(counts, box, half_rad, response.dispersion);
  response.edge_rad = {rising ? posterior.edge : -posterior.edge, posterior.u_edge};
  response.window_rad = {posterior.window, posterior.u_window};
  response.ramp_probability = posterior.ramp;
  response.stops_inside = inside;
  return response;
}

std::vector<EdgeCrossing> find_edge_crossings(const Recording& recording, const EdgeOptions& options) {
  std::vector<EdgeCrossing> crossings;
  const Bench& bench = recording.bench();
  const double u_stop_rad =
      std::hypot(bench.stage_resolution_rad / std::sqrt(12.0), accuracy_of(bench).stage_position_rad.u);
  for (const auto& [key, stops] : collect(recording, options)) {
    const std::vector<std::size_t> calm = calm_stops(stops);
    for (std::size_t c = 0; c + 1 < calm.size(); ++c) {
      const BeamStop &before = stops[calm[c]], &after = stops[calm[c + 1]];
      if (!is_step(before, after) || after.stage_rad - before.stage_rad > options.reach_rad) continue;
      Passage passage{stops, calm[c], calm[c + 1], before.median_mm, after.median_mm};
      if (options.right && *options.right == passage.rising()) continue;
      widen(passage, options.reach_rad);
      EdgeCrossing crossing = crossing_of(passage, options);
      crossing.step = key.first;
      crossing.beam_rad = bench.lidar.beam_angle(key.first);
      crossing.approach = key.second;
      trim(crossing, options);
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
