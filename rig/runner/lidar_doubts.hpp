// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "fit/bench/bench.hpp"

namespace rig {

/// Something in which the lidar that answered is not what the bench file describes, or is not well.
struct LidarDoubt {
  enum class Weight {
    note,      ///< Worth knowing: it has beams that the bench file does not use.
    decision,  ///< Measured only if the operator decides so: another model or serial number, a state of
               ///< trouble.
    refusal,   ///< Cannot work: the beams that the bench file describes are not there or point elsewhere.
  };
  Weight weight;
  std::string what;  ///< "front step" ...
  std::string says;  ///< With the bench file's value, its place in the file, and the lidar's own.
  std::string remedy;
};

inline constexpr const char* lidar_state = "lidar's state";  ///< `what` of a lidar that is not well.

/// Compares what a lidar says of itself (VV, PP and II as LidarSource::connect returns them) with the bench
/// file. What the one does not tell or the other does not state is not compared.
[[nodiscard]] std::vector<LidarDoubt> doubts_of_lidar(const nlohmann::json& identity,
                                                      const fit::Bench& bench);

/// Whether a lidar's STAT says that it is well. Generations have their own words for it; what none of them
/// says is trouble.
[[nodiscard]] bool says_it_is_well(const std::string& state);

}  // namespace rig
