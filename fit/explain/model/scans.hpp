// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain::model {

/// What the beams of one scan, or of a part of it, have in common beside their cells' means: a shift of the
/// range, or an angle of the stage that the shift does not take up. Both are in millimetres of range, and of
/// independent noise.
struct ScanPart {
  Circumstances at;
  int group = 0, capture = 0, scans = 0;
  int in_capture = 0;  ///< Its number there; that in `at` is the mirror's.
  int block = 0;       ///< Those of one block are deviations from their own mean.
  bool of_angle = false;
  double sensitivity_mm =
      0;          ///< d statistic / d stage angle, per rad; d statistic / d range is 1, or 0 of an angle.
  double mm = 0;  ///< The statistic.
  double rest_mm = 0;  ///< Less what repeats, from capture to capture or after a whole number of scans ...
  double news = 1;     ///< ... and how much of an independent value that is.
  double variance_mm2 = 0;  ///< Of its samples' noise.
};

/// Groups of fewer scans say nothing of what these have in common.
inline constexpr int fewest_in_common = 3;

/// Scans of groups of at least so many, each in so many parts (1, 2, 4 or 8). Scans are numbered as mirror
/// faces repeat: in their capture, or with the mirror through the time between captures, whichever the
/// recording shows more of.
[[nodiscard]] std::vector<ScanPart> scan_parts(const Reduced& reduced, int fewest_scans, int parts);

/// By how much ranges, or angles, of whole scans scatter more than their samples say, beside what repeats.
struct ScatterOfScans {
  double variance = 0;  ///< Of one scan's by its samples, mm^2 or rad^2.
  double ratio = 1;     ///< By how much it is more.
  /// Of that, a share is AR(1) from scan to scan with that correlation; none unless that is certain.
  double rho = 0, share = 0;
  /// Variance that every scan has beside that of its samples.
  [[nodiscard]] double beside_samples() const { return more(ratio); }
  /// Variance that independent scans would draw anew for means over so many to scatter as much; 0 where none
  /// is autocorrelated.
  [[nodiscard]] double for_means(int scans) const {
    return share > 0 ? more(ratio * more_in_means(scans)) : 0;
  }
  /// How much more means over so many scatter than if scans were independent.
  [[nodiscard]] double more_in_means(int scans) const;

 private:
  [[nodiscard]] double more(double than_samples) const { return (than_samples - 1) * variance; }
};
[[nodiscard]] ScatterOfScans scatter_of_scans(const std::vector<ScanPart>& scans, bool of_angle);

/// The sectors less what these do from scan to scan, and less what else repeats from capture to capture or
/// with the mirror's faces.
[[nodiscard]] std::vector<Sector> without_what_repeats(const Reduced& reduced,
                                                       const std::vector<Active>& at_work);

/// Predicts what these do from scan to scan, for the cells that their scans are averaged in.
void expect_from_scan_to_scan(Reduced& reduced, const std::vector<Active>& at_work);

}  // namespace fit::explain::model
