// SPDX-License-Identifier: MIT
#include "fit/explain/intensity/answer.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "fit/explain/intensity/deviations.hpp"
#include "fit/explain/intensity/places.hpp"
#include "fit/explain/intensity/rivals.hpp"
#include "fit/explain/intensity/unnamed.hpp"

namespace fit::explain::intensity {
namespace {

using Eigen::Index;
using Eigen::VectorXd;
using L = IntensityLaw;

std::string per_cent(double share) { return rounded(100 * share, 2) + " %"; }

const char* const another_law = "Echoes follow another law of intensity than the bench file claims: ";

/// Largest relative deviation that an unnamed function explains, and where.
std::pair<double, double> largest_of(const Readings& readings, const std::vector<Suspicion>& accepted,
                                     const Suspicion& s) {
  const VectorXd f = function_of(readings, accepted, s);
  Index where = 0;
  const double largest = f.cwiseAbs().maxCoeff(&where);
  return {std::expm1(largest), readings.coordinate(s.coordinate)[where]};
}

/// A law of another form: by how much, and where.
void tell_other_form(const Readings& readings, const std::vector<Suspicion>& accepted, const Suspicion& s,
                     Found& found) {
  const auto [largest, at] = largest_of(readings, accepted, s);
  found.parameters["largest_deviation"] = largest;
  found.says = another_law + ("they deviate by up to " + per_cent(largest)) +
               (s.coordinate == Coordinate::range ? ", most at " + rounded(at, 3) + " mm."
                                                  : ", most around " + rounded(at, 3) + " counts.");
}

/// Coefficients of the law that are not as stated.
void tell_coefficients(const Readings& readings, const FittedLaw& fitted, const Suspicion& s, Found& found) {
  std::string says;
  for (const int k : s.coefficients) {
    const auto c = static_cast<std::size_t>(k);
    const auto which = static_cast<L::Coefficient>(k);
    const Estimate now = in_file_unit(which, {fitted.law.value[c], fitted.u[c]});
    const Estimate said = in_file_unit(which, {readings.claim.law.value[c], readings.claim.u[c]});
    found.parameters[file_name(which)] = now;
    says += (says.empty() ? "" : ", ") + std::string(file_name(which)) + " is " + with_uncertainty(now, "") +
            " where the bench file says " + rounded(said.value, 4);
  }
  found.says = another_law + says + ".";
}

/// Standard uncertainties of the values of the accepted mechanism number t, everything else free.
std::vector<double> uncertainties_of(const Readings& readings, const std::vector<Suspicion>& accepted,
                                     std::size_t t, const FittedLaw& fitted) {
  const Suspicion& s = accepted[t];
  const std::vector<Suspicion> before(accepted.begin(), accepted.begin() + static_cast<std::ptrdiff_t>(t));
  const Index first = base_of(readings, before, fitted.expanded_at).columns.cols();
  const VectorXd u = fitted.model.uncertainties();
  std::vector<double> sigma(s.values.size(), 0);
  const std::vector<Searched> list = searched(*s.mechanism);
  for (std::size_t j = 0; j < list.size(); ++j) {
    const std::size_t k = list[j].parameter;
    const double own = u[first + static_cast<Index>(j)];
    sigma[k] = by_logarithm(s.mechanism->parameters[k]) ? own * s.values[k] : own;
  }
  return sigma;
}

void tell_mechanism(const Readings& readings, const std::vector<Suspicion>& accepted, std::size_t t,
                    const FittedLaw& fitted, Found& found) {
  const Suspicion& s = accepted[t];
  const std::vector<double> sigma = uncertainties_of(readings, accepted, t, fitted);
  Finding finding;
  for (std::size_t k = 0; k < s.mechanism->parameters.size(); ++k)
    finding.parameters[s.mechanism->parameters[k].name] = {s.values[k], sigma[k]};
  if (s.target >= 0) finding.target = readings.target(s.target).name;
  found.parameters = finding.parameters;
  found.target = finding.target;
  found.says = s.mechanism->says(finding);
}

/// How far the farthest of its coefficients is from what the file states, in the file's uncertainties.
double away_from_claim(const Readings& readings, const FittedLaw& fitted, const Suspicion& s) {
  double away = 0;
  for (const int k : s.coefficients) {
    const auto c = static_cast<std::size_t>(k);
    const double u = std::max(1e-9, readings.claim.u[c]);
    away = std::max(away, std::abs(fitted.law.value[c] - readings.claim.law.value[c]) / u);
  }
  return away;
}

std::string evidence_for(const Readings& readings, const Judgement& judgement, const Judged& judged,
                         const FittedLaw& fitted) {
  const std::string after = per_cent(judgement.after.rms);
  if (!judged.is_confirmed())
    return "The readings put it " + rounded(away_from_claim(readings, fitted, judged.suspicion), 2) +
           " of the bench file's standard uncertainties away from what the file states. They are predicted " +
           "no better with it (to " + after + "), because every fit follows them that far.";
  return "Intensities of captures it was not fitted to scatter by " + per_cent(judged.rms_without) +
         " around their prediction without it, and by " + after + " with it; it makes these e^" +
         rounded(judged.gain, 2) + " times more probable.";
}

Found found_of(const Readings& readings, const Judgement& judgement, std::size_t t, const FittedLaw& fitted) {
  const Judged& judged = judgement.judged[t];
  const Suspicion& s = judged.suspicion;
  Found found;
  found.mechanism = find_mechanism(s.name());
  found.probability = std::min(0.999, judged.probability);
  found.log_likelihood_gain = judged.gain;
  if (s.other_law())
    tell_other_form(readings, judgement.accepted, s, found);
  else if (!s.coefficients.empty())
    tell_coefficients(readings, fitted, s, found);
  else
    tell_mechanism(readings, judgement.accepted, t, fitted, found);
  found.evidence = evidence_for(readings, judgement, judged, fitted);
  return found;
}

void tell_found(const Readings& readings, const Judgement& judgement, std::size_t t, const FittedLaw& fitted,
                Explanation& out) {
  const Suspicion& s = judgement.judged[t].suspicion;
  Found found = found_of(readings, judgement, t, fitted);
  found.rms_before_mm = found.rms_after_mm = out.after.rms_mm;
  if (s.acts()) {
    KnownMechanism known{s.mechanism->id, found.parameters, {}};
    if (!found.target.empty()) known.texts["target"] = found.target;
    out.bench.known.push_back(known);
  }
  // Two spots on a window are one dirty window in the answer, and two entries in the bench.
  const bool again = std::ranges::any_of(out.mechanisms, [&](const Found& f) {
    return f.mechanism == found.mechanism && f.target == found.target;
  });
  const bool has_own_place = s.acts() && !is_of_surfaces(*s.mechanism);
  if (!again || has_own_place) out.add_beside_means(found);
  for (const Located& l : locate(readings, judgement.accepted, s, fitted.law)) out.located.push_back(l);
}

void tell_undecided(const Readings& readings, const Judgement& judgement, const Judged& judged,
                    Explanation& out) {
  std::vector<std::string> set{judged.suspicion.name()};
  for (const Suspicion& rival : judged.rivals)
    if (!std::ranges::count(set, rival.name())) set.push_back(rival.name());
  if (set.size() < 2) return;
  if (!std::ranges::count(out.undecided_between, set)) out.undecided_between.push_back(set);
  const auto add = [&](const Suspicion& s) {
    out.light_suspects.push_back(light_suspect(readings, judgement.accepted, s));
  };
  add(judged.suspicion);
  for (const Suspicion& rival : judged.rivals) add(rival);
}

std::string describe_unnamed(const Readings& readings, const std::vector<Suspicion>& accepted,
                             const Suspicion& s) {
  return "intensity deviates from the bench's law by up to " +
         per_cent(largest_of(readings, accepted, s).first) +
         (s.patch ? ", from " + rounded(s.patch->from_mm, 3) + " mm to " + rounded(s.patch->to_mm, 3) +
                        " mm from the middle"
                  : ", a smooth function of " + std::string(name_of(s.coordinate))) +
         (s.about >= 0 ? " along target '" + readings.target(s.about).name + "'" : "");
}

void tell_unknown(const Readings& readings, const std::vector<Suspicion>& accepted, const Suspicion& s,
                  Explanation& out) {
  Unexplained u;
  u.observable = Observable::intensity;
  u.coordinate = s.along();
  if (s.mechanism && u.coordinate == Coordinate::intensity) u.coordinate = Coordinate::range;
  const VectorXd at = readings.coordinate(u.coordinate);
  u.from = s.about >= 0 ? s.about : at.minCoeff();
  u.to = s.about >= 0 ? s.about + 0.1 : at.maxCoeff();
  // A named one that an unnamed function beats is described on the mechanism's coordinate.
  u.describes = s.mechanism
                    ? "intensity deviates from the bench's law along " + std::string(name_of(u.coordinate)) +
                          " in a way that resembles " + s.mechanism->id + " but follows no mechanism"
                    : describe_unnamed(readings, accepted, s);
  u.evidence = s.evidence;
  u.gain = s.gain;
  if (out.unknown)
    out.unknown->describes += "; and " + u.describes;
  else
    out.unknown = u;
  out.located.push_back(
      {u.coordinate, u.from, u.to, Observable::intensity, std::exp(-std::min(600.0, s.gain))});
}

}  // namespace

FittedLaw fitted_law(const Readings& readings, const std::vector<Suspicion>& accepted) {
  const L& claimed = readings.claim.law;
  FittedLaw fitted{claimed, {}, claimed, model_of(readings, accepted)};
  for (int pass = 0; pass < 5; ++pass) {  // the logarithm of an overlap bends
    if (pass > 0) {
      fitted.expanded_at = fitted.law;
      fitted.model = model_of(readings, accepted, fitted.law);
    }
    const VectorXd x = fitted.model.coefficients(), u = fitted.model.uncertainties();
    for (int k = 0; k < L::size; ++k) {
      const auto c = static_cast<std::size_t>(k);
      fitted.law.value[c] = claimed.value[c] + std::clamp(x[k], -2.0, 2.0);
      fitted.u[c] = u[k] > 1e-5 ? u[k] : 0;
    }
  }
  return fitted;
}

void tell_findings(const Readings& readings, const Judgement& judgement, const FittedLaw& fitted,
                   Explanation& out) {
  for (std::size_t t = 0; t < judgement.judged.size(); ++t) {
    const Judged& judged = judgement.judged[t];
    if (judged.unknown)
      tell_unknown(readings, judgement.accepted, judged.suspicion, out);
    else if (!judged.rivals.empty())
      tell_undecided(readings, judgement, judged, out);
    else if (judged.is_found())
      tell_found(readings, judgement, t, fitted, out);
  }
}

void add_notes(const Readings& readings, const Judgement& judgement, Explanation& out) {
  out.notes.push_back("Intensities are compared with the bench's radiometry: held out, they scatter by " +
                      per_cent(judgement.before.rms) + " before and " + per_cent(judgement.after.rms) +
                      " after; neighbouring beams scatter by " + per_cent(readings.scatter) + ".");
  if (readings.excess > 1.5)
    out.notes.push_back("Intensities of neighbouring beams deviate together, " +
                        rounded(std::sqrt(readings.excess), 2) +
                        " times more than their scatter says; everything was weighed accordingly.");
}

}  // namespace fit::explain::intensity
