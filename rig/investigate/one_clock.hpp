// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "rig/session/session_store.hpp"

namespace rig::investigate {

/// The sessions of one investigation as recordings on one clock, which begins with the first: what drifts
/// goes on from session to session. The time between two is the lidar's own where it ran on (a simulation at
/// full speed passes no time of the computer's), else the computer's. With `on_for_s`, how long the lidar had
/// been on when the first session began, captures know how long it is on; a later cold start begins that
/// anew.
///
/// The stores must outlive the recordings. `bench` takes the place of the sessions' own.
[[nodiscard]] std::vector<std::unique_ptr<fit::Recording>> on_one_clock(
    const std::vector<std::unique_ptr<SessionStore>>& sessions, const fit::Bench& bench,
    std::optional<double> on_for_s);

/// What time passed from one moment to the next, seconds, by the lidar's stamps (milliseconds, counted to
/// 2^24) and by the computer's clock. The lidar's counts where both agree or the computer's cannot be right.
[[nodiscard]] double passed_s(std::int64_t device_ms_before, std::int64_t device_ms_after, double computer_s);

}  // namespace rig::investigate
