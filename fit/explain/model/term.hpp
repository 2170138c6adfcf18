// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "fit/explain/model/channel.hpp"
#include "fit/explain/model/hypothesis.hpp"

namespace fit::explain::model {

/// One linear coefficient of a term: a size, or the sine or cosine part of one with a phase.
struct Coefficient {
  std::size_t parameter = 0;
  bool has_phase = false;
  int quadrature = 0;  ///< 1: the part a quarter of a turn ahead.
  double expected = 0, typical = 1;
  double largest = std::numeric_limits<double>::infinity();
  int sign = 0;
  int power = 1;  ///< The effect goes with this power of the size, and so do all of these.
};

/// Something that may be missing: a mechanism of the catalogue, for one target if it acts on one, or a form,
/// which is a mechanism without a name.
struct Kind {
  /// What a form's functions change, and what they are at a row: the same as its `act`, all at once.
  struct Functions {
    double Effect::*changes = nullptr;
    std::function<void(const Circumstances&, const std::vector<double>& values, Eigen::VectorXd& each)> at;
  };

  std::shared_ptr<const Mechanism> mechanism;
  int target = -1;
  /// What of it acts in a channel.
  struct Acting {
    std::vector<bool> sizes;    ///< By coefficient.
    bool without_size = false;  ///< Whatever its sizes are.

    /// Anything.
    explicit operator bool() const { return without_size || std::ranges::count(sizes, true) > 0; }
  };

  std::optional<std::size_t> size;  ///< Of a mechanism whose sizes may be missing apart: the only one.
  std::optional<Shape> form;  ///< What a form is called and drawn by; its place and length are shape values.
  std::string acts_on;        ///< Of a form: where it acts, in words.
  bool is_share = false;      ///< That is a share of what is there.
  std::optional<Functions> functions;
  double log_prior = 0;  ///< Log of its prior odds.
  /// Values of all parameters to begin from: a grid over the shapes, sizes at their typical values.
  std::vector<std::vector<double>> starts;
  std::vector<Coefficient> coefficients;
  std::vector<Acting> acts_in;           ///< Each of the session's channels.
  std::vector<double Effect::*> ways;    ///< In which it acts there.
  std::optional<std::size_t> bins;       ///< The shape of a comb: its starts are proposed by the recording.
  std::optional<std::size_t> threshold;  ///< The shape that is looked for between recorded places.
  std::optional<std::size_t> choice;     ///< The shape that is one of two.
  std::optional<std::size_t> begins;     ///< The shape at which it begins, before that at which it ends.
  bool acts_without_size = false;
  bool refines = true;    ///< Shapes between those of the grid make sense.
  bool is_plain = false;  ///< What makes its formula more general stays where it is left out.

