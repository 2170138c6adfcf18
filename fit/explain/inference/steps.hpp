// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/bench/empirical.hpp"
#include "fit/explain/inference/posterior.hpp"
#include "fit/explain/model/results.hpp"

/// The steps of `infer` before and after the search.
namespace fit::explain::inference {

struct Placed {
  double excess = 1;  ///< Variance of means by how neighbouring cells scatter, over what their samples say.
  bool fits_most = true;
  Nuisance there;   ///< Where most beams agree that mount and targets are; as stated if they do not.
  Nuisance by_all;  ///< Where all of them together have both.
};

/// Decides which cells may be compared, once mount and targets are known a little better than the bench file
/// knows them. The cells' variances are left pooled. `at_work`: what moved one of them meanwhile, if
/// anything.
[[nodiscard]] Placed fit_placements(Reduced& reduced, const MeanNoise& noise,
                                    const std::vector<Active>& at_work = {});

/// What is named makes a set with the catalogue's other names for it (Mechanism::looks_like), and with
/// functions of a coordinate that goes with its own in this session, where they fit the recording as well:
/// how much less a formula leaves open is no evidence between two names of one thing.
void join_what_looks_alike(const Session& session, const Fitted& best, Fits& fits, Posterior& posterior);

/// The share of its cause that the formula of a term of the best hypothesis leaves: what it errs by; where
/// its smooth deviations are in the model, that share of it. A form has no formula.
[[nodiscard]] double share_left(const Fitted& best, std::size_t term);

/// Whole captures predicted from all others; sectors of beams where captures are few. The log density is that
/// of each block as a whole given the others, in all channels or in the means only; the other figures are of
/// means.
[[nodiscard]] HeldOutFigures hold_out(const Session& session, const Fitted& fitted, bool only_means = false);

/// Whether unnamed functions of the means predict captures that had no part in them better than the rest of
/// the hypothesis alone does. True where nothing can say so: one capture, or no such function.
[[nodiscard]] bool forms_carry_over(const Session& session, const Fitted& fitted);

/// Pictures of the channels beside the means, along the coordinates of what was found there: as recorded, as
/// simulated when nothing was known, and as explained.
[[nodiscard]] std::vector<SpreadCurve> curves_of(const Session& session, const Fitted& nothing,
                                                 const Fitted& best, const Posterior& posterior);

/// For the twin, where tables of a bench file can tell what happens in a channel: what terms without a name
/// do there, and how named ones bend away from their formulas.
[[nodiscard]] std::vector<EmpiricalFunction> tables_of(const Session& session, const Fitted& best,
                                                       const Posterior& posterior);

}  // namespace fit::explain::inference
