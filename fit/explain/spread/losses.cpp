// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "fit/explain/spread/losses/answer.hpp"
#include "fit/explain/spread/losses/counts.hpp"
#include "fit/explain/spread/losses/laws.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"
#include "fit/explain/spread/unseen.hpp"

namespace fit::explain::spread {
namespace {

constexpr double price = 8, clearly = 8, nearly_all = 0.1, lost_of_strays = 0.05;

/// Whether weak echoes scatter as those do that are about to be lost.
bool is_near_threshold(const SpreadResult& result) {
  return holds_steep_noise(result.accepted) || std::ranges::any_of(result.undecided, holds_steep_noise);
}

/// Samples that fell on something before their target. Of such things some send too little back to be seen.
double strays_among(const Counts& counts, const SpreadResult& result) {
  const auto strays =
      std::ranges::find_if(result.accepted, [](const Suspect& s) { return is(s, ids::outliers); });
  return strays == result.accepted.end() ? 0 : strays->parameters.at("fraction").value * counts.all;
}

/// What captures gain by the threshold that the others show.
double unseen_gain_of_threshold(const std::vector<Count>& own, const std::vector<Count>& others) {
  const Counts taught = summed(others), asked = summed(own);
  const Threshold learnt = best_threshold(taught, constant_likelihood(taught));
  const double none = asked.lost * std::log(rarest);
  return learnt.at > 0 ? likelihood_of_threshold(asked, learnt.at, learnt.width) - none : 0;
}

/// Every law of losses at its best, and what losses gain by any.
struct Laws {
  const Counts& counts;
  double none, constant;  ///< Log-likelihood, if none is ever lost, and if all are lost alike.
  Threshold threshold;
  Window window;
  std::optional<WindowInTime> in_time;

  explicit Laws(const Counts& counts_, bool has_intensity)
      : counts(counts_),
        none(counts.lost * std::log(rarest)),
        constant(constant_likelihood(counts)),
        threshold(has_intensity ? best_threshold(counts, constant) : Threshold{constant}),
        window(best_window(counts, constant)),
        in_time(best_window_in_time(counts)) {}

  [[nodiscard]] bool happen_for_a_while() const {
    return in_time && in_time->elsewhere < nearly_all * counts.lost &&
           in_time->log_likelihood >
               clearly + std::max({constant, threshold.log_likelihood, window.log_likelihood}) &&
           as_weak_come_back(*in_time, counts);
  }
  [[nodiscard]] bool happen_below_a_threshold() const {
    return threshold.at > 0 && threshold.log_likelihood - constant > 4 &&
           threshold.log_likelihood >= window.log_likelihood - 3;
  }
  /// Light that falls in explains what is lost there, not what is lost everywhere.
  [[nodiscard]] bool happen_in_a_window() const {
    return window.log_likelihood - constant > clearly && window.elsewhere < nearly_all * counts.lost;
  }
};

}  // namespace

void losses(const Reduced& reduced, SpreadResult& result) {
  const Counts counts = count(reduced, is_near_threshold(result));
  if (counts.lost < 3 || counts.all < 100) return;
  const Laws laws(counts, reduced.has_intensity);
  const bool light = is_accepted(result, ids::sunlight);
  // Part of it: background light also hides echoes.
  if (light && laws.window.log_likelihood > laws.threshold.log_likelihood - clearly) return;
  const auto accept = [&](Suspect suspect, double log_likelihood) {
    suspect.gain = log_likelihood - laws.none;
    suspect.evidence = suspect.gain - price;
    result.accepted.push_back(suspect);
  };
  if (laws.happen_for_a_while()) {
    const double gain = laws.in_time->log_likelihood - laws.none;
    if (!light) tell(*laws.in_time, gain, gain - price, result);
  } else if (laws.threshold.log_likelihood - laws.none - price < accept_rare_at) {
    return;
  } else if (laws.happen_below_a_threshold()) {
    Suspect dropout = dropout_at(laws.threshold, counts.lost);
    dropout.held_out_gain = held_out_gain(counts.cells, unseen_gain_of_threshold, &Count::capture);
    accept(dropout, laws.threshold.log_likelihood);
    result.curves.push_back(losses_along_intensity(counts, [&](double intensity) {
      return lost_below(laws.threshold.at, laws.threshold.width, intensity);
    }));
  } else if (laws.happen_in_a_window()) {
    if (!light) accept(light_in(laws.window), laws.window.log_likelihood);
  } else if (counts.lost >= 10 && counts.lost > lost_of_strays * strays_among(counts, result)) {
    Unexplained unknown = lost_anywhere(counts);
    unknown.gain = laws.constant - laws.none;
    unknown.evidence = unknown.gain - price;
    result.unknown.push_back(unknown);
    if (reduced.has_intensity)
      result.curves.push_back(losses_along_intensity(counts, [](double) { return 0.0; }));
  }
}

}  // namespace fit::explain::spread
