// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "fit/explain/spread/interval.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"

namespace fit::explain::spread {
namespace {

constexpr double rarest = 1e-6;  // probability of no echo: so many are lost whatever the cause

constexpr double doubt_rad = 1.5 * rad_per_deg, widest_slit_rad = 6 * rad_per_deg;

/// By how much a target may stand aside from where it is said to stand, as seen by that cell: 60 mm at half a
/// metre, and the same angle farther off, where one that is not seen at all may not be there. Where other
/// echoes scatter as those do that are about to be lost, it is.
double displaced_rad(const Cell& cell, bool near_threshold) {
  constexpr double aside_mm = 60, most_rad = 6 * rad_per_deg;
  if (!near_threshold) return most_rad;
  return std::clamp(aside_mm / std::max(1.0, cell.sight.range_mm), doubt_rad, most_rad);
}

/// Without any echo where one target ends and another begins: one that stands turned leaves a slit there.
bool may_be_a_slit(const Reduced& reduced, std::size_t index) {
  const Cell& cell = reduced.cells[index];
  if (cell.n > 0) return false;
  const Group& group = reduced.groups[static_cast<std::size_t>(cell.group)];
  const Cell *below = nullptr, *above = nullptr;  // the nearest that see something
  for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
    const Cell& other = reduced.cells[i];
    if (other.n == 0) continue;
    if (other.beam_rad < cell.beam_rad)
      below = &other;
    else if (!above)
      above = &other;
  }
  if (!below || !above || above->beam_rad - below->beam_rad > widest_slit_rad) return false;
  const auto begin = reduced.cells.begin() + static_cast<std::ptrdiff_t>(group.first_cell),
             end = reduced.cells.begin() + static_cast<std::ptrdiff_t>(group.last_cell);
  return std::any_of(begin, end, [&](const Cell& other) {
    return other.n > 0 && other.sight.target != cell.sight.target &&
           other.beam_rad > below->beam_rad - doubt_rad && other.beam_rad < above->beam_rad + doubt_rad;
  });
}

/// Near an edge, unless its neighbours on both sides, farther than edges blur, see the target as well.
bool may_miss_its_target(const Reduced& reduced, std::size_t index, bool near_threshold) {
  constexpr double blur_rad = 0.5 * rad_per_deg;
  const Cell& cell = reduced.cells[index];
  const double to_edge = std::abs(cell.at.edge_rad), displaced = displaced_rad(cell, near_threshold);
  if (to_edge < blur_rad || may_be_a_slit(reduced, index)) return true;
  // Nearer than `doubt_rad` to an edge its neighbours must see the target, on both sides; a beam without any
  // echo from farther inside needs only something of the target on both sides.
  const bool near = to_edge < doubt_rad;
  if (!near && (cell.n > 0 || to_edge > displaced)) return false;
  const double from = near ? blur_rad : 0, to = near ? 2 * blur_rad : displaced;
  const Group& group = reduced.groups[static_cast<std::size_t>(cell.group)];
  const auto sees_it = [&](const Cell& other) {
    return other.sight.target == cell.sight.target && 2 * other.n > other.n + other.stray + other.lost;
  };
  bool below = false, above = false;
  for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
    const double away = reduced.cells[i].beam_rad - cell.beam_rad;
    if (std::abs(away) < from || std::abs(away) > to || !sees_it(reduced.cells[i])) continue;
    (away < 0 ? below : above) = true;
  }
  return !below || !above;
}

/// Samples of one cell, with echo or not.
struct Count {
  double intensity, beam_deg, lost, all, time_s;
  int capture;
};
struct Counts {
  std::vector<Count> cells;
  double lost = 0, all = 0;
  double darkest = 1e9;  ///< Intensity, counts.
};

/// Of all cells that cannot but meet their target.
Counts count(const Reduced& reduced, bool near_threshold) {
  Counts counts;
  for (std::size_t i = 0; i < reduced.cells.size(); ++i) {
    const Cell& cell = reduced.cells[i];
    if (cell.n + cell.lost == 0) continue;
    if (std::abs(cell.at.incidence_rad) > 75 * rad_per_deg || may_miss_its_target(reduced, i, near_threshold))
      continue;
    const double all = cell.n + cell.stray + cell.lost;
    counts.cells.push_back({cell.at.intensity, cell.beam_rad * deg_per_rad, static_cast<double>(cell.lost),
                            all, cell.at.time_s,
                            reduced.groups[static_cast<std::size_t>(cell.group)].capture});
    counts.lost += cell.lost;
    counts.all += all;
  }
  // Cells that lost everything are as dark as the darkest seen.
  for (const Count& c : counts.cells)
    if (std::isfinite(c.intensity)) counts.darkest = std::min(counts.darkest, c.intensity);
  for (Count& c : counts.cells)
    if (!std::isfinite(c.intensity)) c.intensity = counts.darkest;
  return counts;
}

