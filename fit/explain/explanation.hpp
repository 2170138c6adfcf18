// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "fit/bench/empirical.hpp"
#include "fit/explain/model/results.hpp"
#include "fit/explain/prediction.hpp"

namespace fit::explain {

/// What answers name where they do not name a mechanism: verdicts, and members of undecided sets.
inline constexpr const char *unknown_physics = "unknown-physics", *nothing_missing = "nothing-missing";

/// A stretch of one coordinate on which simulation and recording differ.
struct Located {
  Coordinate coordinate = Coordinate::beam;
  double from = 0, to = 0;  ///< File unit of the coordinate.
  Observable observable = Observable::range_mean;
  double p_value = 1;
};

/// One mechanism that is part of the explanation.
struct Found : Finding {
  const Mechanism* mechanism = nullptr;
  double probability = 0;
  std::string says, evidence;
  double log_likelihood_gain = 0;
  bool gain_is_expected = false;  ///< Not measured on data that it was not fitted to.
};

/// A curve for the report: residual means against a coordinate, before and after.
struct Curve {
  Coordinate coordinate = Coordinate::beam;
  std::string target = {};  ///< Along which, by the place on it, mm from its middle; empty: none.
  std::vector<double> at, before_mm, after_mm, sigma_mm;
};

/// The answer to "what did the simulation leave out?" (formats.md, `explanation/1`).
struct Explanation {
  std::string verdict;
  std::vector<Located> located;
  std::vector<Found> mechanisms;
  std::vector<std::vector<std::string>> undecided_between;
  std::optional<Unexplained> unknown;
  bool unknown_is_bench_error = false;  ///< It is a target that is not where the bench file has it, no more.
  HeldOutFigures before, after;
  double noise_floor_mm = 0;
  Bench bench;  ///< With what was found.
  std::vector<Curve> curves;
  std::vector<SpreadCurve> spread_curves;  ///< Where noise, echoes, intensity or memory are not as simulated.
  std::vector<std::string> notes;
  long samples = 0;
  std::size_t cells = 0;
  int left_out = 0;
  std::vector<EmpiricalFunction> correction;  ///< Functions without a name that carry over to others.
  Predictor predictor;                        ///< To predict recordings that took no part.
  std::vector<Prediction> predictions;
  bool several_places = false;  ///< Targets were put up in several places, each a target of its own.
  std::vector<Active> suspects;  ///< Members of undecided sets, with their values: for the next experiment.
  std::vector<SeenShape> unnamed_suspects;  ///< Forms that explain nearly as much as one of these.
  std::vector<Suspect> noise_suspects;      ///< The same for noise, lost echoes and intensity.
  bool may_be_nothing = false;              ///< Instead of one of these.

  [[nodiscard]] std::size_t rivals_in_range() const {
    return suspects.size() + unnamed_suspects.size() + (may_be_nothing ? 1 : 0);
  }
  [[nodiscard]] std::size_t rivals_beside_range() const {
    return noise_suspects.size() + (may_be_nothing ? 1 : 0);
  }
  /// Whether there is something that an experiment could decide.
  [[nodiscard]] bool has_rivals() const { return rivals_in_range() > 1 || rivals_beside_range() > 1; }
};

/// Explains one or several recordings of the same bench together. Throws std::invalid_argument when there is
/// nothing to compare: no targets, no scans that meet one, or benches that differ.
[[nodiscard]] Explanation explain(const std::vector<const Recording*>& recordings, const Progress& progress);

/// What is found so far in one word.
[[nodiscard]] std::string verdict_of(const Explanation& explanation);

/// `explanation/1`; `next_experiment` is the caller's.
[[nodiscard]] nlohmann::json to_json(const Explanation& explanation);
/// The answer in a few lines for a terminal.
[[nodiscard]] std::string to_text(const Explanation& explanation);

/// What the catalogue says would tell members of undecided sets from their rivals, work that no procedure can
/// do included: "to X (id); to Y (id)". Empty without such members.
[[nodiscard]] std::string what_separates(const Explanation& explanation);

/// "a, b LAST c".
[[nodiscard]] std::string listed(const std::vector<std::string>& names, const std::string& last = "and");

/// The members of an undecided set as people read them.
[[nodiscard]] std::vector<std::string> suspects_in_words(std::vector<std::string> ids);

}  // namespace fit::explain
