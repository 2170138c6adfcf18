// SPDX-License-Identifier: MIT
#include "fit/explain/model/unnamed.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "fit/find_by_id.hpp"
#include "fit/numeric/linear_table.hpp"

namespace fit::explain {
namespace forms {
std::vector<Form> all();
}
namespace {

Course course_of(const Shape& shape, const MeanModel& model) {
  const ChannelInWords& channel = in_words_of(shape.channel);
  Course course;
  course.what = channel.what;
  course.unit = channel.unit;
  course.scale = channel.in_unit;
  const bool of_places = shape.is_along_one_target() || shape.target == all_targets;
  course.coordinate = of_places ? place_along(model.bench(), shape.target) : name_of(shape.coordinate);
  course.unit_of_coordinate = shape.is_along_one_target() ? " mm" : unit_of(shape.coordinate);
  if (shape.target >= 0) course.target = model.bench().target_at(shape.target).name;
  const Eigen::VectorXd effect = effect_of(model, shape);
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const double v = coordinate_at(model, shape.coordinate, i, shape.target);
    if (!std::isfinite(v)) continue;
    course.add(v);
    const double sensitivity = sensitivity_of(shape.channel, model.cell(i).sight);
    if (std::abs(sensitivity) < channel.least_sensitivity) continue;  // says little about the function
    course.add_value(v, effect[i] / sensitivity);
  }
  return course;
}

}  // namespace

std::string Course::in_words(const Estimate& estimate) const {
  return with_uncertainty({estimate.value * scale, estimate.u * scale},
                          unit.starts_with(' ') ? unit.substr(1) : unit);
}

const std::vector<Form>& all_forms() {
  static const std::vector<Form> list = forms::all();
  return list;
}

std::vector<int> along_targets(const Shape& shape, const Bench& bench) {
  if (shape.target != all_targets) return {shape.target};
  std::vector<int> all(bench.targets.size());
  std::iota(all.begin(), all.end(), 0);
  return all;
}

Columns columns_of(const MeanModel& model, const Shape& shape) {
  const Form& form = *shape.form;
  const Eigen::Index n = model.rows(), terms = form.terms(shape);
  Eigen::VectorXd x;
  if (form.scaled) x = scaled_coordinate(model, shape.coordinate, shape.target);
  Columns c;
  c.columns.resize(n, terms);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double v = coordinate_at(model, shape.coordinate, i, shape.target),
                 sensitivity = sensitivity_of(shape.channel, model.cell(i).sight);
    for (Eigen::Index k = 0; k < terms; ++k)
      c.columns(i, k) =
          std::isfinite(v) ? sensitivity * form.basis(shape, form.scaled ? x[i] : v, static_cast<int>(k)) : 0;
  }
  c.prior = Prior::around_zero(terms, shape.size);
  if (form.shares) {
    const std::vector<double> shares = form.shares(shape);
    for (Eigen::Index k = 0; k < terms; ++k) c.prior.sigma[k] *= shares[static_cast<std::size_t>(k)];
  }
  return c;
}

Eigen::VectorXd effect_of(const MeanModel& model, const Shape& shape) {
  return columns_of(model, shape).columns *
         Eigen::Map<const Eigen::VectorXd>(shape.values.data(),
                                           static_cast<Eigen::Index>(shape.values.size()));
}

SeenShape seen(const Shape& shape, const MeanModel& model) {
  SeenShape seen{shape, {}, {}};
  if (!shape.form->scaled) return seen;
  const Eigen::VectorXd scaled = scaled_coordinate(model, shape.coordinate, shape.target);
  std::map<double, double> curve;
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const double at = coordinate_at(model, shape.coordinate, i, shape.target);
    if (!std::isfinite(at) || curve.contains(at)) continue;
    double& value = curve[at];
    for (std::size_t k = 0; k < shape.values.size(); ++k)
      value += shape.values[k] * shape.form->basis(shape, scaled[i], static_cast<int>(k));
  }
  for (const auto& [at, value] : curve) {
    seen.at.push_back(at);
    seen.value.push_back(value);
  }
  return seen;
}

Eigen::VectorXd effect_of(const MeanModel& model, const SeenShape& seen) {
  if (seen.at.empty()) return effect_of(model, seen.shape);
  Eigen::VectorXd effect = Eigen::VectorXd::Zero(model.rows());
  for (Eigen::Index i = 0; i < model.rows(); ++i)
    if (const double at = coordinate_at(model, seen.shape.coordinate, i, seen.shape.target);
        std::isfinite(at))
      effect[i] =
          sensitivity_of(seen.shape.channel, model.cell(i).sight) * linear_in(seen.at, seen.value, at);
  return effect;
}

Columns columns_of(const MeanModel& model, const SeenShape& seen) {
  Shape shape = seen.shape;
  if (!seen.at.empty()) {
    const double then = seen.at.back() - seen.at.front();
    Extent now{seen.at.front(), seen.at.back()};
    for (Eigen::Index i = 0; i < model.rows(); ++i)
      now.add(coordinate_at(model, shape.coordinate, i, shape.target));
    shape.length *= then / std::max(1e-9, now.length());
  }
  return columns_of(model, shape);
}

Described describe(const Shape& shape, const MeanModel& model) {
  return shape.form->says(shape, course_of(shape, model));
}

}  // namespace fit::explain
