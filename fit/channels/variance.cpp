// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "fit/explain/model/autoregression.hpp"
#include "fit/explain/model/gamma.hpp"
#include "fit/explain/model/neighbours.hpp"
#include "fit/explain/numbers.hpp"
#include "fit/explain/scene/stated_noise.hpp"

namespace fit::explain::channels {
namespace {

using model::IndependentRows;

/// Of the samples' distribution, all cells together.
struct ShapeOfNoise {
  Estimate skewness{0, 1}, kurtosis{3, 1};
};

/// The mean over captures, and its uncertainty by how they differ: what scans draw for all beams makes all
/// cells of one alike.
class MeanOfCaptures {
 public:
  void add(int capture, double weight, double value) {
    auto& [weights, sum] = captures_[capture];
    weights += weight;
    sum += weight * value;
  }
  [[nodiscard]] std::optional<Estimate> mean() const {
    constexpr std::size_t fewest = 4;
    if (captures_.size() < fewest) return {};
    const auto count = static_cast<double>(captures_.size());
    double sum = 0, squares = 0;
    for (const auto& [capture, own] : captures_) {
      sum += own.second / own.first;
      squares += std::pow(own.second / own.first, 2);
    }
    const double mean = sum / count;
    return Estimate{mean, std::sqrt(std::max(0.0, squares / count - mean * mean) / (count - 1))};
  }

 private:
  std::map<int, std::pair<double, double>> captures_;
};

/// Where noise is wide enough to show it in whole millimetres, and most of it is each beam's own: nothing
/// swings or is drawn from scan to scan.
ShapeOfNoise shape_of_noise(const Reduced& reduced, const MeanNoise& noise) {
  constexpr int fewest_samples = 8;
  constexpr double least_mm2 = 2, most_of_scans = 0.05;
  if (reduced.output_steps.step_mm > 1 || reduced.wave_hz || reduced.vibration_hz) return {};
  MeanOfCaptures skewness, kurtosis;
  for (const Cell& cell : reduced.cells) {
    if (!cell.usable || cell.n < fewest_samples || cell.variance_mm2 < least_mm2 || !(cell.pooled_mm2 > 0))
      continue;
    const double of_scans = cell.of_scans_mm2 + noise.scan_range_mm2 +
                            std::pow(cell.sight.stage_sensitivity(), 2) * noise.scan_angle_rad2;
    if (of_scans > most_of_scans * cell.variance_mm2) continue;
    const int capture = reduced.group_of(cell).capture;
    // Of few skewed samples the own variance goes with the third moment: by the neighbours' it is unbiased.
    skewness.add(capture, cell.n, cell.skewness * std::pow(cell.variance_mm2 / cell.pooled_mm2, 1.5));
    kurtosis.add(capture, cell.n, cell.kurtosis);
  }
  const auto s = skewness.mean(), k = kurtosis.mean();
  return s && k ? ShapeOfNoise{*s, *k} : ShapeOfNoise{};
}

/// Tells a shape that lies so far beyond usual noise that a form would cost less, if that is certain.
void add_if_odd(double beyond, double u, const std::string& describes, std::vector<Unexplained>& list) {
  constexpr double certain = 5;
  const double strain = beyond / numbers::usual_shape;
  if (beyond < certain * u || strain * strain / 2 < -std::log(numbers::forms_expected)) return;
  Unexplained odd;
  odd.observable = Observable::range_distribution;
  odd.describes = describes;
  odd.gain = beyond * beyond / (2 * u * u);
  list.push_back(std::move(odd));
}

/// Sample variances: a gamma distribution of shape f/2 around the variance of one sample (mm^2), to which
/// independent causes add.
class Variances final : public model::GammaRows {
 public:
  Variances(std::vector<Row> rows, const model::NoiseOfBeams& own, const ShapeOfNoise& shape,
            const Bench& bench)
      : GammaRows(std::move(rows), rounding_mm2 / 2), own_(own), shape_(shape) {
    constexpr double best_known = 0.02;  // no noise is constant to better than that share
    const Estimate stated = stated_noise(bench);
    Columns base;
    base.columns = Eigen::MatrixXd::Ones(this->Variances::rows(), 1);
    base.prior.mean = Eigen::VectorXd::Constant(1, stated.value * stated.value);
    base.prior.sigma =
        Eigen::VectorXd::Constant(1, 2 * stated.value * std::max(stated.u, best_known * stated.value));
    set_base(std::move(base));
  }

