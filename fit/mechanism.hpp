// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "fit/numeric/angle.hpp"
#include "fit/numeric/estimate.hpp"

namespace fit {

/// Angles at which stray light falls to a half: of the usual receiver, and of those that differ most. Light
/// from nearer by is the beam's own.
inline constexpr std::array halos_rad{0.5 * rad_per_deg, 0.7 * rad_per_deg, 1.4 * rad_per_deg};

/// Standard half widths of beams that circumstances know.
inline constexpr std::array wide_beams_rad{0.1 * rad_per_deg, 0.2 * rad_per_deg, 0.4 * rad_per_deg};

/// Everything about one beam of one scan that a mechanism may depend on. Millimetres, radians, seconds,
/// kelvin.
struct Circumstances {
  double range_mm = 0;       ///< True range.
  double intensity = 0;      ///< Counts; NaN when it is not known.
  double incidence_rad = 0;  ///< Signed: positive where the range grows with the beam angle.
  double beam_rad = 0;       ///< In the lidar's frame.
  double stage_rad = 0;      ///< Commanded.
  double bearing_rad = 0;    ///< Of the beam in the world frame.
  double time_s = 0;         ///< Since power-on.
  double clock_s = 0;  ///< The same by one clock for several recordings, of which none overlaps another.
  double temperature_k = 0;  ///< Minus the session's reference temperature; NaN without a thermometer.
  double since_move_s = 0;   ///< From the end of the stage's last move to this scan.
  double beam_time_s = 0;    ///< From the scan's time stamp to this beam.
  double stage_rate_rad_s = 0;
  int approach = 0;     ///< Sign of the stage's last move.
  int seq = 0;          ///< Number of the scan in its capture.
  int target = -1;      ///< Index of the bench's target that the beam meets.
  double along_mm = 0;  ///< Position on the target from its middle.
  int along_sign = 1;   ///< +1: along_mm grows with the beam angle; -1: against it.
  double half_length_mm = 1;
  bool round =
      false;  ///< The target is: `along_mm` is along its surface, a quarter of a turn at its half length.
  double corner_mm = std::numeric_limits<double>::infinity();  ///< To the next inner corner along the target.
  /// To the next edge with something behind it; positive on the nearer surface.
  double edge_rad = std::numeric_limits<double>::infinity();
  double gap_mm = 0;  ///< Depth of that edge.
  bool alone = true;  ///< No edge, corner or other surface within the reach of stray light.
  /// Range of what lies beside the beam less the own, weighted by their light over the own and by how much of
  /// it reaches so far: for stray light that falls to a half at each of `halos_rad`.
  std::array<double, 3> pull_mm{};
  /// The same of surfaces whose echoes come apart from the own one, as if they were as near as those that
  /// merge with it.
  std::array<double, 3> pull_apart_mm{};
  /// By how much more the nearer ones of those that merge pull where the front of an echo is timed: the
  /// square of the range's difference, at most of 150 mm, over that.
  std::array<double, 3> pull_front_mm{};
  /// Mean range of a beam of each of `wide_beams_rad`, weighted by its light, less the range of its middle:
  /// on slanted walls, beside inner corners, and beside edges, beyond which is another echo, or none.
  std::array<double, 3> spread_mm{};
  Eigen::Vector2d normal = Eigen::Vector2d::UnitX();  ///< Unit normal of the target, away from the axis.
  double cos_incidence = 1;
  double reflectance = 0.5;  ///< Nominal, 0..1.

  friend bool operator==(const Circumstances&, const Circumstances&) = default;
};

/// What a mm out along the normal makes of the range.
[[nodiscard]] inline double range_per_mm_out(double cos_incidence) {
  return 1 / std::max(0.05, cos_incidence);
}

/// How its target stands against what is stated: out along its normal, and turned about its middle,
/// counter-clockwise; a round one out and aside (counter-clockwise), and of another radius.
struct Displacement {
  double out_mm = 0, turn_rad = 0, aside_mm = 0, thicker_mm = 0;

