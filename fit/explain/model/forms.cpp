// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "fit/explain/model/scale.hpp"
#include "fit/explain/model/term.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain::model {
namespace {

using Eigen::Index;

/// What a form changes.
struct Act {
  double Effect::*changes;
  Observable observable;
  double typical;
  const char* in_words;
  explain::Channel channel = explain::Channel::range;  ///< As the rooms that draw forms of means know it.
  bool expects_nothing = false;                        ///< To be there at all is something.
  bool is_share = false;                               ///< Of what is there, without a unit.

  [[nodiscard]] Effect by(double value) const {
    Effect effect;
    effect.*changes = value;
    return effect;
  }
};
constexpr double form_rad = numbers::form_deg * rad_per_deg;
constexpr Act on_range{&Effect::range_mm, Observable::range_mean, numbers::form_mm, "range"};
constexpr Act on_scale{&Effect::range_mm, Observable::range_mean, numbers::form_scale, "range's scale",
                       explain::Channel::range_scale};
constexpr Act on_place{&Effect::range_mm, Observable::range_mean, numbers::form_mm, "place",
                       explain::Channel::place};
constexpr Act on_beam_angle{&Effect::beam_rad, Observable::range_mean, form_rad, "beam angle",
                            explain::Channel::beam_angle};
constexpr Act on_stage_angle{&Effect::stage_rad, Observable::range_mean, form_rad, "stage angle",
                             explain::Channel::stage_angle};
constexpr Act on_variance{&Effect::variance_mm2, Observable::range_variance, numbers::form_mm2,
                          "samples' variance"};
constexpr Act on_scan_range{&Effect::scan_range_variance_mm2,
                            Observable::range_variance,
                            numbers::form_mm2,
                            "variance of the range that a whole scan has in common",
                            explain::Channel::range,
                            true};
constexpr Act on_shared_noise{&Effect::shared_by_neighbours,
                              Observable::range_variance,
                              numbers::form_inflation,
                              "extra variance of sums over neighbouring beams, which share noise, as a share "
                              "of what independent noise makes,",
                              explain::Channel::range,
                              true,
                              true};
constexpr Act on_own_range{&Effect::own_range_variance_mm2,
                           Observable::range_variance,
                           numbers::form_mm2,
                           "variance of what every beam reads off by its own, in all captures alike,",
                           explain::Channel::range,
                           true};
constexpr Act on_loss{&Effect::lost, Observable::dropout, numbers::form_share, "share of lost echoes"};
constexpr Act on_stray{&Effect::stray, Observable::range_distribution, numbers::form_share,
                       "share of samples far off"};
constexpr Act on_late{&Effect::late, Observable::range_distribution, numbers::form_share,
                      "share of samples that come late, in a tail beyond what noise and strays make,"};
constexpr Act on_early{&Effect::early, Observable::range_distribution, numbers::form_share,
                       "share of samples that come early, in a tail before what noise and strays make,"};
constexpr Act on_intensity{&Effect::log_intensity, Observable::intensity, numbers::form_log_intensity,
                           "logarithm of intensity over the bench file's law"};

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
    {Coordinate::beam, on_range},
    {Coordinate::beam, on_scale},
    {Coordinate::time, on_scale},
    {Coordinate::beam, on_beam_angle},
    {Coordinate::stage, on_range},
    {Coordinate::stage, on_stage_angle},
    {Coordinate::range, on_range},
    {Coordinate::intensity, on_range},
    {Coordinate::incidence, on_range},
    {Coordinate::time, on_range},
    {Coordinate::time, on_stage_angle},
    {Coordinate::temperature, on_range},
    {Coordinate::beam, on_variance},
    {Coordinate::range, on_variance},
    {Coordinate::intensity, on_variance},
    {Coordinate::time, on_variance},
    {Coordinate::incidence, on_variance},
    {Coordinate::beam, on_loss},
    {Coordinate::range, on_loss},
    {Coordinate::time, on_loss},
    {Coordinate::beam, on_stray},
    {Coordinate::time, on_stray},
    {Coordinate::scan_seq, on_range},
    {Coordinate::scan_seq, on_scan_range},
    {Coordinate::scan_seq, on_shared_noise},
    {Coordinate::beam, on_own_range},
    {Coordinate::stage, on_variance},
    {Coordinate::target, on_loss},
    {Coordinate::target, on_late},
    {Coordinate::target, on_early},
    {Coordinate::beam, on_intensity},
    {Coordinate::stage, on_intensity},
    {Coordinate::incidence, on_intensity},
    {Coordinate::time, on_intensity},
};
/// Of every target by itself: what a surface does at its place, and where it is found from time to time.
constexpr std::pair<Coordinate, Act> of_one_target[] = {
    {Coordinate::target, on_intensity}, {Coordinate::target, on_place}, {Coordinate::time, on_place}};

Axis axis_of_rows(const Scale& scale, const Way& way) {
  constexpr std::size_t most = 400, parts = 40;
  Axis axis;
  axis.coordinate = way.coordinate;
  axis.channel = way.on.channel;
  axis.expects_nothing = way.on.expects_nothing || (way.coordinate == Coordinate::target && way.target == -1);
  const std::vector<double>& v = scale.sorted();
  axis.low = v.front();
  axis.high = v.back();
  std::set<double> values;
  for (const double one : v)
    if (values.size() < most) values.insert(one);
  axis.values.assign(values.begin(), values.end());
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
  const double each = like.channel == explain::Channel::range_scale ? at.range_mm
                      : like.channel == explain::Channel::place     ? range_per_mm_out(at.cos_incidence)
                                                                    : 1;
  for (std::size_t k = 0; k < terms; ++k)
    see(static_cast<int>(k), each * form.basis(shape, x, static_cast<int>(k)));
}

