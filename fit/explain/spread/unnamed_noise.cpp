// SPDX-License-Identifier: MIT
#include "fit/explain/spread/unnamed_noise.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>

#include "fit/explain/odds.hpp"
#include "fit/explain/spread/suspects.hpp"
#include "fit/explain/spread/unseen.hpp"
#include "fit/number_format.hpp"

namespace fit::explain::spread {
namespace {

bool is_same_within_capture(Coordinate coordinate) {
  return coordinate == Coordinate::stage || coordinate == Coordinate::time;
}

/// Samples' worth and what they say of the variance, in units of what was expected.
struct Sums {
  double freedom = 0, squares = 0;

  [[nodiscard]] double factor() const { return freedom > 0 ? squares / freedom : 1; }
  /// Log-likelihood that a factor of their own gains.
  [[nodiscard]] double gain() const {
    const double s = factor();
    return freedom > 0 && s > 0 ? freedom / 2 * (s - 1 - std::log(s)) : 0;
  }
  /// Log-likelihood if the variance is so many times what was expected, but for a constant.
  [[nodiscard]] double likelihood(double expected) const {
    return -freedom / 2 * std::log(expected) - squares / 2 / expected;
  }
  Sums& operator+=(const Sums& other) {
    freedom += other.freedom;
    squares += other.squares;
    return *this;
  }
  Sums operator-(const Sums& other) const { return {freedom - other.freedom, squares - other.squares}; }
};

/// Pools dealt out to intervals of a coordinate.
struct Division {
  Coordinate coordinate = Coordinate::beam;
  std::vector<int> interval;  ///< Of every pool.
  int count = 0;
  double price_of_places = 0;
};

class Search {
 public:
  Search(const VarianceModel& model, const std::vector<double>& variances, bool places_differ)
      : pools_(model.pools()), places_differ_(places_differ), block_(model.block_of_captures()) {
    for (std::size_t i = 0; i < pools_.size(); ++i) {
      const double freedom = model.worth_of_sample() * pools_[i].freedom;
      sums_.push_back({freedom, freedom * pools_[i].variance / variances[i]});
    }
  }

  [[nodiscard]] std::optional<UnnamedNoise> best() const {
    std::optional<UnnamedNoise> best;
    for (const Coordinate coordinate : coordinates) {
      if (places_differ_ && (is_same_within_capture(coordinate) || coordinate == Coordinate::target))
        continue;
      for (const Division& division : divisions(coordinate)) {
        UnnamedNoise noise = of(division);
        if (noise.evidence() <= (best ? best->evidence() : 0)) continue;
        const std::optional<double> unseen = unseen_gain(division);
        if (unseen.value_or(1) <= 0) continue;
        if (!is_same_within_capture(coordinate)) noise.unseen_gain = unseen;
        best = noise;
      }
    }
    return best;
  }

 private:
  static constexpr std::array coordinates{Coordinate::beam,      Coordinate::stage,     Coordinate::range,
                                          Coordinate::intensity, Coordinate::incidence, Coordinate::time,
                                          Coordinate::target};
  static constexpr std::array intervals{6, 12, 24};
  static constexpr int places_of_span = 40;

  [[nodiscard]] std::vector<Division> divisions(Coordinate coordinate) const {
    const auto place = [&](const Pool& p) { return place_of(p, coordinate); };
    std::set<double> different;
    for (const Pool& p : pools_) {
      if (!std::isfinite(place(p))) return {};
      if (different.size() < places_of_span) different.insert(place(p));
    }
    if (coordinate == Coordinate::target) {
      if (different.size() < 2) return {};
      Division by_target{coordinate, {}, static_cast<int>(*different.rbegin()) + 1};
      for (const Pool& p : pools_) by_target.interval.push_back(p.target);
      return {by_target};
    }
    std::vector<Division> list;
    for (const int count : intervals)
      if (different.size() > static_cast<std::size_t>(count) / 2) list.push_back(equal(coordinate, count));
    if (different.size() >= 6) list.push_back(best_span(equal(coordinate, places_of_span)));
    return list;
  }

  [[nodiscard]] Division equal(Coordinate coordinate, int count) const {
    const auto [low, high] =
        std::ranges::minmax(pools_, {}, [&](const Pool& p) { return place_of(p, coordinate); });
    const double from = place_of(low, coordinate), width = place_of(high, coordinate) - from;
    Division division{coordinate, {}, count};
    for (const Pool& p : pools_)
      division.interval.push_back(
          std::min(count - 1, static_cast<int>((place_of(p, coordinate) - from) / width * count)));
    return division;
  }

