// SPDX-License-Identifier: MIT
#include "fit/explain/inference/explain.hpp"

#include <algorithm>
#include <cmath>

#include "fit/explain/inference/curves.hpp"
#include "fit/explain/inference/hold_out.hpp"
#include "fit/explain/inference/numbers.hpp"
#include "fit/explain/inference/settle.hpp"
#include "fit/explain/stated_noise.hpp"

namespace fit::explain::inference {
namespace {

using Eigen::Index;

bool is_of_means(const Kind& kind) { return moves_means(*kind.mechanism); }

/// As the rooms that draw, predict and plan know it.
explain::Term as_term(const Term& term) {
  return {term.kind->mechanism.get(), term.kind->target, term.values, term.sigma};
}

Shape as_shape(const Term& term) {
  Shape shape = *term.kind->form;
  const std::size_t count = term.kind->coefficients.size();
  shape.values.assign(term.values.begin(), term.values.begin() + static_cast<std::ptrdiff_t>(count));
  shape.at = term.values[count];
  shape.length = term.values[count + 1];
  return shape;
}

double noise_floor(const Reduced& reduced, const MeanNoise& noise) {
  const Reduced rows = merged(reduced, numbers::search_rows);  // as the channel has them
  const MeanModel model(rows, noise);
  double sum = 0;
  for (Index i = 0; i < model.rows(); ++i) sum += model.variance_of_mean(i);
  return std::sqrt(sum / std::max<double>(1, static_cast<double>(model.rows())));
}

/// The constant variance is the first coefficient of its channel; a mechanism that adds to it is the same.
double constant_noise_of(const Session& session, const Hypothesis& best) {
  double variance = 0;
  const std::size_t c = model::channel_of("variance");
  if (session.channels()[c]) variance += best.base[session.first_base(c)];
  for (const Term& term : best.terms)
    if (is_constant_noise(*term.kind->mechanism)) variance += std::pow(term.values.front(), 2);
  return std::sqrt(std::max(0.0, variance));
}

Fitted without_term(const Session& session, const Hypothesis& h, const Kind* kind) {
  Hypothesis less;
  for (const Term& term : h.terms)
    if (term.kind != kind) less.terms.push_back(term);
  return fit(session, less);
}

void measure(const Session& session, const Explored& explored, Inferred& out) {
  const Hypothesis& best = explored.best.hypothesis;
  out.means.after = hold_out(session, explored.best);
  const Fitted nothing = fit(session, {});
  out.means.before = hold_out(session, nothing);
  out.curves = curves_of(session, nothing, explored.best, out.posterior);
  for (const auto* list : {&out.posterior.named, &out.posterior.forms})
    for (const Named& named : *list) {
      const HeldOutFigures without = hold_out(session, without_term(session, best, named.term.kind));
      out.gain.push_back(out.means.after.log_likelihood - without.log_likelihood);
    }
}

/// The best hypothesis as far as means go; of undecided sets, the best member.
void take_means(const Session& session, const Hypothesis& best, MeanResult& means) {
  means.best.nuisance = session.nuisance(best);
  for (const Term& term : best.terms) {
    if (!is_of_means(*term.kind)) continue;
    if (term.kind->is_form()) {
      means.best.shapes.push_back(as_shape(term));
      continue;
    }
    means.best.terms.push_back(as_term(term));
  }
}

}  // namespace

Inferred infer(Reduced& reduced, const MeanNoise& noise, const Progress& progress) {
  Inferred out{nullptr, {}, MeanResult(reduced.bench), 0, {}, {}};
  out.means.excess = settle(reduced, noise);
  out.means.noise = noise;
  out.means.noise.factor *= out.means.excess;
  Session session(reduced, out.means.noise);
  out.kinds = session.shared_kinds();
  const Explored explored = explore(session, progress);
  out.posterior = posterior_of(explored);
  out.means.noise = session.noise();
  take_means(session, explored.best.hypothesis, out.means);
  measure(session, explored, out);
  out.sigma_mm = constant_noise_of(session, explored.best.hypothesis);
  out.means.noise_floor_mm = noise_floor(reduced, out.means.noise);
  return out;
}

}  // namespace fit::explain::inference
