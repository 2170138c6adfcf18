// SPDX-License-Identifier: MIT
#include "fit/explain/mean_search.hpp"

#include <cmath>

#include "fit/explain/search/aliases.hpp"
#include "fit/explain/search/candidates.hpp"
#include "fit/explain/search/climbing.hpp"
#include "fit/explain/search/figures.hpp"
#include "fit/explain/search/judgement.hpp"
#include "fit/explain/search/scatter.hpp"
#include "fit/explain/search/settling.hpp"

namespace fit::explain {
namespace {

using namespace search;

constexpr std::size_t rows_of_search = 6000, rows_of_judgement = 40000, most_rows = 120000;

/// The best hypothesis of a session, or of fewer cells of it if it is large.
Hypothesis found(Fitting& fitting, const Hypothesis& empty, const Progress& progress) {
  if (!fitting.is_larger_than(rows_of_search)) return explored(fitting, empty, progress);
  // A large session is searched with neighbouring beams taken together first; what is found there is the
  // start of the full search.
  Reduced few = merged(fitting.reduced(), rows_of_search);
  Fitting coarse(few, fitting.noise());
  Hypothesis best = explored(coarse, empty, progress);
  fitting.cut_short_if(coarse.is_cut_short());
  settle(fitting, best);
  return best;
}

/// What was found among fewer cells, looked at once more and judged.
void decide(Fitting& fitting, Hypothesis& best, MeanResult& result) {
  constexpr std::size_t few_tries = 4;
  fitting.fit(best);  // Evidences compare on the same cells only.
  best = climbed(fitting, best, {.tries = few_tries, .exchange = !best.shapes.empty()});
  judge(fitting, best, result);
}

/// What was found, judged by all cells, or by fewer of a very large session.
void decide_by_enough(Fitting& fitting, Hypothesis& best, MeanResult& result) {
  if (!fitting.is_larger_than(rows_of_search)) return judge(fitting, best, result);
  if (!fitting.is_larger_than(rows_of_judgement)) return decide(fitting, best, result);
  // So many cells say the same as fewer of them taken together, but for fine combs; the figures are of all.
  if (!fitting.is_larger_than(most_rows) && shows_a_comb(fitting, best)) return decide(fitting, best, result);
  fitting.place(best);
  Reduced some = merged(fitting.reduced(), rows_of_judgement);
  Fitting fewer(some, fitting.noise());
  decide(fewer, best, result);
  fitting.cut_short_if(fewer.is_cut_short());
  fitting.fit(best);
  measure(fitting, best, result);
}

MeanResult searched(Reduced& reduced, const MeanNoise& noise, const Progress& progress) {
  Fitting fitting(reduced, noise);
  Hypothesis empty(reduced.bench);
  pool_variances(reduced, noise);
  // With what the bench knows at work, once: evidences compare on the same cells only.
  fitting.place(empty, true);
  const double excess = excess_beyond_doubt(fitting, empty);
  fitting.widen_noise(excess);
  settle(fitting, empty);
  report(progress, 0.05);
  Hypothesis best = found(fitting, empty, progress);
  report(progress, 0.8);
  MeanResult result(reduced.bench);
  decide_by_enough(fitting, best, result);
  doubt_aliases(fitting, result.best);
  fitting.place(result.best);
  result.noise = fitting.noise();
  result.excess = excess;
  result.cut_short = fitting.is_cut_short();
  report(progress, 1);
  return result;
}

}  // namespace

MeanResult search_means(Reduced& reduced, const MeanNoise& noise, const Progress& progress) {
  MeanResult result = searched(reduced, noise, progress);
  Fitting as_found(reduced, result.noise);
  const double scatter2 = scatter_of_groups(as_found, result.best);
  if (scatter2 <= 0 || !noise.range_mm2.empty()) return result;
  // Whole captures are off at random: their cells are worth far less than their number says.
  MeanNoise wider = noise;
  wider.range_mm2.assign(reduced.groups.size(), scatter2);
  MeanResult second = searched(reduced, wider, progress);
  second.scatter_mm = std::sqrt(scatter2);
  return second;
}

}  // namespace fit::explain
