// SPDX-License-Identifier: MIT
#include "fit/explain/search/scatter.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace fit::explain::search {

double excess_beyond_doubt(const Fitting& fitting, const Hypothesis& empty) {
  const MeanModel model = model_of(fitting.reduced(), fitting.noise(), empty);
  const double excess = excess_scatter(model);
  // Four standard errors of a median of squares of which neighbours share two beams.
  const double doubt = 4 * 3.4 / std::sqrt(std::max<double>(60, static_cast<double>(model.rows())));
  return excess > 1 + doubt ? excess : 1;
}

double scatter_of_groups(Fitting& fitting, const Hypothesis& best) {
  const MeanModel model = fitting.placed_model(best);
  const Eigen::VectorXd residual = model.residual();
  const std::size_t all = fitting.reduced().groups.size();
  std::vector<double> sum(all, 0.0), weight(all, 0.0);
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const auto g = static_cast<std::size_t>(model.cell(i).group);
    const double w = 1 / (model.sigma_of_mean(i) * model.sigma_of_mean(i));
    sum[g] += w * residual[i];
    weight[g] += w;
  }
  double squares = 0, typical = 0;
  int groups = 0;
  for (std::size_t g = 0; g < sum.size(); ++g) {
    if (weight[g] <= 0) continue;
    squares += sum[g] * sum[g] / weight[g];
    typical += 1 / weight[g];
    ++groups;
  }
  if (groups < 10) return 0;
  const double ratio = squares / groups;
  if (ratio < 1 + 4 * std::sqrt(2.0 / groups)) return 0;
  return (ratio - 1) * typical / groups;
}

}  // namespace fit::explain::search
