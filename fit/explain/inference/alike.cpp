// SPDX-License-Identifier: MIT
#include "fit/explain/inference/alike.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "fit/explain/inference/numbers.hpp"
#include "fit/explain/inference/screen.hpp"

namespace fit::explain::inference {
namespace {

using Member = Undecided::Member;

/// Names without a mechanism, of what the bench file states: nothing but priors tells them from the others.
bool is_of_bench_file(const std::string& name) { return !find_mechanism(name); }

/// In the place of a term of the best hypothesis, as well as the recording tells.
std::vector<Member> rivals_of(const Session& session, const Fitted& best, const Term& term) {
  const std::vector<std::string>& names = term.kind->mechanism->looks_like;
  std::vector<Member> rivals;
  if (std::ranges::all_of(names, is_of_bench_file)) return rivals;
  Hypothesis less;
  for (const Term& own : best.hypothesis.terms)
    if (own.kind != term.kind) less.terms.push_back(own);
  for (const Candidate& candidate : screen(session, fit(session, less), term.kind)) {
    if (candidate.term.kind->is_form() || !std::ranges::count(names, candidate.term.kind->mechanism->id)) continue;
    Hypothesis other = less;
    other.terms.push_back(candidate.term);
    const Hypothesis fitted = fit(session, other).hypothesis;
    if (fitted.log_likelihood < best.hypothesis.log_likelihood + numbers::contradicted_at) continue;
    rivals.push_back({candidate.term.kind, std::exp(fitted.log_posterior() - best.hypothesis.log_posterior()),
                      fitted.terms.back()});
  }
  return rivals;
}

std::vector<std::string> names_of_bench_file(const Term& term) {
  std::vector<std::string> names;
  std::ranges::copy_if(term.kind->mechanism->looks_like, std::back_inserter(names), is_of_bench_file);
  return names;
}

void join(const std::vector<Member>& rivals, Undecided& set) {
  for (const Member& rival : rivals)
    if (std::ranges::none_of(set.members, [&](const Member& m) { return m.kind == rival.kind; })) set.members.push_back(rival);
}

}  // namespace

void join_what_looks_alike(const Session& session, const Fitted& best, Posterior& posterior) {
  std::vector<Named> alone;
  for (const Named& named : posterior.named) {
    const std::vector<Member> rivals = rivals_of(session, best, named.term);
    const std::vector<std::string> also = names_of_bench_file(named.term);
    if (rivals.empty() && also.empty()) {
      alone.push_back(named);
      continue;
    }
    Undecided set{{{named.term.kind, named.probability, named.term}}, also};
    join(rivals, set);
    double sum = 0;  // Of what was named, each has its part.
    for (const Member& member : set.members) sum += member.probability;
    for (Member& member : set.members) member.probability *= named.probability / sum;
    posterior.undecided.push_back(std::move(set));
  }
  posterior.named = std::move(alone);
  for (Undecided& set : posterior.undecided)
    for (const Member& member : std::vector(set.members)) {
      if (!member.kind || member.kind->is_form()) continue;
      const bool is_in_best = best.hypothesis.has(*member.kind);
      if (is_in_best) join(rivals_of(session, best, member.term), set);
      for (const std::string& name : names_of_bench_file(member.term))
        if (!std::ranges::count(set.also, name)) set.also.push_back(name);
    }
}

}  // namespace fit::explain::inference
