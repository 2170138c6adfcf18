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
  /// How its beams fit what they would meet from there.
  struct Fit {
    double share = 0;   ///< Of those that are about as far away as they measure.
    double misfit = 0;  ///< On average, of what is allowed at most.
  };
  [[nodiscard]] Fit fit_at(double stage_rad, double target_shift_mm) const {
    constexpr double usual_mm = 60;
    CaptureInfo there = reduced_.capture_of(group_);
    there.target_shift_mm = target_shift_mm;
    const Scene scene(reduced_.bench, as_stated_, there,
                      reduced_.absent[static_cast<std::size_t>(group_.capture)]);
    Fit fit;
    const double each = 1 / static_cast<double>(cells_.size());
    for (const Cell* cell : cells_) {
      const Sight sight = scene.look(stage_rad, cell->beam_rad);
      const double off = sight.target < 0
                             ? 1
                             : std::abs(cell->mean_mm - sight.range_mm) /
                                   (usual_mm + doubt_of_mount * misplaced_mm(reduced_.bench, sight));
      fit.misfit += each * std::min(1.0, off);
      if (off < 1) fit.share += each;
    }
    return fit;
  }
  [[nodiscard]] double share_that_fits() const {
    return fit_at(group_.stage_rad, reduced_.capture_of(group_).target_shift_mm).share;
  }
  /// Where it fits best, if most beams do: where other captures were taken, or anywhere on the stage.
  [[nodiscard]] std::optional<MisplacedCapture> elsewhere(const std::set<double>& stages_rad,
                                                          const std::set<double>& shifts_mm) const {
    const double shift_mm = reduced_.capture_of(group_).target_shift_mm;
    MisplacedCapture best{group_.capture, group_.stage_rad, shift_mm};
    Fit best_fit{0, 1};
    const auto look = [&](double stage_rad, double target_shift_mm) {
      const Fit there = fit_at(stage_rad, target_shift_mm);
      if (there.misfit >= best_fit.misfit) return;
      best_fit = there;
      best = {group_.capture, stage_rad, target_shift_mm};
    };
    for (const double other_mm : shifts_mm) look(group_.stage_rad, other_mm);
    for (double by_rad = 0; by_rad < 2 * pi; by_rad += step_rad)
      look(wrap_angle(group_.stage_rad + by_rad), shift_mm);
    // As near the angle of another capture as steps and mount leave open, it is that.
    const double open_rad = 1.5 * step_rad + 3 * reduced_.bench.lidar.mount.yaw_rad.u;
    for (const double other_rad : stages_rad)
      if (std::abs(wrap_angle(other_rad - best.stage_rad)) < open_rad) best.stage_rad = other_rad;
    if (best_fit.share < most) return {};
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
  std::set<double> stages_rad, shifts_mm;
  int before = -1;
  for (const Group& group : reduced.groups) {
    const CaptureInfo& capture = reduced.capture_of(group);
    stages_rad.insert(group.stage_rad);
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
    if (const auto found = stop.elsewhere(stages_rad, shifts_mm)) misplaced.push_back(*found);
  return misplaced;
}

}  // namespace fit::explain::reduction
