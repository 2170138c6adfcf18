// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <span>
#include <utility>

#include "fit/echo.hpp"
#include "fit/explain/reduction/left_out.hpp"
#include "fit/explain/reduction/margins.hpp"
#include "fit/numeric/median.hpp"

namespace fit::explain::reduction {
namespace {

constexpr double most = 0.9;  // of the beams
constexpr double step_rad = 0.5 * rad_per_deg;
constexpr double usual_mm = 60;

/// What a beam may be off at most by what the bench file leaves open.
double allowed_mm(const Bench& bench, const Sight& sight) {
  return usual_mm + coverage_of_mount * misplaced_mm(bench, sight);
}

/// The beams of a capture that should meet a target and are about as far from it as they measure; none of too
/// few.
std::optional<double> share_that_fits(const Reduced& reduced, const Group& group) {
  double all = 0, fits = 0;
  for (const Cell& cell : reduced.cells_of(group)) {
    if (cell.n + cell.lost == 0) continue;
    ++all;
    fits += cell.n > 0 && std::abs(cell.off_mm()) < allowed_mm(reduced.bench, cell.sight);
  }
  constexpr double enough = 20;
  if (all < enough) return {};
  return fits / all;
}

/// What one beam measured, on median; 0: mostly no echo.
struct Look {
  double beam_rad = 0, range_mm = 0;
};

/// All around, of the first scans of a capture.
std::vector<Look> looks_of(const Recording& recording, std::size_t index) {
  constexpr std::size_t enough_scans = 9, enough_beams = 250;
  const CaptureInfo& capture = recording.captures()[index];
  std::vector<std::vector<double>> ranges;
  std::vector<Look> looks;
  recording.for_each_scan(index, [&](const ScanView& scan) {
    if (ranges.size() * scan.range_mm.size() == 0) {
      const BeamAngles angles(recording.bench().lidar, capture, scan.geometry);
      for (std::size_t k = 0; k < scan.range_mm.size(); ++k) looks.push_back({angles.at_rad(k), 0});
      ranges.resize(looks.size());
    }
    for (std::size_t k = 0; k < std::min(ranges.size(), scan.range_mm.size()); ++k)
      if (ranges[k].size() < enough_scans)
        ranges[k].push_back(scan.range_mm[k] < first_error_code_mm ? scan.range_mm[k] : 0);
  });
  std::vector<Look> some;
  for (std::size_t k = 0; k < looks.size(); k += looks.size() / enough_beams + 1)
    some.push_back({looks[k].beam_rad, median_of(std::span(ranges[k]))});
  return some;
}

/// A stop's beams against the bench file's targets.
class Stop {
 public:
  Stop(const Reduced& reduced, const Group& group, std::vector<Look> looks)
      : reduced_(reduced), group_(group), as_stated_(reduced.bench), looks_(std::move(looks)) {}

