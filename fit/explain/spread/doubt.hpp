// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "fit/explain/spread.hpp"
#include "fit/explain/spread/unnamed_noise.hpp"
#include "fit/explain/spread/variance_model.hpp"

namespace fit::explain::spread {

/// A mechanism that was found, and its columns among the parts of the noise.
struct NamedNoise {
  Suspect suspect;
  std::vector<std::size_t> columns;  ///< None: the constant noise, or not yet among the parts.
  bool is_open = false;              ///< The first of a set that nobody can choose from.

  [[nodiscard]] double price() const { return suspect.gain - suspect.evidence; }
};

/// What unnamed laws leave of names.
struct Doubted {
  std::optional<UnnamedNoise> unnamed;  ///< What was left out, if it explains more than names do.
  std::vector<bool> stays;              ///< Every name.
  std::vector<double> ahead;  ///< Of those that stay: log odds against what unnamed laws do without them.
};

/// Doubts the catalogue: noise that no name explains is not forced into one. A formula may be wrong by a part
/// of its effect, light has a profile that nobody knows, and a name is preferred to an unnamed law that
/// explains hardly more.
[[nodiscard]] Doubted doubt(const VarianceModel& model, Parts parts, std::vector<NamedNoise> names);

}  // namespace fit::explain::spread
