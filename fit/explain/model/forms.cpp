// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "fit/explain/inference/numbers.hpp"
#include "fit/explain/model/scale.hpp"
#include "fit/explain/model/term.hpp"

namespace fit::explain::model {
namespace {

using Eigen::Index;

/// What a form changes.
enum class Act {
  range,
  beam_angle,
  stage_angle,
  variance,
  scan_range,
  own_range,
  loss,
  stray,
  late,
  early,
  intensity
};

/// As the rooms that draw forms of means know it.
explain::Channel channel_of(Act on) {
  return on == Act::beam_angle    ? explain::Channel::beam_angle
         : on == Act::stage_angle ? explain::Channel::stage_angle
                                  : explain::Channel::range;
}

/// A coordinate along which unnamed physics may act, and on what.
struct Way {
  Coordinate coordinate;
  Act on;
  int target = -1;  ///< Along this one, if it is one's; or all of them.
  [[nodiscard]] double place_of(const Circumstances& at) const {
    return model::place_of(coordinate, target, at);
  }
};
// Of range and brightness another intensity would be another law, which has a name.
constexpr Way ways[] = {
    {Coordinate::beam, Act::range},         {Coordinate::beam, Act::beam_angle},
    {Coordinate::stage, Act::range},        {Coordinate::stage, Act::stage_angle},
    {Coordinate::range, Act::range},        {Coordinate::intensity, Act::range},
    {Coordinate::incidence, Act::range},    {Coordinate::time, Act::range},
    {Coordinate::time, Act::stage_angle},   {Coordinate::temperature, Act::range},
    {Coordinate::beam, Act::variance},      {Coordinate::range, Act::variance},
    {Coordinate::intensity, Act::variance}, {Coordinate::time, Act::variance},
    {Coordinate::incidence, Act::variance}, {Coordinate::beam, Act::loss},
    {Coordinate::range, Act::loss},         {Coordinate::time, Act::loss},
    {Coordinate::beam, Act::stray},         {Coordinate::time, Act::stray},
    {Coordinate::scan_seq, Act::range},     {Coordinate::scan_seq, Act::scan_range},
    {Coordinate::beam, Act::own_range},     {Coordinate::stage, Act::variance},
    {Coordinate::target, Act::loss},        {Coordinate::target, Act::late},
    {Coordinate::target, Act::early},       {Coordinate::beam, Act::intensity},
    {Coordinate::stage, Act::intensity},    {Coordinate::incidence, Act::intensity},
    {Coordinate::time, Act::intensity},
};
/// Along every target by itself: what a surface does at its place.
constexpr Act along_targets[] = {Act::intensity, Act::range};

Observable observable_of(Act on) {
  return on == Act::variance || on == Act::scan_range || on == Act::own_range ? Observable::range_variance
         : on == Act::loss                                                    ? Observable::dropout
         : on == Act::intensity                                               ? Observable::intensity
         : on == Act::stray || on == Act::late || on == Act::early            ? Observable::range_distribution
                                                                              : Observable::range_mean;
}

double typical_of(Act on) {
  switch (on) {
    case Act::range:
      return numbers::form_mm;
    case Act::beam_angle:
    case Act::stage_angle:
      return numbers::form_deg * rad_per_deg;
    case Act::variance:
    case Act::scan_range:
    case Act::own_range:
      return numbers::form_mm2;
    case Act::intensity:
      return numbers::form_log_intensity;
    default:
      return numbers::form_share;
  }
}

double Effect::*changed_by(Act on) {
  switch (on) {
    case Act::range:
      return &Effect::range_mm;
    case Act::beam_angle:
      return &Effect::beam_rad;
    case Act::stage_angle:
      return &Effect::stage_rad;
    case Act::variance:
      return &Effect::variance_mm2;
    case Act::scan_range:
      return &Effect::scan_range_variance_mm2;
    case Act::own_range:
      return &Effect::own_range_variance_mm2;
    case Act::loss:
      return &Effect::lost;
    case Act::late:
      return &Effect::late;
    case Act::early:
      return &Effect::early;
    case Act::intensity:
      return &Effect::log_intensity;
    default:
      return &Effect::stray;
  }
}

Effect effect_on(Act on, double value) {
  Effect effect;
  effect.*changed_by(on) = value;
  return effect;
}

const char* in_words(Act on) {
  switch (on) {
    case Act::variance:
      return "samples' variance";
    case Act::scan_range:
      return "variance of the range that a whole scan has in common";
    case Act::own_range:
      return "variance of what every beam reads off by its own, in all captures alike,";
    case Act::loss:
      return "share of lost echoes";
    case Act::intensity:
      return "logarithm of intensity over the bench file's law";
    case Act::stray:
      return "share of samples far off";
    case Act::late:
      return "share of samples that come late, in a tail beyond what noise and strays make,";
    case Act::early:
      return "share of samples that come early, in a tail before what noise and strays make,";
    default:
      return "range";
  }
}

Axis axis_of_rows(const Scale& scale, const Way& way) {
  constexpr std::size_t most = 400, parts = 40;
  Axis axis;
  axis.coordinate = way.coordinate;
  axis.channel = channel_of(way.on);
  axis.expects_nothing = way.on == Act::scan_range || way.on == Act::own_range ||
                         (way.coordinate == Coordinate::target && way.target == -1);
  const std::vector<double>& v = scale.sorted();
  axis.low = v.front();
  axis.high = v.back();
  std::set<double> values;
  for (const double one : v)
    if (values.size() < most) values.insert(one);
  axis.values = values.size();
  for (std::size_t q = 1; q < parts; ++q) {
    const double at = v[v.size() * q / parts];
    const auto next = std::ranges::upper_bound(v, at);
    if (next == v.end()) break;
    const double middle = (at + *next) / 2;
    if (axis.between.empty() || middle > axis.between.back()) axis.between.push_back(middle);
  }
  return axis;
}

/// The functions of a form like that one, where it has a place; values: coefficients, place and length.
template <class See>
void for_each_function(const Form& form, const Way& way, const Shape& like, const Scale& scale,
                       const Circumstances& at, std::span<const double> values, const See& see) {
  const double v = way.place_of(at);
  if (!std::isfinite(v)) return;
  const std::size_t terms = values.size() - 2;
  Shape shape = like;
  shape.at = values[terms];
  shape.length = values[terms + 1];
  const double x = form.scaled ? scale(v) : v;
  for (std::size_t k = 0; k < terms; ++k) see(static_cast<int>(k), form.basis(shape, x, static_cast<int>(k)));
}

/// A form with so many coefficients as a mechanism: these, its place and its length.
std::shared_ptr<const Mechanism> mechanism_of(const Form& form, const Way& way, const Shape& like,
                                              const std::shared_ptr<const Scale>& scale) {
  auto m = std::make_shared<Mechanism>();
  m->id = form.id + " of " + name_of(way.coordinate);
  m->coordinate = way.coordinate;
  m->observable = observable_of(way.on);
  m->formula_error = 0;
  const int terms = form.terms(like);
  std::vector<double> shares(static_cast<std::size_t>(terms), 1.0);
  if (form.shares) shares = form.shares(like);
  const bool only_more = form.is_constant;  // than nothing
  for (int k = 0; k < terms; ++k)
    m->parameters.push_back({.name = "c" + std::to_string(k),
                             .typical = typical_of(way.on) * shares[static_cast<std::size_t>(k)],
                             .sign = only_more ? 1 : 0});
  for (const char* name : {"at", "length"})
    m->parameters.push_back({.name = name, .role = Parameter::Role::shape, .lower = 0, .upper = 0});
  m->act = [&form, way, like, scale](const Circumstances& at, std::span<const double> p) {
    double sum = 0;
    for_each_function(form, way, like, *scale, at, p,
                      [&](int k, double value) { sum += p[static_cast<std::size_t>(k)] * value; });
    return effect_on(way.on, sum);
  };
  return m;
}

Kind::Functions functions_of(const Form& form, const Way& way, const Shape& like,
                             const std::shared_ptr<const Scale>& scale) {
  const auto at = [&form, way, like, scale](const Circumstances& c, const std::vector<double>& values,
                                            Eigen::VectorXd& each) {
    for_each_function(form, way, like, *scale, c, values, [&](int k, double value) { each[k] = value; });
  };
  return {changed_by(way.on), at};
}

bool responds(const ChannelRows& rows, Act on) {
  const Index step = std::max<Index>(1, rows.rows() / 50);
  for (Index i = 0; i < rows.rows(); i += step)
    if (rows.response(i, effect_on(on, 1)) != 0) return true;
  return false;
}

/// Forms along one way, those with as many coefficients together.
void add_forms_along(const Way& way, const ChannelRows& rows, std::vector<Kind>& kinds) {
  constexpr std::size_t fewest_values = 4;
  std::vector<double> values;
  for (Index i = 0; i < rows.rows(); ++i)
    if (const double v = way.place_of(rows.at(i)); std::isfinite(v)) values.push_back(v);
  if (values.empty()) return;
  const auto scale = std::make_shared<const Scale>(std::move(values), Scale::may_crowd(way.coordinate));
  const Axis axis = axis_of_rows(*scale, way);
  const bool varies = (way.coordinate != Coordinate::target || way.target != -1) &&
                      axis.high - axis.low > 1e-6 && axis.values >= fewest_values;
  for (const Form& form : all_forms()) {
    if ((!varies && !form.is_constant) || (way.target != -1 && form.is_constant)) continue;
    if (form.of_all_targets != (way.target == all_targets)) continue;
    std::map<int, std::vector<Shape>> by_terms;
    for (Shape& shape : form.along(axis)) {
      shape.form = &form;
      shape.coordinate = way.coordinate;
      shape.channel = channel_of(way.on);
      shape.target = way.target;
      shape.size = typical_of(way.on);
      by_terms[form.terms(shape)].push_back(shape);
    }
    for (const auto& [terms, shapes] : by_terms) {
      Kind kind;
      kind.form = shapes.front();
      kind.target = std::max(-1, way.target);
      kind.observable = observable_of(way.on);
      kind.mechanism = mechanism_of(form, way, shapes.front(), scale);
      kind.functions = functions_of(form, way, shapes.front(), scale);
      kind.refines = false;
      kind.acts_on = in_words(way.on);
      kind.coefficients = coefficients_of(*kind.mechanism, [](std::size_t) { return 1; });
      for (const Shape& shape : shapes) {
        std::vector<double> start;
        for (const Parameter& p : kind.mechanism->parameters) start.push_back(p.typical);
        start[start.size() - 2] = shape.at;
        start[start.size() - 1] = shape.length;
        kind.starts.push_back(std::move(start));
      }
      kinds.push_back(std::move(kind));
    }
  }
}

/// Of losses and strays of which there is none nothing has a course.
bool shows_anything(const ChannelRows& rows) {
  for (Index i = 0; i < rows.rows(); ++i)
    if (rows.statistic(i) != 0) return true;
  return false;
}

}  // namespace

void add_forms(const std::vector<ChannelKind>& what,
               const std::vector<std::unique_ptr<ChannelRows>>& channels, std::vector<Kind>& kinds) {
  const std::size_t named = kinds.size();
  for (std::size_t c = 0; c < channels.size(); ++c) {
    const auto acts_here = [&](Act on) {
      return channels[c] && what[c].has_forms && what[c].observable == observable_of(on) &&
             responds(*channels[c], on) && shows_anything(*channels[c]);
    };
    for (const Way& way : ways)
      if (acts_here(way.on) && channels[c]->sees(way.coordinate)) add_forms_along(way, *channels[c], kinds);
    for (const Act on : along_targets) {
      if (!acts_here(on)) continue;
      std::set<int> targets;  // which share the prior of one
      for (Index i = 0; i < channels[c]->rows(); ++i) targets.insert(channels[c]->at(i).target);
      const std::size_t before = kinds.size();
      for (const int target : targets) add_forms_along({Coordinate::target, on, target}, *channels[c], kinds);
      for (std::size_t k = before; k < kinds.size(); ++k)
        kinds[k].log_prior = -std::log(static_cast<double>(targets.size()));
      if (on == Act::range) add_forms_along({Coordinate::target, on, all_targets}, *channels[c], kinds);
    }
  }
  double count = 0;
  for (std::size_t k = named; k < kinds.size(); ++k) count += std::exp(kinds[k].log_prior);
  for (std::size_t k = named; k < kinds.size(); ++k)
    kinds[k].log_prior += std::log(numbers::forms_expected / count);
}

}  // namespace fit::explain::model
