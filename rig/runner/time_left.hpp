// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <vector>

#include "rig/procedure/procedure_plan.hpp"

namespace rig {

/// How long a run still takes. Every kind of step has a pace of its own, measured against the plan: prompts
/// that are answered at once say nothing of captures. A kind that has not run yet is believed to go as the
/// plan says, or as the devices have gone so far.
class TimeLeft {
 public:
  /// `plan` is kept by reference.
  explicit TimeLeft(const std::vector<PlannedStep>& plan);

  /// A step that runs. Shares of its work from 0 to 1.
  struct Running {
    std::size_t step = 0;
    double from = 0;      ///< An earlier run had done.
    double done = 0;      ///< Is done now.
    double passed_s = 0;  ///< Since it began, without pauses.
  };

  /// That step is over, and nothing was measured: an earlier run had done it, or it is left out.
  void over(std::size_t step);
  /// That step is done.
  void over(const Running& finished);
  /// That step is to be done again.
  void again(std::size_t step);

  [[nodiscard]] double left_s(const Running& now) const;
  /// Share of the whole plan that is done, by planned time.
  [[nodiscard]] double share(const Running& now) const;

 private:
  struct Pace {
    double planned_s = 0, took_s = 0;  ///< Of what was measured.
    double ahead_s = 0;                ///< Planned, of what is not over.
  };
  [[nodiscard]] static double ratio(double planned_s, double took_s, double otherwise);

  const std::vector<PlannedStep>& plan_;
  std::map<const StepKind*, Pace> paces_;
  double planned_s_ = 0, over_s_ = 0;
};

}  // namespace rig
