// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/intensity/model.hpp"
#include "fit/explain/intensity/suspicion.hpp"

namespace fit::explain::intensity {

/// One accepted suspicion and how certain it is.
struct Judged {
  Suspicion suspicion;
  std::vector<Suspicion> rivals;  ///< With a name, and close behind.
  double probability = 0;
  double gain = 0;         ///< Of the log-likelihood of readings that it was not fitted to.
  double rms_without = 0;  ///< How these scatter around their prediction without it, relative.
  bool unknown = false;    ///< Without a name, or beaten by something without one.

  /// By readings that it was not fitted to. What is not contradicts the bench file, or would not be here.
  [[nodiscard]] bool is_confirmed() const;
  /// Told by its name.
  [[nodiscard]] bool is_found() const;
};

struct Judgement {
  std::vector<Suspicion> accepted;
  std::vector<Judged> judged;    ///< In the order of `accepted`.
  Model::HeldOut before, after;  ///< Without, and with everything accepted.
};

/// Drops what does not predict readings that it was not fitted to, and compares the rest with its rivals.
[[nodiscard]] Judgement judge(const Readings& readings, std::vector<Suspicion> accepted);

}  // namespace fit::explain::intensity