  [[nodiscard]] std::vector<Sums> sums_of(const Division& division) const {
    std::vector<Sums> sums(static_cast<std::size_t>(division.count));
    for (std::size_t i = 0; i < pools_.size(); ++i)
      sums[static_cast<std::size_t>(division.interval[i])] += sums_[i];
    return sums;
  }

  /// Intervals outside and inside of the span that stands out most.
  [[nodiscard]] Division best_span(const Division& fine) const {
    std::vector<Sums> up_to{{}};
    for (const Sums& sums : sums_of(fine)) {
      up_to.push_back(up_to.back());
      up_to.back() += sums;
    }
    double most = -1;
    int first = 0, last = 0;
    for (int i = 0; i < fine.count; ++i)
      for (int j = i + 1; j <= fine.count; ++j) {
        const Sums within = up_to[static_cast<std::size_t>(j)] - up_to[static_cast<std::size_t>(i)],
                   without = up_to.back() - within;
        const double gain = within.gain() + without.gain();
        if (gain <= most) continue;
        most = gain;
        first = i;
        last = j;
      }
    Division span{fine.coordinate, {}, 2, odds::against_place(most, 0.5 * fine.count * (fine.count + 1))};
    for (const int interval : fine.interval) span.interval.push_back(interval >= first && interval < last);
    return span;
  }

  /// Of the log-likelihood, by a factor for every interval; where places differ, beside one for every
  /// capture.
  [[nodiscard]] double gain(const Division& division, const std::vector<Sums>& sums) const {
    double gain = 0;
    if (!places_differ_) {
      for (const Sums& s : sums) gain += s.gain();
      return gain;
    }
    std::map<int, std::vector<Sums>> of_captures;
    for (std::size_t i = 0; i < pools_.size(); ++i) {
      auto& own = of_captures[pools_[i].capture];
      own.resize(static_cast<std::size_t>(division.count));
      own[static_cast<std::size_t>(division.interval[i])] += sums_[i];
    }
    std::vector<double> factor(static_cast<std::size_t>(division.count), 1);
    constexpr int until_settled = 8;
    for (int round = 0; round < until_settled; ++round) {
      std::vector<Sums> left(factor.size());
      gain = 0;
      for (const auto& [capture, own] : of_captures) {
        Sums all, plain;
        double of_factors = 0;
        for (std::size_t k = 0; k < own.size(); ++k) {
          plain += own[k];
          all += {own[k].freedom, own[k].squares / factor[k]};
          of_factors -= own[k].freedom / 2 * std::log(factor[k]);
        }
        const double constant = std::max(1e-6, all.factor());
        gain += all.likelihood(constant) + of_factors - plain.likelihood(std::max(1e-6, plain.factor()));
        for (std::size_t k = 0; k < own.size(); ++k) left[k] += {own[k].freedom, own[k].squares / constant};
      }
      for (std::size_t k = 0; k < factor.size(); ++k)
        factor[k] = std::max(1e-6, left[k].freedom > 0 ? left[k].factor() : 1);
    }
    return gain;
  }

  /// How much more captures differ within intervals than their numbers of samples say: whatever a capture has
  /// in common is one draw, not thousands. 1 if that cannot be told.
  [[nodiscard]] double excess_of_captures(const Division& division, const std::vector<Sums>& sums) const {
    struct Capture {
      Sums sums;
      double expected = 1;
    };
    std::map<int, Capture> captures;
    for (std::size_t i = 0; i < pools_.size(); ++i) {
      Capture& capture = captures[pools_[i].capture];
      capture.sums += sums_[i];
      capture.expected = std::max(1e-6, sums[static_cast<std::size_t>(division.interval[i])].factor());
    }
    double squares = 0;
    for (const auto& [number, capture] : captures)
      squares += capture.sums.freedom / 2 * std::pow(capture.sums.factor() / capture.expected - 1, 2);
    const double freedom = static_cast<double>(captures.size()) - division.count;
    return freedom < 5 ? 1 : std::max(1.0, squares / freedom);
  }

