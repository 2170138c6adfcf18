// SPDX-License-Identifier: MIT
#include "fit/explain/search/figures.hpp"

#include <algorithm>
#include <cmath>

namespace fit::explain::search {
namespace {

/// Whole captures go to one block each in turn; a session of few captures is cut into sectors of beams.
Blocks blocks_of(const MeanModel& model, std::size_t captures) {
  const bool few = captures < 6;
  Blocks blocks;
  blocks.count = few ? 6 : static_cast<int>(std::min<std::size_t>(8, captures));
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const int number =
        few ? static_cast<int>((model.cell(i).beam_rad + 4) * deg_per_rad / 9) : model.group(i).capture;
    blocks.of_row.push_back(number % blocks.count);
  }
  return blocks;
}

}  // namespace

Blocks blocks_and_floor(const Fitting& fitting, MeanResult& result) {
  const MeanModel model(fitting.reduced(), fitting.noise());
  double sum = 0;
  for (Eigen::Index i = 0; i < model.rows(); ++i) sum += model.variance_of_mean(i);
  result.noise_floor_mm = std::sqrt(sum / std::max<double>(1, static_cast<double>(model.rows())));
  return blocks_of(model, fitting.reduced().captures.size());
}

HeldOutFigures held_out(Fitting& fitting, const Hypothesis& h, const Blocks& blocks) {
  const MeanModel::HeldOut out = fitting.placed_model(h).held_out(blocks.of_row, blocks.count);
  const double n = std::max(1.0, out.cells);
  return {out.log_likelihood, std::sqrt(out.squares / n), out.within_2u / n, out.cells};
}

HeldOutFigures held_out_of_nothing(Fitting& fitting, const Blocks& blocks) {
  Hypothesis nothing(fitting.bench());
  fitting.fit(nothing);
  return held_out(fitting, nothing, blocks);
}

void measure(Fitting& fitting, const Hypothesis& best, MeanResult& result) {
  const Blocks blocks = blocks_and_floor(fitting, result);
  result.after = held_out(fitting, best, blocks);
  result.without.clear();
  for (std::size_t t = 0; t < best.terms.size(); ++t)
    result.without.push_back(held_out(fitting, fitting.without(best, t), blocks));
  result.before = held_out_of_nothing(fitting, blocks);
  result.best = best;
  fitting.place(best);
}

}  // namespace fit::explain::search