double clamped(double probability) { return std::clamp(probability, rarest, 1 - rarest); }

/// Of losing each with the same probability.
double constant_likelihood(const Counts& counts) {
  const double p = clamped(counts.lost / counts.all);
  return counts.lost * std::log(p) + (counts.all - counts.lost) * std::log(1 - p);
}

/// Echoes weaker than `at` counts are lost.
struct Threshold {
  double log_likelihood = 0;
  double at = 0, width = 0;
};

/// The best one, if any is better than a constant probability.
Threshold best_threshold(const Counts& counts, double constant) {
  Threshold best{constant};
  double top = 0;
  for (const Count& c : counts.cells) top = std::max(top, c.intensity);
  const auto likelihood = [&](double at, double width) {
    double sum = 0;
    for (const Count& c : counts.cells) {
      const double p = clamped(1 / (1 + std::exp((c.intensity - at) / width)));
      sum += c.lost * std::log(p) + (c.all - c.lost) * std::log(1 - p);
    }
    return sum;
  };
  for (double at = std::max(3.0, counts.darkest * 0.3); at < top; at *= 1.12)
    for (const double share : {0.03, 0.06, 0.1, 0.2, 0.35}) {
      const double l = likelihood(at, share * at);
      if (l > best.log_likelihood) best = {l, at, share * at};
    }
  return best;
}

/// Beams around `centre_deg` lose more, or less, than all others.
struct Window {
  double log_likelihood = 0;
  double centre_deg = 0;
  double elsewhere = 0;  ///< Samples lost by the others.
};

/// The best one, if any is better than a constant probability.
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

/// Log-likelihood of two probabilities, one within and one elsewhere.
double likelihood_of_two(double in_lost, double in_all, const Counts& counts) {
  const auto of = [](double lost, double all) {
    const double p = clamped(lost / std::max(1.0, all));
    return lost * std::log(p) + (all - lost) * std::log(1 - p);
  };
  return of(in_lost, in_all) + of(counts.lost - in_lost, counts.all - in_all);
}

/// More are lost from one time to another, around a beam angle or at all.
struct WindowInTime {
  double log_likelihood = 0;
  bool at_all_angles = false;
  double centre_deg = 0, width_deg = 0, elsewhere = 0;
  Interval times_s;
  double u_from_s = 0, u_to_s = 0;
  std::size_t captures = 0;  ///< That take part.
};

bool is_within(const WindowInTime& window, const Count& c) {
  return c.time_s > window.times_s.from && c.time_s < window.times_s.to &&
         (window.at_all_angles || std::abs(c.beam_deg - window.centre_deg) < window.width_deg);
}

/// The best one, its price paid; none where there are not several times.
std::optional<WindowInTime> best_window_in_time(const Counts& counts) {
  std::set<double> different;
  for (const Count& c : counts.cells) different.insert(c.time_s);
  constexpr std::size_t fewest = 4, most = 200;
  if (different.size() < fewest || different.size() > most) return {};
  const std::vector<double> times(different.begin(), different.end());
  std::optional<WindowInTime> best;
  std::size_t first_time = 0, last_time = 0;
  const auto look = [&](bool everywhere, double centre, double width) {
    std::vector<std::pair<double, double>> up_to(times.size() + 1);
    for (const Count& c : counts.cells) {
      if (!everywhere && std::abs(c.beam_deg - centre) >= width) continue;
      auto& [lost, all] =
          up_to[static_cast<std::size_t>(std::ranges::lower_bound(times, c.time_s) - times.begin()) + 1];
      lost += c.lost;
      all += c.all;
    }
    for (std::size_t t = 0; t < times.size(); ++t) {
      up_to[t + 1].first += up_to[t].first;
      up_to[t + 1].second += up_to[t].second;
    }
    for (std::size_t first = 0; first < times.size(); ++first)
      for (std::size_t last = first; last < times.size(); ++last) {
        if (2 * (last - first + 1) > times.size()) break;  // what is there mostly is told without times
        const double lost = up_to[last + 1].first - up_to[first].first,
                     all = up_to[last + 1].second - up_to[first].second;
        if (all < 1 || lost * counts.all <= counts.lost * all) continue;
        const double l = likelihood_of_two(lost, all, counts);
        if (best && l <= best->log_likelihood) continue;
        best = WindowInTime{l, everywhere, centre, width, counts.lost - lost, {}, 0, 0, 0};
        first_time = first;
        last_time = last;
      }
  };
  look(true, 0, 0);
  for (double centre = -130; centre <= 130; centre += 3)
    for (const double width : {8.0, 14.0, 22.0}) look(false, centre, width);
  if (!best) return {};
  best->log_likelihood -= std::log(static_cast<double>(times.size() * times.size()));
  constexpr double aside_s = 1;
  const double before = first_time > 0 ? times[first_time - 1] : times.front() - 2 * aside_s,
               after = last_time + 1 < times.size() ? times[last_time + 1] : times.back() + 2 * aside_s;
  best->times_s = {std::midpoint(before, times[first_time]), std::midpoint(times[last_time], after)};
  best->u_from_s = (times[first_time] - before) / std::sqrt(12.0);
  best->u_to_s = (after - times[last_time]) / std::sqrt(12.0);
  std::set<int> captures;
  for (const Count& c : counts.cells)
    if (c.lost > 0 && is_within(*best, c)) captures.insert(c.capture);
  best->captures = captures.size();
  return best;
}

