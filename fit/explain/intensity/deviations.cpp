// SPDX-License-Identifier: MIT
#include "fit/explain/intensity/deviations.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fit/explain/intensity/bells.hpp"

namespace fit::explain::intensity {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using L = IntensityLaw;

/// What nobody's law of intensity gets right to better: receivers bend, surfaces are not quite Lambertian.
constexpr double response_doubt = 0.02, incidence_doubt = 0.03;
/// Where the bench leaves parts of the law open, its form is open as well.
constexpr double open_response = 0.3;
/// Reflectances are nominal, and no surface is of one grey.
constexpr double reflectance_doubt = 0.08;
constexpr std::array<double, L::size> open{3, 1, 1, 1, 0, 0};  ///< Where nothing is stated.

/// Takes off what the bench knows: mechanisms, and functions without a name.
void take_off_known(const Readings& readings, const L& law, VectorXd& y) {
  for (const KnownMechanism& known : readings.reduced.bench.known) {
    const Mechanism* m = find_mechanism(known.mechanism);
    if (!m || known.mechanism == law_of_intensity || m->observable != Observable::intensity) continue;
    const auto target = known.texts.find("target");
    const std::vector<double> values = m->values(known.parameters);
    for (Index i = 0; i < readings.count(); ++i) {
      const Circumstances& at = readings.cell(i).at;
      if (target != known.texts.end() && readings.target(at.target).name != target->second) continue;
      y[i] -= m->act(at, values).log_intensity;
    }
  }
  for (const Mechanism& unnamed : readings.reduced.empirical) {
    if (unnamed.observable != Observable::intensity) continue;
    for (Index i = 0; i < readings.count(); ++i) {
      Circumstances at = readings.cell(i).at;
      at.intensity = std::exp(readings.predicted(i, law));
      y[i] -= unnamed.act(at, {}).log_intensity;
    }
  }
}

/// Deviations from the law, from what the bench knows already and from what is accepted.
VectorXd deviations(const Readings& readings, const std::vector<Suspicion>& accepted, const L& law) {
  VectorXd y(readings.count());
  for (Index i = 0; i < readings.count(); ++i) y[i] = readings.row(i).log_counts - readings.predicted(i, law);
  take_off_known(readings, law, y);
  for (const Suspicion& s : accepted)
    if (s.acts()) y -= effect_of(readings, s);
  return y;
}

/// The law's coefficients: as certain as they are stated, and free where they are found wrong.
Block coefficients_of_law(const Readings& readings, const std::vector<Suspicion>& accepted, const L& law) {
  std::array<bool, L::size> wrong{};
  double scale = 1;
  for (const Suspicion& s : accepted)
    for (const int k : s.coefficients) {
      wrong[static_cast<std::size_t>(k)] = true;
      scale = std::max(1.0, s.size);
    }
  Block block;
  const MatrixXd columns = law_columns(readings, law);
  for (int k = 0; k < L::size; ++k) {
    const auto c = static_cast<std::size_t>(k);
    double sigma = readings.claim.stated[c] ? std::hypot(readings.claim.u[c], 1e-6) : open[c];
    if (wrong[c]) sigma = std::hypot(sigma, scale * released[c]);
    block.add(columns.col(k), std::max(1e-9, sigma));
  }
  return block;
}

/// An indicator of every surface: its own grey.
MatrixXd surface_columns(const Readings& readings) {
  MatrixXd columns = MatrixXd::Zero(readings.count(), readings.surfaces);
  for (Index i = 0; i < readings.count(); ++i) columns(i, readings.row(i).surface) = 1;
  return columns;
}

}  // namespace

MatrixXd law_columns(const Readings& readings, const L& law) {
  MatrixXd columns(readings.count(), L::size);
  for (int k = 0; k < L::size; ++k) {
    const auto c = static_cast<std::size_t>(k);
    L up = law, down = law;
    up.value[c] += 0.01;
    down.value[c] -= 0.01;
    for (Index i = 0; i < readings.count(); ++i)
      columns(i, k) = (readings.predicted(i, up) - readings.predicted(i, down)) / 0.02;
  }
  return columns;
}

Block nuisances(const Readings& readings, const std::vector<Suspicion>& accepted, const L& law) {
  Block base = coefficients_of_law(readings, accepted, law);
  base.add(surface_columns(readings), reflectance_doubt);
  const Index count = readings.count();
  VectorXd brightness(count), distance(count), slant(count);  // logarithms, degrees
  for (Index i = 0; i < count; ++i) {
    const Circumstances& at = readings.cell(i).at;
    brightness[i] = readings.predicted(i, law);
    distance[i] = std::log(at.range_mm);
    slant[i] = std::abs(at.incidence_rad) * deg_per_rad;
  }
  const auto& stated = readings.claim.stated;
  const bool whole = stated[L::gain] && stated[L::range_power] && stated[L::reflectance_power];
  if (span_of(brightness) > 0.05) base.add(bells(brightness, 0.7), whole ? response_doubt : open_response);
  // Where it is not, nothing is claimed of the way in which echoes fall with range either.
  if (!whole && span_of(distance) > 0.05) base.add(bells(distance, 0.5), open_response);
  if (span_of(slant) > 5) base.add(bells(slant, 20), incidence_doubt);
  return base;
}

Block freedom_of(const Readings& readings, const Suspicion& s) {
  Block block;
  for (const Searched& by : searched(*s.mechanism)) block.add(slope_of(readings, s, by), by.sigma);
  const VectorXd effect = effect_of(readings, s);
  const double largest = effect.cwiseAbs().maxCoeff();
  if (largest <= 0) return block;
  for (const int wave : {1, 2}) {  // real causes only resemble formulas
    VectorXd bent(readings.count());
    for (Index i = 0; i < readings.count(); ++i)
      bent[i] = effect[i] * std::cos(wave * pi * effect[i] / largest);
    block.add(bent, s.mechanism->formula_error);
  }
  return block;
}

Block base_of(const Readings& readings, const std::vector<Suspicion>& accepted, const L& law) {
  Block base = nuisances(readings, accepted, law);
  for (const Suspicion& s : accepted) {
    if (s.acts()) base.add(freedom_of(readings, s));
    if (!s.mechanism) base.add(columns_of(readings, s), s.size);
  }
  return base;
}

Model model_of(const Readings& readings, const std::vector<Suspicion>& accepted) {
  return model_of(readings, accepted, readings.claim.law);
}

Model model_of(const Readings& readings, const std::vector<Suspicion>& accepted, const L& law) {
  VectorXd weight(readings.count());
  for (Index i = 0; i < readings.count(); ++i) weight[i] = 1 / readings.row(i).sigma;
  VectorXd y = deviations(readings, accepted, law);
  const Block base = base_of(readings, accepted, law);
  // The law's columns pull to what is claimed, not to where the model is expanded.
  for (int k = 0; k < L::size; ++k) {
    const auto c = static_cast<std::size_t>(k);
    y += (law.value[c] - readings.claim.law.value[c]) * base.columns.col(k);
  }
  return {y, std::move(weight), base};
}

}  // namespace fit::explain::intensity
