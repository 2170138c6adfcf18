// SPDX-License-Identifier: MIT
#include "fit/explain/intensity/judgement.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fit/explain/explanation.hpp"
#include "fit/explain/intensity/deviations.hpp"
#include "fit/explain/intensity/search.hpp"
#include "fit/explain/odds.hpp"

namespace fit::explain::intensity {
namespace {

constexpr double confirmed_by = 2;  // log-likelihood of readings not fitted to

Model::HeldOut held_out(const Readings& readings, const std::vector<Suspicion>& accepted) {
  return model_of(readings, accepted).held_out(readings.part, held_out_parts);
}

/// Readings may need no more than what the bench file states to be predicted, and still say that it cannot be
/// true: coefficients follow them a long way from there.
bool contradicts_the_file(const Suspicion& s) {
  return !s.coefficients.empty() && s.evidence > odds::strained;
}

/// Drops the first that the readings held out do not confirm; false when they confirm all.
bool drop_one(const Readings& readings, std::vector<Suspicion>& accepted) {
  const double all = held_out(readings, accepted).log_likelihood;
  for (std::size_t t = 0; t < accepted.size(); ++t) {
    const double rest = held_out(readings, without(accepted, t)).log_likelihood;
    if (all - rest > confirmed_by || contradicts_the_file(accepted[t])) continue;
    accepted = without(accepted, t);
    settle(readings, accepted);
    return true;
  }
  return false;
}

/// How probable it is among all suspects beside the others, of every kind the most evident, and nothing.
/// `alone`: there are no others, and nothing would be missing.
void compare(const std::vector<Suspicion>& suspects, bool alone, Judged& judged) {
  const Suspicion& suspicion = judged.suspicion;
  double own = -1e300;
  for (const Suspicion& s : suspects)
    if (s.same_as(suspicion)) own = std::max(own, s.evidence);
  own = std::max(own, suspicion.evidence);
  double total = 0;
  std::vector<const Suspicion*> kinds;
  for (const Suspicion& s : suspects) {
    if (s.same_kind(suspicion)) continue;
    if (std::ranges::any_of(kinds, [&](const Suspicion* k) { return k->same_kind(s); })) continue;
    kinds.push_back(&s);
    total += std::exp(std::min(50.0, s.evidence - own));
    if (s.has_name() && s.evidence > own - odds::close_behind) judged.rivals.push_back(s);
    if (!s.has_name() && s.evidence > own) judged.unknown = true;
  }
  total += std::exp(std::min(50.0, -own - (alone ? odds::something_is_missing : 0)));  // nothing at all
  judged.probability = 1 / (1 + total);
  if (!suspicion.has_name()) judged.unknown = true;
}

}  // namespace

bool Judged::is_confirmed() const { return gain > confirmed_by; }

bool Judged::is_found() const { return !unknown && rivals.empty() && probability >= worth_telling; }

Judgement judge(const Readings& readings, std::vector<Suspicion> accepted) {
  while (drop_one(readings, accepted)) continue;
  Judgement judgement;
  judgement.before = held_out(readings, {});
  judgement.after = held_out(readings, accepted);
  judgement.accepted = std::move(accepted);
  for (std::size_t t = 0; t < judgement.accepted.size(); ++t) {
    const std::vector<Suspicion> others = without(judgement.accepted, t);
    const Model::HeldOut held = held_out(readings, others);
    Judged judged;
    judged.suspicion = judgement.accepted[t];
    judged.gain = judgement.after.log_likelihood - held.log_likelihood;
    judged.rms_without = held.rms;
    compare(suspects(readings, others), others.empty(), judged);
    judgement.judged.push_back(std::move(judged));
  }
  return judgement;
}

}  // namespace fit::explain::intensity