/// Whether echoes as weak as most of those lost within, or weaker, come back elsewhere or at other times.
/// Otherwise nobody can say that they were not too weak.
bool as_weak_come_back(const WindowInTime& window, const Counts& counts) {
  constexpr double hardly_stronger = 1.01;
  double weakest = std::numeric_limits<double>::infinity();
  for (const Count& c : counts.cells)
    if (!is_within(window, c) && 2 * c.lost < c.all) weakest = std::min(weakest, c.intensity);
  double lost = 0, strong = 0;
  for (const Count& c : counts.cells) {
    if (!is_within(window, c)) continue;
    lost += c.lost;
    // How weak those are of which nothing came back, nobody knows.
    if (c.lost < c.all && weakest <= hardly_stronger * c.intensity) strong += c.lost;
  }
  return 2 * strong > lost;
}

/// Light hides echoes where and while it falls in; what a single capture shows, or all angles do, may be
/// anything.
void tell(const WindowInTime& window, double gain, double evidence, SpreadResult& result) {
  if (window.captures > 1 && !window.at_all_angles) {
    Suspect sun = suspected("sunlight");
    sun.gain = gain;
    sun.evidence = evidence;
    sun.parameters = {{"sigma_mm", {0, 1}},
                      {"centre_deg", {window.centre_deg, 5}},
                      {"width_deg", {window.width_deg, 5}},
                      {"from_s", {window.times_s.from, window.u_from_s}},
                      {"to_s", {window.times_s.to, window.u_to_s}}};
    if (!is_accepted(result, "sunlight")) result.accepted.push_back(sun);
    return;
  }
  Unexplained u;
  u.observable = Observable::dropout;
  u.gain = gain;
  u.evidence = evidence;
  const std::string when =
      "from " + rounded(window.times_s.from) + " to " + rounded(window.times_s.to) + " s after power-on";
  if (window.at_all_angles) {
    u.coordinate = Coordinate::time;
    u.from = window.times_s.from;
    u.to = window.times_s.to;
    u.describes = "echoes are missing " + when + ", at all angles";
  } else {
    u.coordinate = Coordinate::beam;
    u.from = window.centre_deg - window.width_deg;
    u.to = window.centre_deg + window.width_deg;
    u.describes = "echoes are missing " + when + " at beams around " + rounded(window.centre_deg) + " deg";
  }
  result.unknown.push_back(u);
  if (window.at_all_angles) return;
  u.coordinate = Coordinate::time;
  u.from = window.times_s.from;
  u.to = window.times_s.to;
  result.unknown.push_back(u);
}

Unexplained lost_anywhere(const Counts& counts) {
  Unexplained u;
  u.observable = Observable::dropout;
  u.coordinate = Coordinate::beam;
  u.describes = "echoes are missing, " + rounded(100 * clamped(counts.lost / counts.all), 2) +
                " % of all, whatever their strength and angle";
  u.from = 180;
  u.to = -180;
  for (const Count& c : counts.cells) {
    u.from = std::min(u.from, c.beam_deg);
    u.to = std::max(u.to, c.beam_deg);
  }
  return u;
}

bool holds_steep_noise(const std::vector<Suspect>& set) {
  return std::ranges::any_of(set, is_steeper_than_a_receiver);
}