  [[nodiscard]] UnnamedNoise of(const Division& division) const {
    const std::vector<Sums> sums = sums_of(division);
    UnnamedNoise noise;
    noise.coordinate = division.coordinate;
    int used = 0;
    for (const Sums& s : sums) used += s.freedom > 0;
    if (used < 2) return noise;
    noise.gain = gain(division, sums);
    if (is_same_within_capture(division.coordinate)) noise.gain /= excess_of_captures(division, sums);
    const double sizes = used;  // one of them the level of all
    // One of so many coordinates and forms.
    noise.price = sizes * price_of_size(noise.gain / sizes) + division.price_of_places +
                  std::log(static_cast<double>(coordinates.size() * (intervals.size() + 1)));
    describe(division, noise);
    return noise;
  }

  /// What is left of it where it was not fitted. What differs within captures must hold in each with a
  /// constant noise of its own; what does not, without.
  [[nodiscard]] std::optional<double> unseen_gain(const Division& division) const {
    if (block_.empty()) return {};
    const std::vector<Sums> all = sums_of(division);
    std::vector<std::vector<Sums>> own(static_cast<std::size_t>(blocks_in(block_)),
                                       std::vector<Sums>(static_cast<std::size_t>(division.count)));
    for (std::size_t i = 0; i < pools_.size(); ++i)
      own[static_cast<std::size_t>(block_.at(pools_[i].capture))]
         [static_cast<std::size_t>(division.interval[i])] += sums_[i];
    const bool own_constant = !is_same_within_capture(division.coordinate);
    Unseen unseen;
    for (const std::vector<Sums>& asked : own) {
      Sums as_was, with_factors;
      double of_factors = 0;
      for (std::size_t k = 0; k < asked.size(); ++k) {
        const double taught = std::max(1e-6, (all[k] - asked[k]).factor());
        as_was += asked[k];
        with_factors += {asked[k].freedom, asked[k].squares / taught};
        of_factors -= asked[k].freedom / 2 * std::log(taught);
      }
      const auto constant = [&](const Sums& s) { return own_constant ? std::max(1e-6, s.factor()) : 1; };
      unseen.add(with_factors.likelihood(constant(with_factors)) + of_factors -
                 as_was.likelihood(constant(as_was)));
    }
    return unseen.gain();
  }

  /// Where samples scatter most, and least.
  void describe(const Division& division, UnnamedNoise& noise) const {
    struct Within {
      UnnamedNoise::Interval interval{1e300, -1e300, 0};
      double freedom = 0;
    };
    std::map<int, Within> by_number;
    for (std::size_t i = 0; i < pools_.size(); ++i) {
      auto& [interval, freedom] = by_number[division.interval[i]];
      const double at = place_of(pools_[i], division.coordinate);
      interval.from = std::min(interval.from, at);
      interval.to = std::max(interval.to, at);
      freedom += pools_[i].freedom;
      interval.sigma_mm += pools_[i].freedom * pools_[i].variance;
    }
    std::vector<UnnamedNoise::Interval> list;
    for (auto& [number, within] : by_number) {
      within.interval.sigma_mm = std::sqrt(within.interval.sigma_mm / within.freedom);
      list.push_back(within.interval);
    }
    const auto [least, most] = std::ranges::minmax(list, {}, &UnnamedNoise::Interval::sigma_mm);
    noise.least = least;
    noise.most = most;
    noise.only_there = list.size() == 2;
  }

  const std::vector<Pool>& pools_;
  bool places_differ_;
  std::map<int, int> block_;  ///< Of every capture, for what is not fitted to it.
  std::vector<Sums> sums_;    ///< Of every pool.
};

}  // namespace

std::optional<UnnamedNoise> unnamed_noise(const VarianceModel& model, const std::vector<double>& variances,
                                          bool places_differ) {
  return Search(model, variances, places_differ).best();
}

std::string in_words(const UnnamedNoise& noise, const std::vector<std::string>& targets) {
  const std::string name = name_of(noise.coordinate);
  const auto at = [&](const UnnamedNoise::Interval& i) {
    if (noise.coordinate == Coordinate::target) {
      const auto index = static_cast<std::size_t>(i.from);
      return "'" + (index < targets.size() ? targets[index] : std::to_string(index)) + "'";
    }
    return rounded(i.from, 4) + " to " + rounded(i.to, 4) + unit_of(noise.coordinate);
  };
  return "samples scatter by an unnamed law of " + name + ": most, by " + rounded(noise.most.sigma_mm, 3) +
         " mm, at " + at(noise.most) + ", and least, by " + rounded(noise.least.sigma_mm, 3) + " mm, " +
         (noise.only_there ? "elsewhere" : "at " + at(noise.least));
}

}  // namespace fit::explain::spread
