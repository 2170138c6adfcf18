// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/explanation.hpp"
#include "fit/explain/inference/findings.hpp"

/// The chapters of an answer, in their order. Each adds to the explanation what it has to tell: mechanisms
/// with their entries in the bench, undecided sets, what is unknown, places, notes.
namespace fit::explain::answer {

/// What the model has no rows for: coarse steps, wide beams.
void report_spread(const Findings& findings, Explanation& out);

/// What no mechanism of the catalogue explains.
void report_unknown(const Findings& findings, Explanation& out);

/// Where all that shows, and curves of it.
void report_where(const Findings& findings, Explanation& out);

/// What to know before any of it is believed.
void report_doubts(const Findings& findings, Explanation& out);

/// Mount and targets that come out far from where the bench file has them: a wrong bench file, not physics.
void doubt_bench_file(const Findings& findings, Explanation& out);

/// Puts mount, targets and the constant noise into the bench as they were found.
void correct_bench(const Findings& findings, Bench& bench);

}  // namespace fit::explain::answer
