// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <vector>

#include "fit/explain/inference/optimum.hpp"
#include "fit/explain/model/gaussian.hpp"

namespace fit::explain::inference {

/// A hypothesis at its best values with its evidence, and what a search asks about it.
struct Fitted {
  Hypothesis hypothesis;
  Design design;
  Optimum optimum;
  /// Priors and deviations are those of the sizes that were found: else its evidence is of another model.
  bool suits_sizes = true;
};
[[nodiscard]] Fitted fit(const Session& session, const Hypothesis& hypothesis);

/// Fits of parts of one hypothesis, each made once.
class Fits {
 public:
  explicit Fits(const Session& session) : session_(session) {}
  const Fitted& operator()(const Hypothesis& part) {
    const auto [known, is_new] = known_.try_emplace(part.kinds());
    if (is_new) known->second = fit(session_, part);
    return known->second;
  }

 private:
  const Session& session_;
  std::map<std::vector<const Kind*>, Fitted> known_;
};

}  // namespace fit::explain::inference
