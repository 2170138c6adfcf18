// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/explain/experiment/experiments.hpp"
#include "rig/procedure/step.hpp"

namespace rig::investigate {

/// What one session records: experiments in order, and what people call it.
struct SessionPlan {
  std::string title, about;
  std::vector<fit::explain::Experiment> parts;
  std::string more_steps;  ///< Of the procedure, after those of the parts.

  [[nodiscard]] std::vector<fit::CaptureInfo> captures() const;
};

/// Where the stage may go, radians; a stage without soft limits turns 170 deg either way.
[[nodiscard]] fit::explain::StageTravel travel_of(const StageLimits& limits);

/// The first session: a short look from several stage angles, come to from both sides, and, `with_hand` and a
/// target that can be moved, at a few distances and greys.
[[nodiscard]] SessionPlan first_plan(const fit::Bench& bench, const StageLimits& limits, bool with_hand);

/// Sessions that nobody's suspicion asks for, to be taken where nothing is left in doubt: along what no
/// session has looked along so far. Only that at two temperatures needs a hand.
[[nodiscard]] std::vector<SessionPlan> surveys(const fit::Bench& bench, const StageLimits& limits,
                                               const std::vector<fit::CaptureInfo>& so_far);

/// The last session, whose outcome is predicted: other stage angles than all so far, and, `with_hand`, other
/// distances and greys of a target that was moved, other rates of a stage that turned, other temperatures.
[[nodiscard]] SessionPlan fresh_plan(const fit::Bench& bench, const StageLimits& limits, bool with_hand,
                                     const std::vector<fit::CaptureInfo>& so_far);

/// The procedure file of a session. What one of its experiments moved, covered, heated or cooled is put back
/// at its end: the next begins with the bench as its file says.
[[nodiscard]] std::string procedure_text(const std::string& name, const SessionPlan& plan,
                                         const fit::Bench& bench);

}  // namespace rig::investigate
