// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "fit/explain/inference/fit.hpp"
#include "fit/explain/model/spans.hpp"

namespace fit::explain::inference {

/// Columns of all channels, each with its information `around`.
[[nodiscard]] std::vector<Eigen::MatrixXd> whitened_around(const Session& session, const Optimum& around,
                                                           std::vector<Eigen::MatrixXd> columns);
/// Of the whitened columns of so many terms beside each other, with the base and present terms integrated
/// out. Channels may have different numbers of them: the first ones are the same coefficients in all.
/// `starts`: where terms stand at starts, what of their products is known; by term and channel.
[[nodiscard]] std::vector<Quadratic> projected(
    const Fitted& fitted, const Optimum& around, const std::vector<Eigen::MatrixXd>& columns,
    std::size_t count = 1, std::span<const std::vector<Session::AtStart>* const> starts = {});

/// What one kind would add to a fitted hypothesis, by the quadratic approximation of all channels there.
class Approximation {
 public:
  /// `around`: the fitted likelihood, expanded for new terms.
  Approximation(const Session& session, const Fitted& fitted, const Optimum& around, const Kind& kind)
      : session_(&session), fitted_(&fitted), around_(&around), kind_(&kind) {}

 protected:
  /// Log evidence at those shapes, over all sizes; the term gets the best.
  double with_sizes(Term& term) const;
  /// The same of terms that stand at all of the kind's starts.
  std::vector<double> with_sizes_at_starts(std::vector<Term>& terms) const;
  /// With the deviations that the formula allows, and the width of its shapes.
  [[nodiscard]] double with_everything(const Term& term, bool with_shapes) const;

  /// Of what happens to every row of all channels, along a coordinate.
  template <class Happens>
  [[nodiscard]] std::vector<model::RowScore> scores_along(Coordinate coordinate,
                                                          const Happens& happens) const {
    std::vector<model::RowScore> list;
    for (std::size_t c = 0; c < session_->channels().size(); ++c) {
      if (!kind_->acts_in[c]) continue;
      const ChannelRows& rows = *session_->channels()[c];
      const Eigen::VectorXd white = rows.whitened(happens(rows), around_->eta[c]);
      for (Eigen::Index i = 0; i < rows.rows(); ++i)
        list.push_back({model::coordinate_of(coordinate, rows.at(i)),
                        white[i] * around_->white_residual[c][i], white[i] * white[i]});
    }
    return list;
  }

  /// Of a form that acts between two places, were it everywhere, as if each row came alone.
  [[nodiscard]] std::vector<model::RowScore> scores_alone() const;
  /// Along its coordinate, of all cells.
  [[nodiscard]] std::vector<double> recorded_places() const;

  const Session* session_;
  const Fitted* fitted_;
  const Optimum* around_;
  const Kind* kind_;

 private:
  /// At so many of its starts.
  [[nodiscard]] std::vector<Quadratic> projected_at(std::size_t first, std::size_t count) const;
  [[nodiscard]] Quadratic projected_columns(std::vector<Eigen::MatrixXd> columns) const;
  double with_sizes(Term& term, const Quadratic& likelihood, double without_size) const;
  [[nodiscard]] std::vector<Eigen::MatrixXd> columns_of(const Term& term) const;
  [[nodiscard]] double gain_of_offset(const Term& term, std::optional<std::size_t> start = {}) const;
  [[nodiscard]] double width_without_sizes(const Term& term) const;
};

}  // namespace fit::explain::inference
