// SPDX-License-Identifier: MIT
#include <algorithm>
#include <limits>
#include <map>
#include <optional>

#include "fit/explain/model/autoregression.hpp"
#include "fit/explain/model/channel.hpp"
#include "fit/explain/model/neighbours.hpp"

namespace fit::explain::channels {
namespace {

using Eigen::Index;

/// What scans of one length in one capture have summed up.
struct Summed {
  LagSums sums{};
  double squares = 0, cells = 0;
};

/// The bands of one capture's scans of one length: correlated, as the sums of one recording are.
struct Block {
  int capture = 0, scans = 0;
  std::vector<std::size_t> bands;
  Eigen::VectorXd value;
  Eigen::MatrixXd root;  ///< Of the precision: a row times it is white.
};

/// Sums of products of deviations so many scans apart over the sum of their squares, less what white noise
/// about its own mean has: normal around that of autocorrelated noise.
class Autocorrelation final : public model::NormalRows {
 public:
  explicit Autocorrelation(std::vector<Block> blocks) : blocks_(std::move(blocks)) {
    constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
    const Circumstances anywhere{.time_s = unknown, .clock_s = unknown};
    std::vector<Row> rows;
    for (std::size_t b = 0; b < blocks_.size(); ++b)
      for (std::size_t k = 0; k < blocks_[b].bands.size(); ++k) {
        places_.push_back({b, blocks_[b].bands[k]});
        rows.push_back({anywhere, blocks_[b].capture, blocks_[b].value[static_cast<Index>(k)]});
      }
    set_rows(std::move(rows));
  }

  [[nodiscard]] double response(Index row, const Effect& effect) const override {
    if (!(effect.ar1_share > 0) || !(effect.ar1_rho > 0)) return 0;
    const auto [block, band] = places_[static_cast<std::size_t>(row)];
    const LagSums with = model::lagged_of(blocks_[block].scans, effect.ar1_rho),
                  white = model::lagged_of(blocks_[block].scans, 0);
    const auto mixed = [&](std::size_t b) {
      return effect.ar1_share * with[b] + (1 - effect.ar1_share) * white[b];
    };
    return mixed(band) / mixed(0) - white[band] / white[0];
  }
  [[nodiscard]] Eigen::MatrixXd whitened(Eigen::MatrixXd columns, const Eigen::VectorXd&) const override {
    Index first = 0;
    for (const Block& b : blocks_) {
      const auto count = static_cast<Index>(b.bands.size());
      columns.middleRows(first, count) = b.root * columns.middleRows(first, count).eval();
      first += count;
    }
    return columns;
  }

 private:
  struct Place {
    std::size_t block, band;
  };

  std::vector<Block> blocks_;
  std::vector<Place> places_;
};

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

/// Bartlett's covariance of the sums, by the autocorrelation that is known so far, carried over to their
/// ratios to the sum of squares.
std::optional<Block> block_of(int capture, int scans, const Summed& one, const MeanNoise& noise,
                              double of_neighbours) {
  const LagSums pairs = model::pairs_of(scans), white = model::lagged_of(scans, 0);
  Block block{capture, scans, {}, {}, {}};
  for (std::size_t b = 1; b < lag_bands.size(); ++b)
    if (pairs[b] > 0) block.bands.push_back(b);
  if (block.bands.empty()) return {};
  const auto count = static_cast<Index>(block.bands.size());
  const model::LagCovariance of_sums = model::covariance_of_lagged(scans, noise.ar1_rho, noise.ar1_share);
  block.value.resize(count);
  Eigen::MatrixXd slopes = Eigen::MatrixXd::Zero(count, static_cast<Index>(lag_bands.size()));
  for (Index k = 0; k < count; ++k) {
    const std::size_t b = block.bands[static_cast<std::size_t>(k)];
    const double ratio = one.sums[b] / one.sums[0];
    block.value[k] = ratio - white[b] / white[0];
    slopes(k, static_cast<Index>(b)) = 1 / one.sums[0];
    slopes(k, 0) = -ratio / one.sums[0];
  }
  // Beams that differ in noise or share it, and samples that are not normal, make products scatter more.
  const double each = std::max(1.0, one.squares / (one.cells * pairs[1])) /
                      std::max(1.0, of_sums(1, 1) / std::max(1.0, pairs[1]));
  const Eigen::MatrixXd covariance =
      std::max({1.0, each, of_neighbours}) * one.cells * (slopes * of_sums * slopes.transpose());
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  if (factor.info() != Eigen::Success) return {};
  block.root = factor.matrixL().solve(Eigen::MatrixXd::Identity(count, count));
  return block;
}

}  // namespace

model::ChannelKind make_autocorrelation() {
  model::ChannelKind kind;
  kind.id = "autocorrelation";
  kind.observable = Observable::time_correlation;
  kind.shows = "correlation";
  kind.rows = [](const Reduced& reduced, const MeanNoise& noise) -> std::unique_ptr<model::ChannelRows> {
    std::vector<Block> blocks;
    const double of_neighbours = model::inflation_of_squares(reduced);
    for (const auto& [key, one] : by_capture_and_length(reduced))
      if (auto block = block_of(key.first, key.second, one, noise, of_neighbours))
        blocks.push_back(std::move(*block));
    if (blocks.empty()) return nullptr;
    return std::make_unique<Autocorrelation>(std::move(blocks));
  };
  return kind;
}

}  // namespace fit::explain::channels