  [[nodiscard]] bool is_form() const { return form.has_value(); }
  /// From one of the cells that are taken together in a row to the next: a comb, or a piece of a target.
  [[nodiscard]] bool differs_within_rows() const {
    return bins || (is_form() && form->form->from_to && form->is_along_one_target());
  }
  [[nodiscard]] bool moves_means() const { return explain::moves_means(*mechanism); }
  /// The same cause, whether plain or not.
  [[nodiscard]] bool is_same_cause(const Kind& other) const {
    return this == &other ||
           (!is_form() && mechanism == other.mechanism && target == other.target && size == other.size);
  }
};

/// A kind at values of its parameters.
struct Term {
  const Kind* kind = nullptr;
  std::vector<double> values, sigma;
  double factor = 1;  ///< On the prior's sizes.
  /// Log of the evidence of its shapes' places over what it would be if the best were known: at most so much,
  /// by the grid of starts; and of all modes over the best one, with its prior.
  double by_grid = 0, by_modes = 0;
};

/// As the rooms that draw, predict and plan know it.
[[nodiscard]] inline Active as_active(const Term& term) {
  return {term.kind->mechanism, term.values, term.kind->target, term.sigma};
}

/// All ways in which an effect may deviate from its formula.
[[nodiscard]] std::span<double Effect::*const> ways_to_act();

/// The linear coefficients of a mechanism, whose effect goes with that power of every size.
[[nodiscard]] std::vector<Coefficient> coefficients_of(const Mechanism& mechanism,
                                                       const std::function<int(std::size_t size)>& power_of);
/// Coefficients where a term stands.
[[nodiscard]] Eigen::VectorXd coefficients(const Term& term);
/// Puts them, with their covariance, into the term's values and uncertainties.
void set_coefficients(Term& term, const Eigen::VectorXd& value, const Eigen::MatrixXd& covariance);
/// Indices of the parameters that are shapes and have a grid of starts.
[[nodiscard]] std::vector<std::size_t> shapes_of(const Kind& kind);
/// Of these, those that have values between the starts.
[[nodiscard]] std::vector<std::size_t> refined_shapes_of(const Kind& kind);

/// What a mechanism at values does in a row. An angle that differs among the row's scans is one that is
/// drawn.
[[nodiscard]] Effect effect_at(const Rows& channel, Eigen::Index row, const Kind& kind,
                               const std::vector<double>& values);
/// What a term at values does to a channel, per coefficient. `acting`: what is known to act there; else all
/// of it may.
[[nodiscard]] Eigen::MatrixXd columns_of(const Rows& channel, const Kind& kind,
                                         const std::vector<double>& values,
                                         const Kind::Acting* acting = nullptr);
/// What it does there whatever its sizes are.
[[nodiscard]] std::vector<double> without_size(const Kind& kind, std::vector<double> values);
[[nodiscard]] Eigen::VectorXd effect_without_size(const Rows& channel, const Kind& kind,
                                                  const std::vector<double>& values);
/// What it does in all.
[[nodiscard]] Eigen::VectorXd effect_of(const Rows& channel, const Kind& kind,
                                        const std::vector<double>& values);
/// Derivatives by the shapes, each scaled to the standard deviation of its uniform prior.
[[nodiscard]] Eigen::MatrixXd shape_columns(const Rows& channel, const Term& term);
/// Whether a time at which something begins or ends says that it always acts.
[[nodiscard]] inline bool is_always(double time_s) { return std::abs(time_s) >= 1e9; }
/// Keeps a comb's teeth where they are when all places that it sees are farther by so much.
void follow(Term& term, double farther);
/// Ways in which the real cause may deviate from the formula, each with a standard normal coefficient.
struct Deviations {
  Eigen::MatrixXd columns;
  Eigen::Index of_formula = 0;  ///< So many of the first say how near the formula is; the others are known.
};
[[nodiscard]] Deviations deviations_of(const Rows& channel, const Term& term);

/// What a mechanism of the catalogue is by itself: no starts, no coefficients.
[[nodiscard]] Kind kind_without_channels(const Mechanism& mechanism, int target);
/// A mechanism of the catalogue before a session; no starts if it has too many shapes to be looked for, or
/// is nothing that such a target has.
/// `size`: the only one; `is_plain`: with the plain formula.
[[nodiscard]] Kind kind_of(const Mechanism& mechanism, int target,
                           const std::vector<std::unique_ptr<ChannelRows>>& channels,
                           std::optional<std::size_t> size = {}, bool is_plain = false);
/// All that may be missing from the session: the catalogue less what the bench knows, and forms.
[[nodiscard]] std::vector<Kind> kinds_of(const Reduced& reduced,
                                         const std::vector<std::unique_ptr<ChannelRows>>& channels);
/// Forms of every coordinate and every way to act.
void add_forms(const std::vector<ChannelKind>& what,
               const std::vector<std::unique_ptr<ChannelRows>>& channels, std::vector<Kind>& kinds);

/// A coordinate of formats.md in its file unit; not finite where it has none.
[[nodiscard]] double coordinate_of(Coordinate coordinate, const Circumstances& at);
/// The same, but along a target, if it is of one: the place on it from its middle, mm; not finite off it. Of
/// all targets: their number plus the share of the way from one end to the other.
[[nodiscard]] double place_of(Coordinate coordinate, int target, const Circumstances& at);

}  // namespace fit::explain::model
