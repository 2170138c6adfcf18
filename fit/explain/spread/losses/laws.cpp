// SPDX-License-Identifier: MIT
#include "fit/explain/spread/losses/laws.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <vector>

#include "fit/explain/spread/as_weak_elsewhere.hpp"

namespace fit::explain::spread {
namespace {

/// Log-likelihood of two probabilities, one within and one elsewhere.
double likelihood_of_two(double in_lost, double in_all, const Counts& counts) {
  const auto of = [](double lost, double all) {
    const double p = clamped(lost / std::max(1.0, all));
    return lost * std::log(p) + (all - lost) * std::log(1 - p);
  };
  return of(in_lost, in_all) + of(counts.lost - in_lost, counts.all - in_all);
}

bool is_at(const Place& place, const Count& c) {
  return place.everywhere || std::abs(c.beam_deg - place.centre_deg) < place.width_deg;
}

bool is_within(const WindowInTime& window, const Count& c) {
  const auto& [place, times_s, u_from_s, u_to_s] = window.where_and_when;
  return c.time_s > times_s.from && c.time_s < times_s.to && is_at(place, c);
}

std::vector<Place> places_to_try() {
  std::vector<Place> places{{.everywhere = true}};
  for (double centre = -130; centre <= 130; centre += 3)
    for (const double width : {8.0, 14.0, 22.0}) places.push_back({.centre_deg = centre, .width_deg = width});
  return places;
}

}  // namespace

double clamped(double probability) { return std::clamp(probability, rarest, 1 - rarest); }

double constant_likelihood(const Counts& counts) {
  const double p = clamped(counts.lost / counts.all);
  return counts.lost * std::log(p) + (counts.all - counts.lost) * std::log(1 - p);
}

double lost_below(double at, double width, double intensity) {
  return clamped(1 / (1 + std::exp((intensity - at) / width)));
}

double likelihood_of_threshold(const Counts& counts, double at, double width) {
  double sum = 0;
  for (const Count& c : counts.cells) {
    const double p = lost_below(at, width, c.intensity);
    sum += c.lost * std::log(p) + (c.all - c.lost) * std::log(1 - p);
  }
  return sum;
}

Threshold best_threshold(const Counts& counts, double constant) {
  Threshold best{constant};
  double top = 0;
  for (const Count& c : counts.cells) top = std::max(top, c.intensity);
  for (double at = std::max(3.0, counts.darkest * 0.3); at < top; at *= 1.12)
    for (const double share : {0.03, 0.06, 0.1, 0.2, 0.35}) {
      const double l = likelihood_of_threshold(counts, at, share * at);
      if (l > best.log_likelihood) best = {l, at, share * at};
    }
  return best;
}

Window best_window(const Counts& counts, double constant) {
  Window best{constant, 0, counts.lost};
  for (double centre = -130; centre <= 130; centre += 6)
    for (const double width : {8.0, 14.0, 22.0}) {
      double in_lost = 0, in_all = 0;
      for (const Count& c : counts.cells)
        if (std::abs(c.beam_deg - centre) < width) {
          in_lost += c.lost;
          in_all += c.all;
        }
      if (in_all < 1) continue;
      const double out_lost = counts.lost - in_lost, out_all = counts.all - in_all;
      const double p_in = clamped(in_lost / in_all), p_out = clamped(out_lost / std::max(1.0, out_all));
      const double l = in_lost * std::log(p_in) + (in_all - in_lost) * std::log(1 - p_in) +
                       out_lost * std::log(p_out) + (out_all - out_lost) * std::log(1 - p_out);
      if (l > best.log_likelihood) best = {l, centre, out_lost};
    }
  return best;
}

std::optional<WindowInTime> best_window_in_time(const Counts& counts) {
  constexpr std::size_t most_times = 200;
  std::set<double> different_s;
  for (const Count& c : counts.cells) different_s.insert(c.time_s);
  if (different_s.size() > most_times) return {};
  const Times times(different_s, most_times);
  const auto sums_at = [&](const Place& place) {
    std::vector<Sums> sums(times.count(), Sums::Zero());
    for (const Count& c : counts.cells)
      if (is_at(place, c)) sums[times.index_of(c.time_s)] += Sums(c.lost, c.all);
    return sums;
  };
  const auto likelihood = [&](const Sums& within) -> std::optional<double> {
    const double lost = within[0], all = within[1];
    if (all < 1 || lost * counts.all <= counts.lost * all) return {};
    return likelihood_of_two(lost, all, counts);
  };
  const auto best = best_span(times, places_to_try(), {sums_at, likelihood, 2 / std::sqrt(12.0)});
  if (!best) return {};
  const double price = std::log(static_cast<double>(times.count() * times.count()));
  WindowInTime window{best->score - price, best->where_and_when, counts.lost - best->within[0]};
  std::set<int> captures;
  for (const Count& c : counts.cells)
    if (c.lost > 0 && is_within(window, c)) captures.insert(c.capture);
  window.captures = captures.size();
  return window;
}

bool as_weak_come_back(const WindowInTime& window, const Counts& counts) {
  // How weak those are of which nothing came back, nobody knows.
  constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
  std::vector<Echoes> hidden;
  std::vector<double> elsewhere;
  for (const Count& c : counts.cells)
    if (is_within(window, c))
      hidden.push_back({c.lost < c.all ? c.intensity : unknown, c.lost});
    else if (2 * c.lost < c.all)
      elsewhere.push_back(c.intensity);
  return is_as_weak_elsewhere(hidden, elsewhere);
}

}  // namespace fit::explain::spread
