// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/inference/posterior.hpp"

namespace fit::explain::inference {

/// What is named makes a set with the catalogue's other names for it (Mechanism::looks_like), with pairs of
/// mechanisms that do the same together, and with functions of a coordinate that goes with its own in this
/// session, where they fit the recording as well: how much less a formula leaves open is no evidence between
/// two names of one thing.
void join_what_looks_alike(const Session& session, const Explored& explored, Posterior& posterior);

/// The share of its cause that the formula of a term of the best hypothesis leaves: what it errs by; where
/// its smooth deviations are in the model, that share of it. A form has no formula.
[[nodiscard]] double share_left(const Fitted& best, std::size_t term);

}  // namespace fit::explain::inference
