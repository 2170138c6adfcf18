// SPDX-License-Identifier: MIT
#include "fit/explain/model/columns.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <utility>
#include <vector>

#include "fit/explain/model/scale.hpp"
#include "fit/explain/model/term.hpp"

namespace fit::explain {
namespace {

/// As the model has mechanisms of the catalogue, with the ways in which it acts here.
model::Kind kind_here(const model::Rows& rows, const Active& active) {
  model::Kind kind = model::kind_without_channels(*active.mechanism, active.target);
  kind.coefficients = model::coefficients_of(*active.mechanism, [](std::size_t) { return 1; });
  std::vector<double Effect::*> unseen(model::ways_to_act().begin(), model::ways_to_act().end());
  for (Eigen::Index i = 0; i < rows.rows() && !unseen.empty(); ++i) {
    const Effect effect = active.mechanism->act(rows.at(i), active.values);
    std::erase_if(unseen, [&](const auto way) {
      if (effect.*way == 0 || !std::isfinite(effect.*way)) return false;
      Effect only;
      only.*way = effect.*way;
      return rows.response(i, only) != 0;
    });
  }
  std::ranges::copy_if(model::ways_to_act(), std::back_inserter(kind.ways),
                       [&](const auto way) { return !std::ranges::count(unseen, way); });
  return kind;
}

/// Its values with one of them half a standard uncertainty smaller and larger; at a bound, all of it to one
/// side.
std::pair<std::vector<double>, std::vector<double>> around(const Active& active, std::size_t k) {
  const Parameter& p = active.mechanism->parameters[k];
  std::vector<double> less = active.values;
  if (active.mechanism->displaces) std::ranges::fill(less, 0);  // it stands already where it was moved to
  std::vector<double> more = less;
  const double value = less[k], u = active.sigma[k];
  const auto moved = [&](double by) {  // so many standard uncertainties
    return p.logarithmic && value > 0 ? value * std::exp(by * u / value) : value + by * u;
  };
  const bool is_shape = p.role == Parameter::Role::shape && p.lower < p.upper;
  if (is_shape ? value <= p.lower : value == 0 && p.sign > 0) {  // or it may act by its square
    more[k] = moved(1);
  } else if (is_shape && value >= p.upper) {
    less[k] = moved(-1);
  } else {
    more[k] = moved(0.5);
    less[k] = moved(-0.5);
  }
  if (is_shape)
    for (double* one : {&less[k], &more[k]})
      *one = std::clamp(*one, std::min(p.lower, value), std::max(p.upper, value));
  return {std::move(less), std::move(more)};
}

Columns with_standard_prior(const Eigen::MatrixXd& columns_mm) {
  return {columns_mm, Prior::around_zero(columns_mm.cols())};
}

}  // namespace

const ChannelInWords& in_words_of(Channel channel) {
  static constexpr std::array all{ChannelInWords{"range_mm", "range", " mm", 1, 0.5},
                                  ChannelInWords{"range_mm_per_m", "range's scale", " mm/m", 1000, 100},
                                  ChannelInWords{"beam_angle_deg", "beam angle", " deg", deg_per_rad, 100},
                                  ChannelInWords{"stage_angle_deg", "stage angle", " deg", deg_per_rad, 100},
                                  ChannelInWords{"range_mm", "surface", " mm", 1, 0.5}};
  return all[static_cast<std::size_t>(channel)];
}

double sensitivity_of(Channel channel, const Sight& sight) {
  switch (channel) {
    case Channel::range_scale:
      return sight.range_mm;
    case Channel::beam_angle:
      return sight.beam_sensitivity();
    case Channel::stage_angle:
      return sight.stage_sensitivity();
    case Channel::place:
      return range_per_mm_out(sight.cos_incidence());
    default:
      return 1;
  }
}

Eigen::VectorXd effect_of(const MeanModel& model, const Active& term) {
  return model::effect_of(model, model::kind_without_channels(*term.mechanism, term.target), term.values);
}

double coordinate_at(const MeanModel& model, Coordinate coordinate, Eigen::Index row, int target) {
  const Circumstances& at = model.cell(row).at;
  return target < 0 ? model::coordinate_of(coordinate, at) : model::place_of(coordinate, target, at);
}

std::string place_along(const Bench& bench, int target) {
  if (target == all_targets) return "the place along it";
  return "the place along target '" + bench.target_at(target).name + "'";
}

Eigen::VectorXd scaled_coordinate(const MeanModel& model, Coordinate coordinate, int target) {
  Eigen::VectorXd x(model.rows());
  std::vector<double> values;
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    x[i] = coordinate_at(model, coordinate, i, target);
    if (std::isfinite(x[i])) values.push_back(x[i]);
  }
  if (values.empty()) return Eigen::VectorXd::Zero(x.size());
  const model::Scale scale(std::move(values), model::Scale::may_crowd(coordinate));
  for (double& v : x) v = std::isfinite(v) ? scale(v) : 0;
  return x;
}

