// SPDX-License-Identifier: MIT
#include "fit/explain/model/neighbours.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <span>
#include <tuple>
#include <utility>

#include "fit/explain/model/range_and_angle.hpp"
#include "fit/numeric/median.hpp"

namespace fit::explain::model {
namespace {

constexpr int most_sectors = 8;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, most_sectors, most_sectors>;
using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, most_sectors, 1>;

/// Variance of a sector's weighted sum over its weight, were beams independent, mm^2.
using NoiseOfSectors = std::map<std::pair<int, int>, double>;

NoiseOfSectors noise_of_sectors(const std::vector<Sector>& sectors) {
  std::map<std::pair<int, int>, std::pair<double, double>> sums;  // of group and number
  for (const Sector& s : sectors) {
    auto& [square, weight] = sums[{s.group, s.number}];
    square += s.wwdd;
    weight += s.w;
  }
  NoiseOfSectors noise;
  for (const auto& [key, sum] : sums)
    if (sum.second > 0) noise[key] = sum.first / sum.second;
  return noise;
}

/// The sectors of one scan less the range and angle they have in common, by weighted least squares.
struct ScanLeft {
  Vector rest_mm;
  double expected_mm2 = 0, freedom = 0;

  ScanLeft(std::span<const Sector> sectors, const NoiseOfSectors& noise) {
    const auto count = static_cast<Eigen::Index>(sectors.size());
    Eigen::Matrix<double, Eigen::Dynamic, 2, 0, most_sectors, 2> common(count, 2);
    Vector seen(count), own(count), root(count);
    for (Eigen::Index i = 0; i < count; ++i) {
      const Sector& s = sectors[static_cast<std::size_t>(i)];
      root[i] = std::sqrt(s.w);
      common.row(i) << root[i], s.wv / root[i];
      seen[i] = s.wd / root[i];
      own[i] = noise.at({s.group, s.number});
    }
    const Matrix rest = Matrix::Identity(count, count) -
                        common * covariance_of(common.transpose() * common) * common.transpose();
    rest_mm = (rest * seen).cwiseQuotient(root);
    expected_mm2 = rest.diagonal().dot(own);
    freedom = expected_mm2 * expected_mm2 / own.dot(rest.cwiseAbs2() * own);  // Satterthwaite (1946)
  }
};

/// What a sector shows at the same number of the scan in all captures: a range, and an angle of the stage.
struct Repeats {
  RangeAndAngle common;
  int captures = 0;