  Displacement& operator+=(const Displacement& other);
};

/// What mm out and aside make of the range: on a round target, where it is met.
[[nodiscard]] inline double range_of_move(const Circumstances& c, double out_mm, double aside_mm) {
  const double around_rad = c.round ? c.along_mm / c.half_length_mm * pi / 2 : 0;
  return (out_mm * std::cos(around_rad) - aside_mm * std::sin(around_rad)) *
         range_per_mm_out(c.cos_incidence);
}

/// Of which targets something is.
enum class Targets { any, flat, round };
[[nodiscard]] inline bool suits(Targets targets, bool round) {
  return targets == Targets::any || (targets == Targets::round) == round;
}

/// What a mechanism does to the measurement in given circumstances. Effects of several mechanisms add.
struct Effect {
  double range_mm = 0;
  double beam_rad = 0;                                  ///< True minus nominal beam angle.
  double stage_rad = 0;                                 ///< True minus commanded stage angle.
  Eigen::Vector2d origin_mm = Eigen::Vector2d::Zero();  ///< Shift of the optical centre, world frame.
  double variance_mm2 = 0;                              ///< White noise, one draw for each sample.
  double scan_angle_variance_rad2 = 0;                  ///< One angle for a whole scan.
  double beam_angle_variance_rad2 = 0;                  ///< One angle for every beam of every scan.
  double scan_range_variance_mm2 = 0;                   ///< One range for a whole scan.
  double own_range_variance_mm2 = 0;                    ///< One range for every beam, in all scans alike.
  /// Neighbouring beams share noise: by how much more sums over many beams scatter than independent ones do.
  double shared_by_neighbours = 0;
  double ar1_rho = 0;          ///< Noise is AR(1) from scan to scan, with this coefficient ...
  double ar1_share = 0;        ///< ... for this share of the variance.
  double lost = 0;             ///< Probability of no echo.
  double stray = 0;            ///< Probability of a range that has nothing to do with the target.
  double late = 0, early = 0;  ///< Probability of a range somewhat beyond, or before, what noise makes.
  double footprint_rad = 0;    ///< Standard width in which an edge mixes ranges of front and back ...
  double light_rad = 0;        ///< ... and in which it parts the beam's light between them.
  double output_step_mm = 0;   ///< Results are multiples of this.
  double log_echo = 0;         ///< Added to the logarithm of the echo, before the receiver ...
  double log_intensity = 0;    ///< ... and of the intensity, behind it.

