// SPDX-License-Identifier: MIT
#include "fit/explain/model/scans.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <tuple>

#include "fit/explain/model/autoregression.hpp"
#include "fit/explain/model/range_and_angle.hpp"
#include "fit/explain/reduction/whole_scans.hpp"

namespace fit::explain::model {
namespace {

constexpr int sectors_of_scan = 8;

/// Variances of the range and the angle that some beams have in common, times their weights: every beam has
/// noise of its own (a "sandwich": White 1980). Where beams on one side are noisier both go together, but the
/// range does not where it is taken `aside` from the middle of the sensitivities.
struct OwnNoise {
  double of_range = 0, of_angle = 0;
  double aside_mm = 0;  ///< Of the sensitivity, mm per rad.

  OwnNoise() = default;
  OwnNoise(const Reduced& reduced, const Group& group, std::size_t first_cell, std::size_t last_cell) {
    double w = 0, wv = 0, wvv = 0, ww = 0, wwv = 0, wwvv = 0;
    for (std::size_t i = first_cell; i < last_cell; ++i) {
      const Cell& cell = reduced.cells[i];
      if (!reduction::is_informative(cell) || cell.n < 2) continue;
      const double q = reduction::weight_in_scan(reduced, group, i), v = cell.sight.stage_sensitivity(),
                   qq = q * q * cell.variance_mm2;
      w += q, wv += q * v, wvv += q * v * v;
      ww += qq, wwv += qq * v, wwvv += qq * v * v;
    }
    if (!(w > 0)) return;
    const double middle = wv / w, own = wvv - middle * wv, both = wwv - middle * ww,
                 about_middle = wwvv - 2 * middle * wwv + middle * middle * ww;
    of_range = std::max(rounding_mm2 / 4, ww / w);
    if (!(own > 1e-6 * wvv) || !(about_middle > 0)) return;
    aside_mm = both / about_middle * own / w;
    of_range = std::max(rounding_mm2 / 4, (ww - both * both / about_middle) / w);
    of_angle = std::max(rounding_mm2 / 4, about_middle / own);
  }
};

/// Which of so many parts of its scan a sector belongs to.
int part_of(const Sector& sector, int parts) { return sector.number * parts / sectors_of_scan; }

/// The cells of every part of the scans of a group: those that any of its scans sees.
std::map<std::pair<int, int>, std::pair<std::size_t, std::size_t>> cells_of_parts(const Reduced& reduced,
                                                                                  int parts) {
  std::map<std::pair<int, int>, std::pair<std::size_t, std::size_t>> cells;
  for (const Sector& s : reduced.sectors) {
    auto& [first, last] =
        cells.try_emplace({s.group, part_of(s, parts)}, s.first_cell, s.last_cell).first->second;
    first = std::min(first, s.first_cell);
    last = std::max(last, s.last_cell);
  }
  return cells;
}

constexpr std::size_t most_faces = 8;

/// Ways to number scans: in their capture, through the recording, and with the mirror through the time
/// between captures as well.
std::array<std::vector<std::int64_t>, 3> numbers_of(const std::vector<Sector>& sectors) {
  std::array<std::vector<std::int64_t>, 3> numbers;
  std::int64_t counted = -1;
  const Sector* last = nullptr;
  for (const Sector& s : sectors) {
    if (!last || last->group != s.group || last->seq != s.seq) ++counted;
    last = &s;
    numbers[0].push_back(s.seq);
    numbers[1].push_back(counted);
    numbers[2].push_back(s.turn);
  }
  return numbers;
}

/// How mirror faces repeat.
struct Faces {
  std::size_t number = 2;
  std::vector<std::int64_t> scan;  ///< Number of every sector's scan.
  double gain = -1e300;            ///< Of the log-likelihood.
};

/// The numbering and the number of faces by which ranges of scans differ most.
Faces faces_of(const Reduced& reduced) {
  Faces best;
  auto numberings = numbers_of(reduced.sectors);
  std::size_t chosen = 0;
  for (std::size_t way = 0; way < numberings.size(); ++way)
    for (std::size_t faces = 2; faces <= most_faces; ++faces) {
      std::array<double, most_faces> along{}, weight{};
      for (std::size_t i = 0; i < reduced.sectors.size(); ++i) {
        const Sector& s = reduced.sectors[i];
        const double sigma = reduced.group_of(s).sigma_mm, precision = 1 / (sigma * sigma + rounding_mm2);
        const auto face = static_cast<std::size_t>(numberings[way][i]) % faces;
        along[face] += s.wd * precision;
        weight[face] += s.w * precision;
      }
      double gain = -static_cast<double>(faces) / 2;
      for (std::size_t f = 0; f < faces; ++f)
        if (weight[f] > 0) gain += along[f] * along[f] / weight[f] / 2;
      if (gain <= best.gain) continue;
      best.number = faces;
      best.gain = gain;
      chosen = way;
    }
  best.scan = std::move(numberings[chosen]);
  return best;
}

/// As circumstances have it.
int number_of(std::int64_t scan) {
  constexpr std::int64_t any_number_of_faces = 27720;
  return static_cast<int>(scan % any_number_of_faces);
}

/// Takes off the range and the angle that all scans with the same key have in common, each of so many.
template <class Key>
void take_off_common(std::vector<ScanPart>& parts, double fewest, const Key& key) {
  struct Sums {
    RangeAndAngle common;
    double scans = 0;
  };
  const auto unit_of = [](const ScanPart& p) {
    return Eigen::Vector2d(p.of_angle ? 0 : 1, p.sensitivity_mm);
  };
  std::map<decltype(key(parts.front())), Sums> sums;
  for (const ScanPart& p : parts) {
    Sums& s = sums[key(p)];
    s.common.add(unit_of(p), p.rest_mm, 1 / p.variance_mm2);
    s.scans += p.of_angle ? 0 : 1;
  }
  for (ScanPart& p : parts) {
    const Sums& s = sums.at(key(p));
    if (s.scans < fewest) continue;
    p.rest_mm -= s.common.mm(unit_of(p));
    p.news *= s.common.share_left(unit_of(p), 1 / p.variance_mm2);
  }
}

/// What repeats is for terms to explain; the rest says what scans draw at random. Faces come first: a capture
/// that is the only one of its approach shows them as the others do.
void take_off_what_repeats(std::vector<ScanPart>& parts, const Faces& faces) {
  constexpr double captures = 2, turns = 4;
  take_off_common(parts, turns, [&](const ScanPart& p) {
    const int face = static_cast<int>(static_cast<std::size_t>(p.at.seq) % faces.number);
    const bool long_capture = p.scans >= 4 * static_cast<int>(faces.number);
    return std::pair(face, long_capture ? p.capture : -1);
  });
  take_off_common(parts, captures, [](const ScanPart& p) { return std::pair(p.in_capture, p.at.approach); });
}

/// Sums of the sectors of one part of one scan.
struct Part : WeightedSums {
  const Sector* first = nullptr;
  double since_move_s = 0;