  static Eigen::Vector2d per_unit(const Sector& s) { return {1, s.wv / s.w}; }
  void add(const Sector& s, double mm) {
    common.add(per_unit(s), mm, s.w);
    ++captures;
  }
  [[nodiscard]] bool is_known() const { return captures >= 4; }
  [[nodiscard]] double mm(const Sector& s) const { return common.mm(per_unit(s)); }
  /// Of the sector's variance, when it is taken off.
  [[nodiscard]] double share_left(const Sector& s) const { return common.share_left(per_unit(s), s.w); }
};

/// The mean of a ratio, unless it may be 1 by chance.
double if_certain(double ratio, double freedom) {
  return freedom > 0 && ratio > 1 + 3 * std::sqrt(2 / freedom) ? ratio : 1;
}

}  // namespace

std::vector<SectorScatter> sector_scatter(const Reduced& reduced, int fewest_scans) {
  constexpr std::size_t fewest_sectors = 4;  // two of which are the scan's own range and angle
  const std::vector<Sector>& sectors = reduced.sectors;
  const NoiseOfSectors noise = noise_of_sectors(sectors);
  struct Scan {
    std::span<const Sector> sectors;
    ScanLeft left;
  };
  std::vector<Scan> scans;
  std::map<std::tuple<int, int, int>, Repeats> repeats;
  const auto key_of = [](const Sector& s) { return std::tuple(s.seq, s.number, s.approach); };
  for (std::size_t first = 0, last = 0; first < sectors.size(); first = last) {
    const Sector& s = sectors[first];
    while (last < sectors.size() && sectors[last].group == s.group && sectors[last].seq == s.seq) ++last;
    if (reduced.group_of(s).scans < fewest_scans || last - first < fewest_sectors) continue;
    const std::span<const Sector> of_scan(&s, last - first);
    Scan scan{of_scan, ScanLeft(of_scan, noise)};
    if (!(scan.left.freedom > 1)) continue;
    for (std::size_t i = 0; i < of_scan.size(); ++i)
      repeats[key_of(of_scan[i])].add(of_scan[i], scan.left.rest_mm[static_cast<Eigen::Index>(i)]);
    scans.push_back(std::move(scan));
  }
  std::map<int, SectorScatter> by_capture;
  std::map<int, int> scans_of;
  for (const Scan& scan : scans) {
    const Sector& s = scan.sectors.front();
    const Group& group = reduced.group_of(s);
    SectorScatter& sum = by_capture[group.capture];
    if (sum.n == 0) {
      sum.capture = group.capture;
      sum.at.time_s = group.time_s;
      sum.at.clock_s = group.clock_s;
      sum.at.stage_rad = group.stage_rad;
      sum.at.approach = s.approach;
      sum.at.since_move_s = s.since_move_s;
    }
    double share = 0;
    for (std::size_t i = 0; i < scan.sectors.size(); ++i) {
      const Sector& one = scan.sectors[i];
      const Repeats& again = repeats.at(key_of(one));
      const double mm =
          scan.left.rest_mm[static_cast<Eigen::Index>(i)] - (again.is_known() ? again.mm(one) : 0);
      sum.square_mm2 += one.w * mm * mm;
      share += (again.is_known() ? again.share_left(one) : 1) / static_cast<double>(scan.sectors.size());
    }
    sum.expected_mm2 += share * scan.left.expected_mm2;
    sum.n += share * (1 - 1.0 / group.scans) * scan.left.freedom;
    ++scans_of[group.capture];
  }
  std::vector<SectorScatter> list;
  for (auto& [capture, sum] : by_capture) {
    if (!(sum.expected_mm2 > 0)) continue;
    sum.square_mm2 /= scans_of.at(capture);
    sum.expected_mm2 /= scans_of.at(capture);
    list.push_back(sum);
  }
  return list;
}

double inflation_of_sums(const Reduced& reduced) {
  double ratio = 0, n = 0;
  for (const SectorScatter& s : sector_scatter(reduced, 3)) {
    ratio += s.n * s.square_mm2 / s.expected_mm2;
    n += s.n;
  }
  return if_certain(ratio / std::max(1.0, n), n);
}

std::vector<double> inflation_of_targets(const Reduced& reduced) {
  struct Sum {
    double shared = 0, own = 0, samples = 0;
  };
  std::vector<Sum> sums(reduced.bench.targets.size());
  for (const Cell& cell : reduced.cells) {
    if (!cell.usable || cell.n < 3 || cell.sight.target < 0) continue;
    Sum& sum = sums[static_cast<std::size_t>(cell.sight.target)];
    sum.shared += cell.with_neighbours_mm2;
    sum.own += cell.variance_mm2;
    sum.samples += cell.n - 1;
  }
  std::vector<double> list;
  for (const Sum& sum : sums)  // a sum over 2 k beams scatters as much as 2 k products
    list.push_back(sum.own > 0 ? if_certain(1 + sum.shared / sum.own, sum.samples / neighbours_aside) : 1);
  return list;
}

double inflation_of_squares(const Reduced& reduced) {
  double ratio = 0, n = 0;
  for (const Group& group : reduced.groups) {
    ratio += group.square_steps;
    n += group.steps;
  }
  constexpr double independent = 2.0 / 3;  // of successive differences (von Neumann 1941)
  return if_certain(ratio / std::max(1.0, n), independent * n);
}

double inflation_of_variances(const Reduced& reduced, double worth) {
  constexpr int handful = 20;  // more show their tails, and what every beam has of its own besides
  double differences = 0, squares = 0, inverse_freedom = 0, fourth_powers = 0;
  for (const Group& group : reduced.groups)
    for (std::size_t i = group.first_cell + 1; i < group.last_cell; ++i) {
      const Cell &before = reduced.cells[i - 1], &cell = reduced.cells[i];
      if (!before.usable || !cell.usable || std::min(before.n, cell.n) < 3 ||
          std::max(before.n, cell.n) > handful || before.at.target != cell.at.target)
        continue;
      const double square = std::pow((before.variance_mm2 + cell.variance_mm2) / 2, 2);
      differences += std::pow(before.variance_mm2 - cell.variance_mm2, 2);
      squares += square;
      inverse_freedom += square * (1 / (before.n - 1.0) + 1 / (cell.n - 1.0)) / 2 / worth;
      fourth_powers += square * square;
    }
  if (!(squares > 0)) return 1;
  // Of two variances v (1 + e), e^2 = s 2/f: differences are 4 s/f v^2, and squares of means (1 + s/f) v^2.
  const double ratio = differences / squares, scatter = ratio / std::max(1.0, 4 - ratio);
  constexpr double independent = 2.0 / 3;
  const double pairs = squares * squares / fourth_powers;  // the noisiest cells weigh the most
  return if_certain(scatter * squares / inverse_freedom, independent * pairs);
}

namespace {

/// By how much a beam's variance lies above its two neighbours', as a share of all three, over the captures.
struct OwnShare {
  double sum = 0, square = 0;
  int captures = 0;

