// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/whole_scans.hpp"

#include <algorithm>
#include <cmath>

#include "fit/explain/reduction/lag_products.hpp"

namespace fit::explain::reduction {
namespace {

constexpr int sectors_per_scan = 8;

/// The beam deviates by d (mm) and counts so much.
void add_beam(Sector& sums, double weight, double lever, double d) {
  sums.w += weight;
  sums.wv += weight * lever;
  sums.wvv += weight * lever * lever;
  sums.wd += weight * d;
  sums.wdv += weight * d * lever;
}

/// What the beams of one scan have in common: a range, and an angle of the stage.
struct Common {
  double range_mm = 0, angle_rad = 0;
};

Common common_of(const Sector& whole) {
  const double det = whole.w * whole.wvv - whole.wv * whole.wv;
  if (whole.w > 8 && det > 1e-6 * whole.w * whole.wvv) {
    const double angle = (whole.w * whole.wdv - whole.wv * whole.wd) / det;
    return {(whole.wd - angle * whole.wv) / whole.w, angle};
  }
  return {whole.w > 3 ? whole.wd / whole.w : 0, 0};
}

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
        good_(static_cast<std::size_t>(samples.beams)) {}

  void add_scan(int scan) {
    const Sector whole = sum_up(scan);
    // Common range and common angle of the scan are taken off before the memory of single beams is judged.
    const auto [range_mm, angle_rad] = common_of(whole);
    for (std::size_t beam = 0; beam < deviation_.size(); ++beam) {
      if (!good_[beam]) continue;
      deviation_[beam] -= range_mm + angle_rad * cell_of(beam).sight.stage_lever();
      if (scan > 0) ++group_.pairs;
    }
    products_.add(deviation_, group_);
  }

 private:
  [[nodiscard]] const Cell& cell_of(std::size_t beam) const {
    return session_.cells[static_cast<std::size_t>(cell_of_beam_[beam])];
  }

  /// Every beam's deviation from its cell's mean; the sectors of the scan with their sums, and those of the
  /// whole scan.
  Sector sum_up(int scan) {
    std::ranges::fill(deviation_, 0.0);
    std::ranges::fill(good_, 0);
    const int width = std::max(1, (samples_.beams + sectors_per_scan - 1) / sectors_per_scan);
    const std::size_t first_sector = session_.sectors.size();
    Sector whole;
    for (int beam = 0; beam < samples_.beams; ++beam) {
      const auto b = static_cast<std::size_t>(beam);
      if (cell_of_beam_[b] < 0) continue;
      const Cell& cell = cell_of(b);
      const double range = samples_.at(scan, beam);
      if (!is_informative(cell) || !is_echo(range)) continue;
      const int number = beam / width;
      if (session_.sectors.size() == first_sector || session_.sectors.back().number != number)
        session_.sectors.push_back(
            empty_sector(scan, number, width, static_cast<std::size_t>(cell_of_beam_[b])));
      const double q = weight_in_scan(cell, group_, samples_.scans), v = cell.sight.stage_lever(),
                   d = range - cell.mean_mm;
      session_.sectors.back().last_cell = static_cast<std::size_t>(cell_of_beam_[b]) + 1;
      add_beam(session_.sectors.back(), q, v, d);
      add_beam(whole, q, v, d);
      deviation_[b] = d;
      good_[b] = 1;
    }
    return whole;
  }

  [[nodiscard]] Sector empty_sector(int scan, int number, int width, std::size_t first_cell) const {
    const auto s = static_cast<std::size_t>(scan);
    const auto middle =
        static_cast<std::size_t>(std::min(samples_.beams - 1, static_cast<int>((number + 0.5) * width)));
    Sector sector;
    sector.group = static_cast<int>(session_.groups.size());
    sector.seq = static_cast<int>(samples_.seq[s]);
    sector.turn = samples_.turn[s];
    sector.number = number;
    sector.first_cell = sector.last_cell = first_cell;
    sector.since_move_s = samples_.since_start_s[s] + samples_.beam_s[middle];
    sector.approach = session_.captures[static_cast<std::size_t>(group_.capture)].approach;
    return sector;
  }

  const Samples& samples_;
  const std::vector<int>& cell_of_beam_;
  Group& group_;
  Reduced& session_;
  LagProducts products_;
  std::vector<double> deviation_;  ///< Of every beam in the present scan, mm.
  std::vector<char> good_;         ///< Whether it has one.
};

}  // namespace

double weight_in_scan(const Cell& cell, const Group& group, int scans) {
  if (scans < weighted_from_scans) return 1;
  return std::clamp(group.sigma_mm * group.sigma_mm / std::max(rounding_mm2, cell.variance_mm2), 0.01, 4.0);
}

bool is_informative(const Cell& cell) { return cell.smooth && cell.stray == 0; }

void summarise_scans(const Samples& samples, const std::vector<int>& cell_of_beam, Group& group,
                     Reduced& session) {
  WholeScans scans(samples, cell_of_beam, group, session);
  for (int scan = 0; scan < samples.scans; ++scan) scans.add_scan(scan);
  for (std::size_t i = group.first_cell; i < group.last_cell; ++i)
    if (is_informative(session.cells[i])) ++group.cells;
}

}  // namespace fit::explain::reduction
