// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <functional>
#include <limits>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "fit/explain/reduction/lag_bands.hpp"
#include "fit/explain/reduction/output_steps.hpp"
#include "fit/explain/scene/scene.hpp"

namespace fit::explain {

/// Statistics of one beam in one group of scans: what remains of the samples.
constexpr int neighbours_aside = 16;

struct Cell {
  int group = 0;
  double beam_rad = 0;
  int n = 0;                ///< Samples that belong to the target.
  int lost = 0;             ///< Samples without echo.
  int stray = 0;            ///< Samples far from all others.
  int far = 0;              ///< Of these, samples too far for any noise.
  int late = 0, early = 0;  ///< Of those, samples close beyond, and before, all others.
  int edge = -1;            ///< The edge within reach: 2 * target + (0: its start, 1: its end); -1: none.
  double mean_mm = 0, variance_mm2 = 0;
  double kurtosis = 3;      ///< Of the samples' distribution, 3 if it is normal; unknown of too few.
  double skewness = 0;      ///< The same, 0 if it is symmetric.
  double intensity_sd = 0;  ///< Standard deviation of one sample's intensity, counts.
  /// Mean intensity of its own samples; at.intensity is steadied by its neighbours'
  /// (reduction/steady_echoes.hpp). NaN: not known.
  double counts = std::numeric_limits<double>::quiet_NaN();
  double far_share =
      -1;               ///< Mean place between the two surfaces of a near edge (0 near, 1 far); -1: no edge.
  double other_mm = 0;  ///< Range of the plane on the other side of that edge, along this very beam.
  double misplaced_mm = 0;       ///< Standard uncertainty of both ranges there, by the bench file.
  int between = 0;               ///< Samples on neither of them.
  int beside = 0;                ///< Of its samples, those in Reduced::beside, ...
  std::size_t first_beside = 0;  ///< ... from there on.
  /// Standard uncertainty of the mean beyond its samples' noise: part of the beam may miss its surface.
  double u_edge_mm = 0;
  double mixed_mm =
      0;  ///< The same, of samples spread as wide as the best hypothesis has it, on two surfaces.
  bool usable = false;  ///< The mean may be compared with a surface: no edge near, not grazing, one echo.
  bool doubtful =
      false;  ///< Left out only because mount and walls are not known well enough to say what it meets.
  Circumstances at;
  std::size_t first_kept = 0;  ///< Of its n samples in Reduced::kept, if they are kept.
  Sight sight;                 ///< At the nuisance parameters last used for prediction.
  double nominal_mm = 0;       ///< Predicted range.
  [[nodiscard]] double off_mm() const { return mean_mm - nominal_mm; }
  double pooled_mm2 = 0;       ///< Variance of one sample, shared with its neighbours; 0: not yet pooled.
  /// What changes from scan to scan and is predicted: its mean over the scans, mm, and its variance, mm^2.
  double of_scans_mm = 0, of_scans_mm2 = 0;
  /// Covariance of a sample with the sum of those around it, `neighbours_aside` beams to either side, in the
  /// same scan, less what all of the scan have in common.
  double with_neighbours_mm2 = 0;
  /// Of scans with their own geometry: mean square of how far beams lie beside `beam_rad`.
  double aside_rad2 = 0;
  /// Of several beams taken together: standard deviation of their angles, and d range / d angle (mm per rad)
  /// by which they were brought to their middle.
  double joined_rad = 0, joined_sensitivity_mm = 0;
  /// What that leaves in the variance, where the walls are now.
  [[nodiscard]] double of_joining_mm2() const {
    const double off = joined_rad * (sight.beam_sensitivity() - joined_sensitivity_mm);
    return off * off;
  }
  /// What it says counts for nothing.
  void leave_out() {
    lost = stray = far = late = early = 0;
    usable = doubtful = false;
  }
};

/// Distances from a target, mm: of samples too far for noise of that spread, and of those close enough to be
/// its tail.
struct Reach {
  double too_far_mm, close_mm;
  explicit Reach(double sigma_mm)
      : too_far_mm(std::max(12 * sigma_mm, 60.0)), close_mm(std::max(250.0, 2 * too_far_mm)) {}
};

/// Variance of rounding to whole millimetres, in which ranges come.
constexpr double rounding_mm2 = 1.0 / 12;

/// Of so many scans each beam's own noise is known well enough to weigh it.
constexpr int weighted_from_scans = 50;

/// Scans that share all circumstances: a capture, a span of a long one, or one scan of a turning one.
struct Group {
  int capture = 0;
  int scans = 0;
  double stage_rad = 0;
  double time_s = 0, clock_s = 0;  ///< As in Circumstances.
  double sigma_mm = 0;  ///< Robust spread of a sample.
  /// Sums over cells and scans of d_t d_(t+k), mm^2, for the lags k of every band, d the deviation from the
  /// cell's mean less that of its scan; and of (d_t d_(t+1))^2, mm^4.
  LagSums lagged{};
  double lagged_squares = 0;
  long pairs = 0, cells = 0;
  /// Sum over scans of half the squared step from scan to scan of the sum of squares of all beams'
  /// standardised deviations, over its variance for independent normal samples; and how many steps.
  double square_steps = 0, steps = 0;
  std::size_t first_cell = 0, last_cell = 0;
};

/// Sums over beams of their weight w, v (mm per rad of stage angle) and d, by how much one deviates, mm.
struct WeightedSums {
  double w = 0, wv = 0, wvv = 0, wd = 0, wdv = 0;

