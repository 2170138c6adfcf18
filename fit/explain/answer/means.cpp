// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "fit/explain/answer/chapters.hpp"
#include "fit/explain/odds.hpp"

namespace fit::explain::answer {
namespace {

constexpr double sure = 0.9;
constexpr double not_excluded = 5;  // where some are not, those within this belong to them

double largest_effect(const Reduced& reduced, const Term& term, double* at) {
  double largest = 0;
  for (const Cell& cell : reduced.cells) {
    if (!cell.smooth || (term.target >= 0 && term.target != cell.at.target)) continue;
    const double e = cell.sight.shift(term.mechanism->act(cell.at, term.values));
    if (!(std::abs(e) > std::abs(largest))) continue;
    largest = e;
    *at = value_of(term.mechanism->coordinate, cell, reduced.groups[static_cast<std::size_t>(cell.group)]);
  }
  return largest;
}

/// The same of a mechanism whose formula is only the beginning of its curve: against where it does least.
double largest_of_curve(const Findings& findings, std::size_t t, double* at) {
  const Term& term = findings.means.best.terms[t];
  MeanModel model(findings.reduced, findings.means.noise);
  const Base base = base_columns(model, findings.means.best);
  model.set_base(base.all.columns_mm, base.all.prior);
  const Eigen::VectorXd formula = effect_of(model, term),
                        curve = formula + bend_of(base, model.posterior().value, t);
  Eigen::Index least = 0, most = 0;
  formula.cwiseAbs().minCoeff(&least);
  (curve.array() - curve[least]).abs().maxCoeff(&most);
  const Cell& cell = model.cell(most);
  *at = value_of(term.mechanism->coordinate, cell,
                 findings.reduced.groups[static_cast<std::size_t>(cell.group)]);
  return curve[most] - curve[least];
}

std::map<std::string, Estimate> parameters_of(const Term& term) {
  std::map<std::string, Estimate> map;
  for (std::size_t k = 0; k < term.values.size(); ++k)
    map[term.mechanism->parameters[k].name] = {term.values[k], k < term.sigma.size() ? term.sigma[k] : 0.0};
  return map;
}

Finding finding_of(const Findings& findings, std::size_t t) {
  const Reduced& reduced = findings.reduced;
  const Term& term = findings.means.best.terms[t];
  Finding f;
  f.parameters = parameters_of(term);
  if (term.target >= 0) f.target = reduced.bench.targets[static_cast<std::size_t>(term.target)].name;
  f.largest_mm = term.mechanism->any_curve ? largest_of_curve(findings, t, &f.largest_at)
                                           : largest_effect(reduced, term, &f.largest_at);
  return f;
}

std::string name_of_rival(const Rival& rival) {
  if (rival.term) return rival.term->mechanism->id;
  if (rival.shape) return std::string("an unnamed function of ") + name_of(rival.shape->coordinate);
  return "nothing";
}

std::string evidence_of(const MeanResult& means, std::size_t t) {
  std::string text = "On captures it was not fitted to, it raises the log-likelihood by " +
                     rounded(means.after.log_likelihood - means.without[t].log_likelihood, 3) + ".";
  int told = 0;
  for (const Rival& rival : means.rivals[t]) {
    if (told == 2) break;
    text += std::string(told == 0 ? " Next best: " : "; then ") + name_of_rival(rival) + ", 10^" +
            rounded(rival.behind / std::log(10.0), 2) + " times less probable";
    ++told;
  }
  return text + (told > 0 ? "." : "");
}

/// A term, and the rivals that this recording does not tell from it; none that is accepted for something
/// else, unless it might bend more and do both.
std::vector<Term> not_told_apart(const MeanResult& means, std::size_t t) {
  std::vector<Term> members{means.best.terms[t]};
  const auto is_near = [](const Rival& rival) {
    return rival.term && (rival.behind < odds::close_behind || rival.fits_as_well);
  };
  const bool doubt = std::ranges::any_of(means.rivals[t], is_near);
  for (const Rival& rival : means.rivals[t]) {
    if (!is_near(rival) && !(doubt && rival.term && rival.behind < not_excluded)) continue;
    const auto is_it = [&](const Term& other) { return other.mechanism == rival.term->mechanism; };
    const auto is_accepted = [&](const Term& other) {
      return is_it(other) && other.bends_freely == rival.term->bends_freely;
    };
    if (std::ranges::any_of(members, is_it) || std::ranges::any_of(means.best.terms, is_accepted)) continue;
    members.push_back(*rival.term);
  }
  return members;
}

/// Their names, and the other names of the first.
std::vector<std::string> names_of(const std::vector<Term>& members) {
  std::vector<std::string> names;
  for (const Term& term : members) names.push_back(term.mechanism->id);
  for (const std::string& same : members.front().mechanism->same_in_plane)
    if (!std::ranges::count(names, same)) names.push_back(same);
  return names;
}

/// The unnamed form that leaves a term less than sure, if that is what does.
const Shape* near_form(const MeanResult& means, std::size_t t) {
  if (means.probability[t] >= sure) return nullptr;
  const auto form = std::ranges::find_if(means.rivals[t], [](const Rival& r) { return r.shape.has_value(); });
  return form != means.rivals[t].end() && form->behind < odds::close_behind ? &*form->shape : nullptr;
}

void tell_near_form(const Findings& findings, const Term& term, const Shape& form, Explanation& out) {
  const MeanModel model(findings.reduced, findings.means.noise);
  out.unnamed_suspects.push_back(seen(form, model));
  out.notes.push_back("Nearly as probable as " + term.mechanism->id +
                      ", and no mechanism that is known here: " + describe(form, model).text + ".");
}

void tell_found(const Findings& findings, std::size_t t, Explanation& out) {
  const MeanResult& means = findings.means;
  const Term& term = means.best.terms[t];
  const Finding finding = finding_of(findings, t);
  Found found;
  found.mechanism = term.mechanism;
  found.target = finding.target;
  found.parameters = finding.parameters;
  found.probability = std::min(0.999, means.probability[t]);
  // Beside something that the catalogue does not know, no name is certain.
  if (!means.best.shapes.empty()) found.probability = std::min(not_certain, found.probability);
  found.says = term.mechanism->says(finding);
  found.evidence = evidence_of(means, t);
  found.log_likelihood_gain = means.after.log_likelihood - means.without[t].log_likelihood;
  found.rms_before_mm = means.without[t].rms_mm;
  found.rms_after_mm = means.after.rms_mm;
  out.mechanisms.push_back(found);
  KnownMechanism known{term.mechanism->id, finding.parameters, {}};
  if (!found.target.empty()) known.texts["target"] = found.target;
  out.bench.known.push_back(known);
}

}  // namespace

void tell_means(const Findings& findings, Explanation& out) {
  const MeanResult& means = findings.means;
  for (std::size_t t = 0; t < means.best.terms.size(); ++t) {
    const std::vector<Term> members = not_told_apart(means, t);
    std::vector<std::string> set = names_of(members);
    if (const Shape* form = set.size() == 1 ? near_form(means, t) : nullptr) {
      set.emplace_back(unknown_physics);
      tell_near_form(findings, means.best.terms[t], *form, out);
    }
    if (set.size() > 1) {
      out.undecided_between.push_back(set);
      out.suspects.insert(out.suspects.end(), members.begin(), members.end());
    } else if (means.probability[t] >= worth_telling) {
      tell_found(findings, t, out);
    }
  }
}

}  // namespace fit::explain::answer