  void add_sector(const Sector& s) {
    if (!first) first = &s;
    *this += s;
    since_move_s += s.w * s.since_move_s;
  }
};

}  // namespace

std::vector<ScanPart> scan_parts(const Reduced& reduced, int fewest_scans, int parts) {
  const Faces faces = faces_of(reduced);
  std::vector<ScanPart> list;
  std::map<std::tuple<int, int, bool>, int> blocks;
  const auto cells = cells_of_parts(reduced, parts);
  std::map<std::pair<int, int>, OwnNoise> noises;
  Part part;
  const auto close = [&] {
    if (!part.first || !(part.w > 0)) return;
    const Sector& s = *part.first;
    const Group& group = reduced.group_of(s);
    const int number = part_of(s, parts);
    const auto [known, is_first] = noises.try_emplace({s.group, number});
    OwnNoise& noise = known->second;
    if (is_first) {
      const auto& [first, last] = cells.at({s.group, number});
      noise = OwnNoise(reduced, group, first, last);
    }
    if (!(noise.of_range > 0)) return;
    ScanPart one;
    one.group = s.group;
    one.capture = group.capture;
    one.scans = group.scans;
    one.at.time_s = group.time_s;
    one.at.clock_s = group.clock_s;
    one.at.stage_rad = group.stage_rad;
    one.at.approach = s.approach;
    one.at.since_move_s = part.since_move_s / part.w;
    one.at.seq = number_of(faces.scan[static_cast<std::size_t>(part.first - reduced.sectors.data())]);
    one.in_capture = s.seq;
    const auto add = [&](bool of_angle, double sensitivity, double mm, double variance) {
      const auto [block, is_new] =
          blocks.try_emplace({s.group, number, of_angle}, static_cast<int>(blocks.size()));
      one.block = block->second;
      one.of_angle = of_angle;
      one.sensitivity_mm = sensitivity;
      one.mm = one.rest_mm = mm;
      one.news = 1 - 1.0 / group.scans;
      one.variance_mm2 = variance;
      list.push_back(one);
    };
    const double middle = part.wv / part.w, own = part.wvv - middle * part.wv;
    const bool has_angle = own > 1e-6 * part.wvv && noise.of_angle > 0;
    const double mm_per_rad = has_angle ? (part.wdv - middle * part.wd) / own : 0,
                 aside = has_angle ? noise.aside_mm : 0;
    add(false, middle - aside, part.wd / part.w - aside * mm_per_rad, noise.of_range / part.w);
    if (!has_angle) return;
    // In millimetres at the beams' typical sensitivity, so that both statistics have about the same noise.
    const double sensitivity = std::sqrt(own / part.w);
    add(true, sensitivity, mm_per_rad * sensitivity, noise.of_angle / part.w);
  };
  for (const Sector& s : reduced.sectors) {
    const Group& group = reduced.group_of(s);
    if (group.scans < fewest_scans) continue;
    const bool goes_on = part.first && part.first->group == s.group && part.first->seq == s.seq &&
                         part_of(*part.first, parts) == part_of(s, parts);
    if (!goes_on) {
      close();
      part = {};
    }
    part.add_sector(s);
  }
  close();
  take_off_what_repeats(list, faces);
  return list;
}

double ScatterOfScans::more_in_means(int scans) const { return 1 + share * added_to_mean(scans, rho); }

ScatterOfScans scatter_of_scans(const std::vector<ScanPart>& scans, bool of_angle) {
  constexpr int lags = 2;
  std::array<double, lags> products{}, pairs{}, before{};
  double squares = 0, count = 0, of_mean = 0, number = 0, variance = 0;
  int block = -1, in_block = 0;
  for (const ScanPart& p : scans) {
    if (p.of_angle != of_angle) continue;
    const double off = p.rest_mm / std::sqrt(p.variance_mm2);
    squares += off * off;
    count += p.news;
    of_mean += 1.0 / p.scans;
    variance += p.variance_mm2 / (of_angle ? p.sensitivity_mm * p.sensitivity_mm : 1);
    number += 1;
    in_block = p.block == block ? in_block + 1 : 0;
    block = p.block;
    for (std::size_t k = 0; k < static_cast<std::size_t>(std::min(lags, in_block)); ++k) {
      products[k] += off * before[k];
      pairs[k] += 1;
    }
    std::rotate(before.begin(), before.end() - 1, before.end());
    before.front() = off;
  }
  if (count < 1) return {};
  ScatterOfScans scatter;
  scatter.variance = variance / number;
  scatter.ratio = std::max(1.0, squares / count);
  if (pairs[1] < 1) return scatter;
  // Less the mean of their block, values are alike by less than they are: by the variance of that mean. Of
  // what is slower than a block little is left, and the correction for it is most of what is seen: whether
  // scans are alike at all is judged before it.
  constexpr int passes = 6;
  constexpr double slowest = 0.95;  // what is slower is a drift
  constexpr double certain = 3;     // standard errors
  const int in_a_block = static_cast<int>(std::lround(number / of_mean));
  double mean2 = squares / count * of_mean / number;
  const auto correlation = [&](std::size_t k) {
    return (products[k] / pairs[k] + mean2) / std::max(1e-9, squares / number + mean2);
  };
  const auto is_certain = [&](std::size_t k) { return correlation(k) > certain / std::sqrt(pairs[k]); };
  if (!is_certain(0)) return scatter;
  const bool is_correlated_longer = is_certain(1);
  for (int pass = 0; pass < passes; ++pass) {
    const double square = squares / number + mean2, next = correlation(0);
    scatter.ratio = std::max(1.0, square);
    scatter.rho = std::min(slowest, is_correlated_longer ? std::max(next, correlation(1) / next) : next);
    scatter.share = std::min(1.0, next / scatter.rho);
    mean2 = square * scatter.more_in_means(in_a_block) * of_mean / number;
  }
  return scatter;
}

std::vector<Sector> without_what_repeats(const Reduced& reduced, const std::vector<Active>& at_work) {
  const Faces faces = faces_of(reduced);
  std::vector<Sector> rest = reduced.sectors;
  for (std::size_t i = 0; i < rest.size() && !at_work.empty(); ++i) {
    Sector& s = rest[i];
    Circumstances at;
    at.seq = number_of(faces.scan[i]);
    at.approach = s.approach;
    at.since_move_s = s.since_move_s;
    const Effect effect = effect_of(at_work, at);
    s.take_off(effect.range_mm, effect.stage_rad);
  }
  const auto take_off = [&](double fewest, const auto& key) {
    struct Sums {
      double w = 0, wd = 0, number = 0;
    };
    std::map<decltype(key(std::size_t{0})), Sums> sums;
    for (std::size_t i = 0; i < rest.size(); ++i) {
      Sums& s = sums[key(i)];
      s.w += rest[i].w;
      s.wd += rest[i].wd;
      s.number += 1;
    }
    for (std::size_t i = 0; i < rest.size(); ++i) {
      const Sums& s = sums.at(key(i));
      if (s.number >= fewest && s.w > 0) rest[i].take_off(s.wd / s.w, 0);
    }
  };
  take_off(4 * sectors_of_scan, [&](std::size_t i) {
    return std::tuple(static_cast<std::size_t>(faces.scan[i]) % faces.number, 0, 0);
  });
  take_off(3, [&](std::size_t i) { return std::tuple(rest[i].seq, rest[i].number, rest[i].approach); });
  return rest;
}

namespace {

/// A scan of a group: its number, and when it was taken after the group's first.
struct ScanOfGroup {
  int number = 0;
  double after_first_s = 0;
};

std::vector<std::vector<ScanOfGroup>> scans_of_groups(const Reduced& reduced) {
  const Faces faces = faces_of(reduced);
  std::vector<std::vector<ScanOfGroup>> scans(reduced.groups.size());
  std::vector<const Sector*> first(reduced.groups.size());
  for (std::size_t i = 0; i < reduced.sectors.size(); ++i) {
    const Sector& s = reduced.sectors[i];
    const auto group = static_cast<std::size_t>(s.group);
    if (!first[group]) first[group] = &s;
    if (s.number == first[group]->number)
      scans[group].push_back({number_of(faces.scan[i]), s.since_move_s - first[group]->since_move_s});
  }
  return scans;
}

}  // namespace

void expect_from_scan_to_scan(Reduced& reduced, const std::vector<Active>& at_work) {
  for (Cell& cell : reduced.cells) cell.of_scans_mm = cell.of_scans_mm2 = 0;
  if (at_work.empty()) return;
  const auto scans = scans_of_groups(reduced);
  for (Cell& cell : reduced.cells) {
    const auto& of_group = scans[static_cast<std::size_t>(cell.group)];
    if (of_group.empty()) continue;
    double sum = 0, squares = 0;
    for (const ScanOfGroup& scan : of_group) {
      Circumstances at = cell.at;
      at.seq = scan.number;
      at.since_move_s += scan.after_first_s;
      const Effect effect = effect_of(at_work, at);
      const double mm = effect.range_mm + cell.sight.stage_sensitivity() * effect.stage_rad;
      sum += mm;
      squares += mm * mm;
    }
    const auto n = static_cast<double>(of_group.size());
    cell.of_scans_mm = sum / n;
    if (n > 1) cell.of_scans_mm2 = std::max(0.0, squares - sum * sum / n) / (n - 1);
  }
}

}  // namespace fit::explain::model
