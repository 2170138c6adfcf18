// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <vector>

#include "fit/explain/reduction/samples.hpp"

/// What drivers and networks do to scans.
namespace fit::explain::reduction {

/// Scans that were delivered more than once: the same as the one before to the last millimetre and count,
/// with so many echoes that noise lets no two scans be alike.
class RepeatedScans {
 public:
  /// Whether it is the one before again; of one capture, in order.
  bool is_again(const ScanView& scan);
  void next_capture() { range_mm_.clear(), intensity_.clear(); }

 private:
  std::vector<std::uint16_t> range_mm_, intensity_;  ///< Of the one before.
  double alike_ = 0, compared_ = 0;                  ///< Beams of scans that were not the same.
};

/// As if no beam had looked where a scan breaks off or sets in late: where nothing at all came back, though
/// the other scans have echoes there. Losses of echoes are not so many at once; what happens to more than a
/// fifth of the scans is something else, unless they end at the same beam, one after the other. Returns how
/// often.
int do_not_look_beyond_breaks(Samples& samples);

}  // namespace fit::explain::reduction
