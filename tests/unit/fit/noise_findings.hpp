// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/explain/explanation.hpp"

/// What `explain` finds in a recording's noise: names, sets of names, what nobody knows.
struct NoiseFindings {
  std::vector<fit::explain::Found> accepted;
  std::vector<std::vector<std::string>> undecided;
  std::vector<fit::explain::Unexplained> unknown;
  std::vector<fit::explain::SpreadCurve> curves;
  double gain = 0;  ///< Of the log-likelihood of captures that took no part.

  explicit NoiseFindings(const fit::Recording& recording) {
    const fit::explain::Explanation e = fit::explain::explain({&recording}, {});
    accepted = e.mechanisms;
    undecided = e.undecided_between;
    if (e.unknown) unknown.push_back(*e.unknown);
    curves = e.spread_curves;
    gain = e.after.log_likelihood - e.before.log_likelihood;
  }
  /// Ids and sets, for people who read a failure.
  [[nodiscard]] std::string in_words() const {
    std::string text;
    for (const auto& found : accepted) text += found.mechanism->id + " ";
    for (const auto& set : undecided) text += "{" + fit::explain::listed(set, "or") + "} ";
    for (const auto& u : unknown) text += u.describes + " ";
    return text;
  }
};