/// A form with so many coefficients as a mechanism: these, its place and its length.
std::shared_ptr<const Mechanism> mechanism_of(const Form& form, const Way& way, const Shape& like,
                                              const std::shared_ptr<const Scale>& scale) {
  auto m = std::make_shared<Mechanism>();
  m->id = form.id + " of " + name_of(way.coordinate);
  m->coordinate = way.coordinate;
  m->observable = way.on.observable;
  m->formula_error = 0;
  const int terms = form.terms(like);
  std::vector<double> shares(static_cast<std::size_t>(terms), 1.0);
  if (form.shares) shares = form.shares(like);
  const bool only_more = form.is_constant;  // than nothing
  for (int k = 0; k < terms; ++k)
    m->parameters.push_back({.name = "c" + std::to_string(k),
                             .typical = way.on.typical * shares[static_cast<std::size_t>(k)],
                             .sign = only_more ? 1 : 0});
  for (const char* name : {"at", "length"})
    m->parameters.push_back({.name = name, .role = Parameter::Role::shape, .lower = 0, .upper = 0});
  m->act = [&form, way, like, scale](const Circumstances& at, std::span<const double> p) {
    double sum = 0;
    for_each_function(form, way, like, *scale, at, p,
                      [&](int k, double value) { sum += p[static_cast<std::size_t>(k)] * value; });
    return way.on.by(sum);
  };
  return m;
}

Kind::Functions functions_of(const Form& form, const Way& way, const Shape& like,
                             const std::shared_ptr<const Scale>& scale) {
  const auto at = [&form, way, like, scale](const Circumstances& c, const std::vector<double>& values,
                                            Eigen::VectorXd& each) {
    for_each_function(form, way, like, *scale, c, values, [&](int k, double value) { each[k] = value; });
  };
  return {way.on.changes, at};
}

bool responds(const ChannelRows& rows, const Act& on) {
  const Index step = std::max<Index>(1, rows.rows() / 50);
  for (Index i = 0; i < rows.rows(); i += step)
    if (rows.response(i, on.by(1)) != 0) return true;
  return false;
}

/// What happened at its time is where a target stands, or all ranges alike; a target's place in time is that.
bool suits_times(const Form& form, const Way& way) {
  const bool in_time = way.coordinate == Coordinate::time, of_a_target = way.target >= 0;
  const bool of_all_ranges =
      !of_a_target && way.on.changes == on_range.changes && way.on.channel == on_range.channel;
  return form.happened_then ? in_time && (of_a_target || of_all_ranges) : !in_time || !of_a_target;
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
                      axis.high - axis.low > 1e-6 && axis.values.size() >= fewest_values;
  for (const Form& form : all_forms()) {
    if ((!varies && !form.is_constant) || (way.target != -1 && form.is_constant)) continue;
    if (form.of_all_targets != (way.target == all_targets) || !suits_times(form, way)) continue;
    std::map<int, std::vector<Shape>> by_terms;
    for (Shape& shape : form.along(axis)) {
      shape.form = &form;
      shape.coordinate = way.coordinate;
      shape.channel = way.on.channel;
      shape.target = way.target;
      shape.size = way.on.typical;
      by_terms[form.terms(shape)].push_back(shape);
    }
    for (const auto& [terms, shapes] : by_terms) {
      Kind kind;
      kind.form = shapes.front();
      kind.target = std::max(-1, way.target);
      kind.mechanism = mechanism_of(form, way, shapes.front(), scale);
      kind.functions = functions_of(form, way, shapes.front(), scale);
      kind.refines = false;
      kind.acts_on = way.on.in_words;
      kind.is_share = way.on.is_share;
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
    const auto acts_here = [&](const Act& on) {
      return channels[c] && what[c].has_forms && what[c].observable == on.observable &&
             responds(*channels[c], on) && shows_anything(*channels[c]);
    };
    for (const Way& way : ways)
      if (acts_here(way.on) && channels[c]->sees(way.coordinate)) add_forms_along(way, *channels[c], kinds);
    for (const auto& [coordinate, on] : of_one_target) {
      if (!acts_here(on)) continue;
      std::set<int> targets;  // which share the prior of one
      for (Index i = 0; i < channels[c]->rows(); ++i) targets.insert(channels[c]->at(i).target);
      const std::size_t before = kinds.size();
      for (const int target : targets) add_forms_along({coordinate, on, target}, *channels[c], kinds);
      for (std::size_t k = before; k < kinds.size(); ++k)
        kinds[k].log_prior = -std::log(static_cast<double>(targets.size()));
      if (coordinate == Coordinate::target && on.changes == on_place.changes)
        add_forms_along({Coordinate::target, on, all_targets}, *channels[c], kinds);
    }
  }
  double count = 0;
  for (std::size_t k = named; k < kinds.size(); ++k) count += std::exp(kinds[k].log_prior);
  for (std::size_t k = named; k < kinds.size(); ++k)
    kinds[k].log_prior += std::log(numbers::forms_expected / count);
}

}  // namespace fit::explain::model
