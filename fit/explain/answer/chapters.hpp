// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/explanation.hpp"
#include "fit/explain/inference/explain.hpp"

/// The chapters of an answer, in their order. Each adds to the explanation what it has to tell: mechanisms
/// with their entries in the bench, undecided sets, what is unknown, places, notes.
namespace fit::explain::answer {

using inference::Inferred;

/// The model has no rows for them.
void report_coarse_steps(const Inferred& inferred, Explanation& out);

/// What no mechanism of the catalogue explains.
void report_unknown(const Reduced& reduced, const Inferred& inferred, Explanation& out);

/// Where all that shows, and curves of it.
void report_where(const Reduced& reduced, const Inferred& inferred, Explanation& out);

/// What to know before any of it is believed.
void report_doubts(const Reduced& reduced, const Inferred& inferred, Explanation& out);

/// Mount and targets that come out far from where the bench file has them: a wrong bench file, not physics.
void doubt_bench_file(const Reduced& reduced, const Inferred& inferred, Explanation& out);

/// Puts mount, targets and the constant noise into the bench as they were found.
void correct_bench(const Inferred& inferred, Bench& bench);

}  // namespace fit::explain::answer