  void add(double weight, double v, double d) {
    *this += {weight, weight * v, weight * v * v, weight * d, weight * d * v};
  }
  WeightedSums& operator+=(const WeightedSums& more) {
    w += more.w;
    wv += more.wv;
    wvv += more.wvv;
    wd += more.wd;
    wdv += more.wdv;
    return *this;
  }
  /// Less a range and an angle that all of them have in common.
  void take_off(double range_mm, double angle_rad) {
    wd -= range_mm * w + angle_rad * wv;
    wdv -= range_mm * wv + angle_rad * wvv;
  }
};

/// One sector of one scan: what the samples of its cells deviate by from the cells' means. Whatever a whole
/// scan has in common is in here.
struct Sector : WeightedSums {
  int group = 0, seq = 0, number = 0;
  std::int64_t turn = 0;    ///< Of the mirror, counted through all captures by the lidar's clock.
  double since_move_s = 0;  ///< Of the sector's middle beam.
  int approach = 0;
  std::size_t first_cell = 0, last_cell = 0;  ///< Among which its own are.
  /// Of d less what its whole scan has in common: the variance of wd, were beams independent.
  double wwdd = 0;
};

/// Something that stood before the targets in scans of a capture, at beams between these.
struct Occluder {
  int capture = 0;
  double from_rad = 0, to_rad = 0;
  std::optional<Eigen::Vector2d> at_mm = {};  ///< The middle of its front, if it stood there throughout.
};

/// The number that is delivered for whatever is farther away, and the share of samples that are it.
struct RangeLimit {
  double mm = 0, share = 0;
};

/// A mean so far off has nothing to do with the target that the bench file has there.
constexpr double off_target_mm = 400;

struct Reduced {
  Bench bench;
  std::vector<CaptureInfo> captures;
  std::vector<Absent> absent;  ///< For every capture.
  std::vector<int> same_as;    ///< For every target of the bench, the first that is the same thing elsewhere.
  std::vector<Group> groups;
  std::vector<Cell> cells;
  std::vector<Sector> sectors;
  std::vector<float> kept;  ///< Samples that belong to the targets, cell after cell; empty unless asked for.
  std::vector<float> beside;  ///< Samples of cells beside edges: which surface they met is asked again.
  std::vector<long> shown;    ///< How often every whole millimetre was among the samples.
  /// Samples too far from their target for any noise, the first thousands of a recording: in mm, and as a
  /// share of the way to the target.
  std::vector<float> strays_mm, strays_of_target;
  std::size_t most_strays = 0;  ///< With those of the recording that is being read.
  std::vector<Occluder> occluders;  ///< Seen in some scans of a capture.
  std::optional<RangeLimit> limit;
  std::vector<int> unmet;       ///< Targets that hardly a beam meets where the bench file has them.
  long samples = 0;
  double reference_temperature_c = 0;
  std::vector<double> later_s;  ///< Of every recording, by how much later than it says its clock is taken.
  bool has_intensity = false;          ///< Otherwise cells have the echo that the bench file lets expect.
  OutputSteps output_steps;            ///< In which ranges come.
  std::optional<double> wave_hz;       ///< What a lamp or a supply does at that frequency was taken off.
  std::optional<double> vibration_hz;  ///< At which whole scans swing, with another phase in every capture.
  int left_out = 0;                    ///< Cells that no mean is taken of.
  int in_clear = 0;              ///< Cells away from edges and corners, square on enough, by the bench file.
  int off_targets = 0;           ///< Of these, those more than `off_target_mm` off their target.
  int scans = 0;                 ///< That were read; besides, those that came again, ...
  int repeated = 0, broken = 0;  ///< ... and of them, those of which a part is missing.

