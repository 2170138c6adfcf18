// SPDX-License-Identifier: MIT
#include "fit/explain/unnamed.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "fit/find_by_id.hpp"
#include "fit/linear_table.hpp"

namespace fit::explain {
namespace forms {
std::vector<Form> all();
}
namespace {

/// Where unnamed physics may act, and on what.
struct Place {
  Coordinate coordinate;
  Channel channel;
};
constexpr Place places[] = {
    {Coordinate::beam, Channel::range},       {Coordinate::beam, Channel::beam_angle},
    {Coordinate::stage, Channel::range},      {Coordinate::stage, Channel::stage_angle},
    {Coordinate::range, Channel::range},      {Coordinate::intensity, Channel::range},
    {Coordinate::incidence, Channel::range},  {Coordinate::time, Channel::range},
    {Coordinate::time, Channel::stage_angle}, {Coordinate::temperature, Channel::range}};

std::vector<double> quantiles(const MeanModel& model, Coordinate coordinate, int count) {
  std::vector<double> values;
  for (Eigen::Index i = 0; i < model.rows(); i += std::max<Eigen::Index>(1, model.rows() / 4000)) {
    const double v = coordinate_at(model, coordinate, i);
    if (std::isfinite(v)) values.push_back(v);
  }
  std::vector<double> list;
  if (values.empty()) return list;
  std::ranges::sort(values);
  for (int q = 1; q < count; ++q) {
    const std::size_t i = values.size() * static_cast<std::size_t>(q) / static_cast<std::size_t>(count);
    const double v = values[i];
    double next = v;
    for (std::size_t j = i; j < values.size() && next <= v; ++j) next = values[j];
    const double middle = (v + next) / 2;
    if (next > v && (list.empty() || middle > list.back() + 1e-9)) list.push_back(middle);
  }
  return list;
}

Axis axis_of(const MeanModel& model, const Place& place) {
  constexpr std::size_t most = 400;
  constexpr int parts = 40;
  Axis axis{place.coordinate, place.channel, 1e300, -1e300, 0, {}};
  std::set<double> values;
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const double v = coordinate_at(model, place.coordinate, i);
    if (!std::isfinite(v)) continue;
    axis.low = std::min(axis.low, v);
    axis.high = std::max(axis.high, v);
    if (values.size() < most) values.insert(v);
  }
  axis.values = values.size();
  axis.between = quantiles(model, place.coordinate, parts);
  return axis;
}

Course course_of(const Shape& shape, const MeanModel& model) {
  const bool angle = shape.channel != Channel::range;
  Course course;
  course.what = shape.channel == Channel::range        ? "range"
                : shape.channel == Channel::beam_angle ? "beam angle"
                                                       : "stage angle";
  course.unit = angle ? " deg" : " mm";
  course.scale = angle ? deg_per_rad : 1;
  course.coordinate = name_of(shape.coordinate);
  course.unit_of_coordinate = unit_of(shape.coordinate);
  course.low = course.least = 1e300;
  course.high = course.most = -1e300;
  const Eigen::VectorXd effect = effect_of(model, shape);
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const double v = coordinate_at(model, shape.coordinate, i);
    if (!std::isfinite(v)) continue;
    course.low = std::min(course.low, v);
    course.high = std::max(course.high, v);
    const double lever = lever_of(shape.channel, model.cell(i).sight);
    if (std::abs(lever) < (angle ? 100 : 0.5)) continue;  // says little about the function
    const double y = effect[i] / lever;
    if (y < course.least) course.least = y, course.least_at = v;
    if (y > course.most) course.most = y, course.most_at = v;
  }
  return course;
}

}  // namespace

const std::vector<Form>& all_forms() {
  static const std::vector<Form> list = forms::all();
  return list;
}

const Form* find_form(const std::string& id) { return find_by_id(all_forms(), id); }

Columns columns_of(const MeanModel& model, const Shape& shape) {
  const Form& form = *shape.form;
  const Eigen::Index n = model.rows(), terms = form.terms(shape);
  Eigen::VectorXd x;
  if (form.scaled) x = scaled_coordinate(model, shape.coordinate);
  Columns c;
  c.columns_mm.resize(n, terms);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double v = coordinate_at(model, shape.coordinate, i),
                 lever = lever_of(shape.channel, model.cell(i).sight);
    for (Eigen::Index k = 0; k < terms; ++k)
      c.columns_mm(i, k) =
          std::isfinite(v) ? lever * form.basis(shape, form.scaled ? x[i] : v, static_cast<int>(k)) : 0;
  }
  c.prior.mean = Eigen::VectorXd::Zero(terms);
  c.prior.sigma = Eigen::VectorXd::Constant(terms, shape.size);
  if (form.shares) {
    const std::vector<double> shares = form.shares(shape);
    for (Eigen::Index k = 0; k < terms; ++k) c.prior.sigma[k] *= shares[static_cast<std::size_t>(k)];
  }
  return c;
}

Eigen::VectorXd effect_of(const MeanModel& model, const Shape& shape) {
  return columns_of(model, shape).columns_mm *
         Eigen::Map<const Eigen::VectorXd>(shape.values.data(),
                                           static_cast<Eigen::Index>(shape.values.size()));
}

SeenShape seen(const Shape& shape, const MeanModel& model) {
  SeenShape seen{shape, {}, {}};
  if (!shape.form->scaled) return seen;
  const Eigen::VectorXd scaled = scaled_coordinate(model, shape.coordinate);
  std::map<double, double> curve;
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const double at = coordinate_at(model, shape.coordinate, i);
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
    if (const double at = coordinate_at(model, seen.shape.coordinate, i); std::isfinite(at))
      effect[i] = lever_of(seen.shape.channel, model.cell(i).sight) * linear_in(seen.at, seen.value, at);
  return effect;
}

Columns columns_of(const MeanModel& model, const SeenShape& seen) {
  Shape shape = seen.shape;
  if (!seen.at.empty()) {
    const double then = seen.at.back() - seen.at.front();
    double low = seen.at.front(), high = seen.at.back();
    for (Eigen::Index i = 0; i < model.rows(); ++i) {
      const double at = coordinate_at(model, shape.coordinate, i);
      if (!std::isfinite(at)) continue;
      low = std::min(low, at);
      high = std::max(high, at);
    }
    shape.length *= then / std::max(1e-9, high - low);
  }
  return columns_of(model, shape);
}

std::vector<Shape> forms_to_try(const MeanModel& model) {
  constexpr std::size_t fewest_values = 4;
  std::vector<Shape> list;
  for (const Place& place : places) {
    const Axis axis = axis_of(model, place);
    if (!(axis.high - axis.low > 1e-6) || axis.values < fewest_values) continue;
    for (const Form& form : all_forms())
      for (Shape& shape : form.along(axis)) {
        shape.form = &form;
        shape.coordinate = axis.coordinate;
        shape.channel = axis.channel;
        shape.price += price_of_scale(1, 1);
        list.push_back(std::move(shape));
      }
  }
  return list;
}

Described describe(const Shape& shape, const MeanModel& model) {
  return shape.form->says(shape, course_of(shape, model));
}

}  // namespace fit::explain
