// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <string>

#include "fit/explain/explanation.hpp"
#include "fit/explain/inference/explain.hpp"
#include "fit/explain/numbers.hpp"
#include "fit/explain/scene/stated_noise.hpp"

namespace fit::explain::inference {
namespace {

std::map<std::string, Estimate> parameters_of(const Term& term) {
  std::map<std::string, Estimate> map;
  for (std::size_t k = 0; k < term.values.size(); ++k) {
    const Parameter& p = term.kind->mechanism->parameters[k];
    const bool is_own = std::ranges::count(term.kind->coefficients, k, &model::Coefficient::parameter) > 0;
    if (p.role == Parameter::Role::size && !is_own) continue;  // another kind's, or of other targets
    if (model::is_always(term.values[k])) continue;
    if (term.kind->is_plain && p.generalises) continue;
    const double u = k < term.sigma.size() ? term.sigma[k] : 0.0;
    map[p.name] = {term.values[k], std::hypot(u, p.own_affair * term.values[k])};
  }
  return map;
}

Suspect as_suspect(const Term& term, double gain = 0) {
  Suspect suspect;
  suspect.gain = gain;
  suspect.mechanism = term.kind->mechanism.get();
  suspect.target = term.kind->target;
  suspect.parameters = parameters_of(term);
  return suspect;
}

Found found_of(const Term& term, const Reduced& reduced) {
  Found f;
  f.mechanism = term.kind->mechanism.get();
  f.parameters = parameters_of(term);
  if (term.kind->target >= 0) f.target = reduced.bench.target_at(term.kind->target).name;
  for (const Cell& cell : reduced.cells) {
    if (!cell.usable || (term.kind->target >= 0 && term.kind->target != cell.at.target)) continue;
    const double mm = cell.sight.shift(f.mechanism->act(cell.at, term.values));
    if (!(std::abs(mm) > std::abs(f.largest_mm))) continue;
    f.largest_mm = mm;
    f.largest_at = model::coordinate_of(f.mechanism->coordinate, cell.at);
  }
  return f;
}

/// One more size of a mechanism that is told already.
void add_size(const Found& more, Found& found) {
  found.parameters.insert(more.parameters.begin(), more.parameters.end());
  found.largest_mm = found.largest_at = 0;  // that was of one size alone
  found.says = found.mechanism->says(found);
}

std::string on_held_out(double gain, bool moves_means) {
  constexpr double worth_telling = 1;
  if (gain >= worth_telling)
    return "On captures that took no part in the fit it raises the log-likelihood by " + rounded(gain, 3) +
           ".";
  return moves_means ? "Captures alone do not show it: without it mount or targets would have to be "
                       "elsewhere than the bench file says."
                     : "Captures that took no part in the fit do not show it.";
}

/// Whether none of its sizes is known to differ from zero, though it acts.
bool is_of_any_size(const Found& found) {
  bool has_size = false;
  for (const Parameter& p : found.mechanism->parameters) {
    const auto size = found.parameters.find(p.name);
    if (p.role != Parameter::Role::size || size == found.parameters.end()) continue;
    if (std::abs(size->second.value) > 2 * size->second.u) return false;
    has_size = true;
  }
  return has_size;
}

void report_named(const Named& named, double gain, const Reduced& reduced, Explanation& out) {
  Found found = found_of(named.term, reduced);
  found.probability = named.probability;
  found.says = found.mechanism->says(found);
  found.evidence = on_held_out(gain, named.term.kind->moves_means());
  if (is_of_any_size(found))
    found.evidence +=
        " That it acts is surer than how much: other parameters, and what its formula leaves open, make up "
        "for "
        "its size.";
  found.log_likelihood_gain = gain;
  const auto other_size = std::ranges::find_if(out.mechanisms, [&](const Found& f) {
    return named.term.kind->size && f.mechanism == found.mechanism && f.target == found.target;
  });
  if (other_size == out.mechanisms.end())
    out.mechanisms.push_back(found);
  else
    add_size(found, *other_size);
  if (is_constant_noise(*found.mechanism)) return;  // stated there already, with more of it
  add_known(out.bench, as_known(*found.mechanism, found.parameters, found.target));
}

std::string name_of(const Named& member) {
  const Kind* kind = member.term.kind;
  return !kind ? nothing_missing : kind->is_form() ? unknown_physics : kind->mechanism->id;
}

/// Whether it is a mechanism of the catalogue.
bool has_name(const Named& member) { return member.term.kind && !member.term.kind->is_form(); }

/// `functions`: those in sets before it.
void report_set(const Undecided& set, const Reduced& reduced, const MeanNoise& noise,
                std::set<const Kind*>& functions, Explanation& out) {
  const std::vector<Named>& members = set.members;
  std::vector<std::string> all;
  for (const Named& member : members)
    if (!std::ranges::count(all, name_of(member))) all.push_back(name_of(member));
  std::ranges::copy(set.also, std::back_inserter(all));
  out.undecided_between.push_back(std::move(all));
  std::string odds;
  const auto names = std::ranges::count_if(members, has_name);
  const bool may_be_nothing =
      std::ranges::any_of(members, [](const Named& member) { return !member.term.kind; });
  for (const Named& member : members) {
    odds += (odds.empty() ? "" : ", ") + name_of(member) + " " + rounded(member.probability, 2);
    const Kind* kind = member.term.kind;
    if (!kind) continue;
    if (kind->is_form()) {
      if (kind->moves_means() && !kind->form->form->happened_then && functions.insert(kind).second)
        out.unnamed_suspects.push_back(seen(as_shape(member.term), MeanModel(reduced, noise)));
    } else if (kind->mechanism->happened_once(member.term.values)) {
      continue;  // no experiment repeats it
    } else if (kind->moves_means()) {
      out.suspects.push_back(as_active(member.term));
    } else if (names > 1 || may_be_nothing) {  // else there is nobody to tell it from
      out.noise_suspects.push_back(as_suspect(member.term));
    }
  }
  out.may_be_nothing |= may_be_nothing;
  if (members.size() > 1)
    out.notes.push_back("Probabilities by this recording and by usual sizes: " + odds +
                        (set.also.empty() ? "." : "; how far off the bench file may be has no usual size."));
}

/// Whether what was found describes where most of the beams meet the scene.
bool describes(const Inferred& inferred) {
  const HeldOutFigures& after = inferred.means.after;
  return after.cells == 0 || (after.coverage >= numbers::describes_at && !inferred.means.is_another_scene());
}

bool is_confirmed(const Inferred& inferred, std::size_t named) {
  if (inferred.means.is_another_scene()) return false;
  const Gain& gain = inferred.gain[named];
  const bool captures_ask_for_it = gain.fitted > -numbers::contradicted_at;  // and not the bench file alone
  return (!captures_ask_for_it || gain.held_out > numbers::contradicted_at) &&
         ((describes(inferred) && !inferred.means.is_worse_held_out()) ||
          !inferred.posterior.named[named].term.kind->moves_means());
}

/// A mechanism that captures contradict to which it was not fitted is no explanation, nor is any where the
/// scene is another one.
Unexplained contradicted(const Inferred& inferred, const Term& term, double gain) {
  Unexplained u;
  u.gain = std::abs(gain);
  u.observable = term.kind->mechanism->observable;
  u.coordinate = term.kind->mechanism->coordinate;
  u.describes =
      "what looks like " + term.kind->mechanism->id +
      (describes(inferred) ? " is seen in some captures, and others contradict it"
                           : " leaves most means outside of their intervals: scene, mount or stage are not "
                             "as the bench file says");
  return u;
}

/// Hypotheses that count, without what captures contradict. Those that say the same of other recordings are
/// one: functions without a name are told of the best hypothesis alone.
std::vector<Alternative> alternatives_of(const std::vector<Likely>& likely,
                                         const std::vector<const Kind*>& contradicted) {
  std::map<std::vector<const Kind*>, std::size_t> place;
  std::vector<Alternative> list;
  double all = 0;
  for (const Likely& one : likely) {
    std::vector<const Kind*> kinds;
    Alternative alternative{one.probability, {}};
    for (const Term& term : one.hypothesis.terms) {
      if (term.kind->is_form() || std::ranges::count(contradicted, term.kind) > 0) continue;
      kinds.push_back(term.kind);
      alternative.mechanisms.push_back(as_suspect(term));
    }
    all += one.probability;
    const auto [at, is_new] = place.try_emplace(kinds, list.size());
    if (is_new)
      list.push_back(std::move(alternative));
    else
      list[at->second].probability += one.probability;
  }
  for (Alternative& alternative : list) alternative.probability /= all;
  std::ranges::stable_sort(list, std::ranges::greater{}, &Alternative::probability);
  return list;
}

}  // namespace

void report(const Reduced& reduced, const Inferred& inferred, Explanation& out) {
  const Posterior& posterior = inferred.posterior;
  for (std::size_t i = 0; i < posterior.named.size(); ++i) {
    const Named& named = posterior.named[i];
    if (is_confirmed(inferred, i)) report_named(named, inferred.gain[i].held_out, reduced, out);
  }
  std::set<const Kind*> functions;
  for (const Undecided& set : posterior.undecided)
    report_set(set, reduced, inferred.means.noise, functions, out);
  std::ranges::copy(inferred.notes, std::back_inserter(out.notes));
  for (const EmpiricalFunction& table : inferred.tables) add_empirical(out.bench, table);
  for (const auto& [channel, nuisances] : inferred.restated)
    model::channel_kinds()[channel].restate(reduced, nuisances, out.bench);
}

void list_beside_means(Inferred& inferred) {
  std::vector<Unexplained> contradictions;
  std::vector<const Kind*> contradicted_kinds;
  for (std::size_t i = 0; i < inferred.posterior.named.size(); ++i) {
    const Term& term = inferred.posterior.named[i].term;
    if (!is_confirmed(inferred, i)) {
      contradictions.push_back(contradicted(inferred, term, inferred.gain[i].held_out));
      contradicted_kinds.push_back(term.kind);
    } else if (!term.kind->moves_means()) {
      inferred.accepted.push_back(as_suspect(term, inferred.gain[i].held_out));
    }
  }
  inferred.alternatives = alternatives_of(inferred.posterior.likely, contradicted_kinds);
  inferred.unknown.insert(inferred.unknown.begin(), contradictions.begin(), contradictions.end());
}

}  // namespace fit::explain::inference