/// Whether weak echoes scatter as those do that are about to be lost.
bool is_near_threshold(const SpreadResult& result) {
  return holds_steep_noise(result.accepted) || std::ranges::any_of(result.undecided, holds_steep_noise);
}

/// Mean intensity of the cell that is darkest.
double weakest_echo(const Reduced& reduced) {
  double weakest = 1e9;
  for (const Cell& cell : reduced.cells)
    if (cell.smooth && cell.at.intensity > 0) weakest = std::min(weakest, cell.at.intensity);
  return weakest;
}

/// Of which nothing has been lost yet: somewhat below the weakest echo there is, how far nobody knows.
Suspect dropout_below(double weakest) {
  Suspect dropout = suspected("dropout");
  dropout.parameters = {{"intensity_min", {0.75 * weakest, 0.15 * weakest}},
                        {"width", {0.03 * weakest, 0.03 * weakest}}};
  return dropout;
}

}  // namespace

void losses(const Reduced& reduced, SpreadResult& result) {
  constexpr double price = 8;
  const Counts counts = count(reduced, is_near_threshold(result));
  if (counts.lost < 3 || counts.all < 100) return;
  const double none = counts.lost * std::log(rarest), constant = constant_likelihood(counts);
  const Threshold threshold = reduced.has_intensity ? best_threshold(counts, constant) : Threshold{constant};
  const Window window = best_window(counts, constant);
  const bool light = is_accepted(result, "sunlight");
  // Part of it: background light also hides echoes.
  if (light && window.log_likelihood > threshold.log_likelihood - 8) return;
  constexpr double clearly = 8, nearly_all = 0.1;
  const auto in_time = best_window_in_time(counts);
  if (in_time && in_time->elsewhere < nearly_all * counts.lost &&
      in_time->log_likelihood >
          clearly + std::max({constant, threshold.log_likelihood, window.log_likelihood}) &&
      as_weak_come_back(*in_time, counts)) {
    if (light) return;
    const double gain = in_time->log_likelihood - none;
    return tell(*in_time, gain, gain - price, result);
  }
  Suspect dropout = suspected("dropout");
  dropout.gain = threshold.log_likelihood - none;
  dropout.evidence = dropout.gain - price;
  if (dropout.evidence < accept_rare_at) return;
  if (threshold.at > 0 && threshold.log_likelihood - constant > 4 &&
      threshold.log_likelihood >= window.log_likelihood - 3) {
    const double u = threshold.width / std::sqrt(1 + counts.lost);
    dropout.parameters = {{"intensity_min", {threshold.at, u}}, {"width", {threshold.width, u}}};
    result.accepted.push_back(dropout);
    return;
  }
  // Light that falls in explains what is lost there, not what is lost everywhere.
  if (window.log_likelihood - constant > 8 && window.elsewhere < 0.1 * counts.lost) {
    Suspect sun = suspected("sunlight");
    sun.gain = window.log_likelihood - none;
    sun.evidence = sun.gain - price;
    sun.parameters = {{"sigma_mm", {0, 1}}, {"centre_deg", {window.centre_deg, 5}}, {"width_deg", {14, 5}}};
    if (!light) result.accepted.push_back(sun);
    return;
  }
  if (counts.lost < 10) return;
  Unexplained unknown = lost_anywhere(counts);
  unknown.gain = constant - none;
  unknown.evidence = unknown.gain - price;
  result.unknown.push_back(unknown);
}

void may_be_near_threshold(const Reduced& reduced, SpreadResult& result) {
  if (is_accepted(result, "dropout")) {
    // Echoes that are about to be lost scatter more: the same cause.
    const auto bring_along = [&](const std::vector<Suspect>& list) {
      std::ranges::copy_if(list, std::back_inserter(result.brought_along), is_steeper_than_a_receiver);
    };
    bring_along(result.accepted);
    std::erase_if(result.accepted, is_steeper_than_a_receiver);
    for (const auto& set : result.undecided) bring_along(set);
    std::erase_if(result.undecided, holds_steep_noise);
    return;
  }
  const Suspect dropout = dropout_below(weakest_echo(reduced));
  const auto noise = std::ranges::find_if(result.accepted, is_steeper_than_a_receiver);
  if (noise != result.accepted.end()) {
    result.undecided.push_back({*noise});
    result.accepted.erase(noise);
  }
  for (auto& set : result.undecided) {
    if (!holds_steep_noise(set)) continue;
    set.insert(set.begin() + 1, dropout);
    set[1].gain = set.front().gain;
    set[1].evidence = set.front().evidence;
  }
}

}  // namespace fit::explain::spread
