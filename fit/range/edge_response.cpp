// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>

#include "fit/numeric/distributions.hpp"
#include "fit/range/edge.hpp"

namespace fit {
namespace {

constexpr std::array<double, 4> strays = {1e-6, 1e-4, 1e-3, 1e-2};
/// One shape that the response may have; angles in the direction in which the share grows.
struct Shape {
  double edge = 0, window = 0;
  bool ramp = true;
  /// Share of clean samples that see behind.
  [[nodiscard]] double seen(double along_rad) const {
    return share_behind((along_rad - edge) / window, ramp);
  }
};

/// Integral of a function over a coordinate u on which a response depends, constant beyond the ends of a
/// grid.
class Cumulative {
 public:
  template <class Function>
  Cumulative(double from, double to, std::size_t steps, const Function& at)
      : from_(from), step_((to - from) / static_cast<double>(steps)) {
    first_ = at(from);
    sums_.reserve(steps + 1);
    sums_.push_back(0);
    double before = first_;
    for (std::size_t i = 1; i <= steps; ++i) {
      const double now = at(from + static_cast<double>(i) * step_);
      sums_.push_back(sums_.back() + step_ * (before + now) / 2);
      before = now;
    }
    last_ = before;
  }
  [[nodiscard]] double up_to(double u) const {
    const double place = (u - from_) / step_, end = static_cast<double>(sums_.size() - 1);
    if (place <= 0) return first_ * (u - from_);
    if (place >= end) return sums_.back() + last_ * (place - end) * step_;
    const auto i = static_cast<std::size_t>(place);
    return sums_[i] + (place - static_cast<double>(i)) * (sums_[i + 1] - sums_[i]);
  }

 private:
  double from_, step_, first_ = 0, last_ = 0;
  std::vector<double> sums_;
};

/// What was counted at a stop; what does not depend on the response is computed once.
class Count {
 public:
  /// The stop's angle is anywhere within `half_rad` (0: exact).
  Count(double along_rad, double half_rad, double n, double back)
      : along_rad_(along_rad),
        half_rad_(half_rad),
        n_(n),
        back_(back),
        log_choose_(std::lgamma(n + 1) - std::lgamma(back + 1) - std::lgamma(n - back + 1)) {
    if (half_rad == 0) return;
    // Steps are narrower than the binomial probability along them.
    constexpr double farthest = 1.2;  // windows from a Gaussian response's middle
    const auto steps = [&](double per_root, double least) {
      return static_cast<std::size_t>(std::clamp(per_root * std::sqrt(n), least, 20 * least));
    };
    for (const double stray : strays) {
      const auto probability = [&](double seen) {
        return std::exp(log_binomial(stray + (1 - 2 * stray) * seen));
      };
      for (const bool ramp : {true, false}) {
        const double end = ramp ? 0.5 : farthest;
        auto& along = ramp ? along_ramp_ : along_gaussian_;
        along.emplace_back(-end, end, ramp ? steps(3, 150) : steps(9, 300),
                           [&](double x) { return probability(share_behind(x, ramp)); });
      }
    }
  }

  /// Adds the log probabilities for every share of stray samples; their mean where the angle is not exact.
  void add(const Shape& shape, std::array<double, strays.size()>& sums) const {
    const std::vector<Cumulative>& along = shape.ramp ? along_ramp_ : along_gaussian_;
    const double seen = along.empty() ? shape.seen(along_rad_) : 0,
                 from = (along_rad_ - half_rad_ - shape.edge) / shape.window,
                 to = (along_rad_ + half_rad_ - shape.edge) / shape.window;
    for (std::size_t k = 0; k < strays.size(); ++k)
      sums[k] += along.empty()
                     ? log_binomial(strays[k] + (1 - 2 * strays[k]) * seen)
                     : std::log(std::max((along[k].up_to(to) - along[k].up_to(from)) / (to - from), 1e-300));
  }
  /// Its part of Pearson's chi-square at that response; nothing for a stop that says nothing of it.
  [[nodiscard]] std::optional<double> pearson(const Shape& shape, double stray) const {
    const double seen = shape.seen(along_rad_), p = stray + (1 - 2 * stray) * seen;
    if (n_ * p < 3 || n_ * (1 - p) < 3) return std::nullopt;
    const double of_angle =
        n_ * (shape.seen(along_rad_ + half_rad_) - shape.seen(along_rad_ - half_rad_)) / std::sqrt(12.0);
    return std::pow(back_ - n_ * p, 2) / (n_ * p * (1 - p) + of_angle * of_angle);
  }

