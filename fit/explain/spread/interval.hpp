// SPDX-License-Identifier: MIT
#pragma once

namespace fit::explain::spread {

/// From one time to another, seconds since power-on.
struct Interval {
  double from = 0, to = 0;
};

}  // namespace fit::explain::spread
