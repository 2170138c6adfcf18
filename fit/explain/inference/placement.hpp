// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/model/hypothesis.hpp"

namespace fit::explain::inference {

struct Placed {
  double excess = 1;  ///< Variance of means by how neighbouring cells scatter, over what their samples say.
  bool fits_most = true;
  Nuisance there;  ///< Where most beams agree that mount and targets are; as stated if they do not.
  Nuisance by_all;  ///< Where all of them together have both.
};

/// Decides which cells may be compared, once mount and targets are known a little better than the bench file
/// knows them. The cells' variances are left pooled. `at_work`: what moved one of them meanwhile, if
/// anything.
[[nodiscard]] Placed fit_placements(Reduced& reduced, const MeanNoise& noise,
                                    const std::vector<explain::Term>& at_work = {});

}  // namespace fit::explain::inference
