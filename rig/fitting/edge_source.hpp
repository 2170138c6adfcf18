// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "fit/range/edge.hpp"
#include "rig/fitting/fitting.hpp"

namespace rig {

/// A crossing with the recording it was found in.
struct SourcedCrossing {
  fit::EdgeCrossing crossing;
  const fit::Recording* recording = nullptr;
};

/// The edge crossings of all sources, reduced to those of the target the captures are about.
struct EdgeSource {
  std::vector<std::unique_ptr<fit::Recording>> recordings;
  std::vector<std::string> names;           ///< Their files, without folders.
  std::vector<SourcedCrossing> crossings;   ///< Best known first.
  std::string target;                       ///< Empty: captures name none.
  std::vector<std::string> contradictions;  ///< Where the bench file contradicts the captures.
};

/// Options "target" and "edge" (right, left) as described by edge_options(). Throws MeasurementError, saying
/// what was seen instead, when no beam passes an edge.
[[nodiscard]] EdgeSource read_edges(const std::vector<FitSource>& sources, const FitOptions& options);

[[nodiscard]] std::vector<FitOption> edge_options();

}  // namespace rig
