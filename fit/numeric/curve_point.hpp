// SPDX-License-Identifier: MIT
#pragma once

namespace fit {

/// One point of a calibration curve.
struct CurvePoint {
  double x = 0, y = 0, u = 1;  ///< u: standard uncertainty of y.
};

}  // namespace fit
