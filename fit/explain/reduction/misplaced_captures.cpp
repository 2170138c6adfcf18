// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/misplaced_captures.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

#include "fit/explain/reduction/margins.hpp"
#include "fit/median.hpp"

namespace fit::explain::reduction {
namespace {

constexpr double few = 0.5, most = 0.9;  // of the beams
constexpr double step_rad = 0.5 * rad_per_deg;

/// A stop's cells against the bench file's targets.
class Stop {
 public:
  Stop(const Reduced& reduced, const Group& group)
      : reduced_(reduced), group_(group), as_stated_(reduced.bench) {
    constexpr std::size_t enough = 150;
    const std::size_t every = (group.last_cell - group.first_cell) / enough + 1;
    for (std::size_t i = group.first_cell; i < group.last_cell; i += every)
      if (reduced.cells[i].n > 0) cells_.push_back(&reduced.cells[i]);
  }
  [[nodiscard]] bool says_enough() const { return std::ssize(cells_) >= 20; }
  /// The share of beams that meet something about as far away as they measure.
  [[nodiscard]] double share_that_fits(double stage_rad, double target_shift_mm) const {
    CaptureInfo there = reduced_.capture_of(group_);
    there.target_shift_mm = target_shift_mm;
    const Scene scene(reduced_.bench, as_stated_, there,
                      reduced_.absent[static_cast<std::size_t>(group_.capture)]);
    const auto fits = [&](const Cell* cell) {
      constexpr double usual_mm = 60, uncertainties = 3;
      const Sight sight = scene.look(stage_rad, cell->beam_rad);
      return sight.target >= 0 && std::abs(cell->mean_mm - sight.range_mm) <
                                      usual_mm + uncertainties * misplaced_mm(reduced_.bench, sight);
    };
    return static_cast<double>(std::ranges::count_if(cells_, fits)) / static_cast<double>(cells_.size());
  }
  [[nodiscard]] double share_that_fits() const {
    return share_that_fits(group_.stage_rad, reduced_.capture_of(group_).target_shift_mm);
  }
  /// Where most beams fit, if there is such a place.
  [[nodiscard]] std::optional<MisplacedCapture> elsewhere(const std::set<double>& shifts_mm) const {
    const double shift_mm = reduced_.capture_of(group_).target_shift_mm;
    MisplacedCapture best{group_.capture, group_.stage_rad, shift_mm};
    double share = 0;
    const auto look = [&](double stage_rad, double target_shift_mm) {
      const double fits = share_that_fits(stage_rad, target_shift_mm);
      if (fits <= share) return;
      share = fits;
      best = {group_.capture, stage_rad, target_shift_mm};
    };
    for (const double other_mm : shifts_mm) look(group_.stage_rad, other_mm);
    for (double by_rad = 0; by_rad < 2 * pi; by_rad += step_rad)
      look(wrap_angle(group_.stage_rad + by_rad), shift_mm);
    if (share < most) return {};
    return best;
  }

 private:
  const Reduced& reduced_;
  const Group& group_;
  Nuisance as_stated_;
  std::vector<const Cell*> cells_;
};

}  // namespace

std::vector<MisplacedCapture> misplaced_captures(const Reduced& reduced) {
  std::vector<double> shares;
  std::vector<Stop> do_not_fit;
  std::set<double> shifts_mm;
  int before = -1;
  for (const Group& group : reduced.groups) {
    const CaptureInfo& capture = reduced.capture_of(group);
    shifts_mm.insert(capture.target_shift_mm);
    if (group.capture == before || is_turning(capture)) continue;
    before = group.capture;
    const Stop stop(reduced, group);
    if (!stop.says_enough()) continue;
    shares.push_back(stop.share_that_fits());
    if (shares.back() < few) do_not_fit.push_back(stop);
  }
  std::vector<MisplacedCapture> misplaced;
  if (shares.empty() || median_of(shares) < most) return misplaced;
  for (const Stop& stop : do_not_fit)
    if (const auto found = stop.elsewhere(shifts_mm)) misplaced.push_back(*found);
  return misplaced;
}

}  // namespace fit::explain::reduction
