// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "rig/procedure/step.hpp"
#include "rig/text_lines.hpp"

namespace rig {

/// One step of an unrolled procedure: what runs, in which turn of which loops, and what it is expected to
/// take.
struct PlannedStep {
  const Step* step = nullptr;
  std::string key;  ///< "4.1[distance_mm=300]": the same in every run of the same file.
  Variables loop_variables;
  std::vector<std::string> turns;  ///< The turns it is in, outermost first, for skipping and repeating.
  std::string says;
  double seconds = 0, travel_deg = 0;
  long captures = 0, scans = 0;
  bool at_least = false;  ///< The run may take longer and capture more: it depends on what it finds.
};

/// Unrolls the loops and walks through every step without devices: all that the bench file and the soft
/// limits forbid is found here, before anything moves. Throws ProcedureError.
std::vector<PlannedStep> unroll(const Procedure& procedure, const fit::Bench& bench);

/// The `stage` entry of the bench file (limits_deg, speed_deg_s).
StageLimits stage_limits(const fit::Bench& bench);

/// What `--dry-run` prints.
std::string dry_run_text(const Procedure& procedure, const fit::Bench& bench,
                         const std::vector<PlannedStep>& plan);

/// A moment of a session: "1:02:03" after its beginning.
std::string session_time_text(double seconds);
/// "10,000".
std::string grouped(long number);

}  // namespace rig