  /// Where it fits best, if most beams do and better than as stated: where other captures were taken, or
  /// anywhere on the stage.
  [[nodiscard]] std::optional<MisplacedCapture> elsewhere(const std::set<double>& stages_rad,
                                                          const std::set<double>& shifts_mm) const {
    const double shift_mm = reduced_.capture_of(group_).target_shift_mm;
    const Fit stated = fit_at(group_.stage_rad, shift_mm);
    MisplacedCapture best{group_.capture, group_.stage_rad, shift_mm};
    Fit best_fit = stated;
    const auto look = [&](double stage_rad, double target_shift_mm) {
      constexpr int enough = 20;
      const Fit there = fit_at(stage_rad, target_shift_mm);
      if (there.beams < enough || 2 * there.beams < stated.beams || there.misfit >= best_fit.misfit) return;
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
    if (best_fit.share < most || best_fit.misfit > stated.misfit / 2) return {};
    return best;
  }

 private:
  /// How its beams fit what they would meet from somewhere.
  struct Fit {
    int beams = 0;      ///< That would meet a target.
    double share = 0;   ///< Of these, those that are about as far away as they measure.
    double misfit = 1;  ///< On average, of what is allowed at most.
  };
  [[nodiscard]] Fit fit_at(double stage_rad, double target_shift_mm) const {
    CaptureInfo there = reduced_.capture_of(group_);
    there.target_shift_mm = target_shift_mm;
    const Scene scene(reduced_.bench, as_stated_, there,
                      reduced_.absent[static_cast<std::size_t>(group_.capture)]);
    Fit fit;
    double off = 0, fits = 0;
    for (const Look& look : looks_) {
      const Sight sight = scene.look(stage_rad, look.beam_rad);
      if (sight.target < 0) continue;
      ++fit.beams;
      const double share = look.range_mm > 0
                               ? std::abs(look.range_mm - sight.range_mm) / allowed_mm(reduced_.bench, sight)
                               : 1;
      off += std::min(1.0, share);
      fits += share < 1;
    }
    if (fit.beams == 0) return fit;
    fit.share = fits / fit.beams;
    fit.misfit = off / fit.beams;
    return fit;
  }

  const Reduced& reduced_;
  const Group& group_;
  Nuisance as_stated_;
  std::vector<Look> looks_;
};

/// The recording of a capture that is counted through all of them, and its index there.
std::pair<const Recording*, std::size_t> recording_of(const std::vector<const Recording*>& recordings,
                                                      std::size_t capture) {
  for (const Recording* one : recordings) {
    if (capture < one->captures().size()) return {one, capture};
    capture -= one->captures().size();
  }
  return {recordings.back(), recordings.back()->captures().size() - 1};
}

/// Several captures that are off by the same angle were not mistyped: the stage slipped, and physics says so.
void leave_slips(const Reduced& reduced, std::vector<MisplacedCapture>& misplaced) {
  constexpr std::ptrdiff_t several = 3;
  const auto off_rad = [&](const MisplacedCapture& one) {
    return wrap_angle(one.stage_rad - reduced.captures[static_cast<std::size_t>(one.capture)].stage_rad);
  };
  const std::vector<MisplacedCapture> all = misplaced;
  std::erase_if(misplaced, [&](const MisplacedCapture& one) {
    return off_rad(one) != 0 && std::ranges::count_if(all, [&](const MisplacedCapture& other) {
                                  return std::abs(wrap_angle(off_rad(one) - off_rad(other))) < 2.5 * step_rad;
                                }) >= several;
  });
}

}  // namespace

std::vector<MisplacedCapture> misplaced_captures(const Reduced& reduced,
                                                 const std::vector<const Recording*>& recordings) {
  constexpr std::size_t most_asked = 100;  // computing time
  std::vector<double> shares;
  std::vector<const Group*> do_not_fit;
  std::set<double> stages_rad, shifts_mm;
  int before = -1;
  for (const Group& group : reduced.groups) {
    const CaptureInfo& capture = reduced.capture_of(group);
    stages_rad.insert(group.stage_rad);
    shifts_mm.insert(capture.target_shift_mm);
    if (group.capture == before || is_turning(capture)) continue;
    before = group.capture;
    const auto share = share_that_fits(reduced, group);
    if (!share) continue;
    shares.push_back(*share);
    if (*share < most && do_not_fit.size() < most_asked) do_not_fit.push_back(&group);
  }
  std::vector<MisplacedCapture> misplaced;
  if (shares.empty() || median_of(shares) < most) return misplaced;
  for (const Group* group : do_not_fit) {
    const auto [recording, index] = recording_of(recordings, static_cast<std::size_t>(group->capture));
    const Stop stop(reduced, *group, looks_of(*recording, index));
    if (const auto found = stop.elsewhere(stages_rad, shifts_mm)) misplaced.push_back(*found);
  }
  leave_slips(reduced, misplaced);
  return misplaced;
}

}  // namespace fit::explain::reduction
