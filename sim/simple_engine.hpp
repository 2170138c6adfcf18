// SPDX-License-Identifier: MIT
#pragma once

#include <limits>
#include <map>
#include <optional>
#include <vector>

#include "sim/engine.hpp"
#include "sim/random.hpp"

namespace sim {

/// What the simple engine needs beyond the scene. In a bench file: the section "sim"
/// (docs/develop/simulator.md).
struct SimpleOptions {
  double sigma_mm =
      3;  ///< Range noise; a UST-10LX stays under 30 mm (manual), 3 mm is a good one on white paper.
  double edge_window_rad = 0.05 * fit::rad_per_deg;  ///< Where a beam at an edge sees now one surface, now
                                                     ///< the other (Zhao et al., table 4).
  double intensity_at_reference = 2400;  ///< Counts at 200 mm on a white surface met squarely (Zhao et al.).
  double intensity_falloff_mm = 3000;    ///< Range at which the echo has fallen to half.
  double relative_intensity_noise = 0.01;
  /// Noise depends on the seed, the stage's place and the number of the scan in its stream alone, not on what
  /// was measured before: a run that was interrupted and resumed measures what an undisturbed one does.
  bool repeatable = false;
  double min_range_mm = 21,
         max_range_mm = 30000;  ///< Nearer: code 4; farther or no target: code 65533 (manual, table 3).
};

/// Planar scene of flat and round targets, one ray a beam, Gaussian noise, 1 mm steps; at edges a beam sees
/// one surface or the other at random within the window. What does not change between scans is computed once
/// per stage angle, so a standing stage costs only the noise.
class SimpleEngine : public Engine {
 public:
  SimpleEngine(fit::Bench bench, SimpleOptions options, std::uint64_t seed);
  void scan(double scan_s, const std::function<StageMoment(double)>& stage_at,
            std::span<std::uint32_t> range_mm, std::span<std::uint32_t> intensity) override;
  void set_scene(const SceneState& scene) override;
  void begin_stream() override { scan_in_stream_ = 0; }

 private:
  struct Wall {
    Eigen::Vector2d from, along;  ///< Start, and the vector to the other end.
    double length;
    double brightness;  ///< Echo near by, over the cross product of ray and `along`; 1: the full intensity.
  };
  /// A round target.
  struct Post {
    Eigen::Vector2d centre;
    double radius_mm;
    double brightness;  ///< Echo near by, over the cosine of incidence.
  };
  struct Hit {
    float range_mm = 0, intensity = 0;  ///< 0: nothing there.
  };
  /// What one beam may see: the surface in front, and, in an edge's window, the one behind with its
  /// probability.
  struct BeamHits {
    Hit front, back;
    float back_probability = 0;
  };
  /// Rays that begin within `shift_mm` of `origin` and point within `spread_rad` of `ray`.
  struct Fan {
    Eigen::Vector2d origin, ray;
    double spread_rad, shift_mm;
  };
  /// How a fan stands to a wall: range and place along the wall are the quotients of depth and side by
  /// facing.
  struct Aspect {
    double depth, side, facing;  ///< Of the middle ray, signs such that depth is not negative ...
    double doubt_depth, doubt_side, doubt_facing;  ///< ... and by how much the others may differ.
    [[nodiscard]] bool may_meet() const;
    [[nodiscard]] bool all_meet() const;
    [[nodiscard]] bool all_behind(const Aspect& other) const;
  };
  [[nodiscard]] static Aspect aspect(const Fan& fan, const Wall& wall);
  [[nodiscard]] Hit hit(double brightness, double range_mm, double facing) const;
  /// `surface`: which was met, -1 for none; walls first, then posts.
  [[nodiscard]] Hit cast(const Eigen::Vector2d& origin, double direction, int* surface) const;
  [[nodiscard]] static bool may_meet(const Fan& fan, const Post& post);
  [[nodiscard]] BeamHits trace(const Eigen::Vector2d& origin, double direction) const;
  [[nodiscard]] std::optional<Hit> trace_away_from_edges(const Fan& fan) const;
  void find_candidates(const Fan& fan);
  void prepare_turning(double scan_s, const std::function<StageMoment(double)>& stage_at);
  void prepare(double stage_rad);
  void build_walls();
  std::uint32_t measure(const BeamHits& hits, Random& random, std::uint32_t& intensity) const;

  fit::Bench bench_;
  SimpleOptions options_;
  std::uint64_t seed_, scan_in_stream_ = 0;
  Random random_;
  double per_falloff_;
  std::map<std::string, SceneState> changes_;
  std::vector<Wall> walls_;
  std::vector<Post> posts_;
  std::vector<BeamHits> beam_hits_;
  std::vector<Eigen::Vector2d> beam_rays_;  ///< In the stage's frame.
  std::vector<const Wall*> candidates_;     ///< Walls that the next few beams may meet ...
  bool post_near_ = false;                  ///< ... and whether a post is among what they may.
  double prepared_for_ = std::numeric_limits<double>::quiet_NaN();
};

/// Reads the "sim" section and the known range-noise of a bench.
[[nodiscard]] SimpleOptions simple_options(const fit::Bench& bench);

}  // namespace sim