  Effect& operator+=(const Effect& other);
};

enum class Observable {
  range_mean,
  range_variance,
  range_distribution,
  intensity,
  dropout,
  time_correlation
};
enum class Coordinate {
  beam,
  stage,
  range,
  intensity,
  incidence,
  edge_distance,
  time,
  temperature,
  approach,
  stage_rate,
  range_rate,
  scan_seq,
  target
};
[[nodiscard]] const char* name_of(Observable);
[[nodiscard]] const char* name_of(Coordinate);
/// With a space before it; empty for none.
[[nodiscard]] const char* unit_of(Coordinate);

/// One parameter of a mechanism, in the unit its name says.
struct Parameter {
  enum class Role {
    size,   ///< The effect is proportional to it.
    phase,  ///< Degrees; turns the size before it: size * sin(x + phase).
    shape   ///< Anything else: searched between its bounds.
  };
  /// What a shape measures along the mechanism's coordinate, where that tells a search how to look for it.
  enum class Scale {
    other,
    width,       ///< The extent of what is local. Where less than the least was recorded, it is not local.
    decay,       ///< Over which the effect fades by 1/e. At its bounds it is no fading any more.
    wavelength,  ///< Of a sine. Where only regular places were recorded, several look alike.
    gear,    ///< Of a sine that gears make, in degrees of a turn: a short one is a turn by a whole number.
    bin,     ///< To multiples of which the coordinate is rounded. No two that differ by much look alike. The
             ///< next parameter is how many of them are added before, 0 to 1.
    count,   ///< A whole number: there is nothing between its starts.
    choice,  ///< One of two, 0 or 1, beside shapes that have something between theirs. The usual one is 0,
             ///< which it is where a recording does not tell.
    threshold,  ///< Of the coordinate, below which something happens at once: looked for between recorded
                ///< places.
    from,    ///< The time at which it begins, s by `clock_s`; the next parameter is the one at which it ends.
             ///< As often as not it acts always, which is what they are expected to say.
    moment,  ///< A time at which something changes for good, s by `clock_s`: looked for between all that
             ///< were recorded.
  };
  std::string name;
  Role role = Role::size;
  Scale scale = Scale::other;
  double typical = 1;   ///< Size: standard deviation of the prior around `expected`.
  double expected = 0;  ///< Shape: what a bench file that leaves it out means; 0: the lower bound.
  double largest = std::numeric_limits<double>::infinity();  ///< Size: what physics allows at most.
  /// Size: another one at which a search asks as well, where what it does is no multiple of what the typical
  /// one does; 0: none.
  double also = 0;
  Targets targets = Targets::any;  ///< Size: those that have it; of others it is left out.
  int sign = 0;                    ///< Size: +1 or -1 when physics allows only one sign.
  /// Size: how far what shows may be from what the parameter means, as a share of it, from device to device.
  /// Part of its stated uncertainty.
  double own_affair = 0;
  bool any_curve = false;       ///< Size that may be missing apart: as of Mechanism, for what it does alone.
  double lower = 0, upper = 1;  ///< Shape: bounds.
  /// Shape: what makes the formula more general than the literature's plain one, which has it where it is
  /// left out. As often as not a device is plain in all of them.
  bool generalises = false;
  int starts = 8;  ///< Shape: points of the first search, spread by the logarithm if `logarithmic`.
  bool logarithmic = true;