  [[nodiscard]] std::size_t usable_cells() const;
  /// Of one sample, the groups' median.
  [[nodiscard]] double typical_sigma_mm() const;
  [[nodiscard]] const CaptureInfo& capture_of(const Group& group) const {
    return captures[static_cast<std::size_t>(group.capture)];
  }
  [[nodiscard]] const CaptureInfo& capture_of(const Cell& cell) const { return capture_of(group_of(cell)); }
  /// Of a cell or a sector.
  template <class Part>
  [[nodiscard]] const Group& group_of(const Part& part) const {
    return groups[static_cast<std::size_t>(part.group)];
  }
  /// Of a group, or those among which a sector's are.
  template <class Part>
  [[nodiscard]] std::span<Cell> cells_of(const Part& part) {
    return std::span(cells).subspan(part.first_cell, part.last_cell - part.first_cell);
  }
  template <class Part>
  [[nodiscard]] std::span<const Cell> cells_of(const Part& part) const {
    return std::span(cells).subspan(part.first_cell, part.last_cell - part.first_cell);
  }
  /// The targets as they stand in the group's capture.
  [[nodiscard]] Scene scene_of(const Group& group, const Nuisance& nuisance) const;
};

/// What of the bench stands where. Left empty: every target is there in every capture, and all differ.
struct Standing {
  std::vector<Absent> absent;  ///< For every capture.
  std::vector<int> same_as;    ///< For every target; what belongs to a thing goes with it to another place.
  /// For captures, counted through all recordings, between which beams, rad, something else hides all that
  /// the bench describes.
  std::map<int, std::vector<std::pair<double, double>>> hidden;
};

/// Called with the share done, 0..1, or unknown_share.
using Progress = std::function<void(double share, const std::string& what)>;
/// Of work whose end nobody knows, such as a search.
inline constexpr double unknown_share = -1;

/// Walks one more recording before the same bench.
void reduce_into(Reduced& reduced, const Recording& recording, const Progress& progress,
                 const Standing& standing = {}, bool keep_samples = false);
/// Walks the recording once. Cells of captures about nothing in the scene are left out.
[[nodiscard]] Reduced reduce(const Recording& recording, const Progress& progress,
                             const Standing& standing = {}, bool keep_samples = false);

/// The nuisances with the targets where those mechanisms that displace one put it.
[[nodiscard]] Nuisance displaced(const Reduced& reduced, Nuisance nuisance,
                                 const std::vector<Active>& at_work);

/// Predicts every cell anew with other nuisance parameters and with mechanisms at work, to all orders in
/// geometry. `nominal_mm`, `sight` and the place in `at` are replaced. A cell that now meets another target
/// is left out if `may_leave_out`; otherwise it is seen on its own target's plane.
void predict(Reduced& reduced, const Nuisance& nuisance, const std::vector<Active>& at_work,
             bool may_leave_out);

/// Says anew which cells may be compared, once mount and walls are fitted: leaves out those that meet another
/// target or a corner there, and takes doubtful ones in again that are farther from corners and edges than
/// what is left of the doubt, and than `footprint_rad`, the beam's standard half width if it is known.
/// Returns how many changed.
int reassign(Reduced& reduced, const Nuisance& nuisance, const std::vector<Active>& at_work,
             double footprint_rad);

/// How a search takes a large session, so that about so many rows remain: as many of every
/// group, or all that it has. So many neighbouring cells come together; where that would be too wide for the
/// middle one to stand for them all, an even choice of the groups with as many cells counts.
class SearchRows {
 public:
  /// at_least: cells of a row, however few there are.
  SearchRows(const Reduced& reduced, bool only_usable, std::size_t rows, std::size_t at_least = 1);
  [[nodiscard]] std::size_t together(std::size_t group) const;
  [[nodiscard]] bool take(std::size_t group) const;

 private:
  std::vector<double> cells_;  ///< Of every group.
  std::size_t at_least_;
  double widest_, quota_ = 1e300;  ///< Cells together, and rows of a group, at most.
};

/// The session with neighbouring smooth cells on one target taken together, as a search of
/// smooth functions needs them. Their deviations from the present prediction are averaged
/// with their weights and stand at the place of the middle one. Variances must be pooled.
[[nodiscard]] Reduced merged(const Reduced& reduced, std::size_t rows);
/// The cells that are taken together in each of its rows, in their order.
[[nodiscard]] std::vector<std::vector<const Cell*>> taken_together(const Reduced& reduced, std::size_t rows);
/// Of more, neighbours come together in a bin of any picture or table anyway.
constexpr std::size_t rows_for_tables = 100'000;

}  // namespace fit::explain
