// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "fit/recording.hpp"
#include "rig/procedure/step.hpp"

namespace rig {

/// The bench as the prompts of a run have left it: where targets were put and with which surface, how warm
/// the housing is, and when the lidar was switched on. Captures are recorded with it.
class PlacedBench {
 public:
  /// What a prompt placed, at a moment of the session.
  void place(const Placement& placement, std::int64_t now_us);
  /// What to keep for a resumed run, and back again; what is no such document is passed over.
  [[nodiscard]] nlohmann::json placements_json() const;
  void restore(const nlohmann::json& placements, const nlohmann::json& power_on_us);

  /// By target; the temperature under "".
  [[nodiscard]] const std::map<std::string, Placement>& placements() const { return placements_; }
  [[nodiscard]] bool has_placed(const std::string& target) const { return placements_.contains(target); }
  /// When the lidar was switched on, on the session's clock, if a prompt said so.
  [[nodiscard]] std::optional<std::int64_t> power_on_us() const { return power_on_us_; }
  /// A target of the bench file where the prompts so far have put it.
  [[nodiscard]] fit::Target as_placed(const fit::Target& target) const;
  /// Completes a capture's circumstances, for its own target and moment. A capture about no target is about
  /// the only one that was moved, whose place it then records.
  void describe(fit::CaptureInfo& capture) const;
  /// Targets that stand elsewhere than the bench file has them, which a capture about `target` does not
  /// record.
  [[nodiscard]] std::vector<std::string> moved_beside(const std::optional<std::string>& target) const;

 private:
  std::map<std::string, Placement> placements_;
  std::optional<std::int64_t> power_on_us_;
};

}  // namespace rig