TermColumns columns_of(const MeanModel& model, const Active& term) {
  const model::Kind kind = kind_here(model, term);
  model::Term there;
  there.kind = &kind;
  there.values = term.values;
  TermColumns columns{model::coefficients(there), {}, {}, {}};
  columns.sizes = with_standard_prior(model::columns_of(model, kind, term.values));
  for (std::size_t k = 0; k < kind.coefficients.size(); ++k) {
    columns.sizes.prior.mean[static_cast<Eigen::Index>(k)] = kind.coefficients[k].expected;
    columns.sizes.prior.sigma[static_cast<Eigen::Index>(k)] = kind.coefficients[k].typical;
  }
  columns.shapes = with_standard_prior(model::shape_columns(model, there));
  columns.deviations = with_standard_prior(model::deviations_of(model, there).columns);
  return columns;
}

Columns uncertain_values(const model::Rows& rows, const std::vector<Active>& known) {
  Columns all;
  all.columns.resize(rows.rows(), 0);
  for (const Active& active : known) {
    const model::Kind kind = model::kind_without_channels(*active.mechanism, active.target);
    for (std::size_t k = 0; k < active.sigma.size(); ++k) {
      if (!(active.sigma[k] > 0)) continue;
      const auto [less, more] = around(active, k);
      Eigen::VectorXd column(rows.rows());
      for (Eigen::Index i = 0; i < column.size(); ++i) {
        if (active.target >= 0 && active.target != rows.at(i).target) {
          column[i] = 0;
          continue;
        }
        const double change = rows.response(i, model::effect_at(rows, i, kind, more)) -
                              rows.response(i, model::effect_at(rows, i, kind, less));
        column[i] = std::isfinite(change) ? change : 0;
      }
      all.append(with_standard_prior(column));
    }
  }
  return all;
}

Columns uncertainty_columns(const model::Rows& rows, std::vector<Active> known) {
  std::erase_if(known, [](const Active& active) {
    // A statement that may be corrected is a nuisance of its channel already.
    return active.mechanism->parameters.empty() || active.mechanism->corrects_a_statement;
  });
  Columns all = uncertain_values(rows, known);
  for (const Active& active : known) {
    const model::Kind kind = kind_here(rows, active);
    if (kind.ways.empty()) continue;
    model::Term there;
    there.kind = &kind;
    there.values = active.values;
    all.append(with_standard_prior(model::deviations_of(rows, there).columns));
  }
  return all;
}

void append_uncertainty(std::vector<Active> known, model::ChannelRows& rows) {
  if (rows.sees_only_combs()) return;
  std::erase_if(known, [&](const Active& active) { return !rows.sees(active.mechanism->coordinate); });
  rows.append_to_base(uncertainty_columns(rows, std::move(known)));
}

}  // namespace fit::explain
