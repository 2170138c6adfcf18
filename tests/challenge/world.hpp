// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "session.hpp"

namespace challenge {

/// One beam of one scan.
struct Moment {
  const Capture* capture = nullptr;
  std::size_t capture_index = 0;
  int seq = 0;
  int step = 0;
  double alpha = 0;           ///< Nominal beam angle, rad.
  double beam_s = 0;          ///< From the scan's first step to this beam.
  double since_power_on = 0;  ///< s
  double since_move = 0;      ///< s
};

/// What a ray meets.
struct Sight {
  int wall = -1;         ///< -1: nothing.
  double range_mm = 0;   ///< Geometric.
  double incidence = 0;  ///< Signed, rad.
  double along_mm = 0;   ///< Position on the wall from its middle.
  double end_mm = 0;     ///< Distance to the wall's nearer end.
  double power = 0;      ///< Echo power; 1 for white, square on, at 1 m.
  double counts = 0;     ///< Intensity without noise.
};

class World;

/// How a wall stands otherwise than the session's truth says.
struct Displacement {
  double away_mm = 0, turned_rad = 0;  ///< Counter-clockwise about its middle.
};

/// One concealed piece of physics. `draw` fixes its shape once; `strength` scales it (1: as drawn) until an
/// oracle sees it at the wanted signal-to-noise. Hooks that a cause does not need stay as they are here.
class Cause {
 public:
  virtual ~Cause() = default;
  std::string id;          ///< Id of physics.md, or "unknown-..." for what is not in the catalogue.
  std::string coordinate;  ///< Where it shows best (a coordinate of an explanation).
  std::string observable = "range-mean";
  double strength = 1;

  virtual void draw(Session&, Random&) {}
  virtual void build(Session&) {}  ///< Called whenever strength has changed.
  /// Of another that is concealed besides; false: that changes nothing in how it shows.
  virtual bool stand_beside(Session&, const Cause&) { return false; }
  virtual bool has_size() const { return true; }  ///< False: `strength` does not scale it.
  virtual double largest_strength() const { return 1e9; }
  virtual double stage(const Moment&) const { return 0; }  ///< True minus commanded stage angle, rad.
  virtual double beam(const Moment&) const { return 0; }   ///< True minus nominal beam angle, rad.
  virtual Vector origin(const Moment&, double) const { return Vector::Zero(); }
  virtual Displacement displaced(int) const { return {}; }  ///< Of a wall.
  virtual double range(const Moment&, const Sight&, const World&) const { return 0; }
  virtual double variance(const Moment&, const Sight&, const World&) const { return 0; }
  virtual double lost(const Moment&, const Sight&) const { return 0; }
  virtual double stray(const Moment&, const Sight&) const { return 0; }
  virtual double stray_range(const Sight& sight, Random& random) const {
    return random.uniform(60, sight.range_mm);
  }
  virtual bool differs_within_capture() const { return false; }
  virtual double scan_angle_sigma() const { return 0; }  ///< One random angle for a whole scan, rad.
  virtual double footprint() const { return 0; }         ///< Full width of the beam, rad; 0: a line.
  virtual bool merges(double) const { return true; }     ///< Two echoes that far apart (mm) are one.
  virtual double bins_mm() const { return 0; }           ///< Width of the time counter's bins.
  virtual double output_step_mm() const { return 1; }
  /// (share of the noise variance, memory from scan to scan); the rest is white.
  virtual std::vector<std::pair<double, double>> memory() const { return {}; }
  virtual bool memory_is_common() const { return false; }
  virtual bool shows_in_intensity() const { return false; }  ///< Needs a bench that claims to know intensity.
  virtual double log_intensity(const Moment&) const { return 0; }
  /// What the device reports as intensity there, if another receiver than the effects' own makes it.
  virtual std::optional<double> counts(const Moment&) const { return {}; }
  virtual nlohmann::json parameters() const { return nlohmann::json::object(); }
  virtual std::vector<std::string> also_makes() const { return {}; }  ///< Other effects of the catalogue.
};

using Causes = std::vector<std::shared_ptr<Cause>>;

/// Makes the cause of that id. Throws std::invalid_argument for an unknown one.
std::shared_ptr<Cause> make_cause(const std::string& id);
/// Every id, and the scenes in which it can show (the first is the usual one).
const std::vector<std::pair<std::string, std::vector<std::string>>>& cause_scenes();

/// What a cell's samples are expected to be.
struct Expectation {
  Sight sight;
  double mean_mm = 0, variance_mm2 = 0;
  double lost = 0, stray = 0;
  double far_share = 0;  ///< Probability that the echo of the farther surface is reported.
  double far_mm = 0;
  double between_share = 0;  ///< Probability of a range between two surfaces.
};

/// The scene with everything where it really is, and causes acting in it.
/// A wall as it stands.
struct Segment {
  Vector from, to, along, normal, outward;
  double length, reflectance;
  bool closed;
  double first_mm = 0, last_mm = 0;  ///< Where it ends, from `from`.
};
/// All walls of a session with those nuisances, displaced by so much (none: not at all). Those of a closed
/// outline follow each other in the list, and end where the lines of their neighbours cross them.
[[nodiscard]] std::vector<Segment> standing_walls(const Session& session, const Nuisance& nuisance,
                                                  const std::vector<Displacement>& displaced = {});

class World {
 public:
  World(const Session& session, Causes causes, Nuisance nuisance);

  [[nodiscard]] Moment moment(std::size_t capture, int seq, int step) const;
  [[nodiscard]] Sight look(const Moment& moment, double extra_angle = 0) const;
  [[nodiscard]] Expectation expect(const Moment& moment, double extra_angle = 0) const;
  [[nodiscard]] const Session& session() const { return session_; }
  [[nodiscard]] const Causes& causes() const { return causes_; }

  /// One scan of samples: range and intensity per step, as the device would put them out.
  struct Noise {
    std::vector<std::vector<double>> state;  ///< One row per memory component, one value per beam.
  };
  void scan(std::size_t capture, int seq, Random& random, Noise& noise, std::vector<std::uint16_t>& range,
            std::vector<std::uint16_t>& intensity) const;

 private:
  [[nodiscard]] const std::vector<Segment>& standing(std::size_t capture) const;
  [[nodiscard]] Expectation mixed(const Moment& moment, double extra_angle, const Sight& centre) const;
  [[nodiscard]] double add_causes(const Moment& moment, const Sight& sight) const;

  const Session& session_;
  Causes causes_;
  Nuisance nuisance_;
  double footprint_ = 0;
  mutable std::size_t standing_capture_ = static_cast<std::size_t>(-1);
  mutable double standing_moved_ = 0;
  mutable std::vector<Segment> standing_;
};

/// Smallest and largest echo power of a session's boards up to that incidence, to put thresholds where they
/// matter.
struct PowerSpan {
  double low = 1e9, high = 0;
};
[[nodiscard]] PowerSpan power_span(const Session& session, double steepest_rad = 75 * degree);

}  // namespace challenge
