// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "fit/bench/bench.hpp"
#include "fit/mechanism.hpp"

namespace fit {

/// What a device does that no mechanism of the catalogue explains, as a table over one coordinate: linear
/// between its places, nothing farther outside of them than their spacing. In a bench file: an entry of the
/// list `empirical` (docs/develop/simulator.md).
struct EmpiricalFunction {
  /// `beam_deg`, `stage_deg`, `range_mm`, `intensity`, `incidence_deg`, `time_s`, `temperature_c` (rise since
  /// the first capture), `corner_mm` (to the next inner corner), `along_mm` (place on `target`),
  /// `edge_distance_deg` (positive on the nearer surface; for `far_share` only).
  std::string coordinate;
  /// What it is added to: `range_mm`, `range_mm_per_m` (times the range), `beam_angle_deg`,
  /// `stage_angle_deg`, `log_intensity`; or
  /// `far_share`: how much of an echo at an edge comes from the farther surface.
  std::string acts_on;
  std::string target;  ///< The only one it acts on; empty: all.
  std::vector<double> at, value;

  [[nodiscard]] double value_at(double coordinate_value) const;
  /// Whether it was measured about there: at one of its places, or between two that lie close together.
  [[nodiscard]] bool covers(double coordinate_value) const;
  /// Its coordinate there, file unit; not finite where it has none.
  [[nodiscard]] double place_of(const Circumstances& at) const;
};

/// Those that a bench file holds. Throws std::invalid_argument when an entry is not what it should be.
[[nodiscard]] std::vector<EmpiricalFunction> empirical_functions(const Bench& bench);
/// One as an entry of the list.
[[nodiscard]] nlohmann::json as_entry(const EmpiricalFunction& function);
/// Adds one to the bench's document, if it has a place.
void add_empirical(Bench& bench, const EmpiricalFunction& function);
/// Drops all targets but the first `count`, and what acts on those dropped.
void keep_targets(Bench& bench, std::size_t count);

/// Whether it acts beside mechanisms: it is no `far_share`.
[[nodiscard]] bool moves_or_dims(const EmpiricalFunction& function);
/// The same as a mechanism without parameters, to act beside those of the catalogue.
[[nodiscard]] Mechanism as_mechanism(const EmpiricalFunction& function, const Bench& bench);

/// Depth of an edge below which front and back make one echo in between, mm: `merging_mm` in the section
/// `sim`.
[[nodiscard]] std::optional<double> described_merging(const Bench& bench);
void state_merging(Bench& bench, double merging_mm);

/// Where samples lie that have nothing to do with the target: quantiles of the range in mm, or of its share
/// of the way to the target. `strays` in the section `sim`: {"range_mm": [...]} or {"of_target": [...]}.
struct StrayPlaces {
  bool before_target = false;
  std::vector<double> quantiles;  ///< In equal steps of probability, the least and the largest included.

  /// Range of the stray that lies at `probability`.
  [[nodiscard]] double range_mm(double probability, double target_mm) const;
};
[[nodiscard]] std::optional<StrayPlaces> described_strays(const Bench& bench);
void state_strays(Bench& bench, const StrayPlaces& strays);

}  // namespace fit
