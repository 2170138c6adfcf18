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

/// As if no beam had looked where a part of a scan is missing: a packet, or all from some beam on. Nothing at
/// all came back there, though the other scans have echoes. Losses of echoes are not so many side by side;
/// what happens to more than a fifth of the scans is something else, unless they end at the same beam, one
/// after the other. Returns how many scans have gaps.
int do_not_look_at_gaps(Samples& samples);

}  // namespace fit::explain::reduction
