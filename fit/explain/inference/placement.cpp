// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "fit/explain/inference/steps.hpp"
#include "fit/explain/reduction/edge_shares.hpp"
#include "fit/numeric/median.hpp"

namespace fit::explain::inference {
namespace {

/// Neighbours scatter so much more than their samples say, beyond chance.
double excess_of(const Reduced& reduced, const MeanNoise& noise, const explain::Hypothesis& h) {
  const MeanModel model = model_of(reduced, noise, h);
  const double excess = birge_ratio(model);
  // Four standard errors of a median of squares of which neighbours share two beams.
  const double doubt = 4 * 3.4 / std::sqrt(std::max<double>(60, static_cast<double>(model.rows())));
  return excess > 1 + doubt ? excess : 1;
}

/// Mount and targets where the means have them.
class Places {
 public:
  Places(Reduced& reduced, const MeanNoise& noise, std::vector<Active> at_work = {})
      : reduced_(reduced), noise_(noise), at_(reduced.bench) {
    at_.terms = std::move(at_work);
  }

  void fit() {
    constexpr int passes = 3;
    fit_nuisances(reduced_, noise_, passes, at_);
  }
  /// Turns the mount to where most beams agree: it may be stated wrong by much more than its uncertainty.
  void turn() {
    constexpr std::size_t rows = 1500;
    constexpr double farthest_rad = 20 * rad_per_deg, step_rad = rad_per_deg;
    Reduced few = merged(reduced_, rows);
    Places there(few, noise_, at_.terms);
    const double stated = at_.nuisance.yaw_rad;
    double least = 1e300;
    for (double by = -farthest_rad; by <= farthest_rad; by += step_rad) {
      there.at_.nuisance.yaw_rad = stated + by;
      const double off = median_of(there.deviations());
      if (off >= least) continue;
      least = off;
      at_.nuisance.yaw_rad = stated + by;
    }
  }
  /// Mount and targets fitted to the beams that agree with each other: what lies far off, such as beams that
  /// meet another wall than the bench file says, has no say.
  void fit_trimmed() {
    constexpr int most_passes = 8;
    std::size_t before = 0;
    for (int pass = 0; pass < most_passes; ++pass) {
      const std::vector<double> off = deviations();
      const double far = std::max(4.0, 2.5 * 1.4826 * median_of(std::vector(off)));
      std::vector<Cell*> without;
      std::size_t row = 0;
      for (Cell& cell : reduced_.cells)
        if (cell.usable && off[row++] > far) without.push_back(&cell);
      for (Cell* cell : without) cell->usable = false;
      fit();
      for (Cell* cell : without) cell->usable = true;
      if (without.size() == before) break;
      before = without.size();
    }
  }
  /// Whether most beams are explained but for noise. Otherwise mount and walls were bent to explain something
  /// else, and no beam may be left out by where they stand.
  [[nodiscard]] bool fits_most() const {
    constexpr double median_of_chance = 0.6745;
    return median_of(deviations()) < 1.4 * median_of_chance;
  }
  [[nodiscard]] explain::Hypothesis& at() { return at_; }

 private:
  /// How far the beams are off, in standard uncertainties; in the order of the smooth cells.
  [[nodiscard]] std::vector<double> deviations() const {
    predict_at(reduced_, at_);
    const MeanModel model(reduced_, noise_);
    std::vector<double> list(static_cast<std::size_t>(model.rows()));
    for (Eigen::Index i = 0; i < model.rows(); ++i)
      list[static_cast<std::size_t>(i)] = std::abs(model.raw_residual()[i]) / model.sigma_of_mean(i);
    return list;
  }

  Reduced& reduced_;
  MeanNoise noise_;
  explain::Hypothesis at_;
};

}  // namespace

Placed fit_placements(Reduced& reduced, const MeanNoise& noise, const std::vector<Active>& at_work) {
  constexpr int most_passes = 4;
  pool_variances(reduced, noise);
  explain::Hypothesis stated(reduced.bench);
  stated.terms = at_work;
  predict_at(reduced, stated, true);
  const double excess = excess_of(reduced, noise, stated);
  MeanNoise wider = noise;
  wider.factor *= excess;
  Places places(reduced, wider, at_work);
  explain::Hypothesis& there = places.at();
  places.fit();
  const Nuisance by_all = there.nuisance;
  bool most = places.fits_most();
  if (!most) {
    Places trimmed(reduced, wider, at_work);  // from where the bench file has them
    trimmed.turn();
    trimmed.fit_trimmed();
    if (trimmed.fits_most()) {
      there = trimmed.at();
      most = true;
    }
  }
  for (int pass = 0; most && pass < most_passes; ++pass) {
    if (reassign(reduced, there.nuisance, all_at_work(reduced.bench, there), wider.footprint_rad) == 0) break;
    pool_variances(reduced, wider);
    places.fit();
    most = places.fits_most();
  }
  if (most) {
    reduction::share_out_again(reduced, there.nuisance, all_at_work(reduced.bench, there));
    return {excess, true, there.nuisance, by_all};
  }
  // Nobody knows what beams meet but by the bench file.
  predict_at(reduced, stated, true);
  return {excess, false, stated.nuisance, by_all};
}

}  // namespace fit::explain::inference
