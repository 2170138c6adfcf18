// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "fit/range/selection.hpp"
#include "fit/recording.hpp"

namespace fit {

/// What one beam saw at one stop of the stage, near an edge.
struct EdgeStop {
  enum class State { front, jitter, back };
  std::size_t capture = 0;  ///< Index into the recording's captures.
  double stage_rad = 0;
  long n = 0;
  long back = 0;                             ///< Samples nearer to the surface behind.
  long outside_front = 0, outside_back = 0;  ///< Samples that neither surface alone explains.
  double mean_mm = 0, sd_mm = 0;             ///< Of the echoes.
  State state = State::front;
};

/// Where the edge is and how wide the window of jitter, from the share of samples that see the surface
/// behind.
struct EdgeResponse {
  Estimate edge_rad;              ///< Stage angle at which half of the samples see behind.
  Estimate window_rad;            ///< Whole width of the response; of a Gaussian one, from 1 % to 99 %.
  double ramp_probability = 0.5;  ///< That the response is a straight ramp rather than a Gaussian one.
  double dispersion = 1;  ///< Pearson's chi-square per degree of freedom that widened the uncertainties.
  int stops_inside = 0;   ///< Stops that jitter: with none, the window is only bounded from above.
};

/// The paper's way: the stage angles of the first and last stop that jitter, in ascending order, of a series
/// of stops `step_rad` apart.
struct CountedWindow {
  double first_rad = 0, last_rad = 0, step_rad = 0;
  [[nodiscard]] double width_rad() const { return last_rad - first_rad + step_rad; }
};

/// One beam passing a target's edge while the stage turns (source A, experiment A4).
struct EdgeCrossing {
  int step = 0;  ///< The beam.
  double beam_rad = 0;
  int approach = 0;                  ///< Sign of the moves by which its stops were reached.
  bool right = true;                 ///< The clockwise end of the front surface, as the lidar sees it.
  double front_mm = 0, back_mm = 0;  ///< Levels; back 0: nothing is there.
  std::vector<EdgeStop> stops;       ///< Those near the edge, by stage angle.
  EdgeResponse response;
  /// From the stops of one step of the procedure, which passed the window evenly and has a smooth stop on
  /// both sides; of several the finest. Stops of others may lie between.
  std::optional<CountedWindow> counted;
  double step_rad = 0;  ///< Smallest distance of stops about the edge.
};

struct EdgeOptions {
  std::optional<std::string> target;         ///< Only captures about this target, or about none.
  std::optional<bool> right;                 ///< Only this end.
  double chance = 1e-3;                      ///< Probability at which a smooth stop may be called jittering.
  double reach_rad = 2 * rad_per_deg;        ///< Stops farther from the edge are left out.
  double least_gap_rad = 0.2 * rad_per_deg;  ///< Edges that stops bracket less closely are not fitted.
};

/// All edge crossings in a recording whose stops bracket the edge within `least_gap_rad`, best known first.
/// A stop jitters when more of its samples leave the surface's gate than chance allows (binomial test against
/// the share measured at all other smooth stops of that surface), so no threshold in millimetres is chosen.
[[nodiscard]] std::vector<EdgeCrossing> find_edge_crossings(const Recording& recording,
                                                            const EdgeOptions& options = {});

/// Share of samples that see behind, so many windows past the edge: of a straight response, or of a Gaussian
/// one.
[[nodiscard]] double share_behind(double windows, bool ramp);

/// Posterior mean and standard deviation of edge and window, by summing the likelihood over edge, window,
/// shape of the response (ramp, Gaussian) and share of stray samples; flat priors. Every stop is off by an
/// angle of its own, with equal probability within sqrt(3) `u_stop_rad` (0: exact). `rising`: the share of
/// samples behind grows with the stage angle. Needs a stop at each side of the edge.
[[nodiscard]] EdgeResponse fit_edge_response(const std::vector<EdgeStop>& stops, bool rising,
                                             double u_stop_rad = 0);

}  // namespace fit
