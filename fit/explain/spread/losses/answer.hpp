// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/spread.hpp"
#include "fit/explain/spread/losses/laws.hpp"

/// What is said about lost echoes.
namespace fit::explain::spread {

/// Weak echoes, of which so many are lost, stay below a threshold.
[[nodiscard]] Suspect dropout_at(const Threshold& threshold, double lost);

/// Light hides echoes around one beam angle.
[[nodiscard]] Suspect light_in(const Window& window);

/// Light hides echoes where and while it falls in; what a single capture shows, or all angles do, may be
/// anything.
void tell(const WindowInTime& window, double gain, double evidence, SpreadResult& result);

/// Whatever their strength and angle.
[[nodiscard]] Unexplained lost_anywhere(const Counts& counts);

}  // namespace fit::explain::spread