  /// What it is where nobody says so ...
  [[nodiscard]] double left_out() const;
  /// ... and how well that is known. What makes the formula more general is plain as often as not, and else
  /// anywhere between its bounds: by so much it differs from the plain value (root mean square).
  [[nodiscard]] double u_left_out() const;
  /// Shape: the same, where a bench file that leaves it out means that.
  [[nodiscard]] Parameter expecting(double that) const;
  /// Shape: the same, as what makes the formula more general; the plain one has it at that, or at the
  /// bound nearest to it.
  [[nodiscard]] Parameter generalising(double that = 0) const;
  /// Shape: the same, measuring that.
  [[nodiscard]] Parameter on(Scale that) const;
};

/// A shape between two bounds, which a search asks for at so many places: spread by its logarithm, or evenly.
[[nodiscard]] Parameter log_shape(std::string name, double lower, double upper, int starts);
[[nodiscard]] Parameter even_shape(std::string name, double lower, double upper, int starts);

/// For what may act during a part of the recording: `from_s` and `to_s`, by `clock_s`.
[[nodiscard]] Parameter begins_at();
[[nodiscard]] Parameter ends_at();

/// A mechanism with its parameters found, as sentences need it.
struct Finding {
  std::map<std::string, Estimate> parameters;
  std::string target;     ///< For a mechanism that acts on one target.
  double largest_mm = 0;  ///< Largest effect on a mean in this session.
  double largest_at = 0;  ///< Where on the mechanism's coordinate, in the coordinate's own file unit.
  [[nodiscard]] Estimate at(const std::string& name) const;
};

/// Part of a coordinate, in its file unit.
struct Interval {
  Coordinate coordinate = Coordinate::beam;
  double from = 0, to = 0;
};

/// What was recorded of a mechanism's coordinate, in its file unit.
struct Recorded {
  double from = 0, to = 0;
  double scan_hz = 0;
};

/// What a bench file states about the lidar's mount, as answers name it beside mechanisms.
inline constexpr const char *mount_offset = "mount-offset", *mount_yaw = "mount-yaw";

/// One physical mechanism of the catalogue. Each lives in its own file mechanisms/NAME.cpp, which defines
/// `fit::Mechanism fit::mechanisms::make_NAME()`; the build finds it by its name. The same `act` serves the
/// simulator, which generates with it, and the fitter, which differentiates it.
struct Mechanism {
  std::string id;     ///< Of the catalogue: a contract.
  std::string cause;  ///< "the code disk sits off the mirror's axis"
  Observable observable = Observable::range_mean;
  Coordinate coordinate = Coordinate::range;
  std::vector<Parameter> parameters;
  bool one_target = false;         ///< Acts on one target, named by the text parameter "target" ...
  Targets targets = Targets::any;  ///< ... of that shape.
  /// How far real causes differ from the formula, as a share of the effect: a scale is a scale, a pulse on a
  /// threshold only resembles an exponential.
  double formula_error = 0.1;
  /// Only the coordinate is certain: the curve along it differs from device to device, and so does the place
  /// where the instrument was set to read right.
  bool any_curve = false;
  /// Of surfaces: acts on all targets alike or, named by the text parameter "target", on one of them.
  bool of_surfaces = false;
  /// What the bench file states under this name is a law, and this is what is wrong with it: it may be
  /// missing all the same.
  bool corrects_a_statement = false;
  bool sizes_apart = false;       ///< Each size may be missing without the others.
  bool only_for_a_while = false;  ///< What acts all the time is another mechanism.
  bool geometric = false;  ///< Works through angles or places, not through the measured distance itself.
  /// Values in the order of `parameters`.
  std::function<Effect(const Circumstances&, std::span<const double> values)> act;
  /// Of what is local and may move along its coordinate: how far away its middle is, in the coordinate's file
  /// unit. Empty: as far as the place of its middle says.
  std::function<double(const Circumstances&, std::span<const double> values)> away;
  /// Of a drift: what usually lies between where its formula is zero and where instruments are set to read
  /// right, mm.
  std::function<double(std::span<const double> values)> set_right_mm;
  /// Of a mechanism that is nothing but another place of its target, whose effect is not proportional to its
  /// size: that place. Who has the geometry moves the target instead of calling `act`.
  std::function<Displacement(std::span<const double> values)> displaces;
  /// Other names of what one bench may show alike: ids, `mount_offset` or `mount_yaw`. Where those have no
  /// signs of their own, only sizes could tell them apart, and sizes are a prior, not evidence.
  std::vector<std::string> looks_like;
  /// Whether values with such standard uncertainties show what the cause alone does, and not just anything
  /// that is always there; empty: yes.
  std::function<bool(std::span<const double> values, std::span<const double> u)> has_own_sign;
  /// Where most of the effect is, of what was recorded; empty: wherever something was.
  std::function<std::vector<Interval>(const Finding&, const Recorded&)> shows;
  std::function<std::string(const Finding&)> says;
  /// What separates it from its rivals: one clause for the operator.
  std::string separate;

  [[nodiscard]] std::vector<double> values(const std::map<std::string, Estimate>& parameters) const;
  /// Whether it is an accident of the session that was recorded, and no trait of lidar or bench: it came or
  /// went then.
  [[nodiscard]] bool happened_once(std::span<const double> values) const;
  /// Index of the parameter that measures such a scale, if there is one.
  [[nodiscard]] std::optional<std::size_t> parameter_of(Parameter::Scale scale) const;
};

/// The whole catalogue, in alphabetical order.
[[nodiscard]] const std::vector<Mechanism>& catalogue();
/// The mechanism of that id, or nullptr.
[[nodiscard]] const Mechanism* find_mechanism(const std::string& id);
/// A pointer that does not own it: those of the catalogue live as long as the program.
[[nodiscard]] inline std::shared_ptr<const Mechanism> not_owned(const Mechanism& mechanism) {
  return {std::shared_ptr<const Mechanism>(), &mechanism};
}

/// "0.1210 ± 0.0042 deg": with its expanded uncertainty (k = 2), to the second digit of that
/// (fit/numeric/number_format.hpp).
[[nodiscard]] std::string with_uncertainty(const Estimate& estimate, const std::string& unit);
[[nodiscard]] std::string rounded(double value, int digits = 3);

}  // namespace fit