  void add(double share) {
    sum += share;
    square += share * share;
    ++captures;
  }
  [[nodiscard]] double mean() const { return sum / captures; }
  /// Variance of that mean, by how captures differ.
  [[nodiscard]] double chance() const {
    return std::max(0.0, square - sum * mean()) / (captures - 1) / captures;
  }
};

std::map<double, OwnShare> own_shares(const Reduced& reduced) {
  constexpr int fewest_samples = 5;
  std::map<double, OwnShare> shares;  // by beam angle
  for (const Group& group : reduced.groups)
    for (std::size_t i = group.first_cell + 1; i + 1 < group.last_cell; ++i) {
      const Cell &before = reduced.cells[i - 1], &cell = reduced.cells[i], &after = reduced.cells[i + 1];
      const auto counts = [&](const Cell& one) {
        return one.usable && one.n >= fewest_samples && one.at.target == cell.at.target;
      };
      if (!counts(before) || !counts(cell) || !counts(after)) continue;
      const double beside = (before.variance_mm2 + after.variance_mm2) / 2,
                   level = (2 * beside + cell.variance_mm2) / 3;
      if (level > 0) shares[cell.beam_rad].add((cell.variance_mm2 - beside) / level);
    }
  std::erase_if(shares, [](const auto& one) { return one.second.captures < 2; });
  return shares;
}

}  // namespace

NoiseOfBeams noise_of_beams(const Reduced& reduced) {
  constexpr std::size_t fewest_beams = 30;
  constexpr double of_difference = 1.5,  // a beam's own against the mean of two others
      of_median = 1.4826,                // a normal deviation's absolute value
      // Squared relative standard error of the variance from one beam: by a median it is 2.72 times that by a
      // mean, and neighbours share terms.
      of_one = 2 * 2.72 * of_difference;
  const std::map<double, OwnShare> shares = own_shares(reduced);
  if (shares.size() < fewest_beams) return {};
  std::vector<double> sizes;
  double chance = 0, captures = 0;
  for (const auto& [beam_rad, share] : shares) {
    sizes.push_back(std::abs(share.mean()));
    chance += share.chance();
    captures += share.captures;
  }
  const auto beams = static_cast<double>(shares.size());
  const double seen = std::pow(of_median * median_of(std::move(sizes)), 2), own = seen - chance / beams;
  if (own < 3 * seen * std::sqrt(of_one / beams)) return {};
  return {own / of_difference, captures / beams};
}

}  // namespace fit::explain::model