  [[nodiscard]] double response(Eigen::Index row, const Effect& effect) const override {
    return effect.variance_mm2 +
           of(row).sensitivity2 * (effect.scan_angle_variance_rad2 + effect.beam_angle_variance_rad2);
  }
  [[nodiscard]] model::Draws draws(Eigen::Index row) const override { return of(row).draws; }
  [[nodiscard]] std::string note(const Eigen::VectorXd&, const Eigen::VectorXd&) const override {
    if (own_.variance == 0) return {};
    return "Every beam has noise of its own: its variance differs from that of its neighbours by " +
           rounded(100 * std::sqrt(own_.variance), 2) +
           " % (standard deviation), in all captures alike. More noise of some beams counts as something "
           "else only beyond that.";
  }

  [[nodiscard]] std::vector<Unexplained> unexplained(const Eigen::VectorXd&) const override {
    std::vector<Unexplained> list;
    add_if_odd(std::abs(shape_.skewness.value), shape_.skewness.u,
               "samples scatter farther to the " + std::string(shape_.skewness.value > 0 ? "long" : "short") +
                   " side: the skewness of their distribution is " + rounded(shape_.skewness.value, 2),
               list);
    add_if_odd(3 - shape_.kurtosis.value, shape_.kurtosis.u,
               "samples spread evenly, or about two values: the kurtosis of their distribution is " +
                   rounded(shape_.kurtosis.value, 2) + ", that of normal noise 3",
               list);
    return list;
  }

 private:
  model::NoiseOfBeams own_;
  ShapeOfNoise shape_;
};

std::vector<IndependentRows::Row> variance_rows(const Reduced& reduced, const MeanNoise& noise,
                                                const model::NoiseOfBeams& own) {
  constexpr int beams = 8;
  constexpr double least_share = 0.05;
  const double worth = model::worth_for_variance(noise.ar1_rho, noise.ar1_share);
  double kurtosis = 0, freedom = 0;
  std::map<int, double> shares;  // of the variance that the sample variance of so many shows
  const auto share_of = [&](int n) {
    const auto [at, is_new] = shares.try_emplace(n, 0);
    if (is_new)
      at->second = std::max(least_share, model::share_in_sample_variance(n, noise.ar1_rho, noise.ar1_share));
    return at->second;
  };
  const OutputSteps& steps = reduced.output_steps;
  auto rows = model::pooled_rows(reduced, beams, [&](std::size_t i, IndependentRows::Row& row) {
    const Cell& cell = reduced.cells[i];
    if (!cell.usable || cell.n < 3) return false;
    const double f = own.left_of((cell.n - 1) * worth);
    row.y = (row.y * row.n + f * cell.variance_mm2 / share_of(cell.n)) / (row.n + f);
    const double expected =
        cell.of_scans_mm2 + cell.of_joining_mm2() + steps.variance_mm2(steps.place_of(cell.nominal_mm));
    row.expected = (row.expected * row.n + f * expected) / (row.n + f);
    row.n += f;
    kurtosis += f * cell.kurtosis;
    freedom += f;
    return true;
  });
  // Where a mean lies between coarse steps decides its variance.
  const bool is_uneven = own.variance > 0 || steps.step_mm > 1;
  // Samples with tails say less of their variance, and so do those whose noise is autocorrelated or shared.
  const double of_tails = freedom > 0 ? (kurtosis / freedom - 1) / 2 : 1,
               of_squares = own.variance > 0 ? 1 : model::inflation_of_squares(reduced),
               of_variances = is_uneven ? 1 : model::inflation_of_variances(reduced, worth),
               scatter = std::max({1.0, of_tails, of_squares, of_variances});
  for (auto& row : rows) row.n /= scatter;
  return rows;
}

}  // namespace

model::ChannelKind make_variance() {
  model::ChannelKind kind;
  kind.id = "variance";
  kind.observable = Observable::range_variance;
  kind.shows = "standard deviation of a sample";
  kind.unit = "mm";
  kind.is_square = true;
  kind.rows = [](const Reduced& reduced, const MeanNoise& noise) -> std::unique_ptr<model::ChannelRows> {
    const model::NoiseOfBeams own = model::noise_of_beams(reduced);
    auto rows = variance_rows(reduced, noise, own);
    if (rows.size() < 3) return nullptr;
    return std::make_unique<Variances>(std::move(rows), own, shape_of_noise(reduced, noise), reduced.bench);
  };
  return kind;
}

}  // namespace fit::explain::channels
