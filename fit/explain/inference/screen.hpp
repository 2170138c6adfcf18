// SPDX-License-Identifier: MIT
#pragma once

#include <optional>

#include "fit/explain/inference/fit.hpp"

namespace fit::explain::inference {

/// One more term, by a score test: what it would add to a fitted hypothesis.
struct Candidate {
  Term term;
  double log_evidence = -1e300;  ///< Against the hypothesis without it.
  /// At all times, where the term acts for a while: few lost echoes within a short while promise too much.
  std::optional<Term> always;
  [[nodiscard]] double log_posterior() const { return log_evidence + term.kind->log_prior; }
};

/// Every kind that is not in the hypothesis, nor `but`; the most probable first. `at_other_places`: also
/// those in it that are local, and may be so twice. `around`: the fitted likelihood expanded for new terms,
/// if that was done.
[[nodiscard]] std::vector<Candidate> screen(const Session& session, const Fitted& fitted,
                                            const Kind* but = nullptr, bool at_other_places = false,
                                            const Optimum* around = nullptr);

}  // namespace fit::explain::inference
