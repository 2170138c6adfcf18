// SPDX-License-Identifier: MIT
#include "fit/explain/model/channel.hpp"

#include <algorithm>
#include <cmath>

#include "fit/explain/numbers.hpp"

namespace fit::explain::channels {
std::vector<model::ChannelKind> all();
}

namespace fit::explain::model {

using Eigen::Index;

const std::vector<ChannelKind>& channel_kinds() {
  static const std::vector<ChannelKind> kinds = channels::all();
  return kinds;
}

std::size_t channel_of(const std::string& id) {
  const auto& kinds = channel_kinds();
  return static_cast<std::size_t>(std::ranges::find(kinds, id, &ChannelKind::id) - kinds.begin());
}

Eigen::VectorXd NormalRows::score_alone(const Eigen::VectorXd& eta) const {
  return information(eta).cwiseProduct(
      Eigen::VectorXd::NullaryExpr(rows(), [&](Index i) { return statistic(i) - eta[i]; }));
}

Eigen::VectorXd NormalRows::white_residual(const Eigen::VectorXd& eta) const {
  return whitened(Eigen::VectorXd::NullaryExpr(rows(), [&](Index i) { return statistic(i) - eta[i]; }), eta);
}

Eigen::VectorXd IndependentRows::log_likelihoods(const Eigen::VectorXd& eta) const {
  return Eigen::VectorXd::NullaryExpr(rows(), [&](Index i) { return log_likelihood(i, eta[i]); });
}

Eigen::MatrixXd IndependentRows::whitened(Eigen::MatrixXd columns, const Eigen::VectorXd& eta) const {
  const Eigen::VectorXd root =
      Eigen::VectorXd::NullaryExpr(rows(), [&](Index i) { return std::sqrt(information(i, eta[i])); });
  for (Index k = 0; k < columns.cols(); ++k) columns.col(k).array() *= root.array();
  return columns;
}

Eigen::VectorXd IndependentRows::white_residual(const Eigen::VectorXd& eta) const {
  return Eigen::VectorXd::NullaryExpr(
      rows(), [&](Index i) { return score(i, eta[i]) / std::sqrt(information(i, eta[i])); });
}

namespace {

/// Cells that take part in rows of few cells, though a search has time for few rows.
std::vector<char> apart(const Reduced& reduced, int within, const TakeCell& take) {
  const std::size_t cells = reduced.cells.size(), reach = static_cast<std::size_t>(within);
  std::vector<char> near(cells, 0);
  for (std::size_t i = 0; i < cells; ++i) {
    IndependentRows::Row row;
    if (!take(i, row) || row.y == 0) continue;
    for (std::size_t k = i - std::min(i, reach); k < std::min(cells, i + reach + 1); ++k) near[k] = 1;
  }
  return near;
}

/// Of how many cells and samples a row is.
struct RowSize {
  std::size_t cells;
  double samples;
};

std::vector<IndependentRows::Row> rows_of(
    const Reduced& reduced, const SearchRows& search, const TakeCell& take,
    const std::function<RowSize(std::size_t cell, std::size_t group)>& size) {
  constexpr double falls_with =
      1.5;  // power of the intensity by which variances fall, about: it is their mean
  std::vector<IndependentRows::Row> list;
  for (std::size_t g = 0; g < reduced.groups.size(); ++g) {
    if (!search.take(g)) continue;
    const Group& group = reduced.groups[g];
    IndependentRows::Row row;
    std::vector<std::size_t> taken;
    double echoes = 0, lit = 0;
    const auto close = [&] {
      if (!taken.empty()) {
        const Cell& middle = reduced.cells[taken[taken.size() / 2]];
        row.at = middle.at;
        if (lit > 0) row.at.intensity = std::pow(lit / echoes, 1 / falls_with);
        row.capture = group.capture;
        row.draws = {g, group.scans};
        row.sensitivity2 /= static_cast<double>(taken.size());
        list.push_back(row);
      }
      row = {};
      taken.clear();
      echoes = lit = 0;
    };
    for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
      const Cell& cell = reduced.cells[i];
      if (!taken.empty()) {
        const RowSize of = size(taken.back(), g), here = size(i, g);
        if (taken.size() >= of.cells || row.n >= of.samples || here.cells != of.cells ||
            cell.at.target != reduced.cells[taken.back()].at.target)
          close();
      }
      if (!take(i, row)) continue;
      taken.push_back(i);
      row.sensitivity2 += cell.sight.beam_sensitivity() * cell.sight.beam_sensitivity();
      if (!std::isfinite(cell.at.intensity)) continue;
      echoes += std::pow(std::max(1.0, cell.at.intensity), -falls_with);
      lit += 1;
    }
    close();
  }
  return list;
}

/// How many times as many there are as a search has time for.
double times_too_many(double rows) {
  return std::ceil(std::max(1.0, rows / static_cast<double>(numbers::search_rows)));
}

}  // namespace

std::vector<IndependentRows::Row> pooled_rows(const Reduced& reduced, int count, const TakeCell& take) {
  const SearchRows search(reduced, false, numbers::search_rows, static_cast<std::size_t>(count));
  return rows_of(reduced, search, take, [&](std::size_t, std::size_t group) {
    return RowSize{search.together(group), 1e300};
  });
}

std::vector<IndependentRows::Row> counted_rows(const Reduced& reduced, int count, const TakeCell& take,
                                               double enough) {
  const SearchRows search(reduced, false, numbers::search_rows, static_cast<std::size_t>(count));
  const double cells = static_cast<double>(reduced.cells.size());
  const auto rows = [&](double of) {
    const double share = of / std::max(1.0, cells);
    return std::max(of / count, std::min(of, share * static_cast<double>(reduced.samples) / enough));
  };
  const std::vector<char> near = apart(reduced, count, take);
  const double too_many = times_too_many(rows(cells)),
               too_many_near = times_too_many(rows(static_cast<double>(std::ranges::count(near, 1))));
  const auto few = static_cast<std::size_t>(std::lround(count * too_many_near));
  return rows_of(reduced, search, take, [&](std::size_t cell, std::size_t group) {
    const std::size_t together = search.together(group);
    const bool is_near = near[cell] != 0 && few < together;
    return is_near ? RowSize{few, enough * too_many_near} : RowSize{together, enough * too_many};
  });
}

}  // namespace fit::explain::model
