// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/whole_scans.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "fit/explain/reduction/lag_products.hpp"
#include "fit/numeric/median.hpp"

namespace fit::explain::reduction {
namespace {

constexpr int sectors_per_scan = 8;

/// How much a beam counts in a scan, and its variance over the group's.
struct Weighed {
  double weight = 0, variance = 1;
};

/// What the beams of one scan have in common, as far as so many tell: a range, and an angle of the stage.
class Common {
 public:
  /// `noise`: covariance of the sums wd and wdv, over the group's variance.
  Common(const WeightedSums& whole, const Eigen::Matrix2d& noise) {
    const double det = whole.w * whole.wvv - whole.wv * whole.wv;
    if (whole.w > 8 && det > 1e-6 * whole.w * whole.wvv)
      solved_ << whole.wvv / det, -whole.wv / det, -whole.wv / det, whole.w / det;
    else if (whole.w > 3)
      solved_(0, 0) = 1 / whole.w;
    range_and_angle_ = solved_ * Eigen::Vector2d(whole.wd, whole.wdv);
    covariance_ = solved_ * noise * solved_;
  }
  [[nodiscard]] double mm(double sensitivity) const {
    return range_and_angle_.dot(Eigen::Vector2d(1, sensitivity));
  }
  /// Of a beam's variance, when the common part is taken off.
  [[nodiscard]] double share_left(const Weighed& beam, double sensitivity) const {
    const Eigen::Vector2d unit(1, sensitivity);
    return 1 - 2 * beam.weight * unit.dot(solved_ * unit) + unit.dot(covariance_ * unit) / beam.variance;
  }

 private:
  Eigen::Matrix2d solved_ = Eigen::Matrix2d::Zero();  ///< Range and angle of the sums wd and wdv.
  Eigen::Vector2d range_and_angle_;
  Eigen::Matrix2d covariance_;
};

/// One group's scans, one after the other.
class WholeScans {
 public:
  WholeScans(const Samples& samples, const std::vector<int>& cell_of_beam, Group& group, Reduced& session)
      : samples_(samples),
        cell_of_beam_(cell_of_beam),
        group_(group),
        session_(session),
        products_(static_cast<std::size_t>(samples.beams)),
        deviation_(static_cast<std::size_t>(samples.beams)),
        good_(static_cast<std::size_t>(samples.beams)),
        weighed_(static_cast<std::size_t>(samples.beams)) {
    for (std::size_t beam = 0; beam < weighed_.size(); ++beam) {
      if (cell_of_beam_[beam] < 0) continue;
      weighed_[beam].weight = weight_in_scan(session_, group_, static_cast<std::size_t>(cell_of_beam_[beam]));
      if (group_.scans >= weighted_from_scans)
        weighed_[beam].variance =
            std::max(rounding_mm2, cell_of(beam).variance_mm2) / (group_.sigma_mm * group_.sigma_mm);
    }
  }

  void add_scan(int scan) {
    constexpr double hardly_any = 0.1;  // is left of a beam's variance
    constexpr int fewest_echoes = 6;    // of fewer, the inverse of a sample variance has no variance
    const std::size_t first_sector = session_.sectors.size();
    // Common range and common angle of the scan are taken off before the autocorrelation of single beams is
    // judged.
    const Common common = sum_up(scan);
    std::size_t sector = first_sector;
    double squares = 0, count = 0;
    for (std::size_t beam = 0; beam < deviation_.size(); ++beam) {
      if (!good_[beam]) continue;
      const Cell& cell = cell_of(beam);
      const double sensitivity = cell.sight.stage_sensitivity(), weight = weighed_[beam].weight,
                   left = common.share_left(weighed_[beam], sensitivity);
      deviation_[beam] -= common.mm(sensitivity);
      const double square = deviation_[beam] * deviation_[beam];
      if (cell.n >= fewest_echoes) {
        squares += square / std::max(rounding_mm2, cell.variance_mm2);
        count += left;
      }
      if (session_.sectors[sector].number != sector_of(beam)) ++sector;
      session_.sectors[sector].wwdd += weight * weight * square / std::max(hardly_any, left);
      if (scan > 0) ++group_.pairs;
    }
    products_.add(deviation_, group_);
    add_neighbours();
    add_squares(squares - count, count);
  }

 private:
  [[nodiscard]] const Cell& cell_of(std::size_t beam) const {
    return session_.cells[static_cast<std::size_t>(cell_of_beam_[beam])];
  }

  void add_neighbours() {
    constexpr std::size_t aside = neighbours_aside;
    std::vector<double> sum(deviation_.size() + 1, 0.0);
    std::partial_sum(deviation_.begin(), deviation_.end(), sum.begin() + 1);
    for (std::size_t beam = 0; beam < deviation_.size(); ++beam) {
      if (!good_[beam]) continue;
      const double around = sum[std::min(deviation_.size(), beam + aside + 1)] -
                            sum[std::max(beam, aside) - aside] - deviation_[beam];
      Cell& cell = session_.cells[static_cast<std::size_t>(cell_of_beam_[beam])];
      cell.with_neighbours_mm2 += deviation_[beam] * around / std::max(1, cell.n - 1);
    }
  }

