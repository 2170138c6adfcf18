// SPDX-License-Identifier: MIT
#include "fit/explain/model/hypothesis.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "fit/explain/scene/stated_noise.hpp"

namespace fit::explain {

bool moves_means(const Mechanism& m) {
  return m.observable == Observable::range_mean && m.coordinate != Coordinate::scan_seq;
}

void predict_at(Reduced& reduced, const Hypothesis& h, bool may_leave_out) {
  predict(reduced, h.nuisance, all_at_work(reduced.bench, h), may_leave_out);
}

std::vector<Active> all_at_work(const Bench& bench, const Hypothesis& h) {
  std::vector<Active> list = h.terms;
  std::ranges::move(known_terms(bench), std::back_inserter(list));
  return list;
}

std::vector<Active> known_effects(const Bench& bench) {
  std::vector<Active> list = known_to_be_at_work(bench);
  std::erase_if(list, [](const Active& known) { return is_constant_noise(*known.mechanism); });
  return list;
}

double variance_of_sample(const std::vector<Active>& at_work, const Cell& cell) {
  const Effect all = effect_of(at_work, cell.at);
  const double step_mm = std::max(1.0, all.output_step_mm);
  return all.variance_mm2 +
         std::pow(cell.sight.beam_sensitivity(), 2) *
             (all.scan_angle_variance_rad2 + all.beam_angle_variance_rad2) +
         (step_mm * step_mm - 1) * rounding_mm2;
}

std::vector<Active> known_terms(const Bench& bench) {
  std::vector<Active> list = known_effects(bench);
  std::erase_if(list,
                [](const Active& known) { return known.mechanism->coordinate == Coordinate::scan_seq; });
  return list;
}

Columns nuisance_columns(const MeanModel& model, const Nuisance& there) {
  const Nuisance stated(model.bench());
  return {model.nuisance_columns(),
          {stated.as_vector() - there.as_vector(), Nuisance::prior_sigma(model.bench())}};
}

Base base_columns(const MeanModel& model, const Hypothesis& h) {
  Base base;
  base.all = nuisance_columns(model, h.nuisance);
  base.all.append(uncertainty_columns(model, known_terms(model.bench())));
  for (const Active& term : h.terms) {
    TermColumns c = columns_of(model, term);
    Prior& prior = c.sizes.prior;
    // A coefficient that is expected to be something does not become certain by being just that.
    double ratio = prior.mean.isZero() ? 1e-4 : 1;
    for (Eigen::Index k = 0; k < c.at.size(); ++k)
      ratio = std::max(ratio, 1.2 * std::abs(c.at[k] - prior.mean[k]) / prior.sigma[k]);
    prior.mean -= c.at;
    prior.sigma *= ratio;
    base.term_first.push_back(base.all.columns.cols());
    base.term_count.push_back(c.sizes.columns.cols() + c.shapes.columns.cols());
    base.all.append(c.sizes);
    base.all.append(c.shapes);
    base.all.append(c.deviations);
  }
  for (const Shape& shape : h.shapes) {
    base.shape_first.push_back(base.all.columns.cols());
    base.all.append(columns_of(model, shape));
  }
  base.shape_first.push_back(base.all.columns.cols());
  return base;
}

Eigen::VectorXd bend_of(const Base& base, const Eigen::VectorXd& coefficients, std::size_t term) {
  const Eigen::Index from = base.term_first[term] + base.term_count[term],
                     to = term + 1 < base.term_first.size() ? base.term_first[term + 1]
                                                            : base.shape_first.front();
  return base.all.columns.middleCols(from, to - from) * coefficients.segment(from, to - from);
}

MeanModel model_of(const Reduced& reduced, const MeanNoise& noise, const Hypothesis& h) {
  MeanModel model(reduced, noise);
  Base base = base_columns(model, h);
  model.set_base(std::move(base.all.columns), base.all.prior);
  return model;
}

void fit_nuisances(Reduced& reduced, const MeanNoise& noise, int passes, Hypothesis& hypothesis) {
  for (int pass = 0; pass < passes; ++pass) {
    predict_at(reduced, hypothesis);
    const Eigen::VectorXd now = hypothesis.nuisance.as_vector();
    hypothesis.nuisance.set(now + model_of(reduced, noise, hypothesis).posterior_mean().head(now.size()));
  }
  predict_at(reduced, hypothesis);
}

}  // namespace fit::explain
