// SPDX-License-Identifier: MIT
#include "fit/explain/search/settling.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "fit/median.hpp"

namespace fit::explain::search {
namespace {

/// How far the beams are off at a hypothesis, in standard uncertainties; in the order of the smooth cells.
std::vector<double> deviations(Fitting& fitting, const Hypothesis& h) {
  fitting.place(h);
  const MeanModel model(fitting.reduced(), fitting.noise());
  std::vector<double> list(static_cast<std::size_t>(model.rows()));
  for (Eigen::Index i = 0; i < model.rows(); ++i)
    list[static_cast<std::size_t>(i)] = std::abs(model.raw_residual()[i]) / model.sigma_of_mean(i);
  return list;
}

/// Whether most beams are explained but for noise. Otherwise mount and walls were bent to explain something
/// else, and no beam may be left out by where they stand.
bool fits_most(Fitting& fitting, const Hypothesis& h) {
  constexpr double median_of_chance = 0.6745;
  return h.shapes.empty() && median_of(deviations(fitting, h)) < 1.4 * median_of_chance;
}

/// Mount and walls fitted to the beams that agree with each other: what lies far off, such as beams that
/// meet another wall than the bench file says, has no say.
Hypothesis trimmed(Fitting& fitting, Hypothesis h) {
  constexpr int most_passes = 8;
  std::size_t before = 0;
  for (int pass = 0; pass < most_passes; ++pass) {
    const std::vector<double> off = deviations(fitting, h);
    const double far = std::max(4.0, 2.5 * 1.4826 * median_of(std::vector(off)));
    std::vector<Cell*> without;
    std::size_t row = 0;
    for (Cell& cell : fitting.reduced().cells)
      if (cell.smooth && off[row++] > far) without.push_back(&cell);
    for (Cell* cell : without) cell->smooth = false;
    fitting.fit(h);
    for (Cell* cell : without) cell->smooth = true;
    if (without.size() == before) break;
    before = without.size();
  }
  return h;
}

}  // namespace

void settle(Fitting& fitting, Hypothesis& h) {
  constexpr int most_passes = 4;
  Reduced& reduced = fitting.reduced();
  const MeanNoise& noise = fitting.noise();
  fitting.fit(h);
  bool most = fits_most(fitting, h);
  if (h.terms.empty() && !most) {
    const Hypothesis other = trimmed(fitting, h);
    if (fits_most(fitting, other)) {
      h = other;
      most = true;
    }
  }
  for (int pass = 0; pass < most_passes; ++pass) {
    if (reassign(reduced, h.nuisance, all_at_work(fitting.bench(), h), noise.footprint_rad, most) == 0) break;
    pool_variances(reduced, noise);
    fitting.fit(h);
    most = fits_most(fitting, h);
  }
}

}  // namespace fit::explain::search
