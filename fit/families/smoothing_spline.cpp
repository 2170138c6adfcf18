// SPDX-License-Identifier: MIT
#include "fit/range/family.hpp"

namespace fit::families {

// No equation: what a curve without a prescribed form would say. It judges the others.
Family make_smoothing_spline() {
  Family f;
  f.id = "smoothing-spline";
  f.title = "smoothing spline";
  f.honest_reference = true;
  return f;
}

}  // namespace fit::families
