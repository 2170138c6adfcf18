// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/answer/findings.hpp"
#include "fit/explain/explanation.hpp"

/// The chapters of an answer, in their order. Each adds to the explanation what it has to tell: mechanisms
/// with their entries in the bench, undecided sets, what is unknown, places, notes.
namespace fit::explain::answer {

/// The most probable that a name is beside something that nobody could name.
inline constexpr double not_certain = 0.85;

/// Mechanisms that move means, and sets of those that cannot be told apart.
void tell_means(const Findings& findings, Explanation& out);

/// Mount and targets that had to go farther from where the bench file has them than a mechanism costs, unless
/// something named says so: that the file is wrong is an answer, and nothing is not missing then.
void tell_stated_otherwise(const Findings& findings, Explanation& out);

/// Stray light beside edges.
void tell_stray_light(const Findings& findings, Explanation& out);

/// Mechanisms of noise, lost echoes, distributions and memory.
void tell_spread(const Findings& findings, Explanation& out);

/// What no mechanism of the catalogue explains.
void tell_unknown(const Findings& findings, Explanation& out);

/// Where all that shows, and curves of it. Leaves the findings predicted as they were.
void tell_where(Findings& findings, Explanation& out);

/// What to know before any of it is believed.
void tell_doubts(const Findings& findings, Explanation& out);

/// Mount and targets that come out far from where the bench file has them: a wrong bench file, not physics.
void doubt_bench_file(const Findings& findings, Explanation& out);

/// Puts mount, targets and the constant noise into the bench as they were found.
void correct_bench(const Findings& findings, Bench& bench);

}  // namespace fit::explain::answer
