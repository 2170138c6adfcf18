// SPDX-License-Identifier: MIT
#include <algorithm>
#include <map>

#include "fit/explain/model/channel.hpp"
#include "fit/explain/model/autoregression.hpp"

namespace fit::explain::channels {
namespace {

using model::IndependentRows;

/// What scans of one length in one capture have summed up.
struct Summed {
  LagSums sums{};
  double squares = 0, cells = 0;
};

/// Which lags a row is about, of how many scans.
struct Lags {
  int scans = 0;
  std::size_t band = 1;
};

/// Sums of products of deviations so many scans apart over the sum of their squares, less what white noise
/// about its own mean has: normal around that of noise with memory.
class Memory final : public IndependentRows {
 public:
  Memory(std::vector<Row> rows, std::vector<Lags> lags) : IndependentRows(std::move(rows)), lags_(std::move(lags)) {}

  [[nodiscard]] double response(Eigen::Index row, const Effect& effect) const override {
    if (!(effect.memory_share > 0) || !(effect.memory_rho > 0)) return 0;
    const auto& [scans, band] = lags_[static_cast<std::size_t>(row)];
    const LagSums with = model::lagged_of(scans, effect.memory_rho), white = model::lagged_of(scans, 0);
    const auto mixed = [&](std::size_t b) {
      return effect.memory_share * with[b] + (1 - effect.memory_share) * white[b];
    };
    return mixed(band) / mixed(0) - white[band] / white[0];
  }
  [[nodiscard]] double offset(Eigen::Index) const override { return 0; }

 protected:
  [[nodiscard]] double log_likelihood(const Row& row, double eta) const override {
    return -0.5 * row.n * (row.y - eta) * (row.y - eta);
  }
  [[nodiscard]] double score(const Row& row, double eta) const override { return row.n * (row.y - eta); }
  [[nodiscard]] double information(const Row& row, double) const override { return row.n; }

 private:
  std::vector<Lags> lags_;
};

/// By how much the sums scatter more than those of white noise (Bartlett 1946): once and twice the squares of
/// the correlations that all scans show together.
double scatter_of_sums(const std::map<std::pair<int, int>, Summed>& all) {
  LagSums sums{}, pairs{};
  for (const auto& [key, one] : all) {
    const LagSums of = model::pairs_of(key.second);
    for (std::size_t b = 0; b < sums.size(); ++b) {
      sums[b] += one.sums[b];
      pairs[b] += of[b] * one.cells;
    }
  }
  double factor = 1;
  for (std::size_t b = 1; b < sums.size(); ++b) {
    const double correlation = pairs[b] > 0 ? sums[b] / pairs[b] : 0;
    factor += 2 * correlation * correlation * (lag_bands[b].last - lag_bands[b].first + 1);
  }
  return factor;
}

std::map<std::pair<int, int>, Summed> by_capture_and_length(const Reduced& reduced) {
  constexpr int fewest_scans = 4;
  std::map<std::pair<int, int>, Summed> all;
  for (const Group& group : reduced.groups) {
    if (group.scans < fewest_scans || group.cells == 0) continue;
    const double scale = group.lagged[0] / (group.scans - 1.0) / static_cast<double>(group.cells);
    if (!(scale > 0)) continue;
    Summed& one = all[{group.capture, group.scans}];
    for (std::size_t b = 0; b < lag_bands.size(); ++b) one.sums[b] += group.lagged[b] / scale;
    one.squares += group.lagged_squares / (scale * scale);
    one.cells += static_cast<double>(group.cells);
  }
  return all;
}

}  // namespace

model::ChannelKind make_memory() {
  model::ChannelKind kind;
  kind.id = "memory";
  kind.observable = Observable::time_correlation;
  kind.shows = "correlation";
  kind.rows = [](const Reduced& reduced, const MeanNoise&) -> std::unique_ptr<model::ChannelRows> {
    const auto all = by_capture_and_length(reduced);
    const double scatter = scatter_of_sums(all);
    std::vector<IndependentRows::Row> rows;
    std::vector<Lags> lags;
    for (const auto& [key, one] : all) {
      const LagSums pairs = model::pairs_of(key.second), white = model::lagged_of(key.second, 0);
      // Beams that differ in noise, and samples that are not normal, make products scatter more.
      const double each = std::max(1.0, one.squares / (one.cells * pairs[1]));
      for (std::size_t b = 1; b < lag_bands.size(); ++b) {
        if (!(pairs[b] > 0)) continue;
        IndependentRows::Row row;
        row.capture = key.first;
        row.y = one.sums[b] / one.sums[0] - white[b] / white[0];
        row.n = one.sums[0] * one.sums[0] / (one.cells * pairs[b] * each * scatter);
        rows.push_back(row);
        lags.push_back({key.second, b});
      }
    }
    if (rows.empty()) return nullptr;
    return std::make_unique<Memory>(std::move(rows), std::move(lags));
  };
  return kind;
}

}  // namespace fit::explain::channels
