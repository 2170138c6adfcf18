// SPDX-License-Identifier: MIT
#include "fit/explain/model/channel.hpp"

#include <algorithm>
#include <cmath>

#include "fit/explain/inference/numbers.hpp"

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

Eigen::VectorXd NormalRows::white_residual(const Eigen::VectorXd& eta) const {
  Eigen::VectorXd left(rows());
  for (Eigen::Index i = 0; i < left.size(); ++i) left[i] = statistic(i) - eta[i];
  return whitened(std::move(left), eta);
}

Eigen::VectorXd IndependentRows::log_likelihoods(const Eigen::VectorXd& eta) const {
  Eigen::VectorXd list(rows());
  for (Index i = 0; i < rows(); ++i) list[i] = log_likelihood(of(i), eta[i]);
  return list;
}

Eigen::MatrixXd IndependentRows::whitened(Eigen::MatrixXd columns, const Eigen::VectorXd& eta) const {
  Eigen::VectorXd root(rows());
  for (Index i = 0; i < rows(); ++i) root[i] = std::sqrt(information(of(i), eta[i]));
  for (Index k = 0; k < columns.cols(); ++k) columns.col(k).array() *= root.array();
  return columns;
}

Eigen::VectorXd IndependentRows::white_residual(const Eigen::VectorXd& eta) const {
  Eigen::VectorXd list(rows());
  for (Index i = 0; i < rows(); ++i) list[i] = score(of(i), eta[i]) / std::sqrt(information(of(i), eta[i]));
  return list;
}

std::vector<IndependentRows::Row> pooled_rows(
    const Reduced& reduced, int count,
    const std::function<bool(std::size_t cell, IndependentRows::Row& row)>& take, double enough) {
  // No more rows than a search has time for.
  const double cells = static_cast<double>(reduced.cells.size()),
               most = static_cast<double>(numbers::search_rows);
  const double by_beams = cells / count, by_samples = static_cast<double>(reduced.samples) / enough;
  const int times =
      static_cast<int>(std::ceil(std::max(1.0, std::max(by_beams, std::min(cells, by_samples)) / most)));
  if (times > 1) enough *= times;
  const SearchRows search(reduced, false, numbers::search_rows, static_cast<std::size_t>(count));
  std::vector<IndependentRows::Row> list;
  for (std::size_t g = 0; g < reduced.groups.size(); ++g) {
    if (!search.take(g)) continue;
    const Group& group = reduced.groups[g];
    const std::size_t together = search.together(g);
    IndependentRows::Row row;
    std::vector<std::size_t> taken;
    double echoes = 0, lit = 0;
    const auto close = [&] {
      if (!taken.empty()) {
        const Cell& middle = reduced.cells[taken[taken.size() / 2]];
        row.at = middle.at;
        if (lit > 0) row.at.intensity = echoes / lit;
        row.capture = group.capture;
        row.draws = {g, group.scans};
        row.lever2 /= static_cast<double>(taken.size());
        list.push_back(row);
      }
      row = {};
      taken.clear();
      echoes = lit = 0;
    };
    for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
      const Cell& cell = reduced.cells[i];
      if (!taken.empty() && (taken.size() == together || row.n >= enough ||
                             cell.at.target != reduced.cells[taken.back()].at.target))
        close();
      if (!take(i, row)) continue;
      taken.push_back(i);
      row.lever2 += cell.sight.beam_lever() * cell.sight.beam_lever();
      if (!std::isfinite(cell.at.intensity)) continue;
      echoes += cell.at.intensity;
      lit += 1;
    }
    close();
  }
  return list;
}

}  // namespace fit::explain::model
