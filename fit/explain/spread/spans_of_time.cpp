// SPDX-License-Identifier: MIT
#include "fit/explain/spread/spans_of_time.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace fit::explain::spread {

Times::Times(const std::set<double>& different_s, std::size_t most)
    : all_s_(different_s.begin(), different_s.end()),
      each_(std::max<std::size_t>(1, (all_s_.size() + most - 1) / most)) {}

std::size_t Times::index_of(double time_s) const {
  return static_cast<std::size_t>(std::ranges::lower_bound(all_s_, time_s) - all_s_.begin()) / each_;
}

PlaceAndTimes Times::lasting(const Place& place, std::size_t first, std::size_t last, double u_open_s) const {
  const std::size_t begin = first * each_, end = std::min(all_s_.size(), (last + 1) * each_);
  const auto middle_s = [&](std::size_t before) { return std::midpoint(all_s_[before], all_s_[before + 1]); };
  const auto u_s = [&](std::size_t before) {
    return (all_s_[before + 1] - all_s_[before]) / std::sqrt(12.0);
  };
  constexpr double aside_s = 1;
  return {.place = place,
          .times_s = {begin > 0 ? middle_s(begin - 1) : all_s_.front() - aside_s,
                      end < all_s_.size() ? middle_s(end - 1) : all_s_.back() + aside_s},
          .u_from_s = begin > 0 ? u_s(begin - 1) : u_open_s,
          .u_to_s = end < all_s_.size() ? u_s(end - 1) : u_open_s};
}

std::optional<FoundSpan> best_span(const Times& times, const std::vector<Place>& places,
                                   const SpanSearch& search) {
  constexpr std::size_t fewest = 4;
  if (times.count() < fewest) return {};
  struct Best {
    Place place;
    std::size_t first, last;
    Sums within;
    double score;
  };
  std::optional<Best> best;
  for (const Place& place : places) {
    std::vector<Sums> up_to{Sums::Zero()};
    for (const Sums& sums : search.sums_at(place)) up_to.push_back(up_to.back() + sums);
    for (std::size_t first = 0; first < times.count(); ++first)
      for (std::size_t last = first; last < times.count(); ++last) {
        if (2 * (last - first + 1) > times.count()) break;  // what is there mostly is told without times
        const Sums within = up_to[last + 1] - up_to[first];
        const std::optional<double> score = search.score(within);
        if (score && (!best || *score > best->score)) best = Best{place, first, last, within, *score};
      }
  }
  if (!best) return {};
  return FoundSpan{times.lasting(best->place, best->first, best->last, search.u_open_s), best->within,
                   best->score};
}

}  // namespace fit::explain::spread