  /// How the sum of squares of so many degrees of freedom, less their number, goes on from that of the scan
  /// before.
  void add_squares(double more, double freedom) {
    constexpr double fewest = 1;  // two beams are no more than a range and an angle in common
    if (squares_before_ && freedom > fewest) {
      group_.square_steps += std::pow(more - *squares_before_, 2) / 2 / (2 * freedom);
      ++group_.steps;
    }
    squares_before_ = freedom > 0 ? std::optional(more) : std::nullopt;
  }

  /// Every beam's deviation from its cell's mean; the sectors of the scan with their sums.
  Common sum_up(int scan) {
    std::ranges::fill(deviation_, 0.0);
    std::ranges::fill(good_, 0);
    const std::size_t first_sector = session_.sectors.size();
    WeightedSums whole;
    Eigen::Matrix2d noise = Eigen::Matrix2d::Zero();
    for (int beam = 0; beam < samples_.beams; ++beam) {
      const auto b = static_cast<std::size_t>(beam);
      if (cell_of_beam_[b] < 0) continue;
      const Cell& cell = cell_of(b);
      const double range = samples_.at(scan, beam);
      if (!is_informative(cell) || !is_echo(range)) continue;
      const int number = sector_of(b);
      if (session_.sectors.size() == first_sector || session_.sectors.back().number != number)
        session_.sectors.push_back(empty_sector(scan, number, static_cast<std::size_t>(cell_of_beam_[b])));
      const double q = weighed_[b].weight, v = cell.sight.stage_sensitivity(), d = range - cell.mean_mm;
      session_.sectors.back().last_cell = static_cast<std::size_t>(cell_of_beam_[b]) + 1;
      session_.sectors.back().add(q, v, d);
      whole.add(q, v, d);
      const Eigen::Vector2d unit(1, v);
      noise += q * q * weighed_[b].variance * unit * unit.transpose();
      deviation_[b] = d;
      good_[b] = 1;
    }
    return {whole, noise};
  }

  [[nodiscard]] int sector_of(std::size_t beam) const { return static_cast<int>(beam) / beams_per_sector_; }

  [[nodiscard]] Sector empty_sector(int scan, int number, std::size_t first_cell) const {
    const auto s = static_cast<std::size_t>(scan);
    const auto middle = static_cast<std::size_t>(
        std::min(samples_.beams - 1, static_cast<int>((number + 0.5) * beams_per_sector_)));
    Sector sector;
    sector.group = static_cast<int>(session_.groups.size());
    sector.seq = static_cast<int>(samples_.seq[s]);
    sector.turn = samples_.turn[s];
    sector.number = number;
    sector.first_cell = sector.last_cell = first_cell;
    sector.since_move_s = samples_.since_start_s[s] + samples_.beam_s[middle];
    sector.approach = session_.capture_of(group_).approach;
    return sector;
  }

  const Samples& samples_;
  const std::vector<int>& cell_of_beam_;
  Group& group_;
  Reduced& session_;
  int beams_per_sector_ = std::max(1, (samples_.beams + sectors_per_scan - 1) / sectors_per_scan);
  LagProducts products_;
  std::vector<double> deviation_;  ///< Of every beam in the present scan, mm.
  std::vector<char> good_;         ///< Whether it has one.
  std::vector<Weighed> weighed_;   ///< Every beam, the same in all scans.
  std::optional<double> squares_before_;
};

}  // namespace

double weight_in_scan(const Reduced& reduced, const Group& group, std::size_t i) {
  constexpr std::size_t aside = 4;  // beams on either side
  constexpr double far_noisier = 4;
  if (group.scans < weighted_from_scans) return 1;
  // By its neighbours' variance: samples whose deviations happen to be small have a small one themselves, and
  // what scans have in common would shrink by 2 / n.
  const Cell& cell = reduced.cells[i];
  std::vector<double> variances;
  for (std::size_t k = std::max(group.first_cell + aside, i) - aside;
       k < std::min(group.last_cell, i + aside + 1); ++k) {
    const Cell& other = reduced.cells[k];
    if (k != i && is_informative(other) && other.at.target == cell.at.target)
      variances.push_back(other.variance_mm2);
  }
  double usual = group.sigma_mm * group.sigma_mm;
  if (!variances.empty()) usual = std::max(rounding_mm2, median_of(std::move(variances)));
  if (cell.variance_mm2 > far_noisier * usual) usual = cell.variance_mm2;
  return std::clamp(group.sigma_mm * group.sigma_mm / usual, 0.01, 4.0);
}

bool is_informative(const Cell& cell) {
  constexpr int hardly_any = 20;  // of so many samples one may be lost: else means are of other scans
  return cell.usable && cell.stray == 0 && hardly_any * cell.lost <= cell.n;
}

void summarise_scans(const Samples& samples, const std::vector<int>& cell_of_beam, Group& group,
                     Reduced& session) {
  WholeScans scans(samples, cell_of_beam, group, session);
  for (int scan = 0; scan < samples.scans; ++scan) scans.add_scan(scan);
  for (std::size_t i = group.first_cell; i < group.last_cell; ++i)
    if (is_informative(session.cells[i])) ++group.cells;
}

}  // namespace fit::explain::reduction