 private:
  [[nodiscard]] double log_binomial(double share) const {
    return log_choose_ + back_ * std::log(share) + (n_ - back_) * std::log1p(-share);
  }
  double along_rad_, half_rad_, n_, back_, log_choose_;
  std::vector<Cumulative> along_ramp_, along_gaussian_;  ///< Probabilities, for every share of stray samples.
};

std::vector<Count> counts_of(const std::vector<EdgeStop>& stops, bool rising, double half_rad) {
  std::vector<Count> counts;
  for (const EdgeStop& stop : stops)
    counts.emplace_back(rising ? stop.stage_rad : -stop.stage_rad, half_rad, static_cast<double>(stop.n),
                        static_cast<double>(stop.back));
  return counts;
}

/// Log likelihood of a shape for every share of stray samples.
std::array<double, strays.size()> log_likelihoods(const std::vector<Count>& counts, const Shape& shape) {
  std::array<double, strays.size()> sums{};
  for (const Count& count : counts) count.add(shape, sums);
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
Posterior sum_over(const std::vector<Count>& counts, Box& box, double dispersion) {
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
        const auto likelihoods = log_likelihoods(counts, shape);
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

Posterior zoom(const std::vector<Count>& counts, Box box, double dispersion) {
  Posterior posterior = sum_over(counts, box, dispersion);
  for (int round = 0; round < 6; ++round) {
    const double width = box.edge_to - box.edge_from, height = box.window_to - box.window_from;
    posterior = sum_over(counts, box, dispersion);
    if (box.edge_to - box.edge_from > 0.8 * width && box.window_to - box.window_from > 0.8 * height) break;
  }
  return posterior;
}

/// Pearson's chi-square per degree of freedom at the best response, if chance alone would not make it (1 %).
double dispersion_at(const std::vector<Count>& counts, const Posterior& at) {
  double chi2 = 0;
  int informative = 0;
  for (const Count& count : counts) {
    const auto part = count.pearson(at.best, at.best_stray);
    if (!part) continue;
    ++informative;
    chi2 += *part;
  }
  const int freedom = informative - 2;
  if (freedom < 1) return 1;
  return chi2 > chi_squared_quantile(freedom, 0.99) ? chi2 / freedom : 1;
}

}  // namespace

double share_behind(double windows, bool ramp) {
  constexpr double sigmas_of_window = 4.652696;  // of a Gaussian response, from 1 % to 99 %
  return ramp ? std::clamp(0.5 + windows, 0.0, 1.0)
              : std::erfc(-windows * sigmas_of_window / std::numbers::sqrt2) / 2;
}

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
  const std::vector<Count> counts = counts_of(stops, rising, std::numbers::sqrt3 * u_stop_rad);
  Posterior posterior = zoom(counts, box, 1);
  EdgeResponse response;
  response.dispersion = dispersion_at(counts, posterior);
  if (response.dispersion > 1) posterior = zoom(counts, box, response.dispersion);
  response.edge_rad = {rising ? posterior.edge : -posterior.edge, posterior.u_edge};
  response.window_rad = {posterior.window, posterior.u_window};
  response.ramp_probability = posterior.ramp;
  response.stops_inside = inside;
  return response;
}

}  // namespace fit
