// SPDX-License-Identifier: MIT
#pragma once

#include <optional>

#include "fit/explain/reduction/samples.hpp"

namespace fit::explain::reduction {

/// Takes off the scans what a solid thing hid that stood before the targets in some of them: a person, a
/// door. Neighbouring beams see it side by side in one scan, as no stray sample of theirs does. What stands
/// there in all scans is left, as the bench file may be wrong. Returns where it was, if anywhere.
[[nodiscard]] std::optional<Passer> leave_out_passers(Samples& samples, const Scene& scene, double stage_rad);

}  // namespace fit::explain::reduction
