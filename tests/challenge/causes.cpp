// SPDX-License-Identifier: MIT
// Concealed physics, made from causes: pulses on thresholds, disks off their axes, gears with play. Nothing
// here uses the effect-level formulas of fit/; where both agree it is because the physics does.
#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "cause_entry.hpp"

namespace challenge {

namespace {

using nlohmann::json;

/// Rising edge of an echo, in units of its own width: when it reaches a fraction of its peak.
struct Edge {
  int shape = 0;
  double width_ns = 2;

  void draw(Random& random) {
    shape = random.integer(0, 2);
    width_ns = random.uniform(1.5, 3);
  }
  [[nodiscard]] double reaches_ns(double fraction) const {
    const double x = std::clamp(fraction, 1e-6, 0.9999);
    if (shape == 0) return -width_ns * std::sqrt(2 * std::log(1 / x));   // Gaussian
    if (shape == 1) return -2.5 * width_ns * std::acos(2 * x - 1) / pi;  // raised cosine
    double low = 0, high = 1;                                            // u e^(1-u): two RC stages
    for (int i = 0; i < 40; ++i) {
      const double u = (low + high) / 2;
      (u * std::exp(1 - u) < x ? low : high) = u;
    }
    return 1.5 * width_ns * (low - 1);
  }
};

// ---- range
// -------------------------------------------------------------------------------------------------

struct ZeroOffset : Cause {  // a longer cable between detector and counter
  double delay_ns = 0.05;
  void draw(Session&, Random& random) override { delay_ns *= random.sign(); }
  double range(const Moment&, const Sight&, const World&) const override {
    return strength * delay_ns * light_mm_per_ns;
  }
  json parameters() const override { return {{"offset_mm", strength * delay_ns * light_mm_per_ns}}; }
};

struct RangeScale : Cause {  // the counter's crystal is off
  double offset = 1e-3;
  void draw(Session&, Random& random) override { offset *= random.sign(); }
  double range(const Moment&, const Sight& sight, const World&) const override {
    return sight.range_mm * (1 / (1 - strength * offset) - 1);
  }
  double largest_strength() const override { return 100; }
  json parameters() const override { return {{"scale", 1 / (1 - strength * offset) - 1}}; }
};

struct RangeWalk : Cause {  // fixed threshold, compensated but for a part
  Edge edge;
  double threshold = 1, reference = 1;
  void draw(Session& session, Random& random) override {
    edge.draw(random);
    const auto [low, high] = power_span(session);
    threshold = low * random.uniform(0.3, 0.7);
    reference = high;
  }
  double range(const Moment&, const Sight& sight, const World&) const override {
    return strength * 0.02 * light_mm_per_ns *
           (edge.reaches_ns(threshold / sight.power) - edge.reaches_ns(threshold / reference));
  }
  json parameters() const override { return {{"residual", 0.02 * strength}, {"edge_ns", edge.width_ns}}; }
};

struct Saturation : Cause {  // constant fraction of a clipped peak is reached early
  Edge edge;
  double clip = 1;
  void draw(Session& session, Random& random) override {
    edge.draw(random);
    const auto [low, high] = power_span(session);
    clip = std::max(low * 1.5, high * random.uniform(0.15, 0.35));
  }
  double range(const Moment&, const Sight& sight, const World&) const override {
    const double peak = sight.power / std::pow(1 + std::pow(sight.power / clip, 6), 1.0 / 6);
    return strength * 0.1 * light_mm_per_ns *
           (edge.reaches_ns(0.5 * peak / sight.power) - edge.reaches_ns(0.5));
  }
};

struct CyclicError : Cause {  // the counter's own clock leaks into the measured phase
  double leak = 0.03, period_mm = 1000, phase = 0;
  void draw(Session&, Random& random) override {
    period_mm = random.log_uniform(350, 2500);
    phase = random.uniform(0, 2 * pi);
  }
  double range(const Moment&, const Sight& sight, const World&) const override {
    const double x = 2 * pi * sight.range_mm / period_mm + phase, e = strength * leak;
    return period_mm / (2 * pi) * std::atan2(e * std::sin(x), 1 + e * std::cos(x));
  }
  double largest_strength() const override { return 20; }
  json parameters() const override {
    return {{"amplitude_mm", strength * leak * period_mm / (2 * pi)},
            {"period_mm", period_mm},
            {"phase_deg", phase / degree}};
  }
};

struct TimeQuantisation : Cause {
  double width_mm = 6;
  double bins_mm() const override { return strength * width_mm; }
  double largest_strength() const override { return 10; }
  json parameters() const override { return {{"bin_mm", strength * width_mm}}; }
};

/// The echo rides on the tail of the transmitter's own flash (an undershoot of the receiver after it).
struct NearField : Cause {
  Edge edge;
  double undershoot = 0.1, reach_mm = 200;
  void draw(Session&, Random& random) override {
    edge.draw(random);
    reach_mm = random.uniform(100, 350);
  }
  [[nodiscard]] double late(double base) const {
    return light_mm_per_ns * (edge.reaches_ns(0.5 + base) - edge.reaches_ns(0.5));
  }
  double range(const Moment&, const Sight& sight, const World&) const override {
    return late(std::min(0.45, strength * undershoot * std::exp(-sight.range_mm / reach_mm)));
  }
  json parameters() const override { return {{"reach_mm", reach_mm}}; }
};

struct WindowReflection : NearField {  // the same from a glint of the housing at some beam angles
  double centre = 0, width = 0.3;
  void draw(Session& session, Random& random) override {
    NearField::draw(session, random);
    centre = random.uniform(-80, 80) * degree;
    width = random.uniform(10, 30) * degree;
  }
  double range(const Moment& moment, const Sight& sight, const World&) const override {
    const double x = (moment.alpha - centre) / width;
    const double glint = 1 / (1 + x * x * x * x);
    return late(std::min(0.45, strength * undershoot * glint * std::exp(-sight.range_mm / reach_mm)));
  }
  json parameters() const override {
    return {{"reach_mm", reach_mm}, {"centre_deg", centre / degree}, {"width_deg", width / degree}};
  }
};

struct IncidenceBias : Cause {  // a slanted wall stretches the pulse; a fraction of its peak comes earlier
  double spot_mm = 12, fraction = 0.3, pulse_mm = 100;
  void draw(Session&, Random& random) override {
    spot_mm = random.uniform(8, 20);
    fraction = random.uniform(0.15, 0.5);
    pulse_mm = random.uniform(60, 150);
  }
  double range(const Moment&, const Sight& sight, const World&) const override {
    const double spread = spot_mm * std::tan(std::min(std::abs(sight.incidence), 84 * degree));
    const double stretched = std::hypot(pulse_mm, spread);
    return -strength * std::sqrt(2 * std::log(1 / fraction)) * (stretched - pulse_mm);
  }
  json parameters() const override { return {{"spot_mm", spot_mm}, {"fraction", fraction}}; }
};

struct Subsurface : Cause {  // light enters one material and returns late
  int wall = 0;
  void draw(Session& session, Random& random) override {
    wall = random.integer(0, static_cast<int>(session.walls.size()) - 1);
    name = session.walls[static_cast<std::size_t>(wall)].name;
  }
  double range(const Moment&, const Sight& sight, const World&) const override {
    return sight.wall == wall ? strength * 5 : 0;
  }
  json parameters() const override { return {{"target", name}, {"depth_mm", 5 * strength}}; }
  std::string name;
};

struct WarmUp : Cause {  // board and housing: two time constants
  double fast_s = 300, slow_s = 1500, share = 0.6, sign = 1;
  void draw(Session&, Random& random) override {
    fast_s = random.uniform(200, 700);
    slow_s = fast_s * random.uniform(2, 4);
    share = random.uniform(0.5, 0.9);
    sign = random.sign();
  }
  double range(const Moment& moment, const Sight&, const World&) const override {
    const double t = moment.since_power_on;
    return sign * strength * 5 *
           (share * (1 - std::exp(-t / fast_s)) + (1 - share) * (1 - std::exp(-t / slow_s)));
  }
  json parameters() const override { return {{"amplitude_mm", sign * strength * 5}}; }
};

struct Temperature : Cause {  // the detector's gain follows the housing, with a small quadratic part
  double sign = 1;
  void draw(Session&, Random& random) override { sign = random.sign(); }
  double range(const Moment& moment, const Sight&, const World&) const override {
    const double rise = moment.capture->temperature_c - 25;
    return sign * strength * (0.5 * rise + 0.002 * rise * rise);
  }
  json parameters() const override { return {{"slope_mm_k", sign * 0.5 * strength}}; }
};

struct Multipath : Cause {  // light over the other wall of an inner corner: form factor of a strip
  double reach_mm = 200;
  void draw(Session&, Random& random) override { reach_mm = random.uniform(100, 300); }
  double range(const Moment&, const Sight& sight, const World&) const override {
    const double x = std::max(0.0, sight.end_mm) / reach_mm;
    return strength * 20 / std::pow(1 + x * x, 1.5);
  }
  json parameters() const override { return {{"reach_mm", reach_mm}}; }
};

struct Crosstalk : Cause {  // stray light of neighbours is part of the same echo
  void draw(Session&, Random& random) override { halo = random.uniform(0.4, 1.0) * degree; }
  double range(const Moment& moment, const Sight& sight, const World& world) const override {
    double power = sight.power, sum = 0;
    for (const int side : {-4, -3, -2, -1, 1, 2, 3, 4}) {
      const double angle = side * 0.25 * degree;
      const Sight other = world.look(moment, angle);
      if (other.wall < 0 || other.wall == sight.wall) continue;
      const double gap = other.range_mm - sight.range_mm;
      if (std::abs(gap) > 500) continue;
      const double light = 0.03 * strength * other.power / (1 + std::pow(angle / halo, 2));
      power += light;
      sum += light * gap;
    }
    return sum / power;
  }
  double halo = 0.01;
};

struct AirIndex : Cause {  // the index the firmware assumes is not that of this air
  double range(const Moment&, const Sight& sight, const World&) const override {
    return sight.range_mm * 2.7e-4 * strength;
  }
  double largest_strength() const override { return 1.2; }  // no air refracts more (dense and cold: 3.2e-4)
  json parameters() const override { return {{"index_error", 2.7e-4 * strength}}; }
};

// ---- angles and geometry
// -----------------------------------------------------------------------------------

struct EncoderEccentricity : Cause {  // code disk off the mirror's axis
  double off = 0.002, phase = 0;
  void draw(Session&, Random& random) override { phase = random.uniform(-pi, pi); }
  double beam(const Moment& moment) const override {
    const double e = strength * off, x = moment.alpha + phase;
    return std::atan2(e * std::sin(x), 1 - e * std::cos(x));
  }
  double largest_strength() const override { return 100; }
  json parameters() const override {
    return {{"amplitude_deg", strength * off / degree}, {"phase_deg", phase / degree}};
  }
};

struct EncoderSecondHarmonic : Cause {  // disk tilted on its axis: seen as an ellipse
  double tilt = 0.06, phase = 0;
  void draw(Session&, Random& random) override { phase = random.uniform(-pi / 2, pi / 2); }
  double beam(const Moment& moment) const override {
    const double squeeze = std::cos(std::min(tilt * std::sqrt(strength), 0.7)), x = moment.alpha + phase;
    return std::remainder(std::atan2(std::sin(x), std::cos(x) * squeeze) - x, 2 * pi);
  }
  double largest_strength() const override { return 100; }
  json parameters() const override {
    return {{"amplitude_deg", tilt * tilt * strength / 4 / degree}, {"phase_deg", 2 * phase / degree}};
  }
};

struct AngleScale : Cause {  // mirror runs fast against the firing clock; it starts right at the index
  double slip = 1e-3;
  void draw(Session&, Random& random) override { slip *= random.sign(); }
  double beam(const Moment& moment) const override { return strength * slip * moment.alpha; }
  json parameters() const override { return {{"scale", strength * slip}}; }
};

struct IndexOffset : Cause {
  double beam(const Moment&) const override { return strength * 0.5 * degree; }
  json parameters() const override { return {{"offset_deg", strength * 0.5}}; }
};

struct AngleJitter : Cause {
  AngleJitter() { observable = "range-variance"; }
  double scan_angle_sigma() const override { return strength * 0.05 * degree; }
  json parameters() const override { return {{"sigma_deg", strength * 0.05}}; }
};

struct LidarArm : Cause {  // the optical centre is far off the axis
  double direction = 0;
  void draw(Session&, Random& random) override { direction = random.uniform(-pi, pi); }
  Vector origin(const Moment&, double stage) const override {
    return strength * 10 * Vector(std::cos(stage + direction), std::sin(stage + direction));
  }
  json parameters() const override {
    return {{"x_mm", strength * 10 * std::cos(direction)}, {"y_mm", strength * 10 * std::sin(direction)}};
  }
};

struct ScanPlaneTilt : Cause {  // mirror's plane leans: rays climb, walls stay upright
  double tilt = 2 * degree, axis = 0;
  void draw(Session&, Random& random) override { axis = random.uniform(-pi, pi); }
  [[nodiscard]] double lean() const { return std::min(tilt * std::sqrt(strength), 25 * degree); }
  double beam(const Moment& moment) const override {
    const double x = moment.alpha - axis;
    return std::remainder(std::atan2(std::sin(x) * std::cos(lean()), std::cos(x)) - x, 2 * pi);
  }
  double range(const Moment& moment, const Sight& sight, const World&) const override {
    const double rise = std::sin(moment.alpha - axis) * std::sin(lean());
    return sight.range_mm * (1 / std::sqrt(1 - rise * rise) - 1);
  }
  double largest_strength() const override { return 100; }
  json parameters() const override {  // rays climb most a right angle from the axis, and fall opposite
    return {{"tilt_squared_deg2", std::pow(lean() / degree, 2)},
            {"axis_deg", std::remainder(axis / degree + 90, 180)}};
  }
};

struct FacetWobble : Cause {  // polygon mirror whose faces are not equally far from its axis
  std::vector<double> face;
  void draw(Session&, Random& random) override {
    face.resize(random.chance(0.5) ? 2 : 4);
    double mean = 0;
    for (double& f : face) mean += (f = random.normal()) / static_cast<double>(face.size());
    for (double& f : face) f -= mean;
  }
  double range(const Moment& moment, const Sight&, const World&) const override {
    return strength * face[static_cast<std::size_t>(moment.seq) % face.size()];
  }
  bool differs_within_capture() const override { return true; }
  json parameters() const override { return {{"facets", face.size()}}; }
};

struct StagePeriodic : Cause {  // worm or wheel off its axis; meshing adds a little of the second harmonic
  double period_deg = 3, size = 0.05, phase = 0, second = 0.15;
  void draw(Session& session, Random& random) override {
    const bool fine = session.scene == "two-sided" || session.scene == "edge";
    period_deg = fine ? random.pick(std::vector<double>{2, 2.5, 3, 3.6}) : 360;
    phase = random.uniform(-pi, pi);
    second = random.uniform(0.0, 0.2);
  }
  double stage(const Moment& moment) const override {
    const double e = strength * size * degree, x = 2 * pi * moment.capture->stage_deg / period_deg + phase;
    if (period_deg >= 360) return std::atan2(e * std::sin(x), 1 - e * std::cos(x));
    return e * (std::sin(x) + second * std::sin(2 * x + 1));
  }
  json parameters() const override {
    return {{"amplitude_deg", strength * size}, {"period_deg", period_deg}, {"phase_deg", phase / degree}};
  }
};

struct StageScale : Cause {
  double sign = 1;
  void draw(Session&, Random& random) override { sign = random.sign(); }
  double stage(const Moment& moment) const override {
    return sign * strength * 1e-3 * std::remainder(moment.capture->stage_deg, 3600.0) * degree;
  }
  json parameters() const override { return {{"scale", sign * strength * 1e-3}}; }
};

struct StageEccentricity : Cause {  // bearing runs out: the axis itself travels a circle
  double phase = 0;
  void draw(Session&, Random& random) override { phase = random.uniform(-pi, pi); }
  Vector origin(const Moment&, double stage) const override {
    return strength * 0.3 * Vector(std::cos(stage + phase), std::sin(stage + phase));
  }
  json parameters() const override {
    return {{"amplitude_mm", 0.3 * strength}, {"phase_deg", phase / degree}};
  }
};

struct Backlash : Cause {  // play between worm and wheel: the wheel is pushed, never pulled
  std::vector<double> lag;
  [[nodiscard]] double width() const { return strength * 0.1; }
  void build(Session& session) override {
    lag.clear();
    double wheel = session.captures.front().stage_deg - width() / 2;
    for (const Capture& capture : session.captures) {
      wheel = std::clamp(wheel, capture.stage_deg - width() / 2, capture.stage_deg + width() / 2);
      lag.push_back((wheel - capture.stage_deg) * degree);
    }
  }
  double stage(const Moment& moment) const override { return lag[moment.capture_index]; }
  double largest_strength() const override { return 50; }
  json parameters() const override { return {{"width_deg", width()}}; }
};

struct Settling : Cause {  // table on a springy shaft rings after the stop
  double tau_s = 0.2, hz = 9;
  void draw(Session&, Random& random) override {
    tau_s = random.uniform(0.08, 0.3);
    hz = random.uniform(3, 14);
  }
  double stage(const Moment& moment) const override {
    const double t = moment.since_move + moment.beam_s;
    return strength * 0.05 * degree * moment.capture->approach * std::exp(-t / tau_s) *
           std::cos(2 * pi * hz * t);
  }
  bool differs_within_capture() const override { return true; }
  json parameters() const override {
    return {{"amplitude_deg", 0.05 * strength}, {"tau_s", tau_s}, {"frequency_hz", hz}};
  }
};

struct MotionSkew : Cause {  // the mirror sweeps while the stage turns; strength scales the turning itself
  std::vector<double> rates;
  void draw(Session& session, Random&) override {
    for (const Capture& capture : session.captures) rates.push_back(capture.rate_deg_s);
  }
  void build(Session& session) override {
    for (std::size_t i = 0; i < rates.size(); ++i) session.captures[i].rate_deg_s = rates[i] * strength;
  }
  double stage(const Moment& moment) const override {
    return moment.capture->rate_deg_s * degree * moment.beam_s;
  }
};

struct TimeOffset : Cause {  // the stage's stamps come late
  double stage(const Moment& moment) const override {
    return moment.capture->rate_deg_s * degree * strength * 0.01;
  }
  json parameters() const override { return {{"offset_ms", strength * 10}}; }
};

struct TargetOffset : Subsurface {  // a board stands elsewhere
  double range(const Moment&, const Sight&, const World&) const override { return 0; }
  Displacement displaced(int which) const override {
    return which == wall ? Displacement{strength * 5, 0} : Displacement{};
  }
  json parameters() const override { return {{"target", name}, {"offset_mm", 5 * strength}}; }
};

struct TargetTilt : TargetOffset {
  double out = 1;  // 1: counter-clockwise
  void draw(Session& session, Random& random) override {
    Subsurface::draw(session, random);
    out = random.sign();
  }
  double largest_strength() const override { return 40; }
  Displacement displaced(int which) const override {
    return which == wall ? Displacement{0, out * strength * 0.3 * degree} : Displacement{};
  }
  json parameters() const override { return {{"target", name}, {"tilt_deg", out * 0.3 * strength}}; }
};

struct TargetCurvature : Subsurface {  // a board bent to a circle between its supports
  double length = 1000;
  void draw(Session& session, Random& random) override {
    Subsurface::draw(session, random);
    const Wall& board = session.walls[static_cast<std::size_t>(wall)];
    length = (board.to - board.from).norm();
  }
  double range(const Moment&, const Sight& sight, const World&) const override {
    if (sight.wall != wall) return 0;
    const double sag = strength * 3, radius = length * length / (8 * sag) + sag / 2;
    const double inside = std::max(0.0, radius * radius - sight.along_mm * sight.along_mm);
    return (std::sqrt(inside) - (radius - sag)) / std::cos(sight.incidence);
  }
  json parameters() const override { return {{"target", name}, {"sagitta_mm", 3 * strength}}; }
};

// ---- light, echoes, noise
// ----------------------------------------------------------------------------------

struct MixedPixel : Cause {
  double pulse_mm = 700;
  MixedPixel() { observable = "range-distribution"; }
  double divergence_deg = 0.2;
  void draw(Session&, Random& random) override {
    pulse_mm = random.uniform(300, 1200);
    divergence_deg = random.log_uniform(0.04, 0.5);
  }
  bool has_size() const override { return false; }  // seen at once or, below the stage's steps, not at all
  double footprint() const override { return divergence_deg * degree; }
  bool merges(double gap) const override { return gap < pulse_mm; }
  json parameters() const override {
    return {{"divergence_deg", footprint() / degree}, {"pulse_mm", pulse_mm}};
  }
};

struct RangeNoise : Cause {  // a second source of white noise
  RangeNoise() { observable = "range-variance"; }
  double variance(const Moment&, const Sight&, const World&) const override { return strength * 4; }
  json parameters() const override { return {{"extra_sigma_mm", 2 * std::sqrt(strength)}}; }
};

struct IntensityNoise : Cause {  // timing jitter = electronic noise over slope: weak echoes jitter more
  double half = 0.1;
  bool photons = true;
  IntensityNoise() { observable = "range-variance"; }
  void draw(Session& session, Random& random) override {
    const auto [low, high] = power_span(session);
    half = low * random.uniform(1, 3);
    photons = random.chance(0.5);
  }
  double variance(const Moment&, const Sight& sight, const World& world) const override {
    const double weak = half / sight.power;
    return strength * std::pow(world.session().sigma_mm, 2) * (photons ? weak : weak * weak);
  }
};

struct Sunlight : Cause {  // background light through part of the field of view
  double centre = 0, width = 0.3;
  Sunlight() { observable = "range-variance"; }
  void draw(Session&, Random& random) override {
    centre = random.uniform(-50, 50) * degree;
    width = random.uniform(8, 20) * degree;
  }
  [[nodiscard]] double light(const Moment& moment) const {
    const double x = (moment.alpha - centre) / width;
    return 1 / (1 + std::pow(x, 6));
  }
  double variance(const Moment& moment, const Sight&, const World& world) const override {
    return strength * std::pow(world.session().sigma_mm, 2) * light(moment);
  }
  double lost(const Moment& moment, const Sight&) const override {
    const double excess = strength * light(moment);
    return 0.02 * excess * excess / (1 + excess * excess);
  }
  json parameters() const override {
    return {{"centre_deg", centre / degree}, {"width_deg", width / degree}};
  }
};

struct CorrelatedNoise : Cause {
  std::vector<std::pair<double, double>> shape;
  bool common = false;
  CorrelatedNoise() { observable = "time-correlation"; }
  void draw(Session&, Random& random) override {
    common = random.chance(0.25);
    if (random.chance(0.6)) {
      shape = {{1.0, random.uniform(0.5, 0.95)}};
    } else {  // a ladder of time constants is nearly 1/f
      shape = {{0.34, 0.37}, {0.33, 0.78}, {0.33, 0.94}};
    }
  }
  double largest_strength() const override { return 1 / 0.3; }
  std::vector<std::pair<double, double>> memory() const override {
    auto scaled = shape;
    for (auto& [share, rho] : scaled) share *= std::min(1.0, strength * 0.3);
    return scaled;
  }
  bool memory_is_common() const override { return common; }
  json parameters() const override {
    json list = json::array();
    for (const auto& [share, rho] : memory()) list.push_back({{"share", share}, {"rho", rho}});
    return {{"components", list}, {"common_to_a_scan", common}};
  }
};

struct Rounding : Cause {  // firmware drops the last bits
  double step_mm = 5;
  Rounding() { observable = "range-distribution"; }
  void draw(Session&, Random& random) override { step_mm = random.integer(2, 10); }
  bool has_size() const override { return false; }
  double output_step_mm() const override { return step_mm; }
  json parameters() const override { return {{"step_mm", step_mm}}; }
};

struct Outliers : Cause {
  double ghost_mm = 0;
  Outliers() { observable = "range-distribution"; }
  void draw(Session&, Random& random) override {
    ghost_mm = random.chance(0.4) ? random.uniform(150, 600) : 0;
  }
  double stray(const Moment&, const Sight&) const override { return std::min(0.2, strength * 0.005); }
  double stray_range(const Sight& sight, Random& random) const override {
    return ghost_mm > 0 ? ghost_mm + 5 * random.normal() : random.uniform(60, sight.range_mm);
  }
  json parameters() const override { return {{"fraction", std::min(0.2, strength * 0.005)}}; }
};

struct Dropout : Cause {  // echo below the comparator's threshold
  double weakest = 0.01;
  Dropout() { observable = "dropout"; }
  void draw(Session& session, Random&) override { weakest = power_span(session).low; }
  double lost(const Moment&, const Sight& sight) const override {
    const double threshold = weakest * 0.6 * std::sqrt(strength);
    return 0.5 * std::erfc((sight.power / threshold - 1) / (0.3 * std::sqrt(2.0)));
  }
  double largest_strength() const override { return 50; }
};

const Entries& catalogue() {
  static const Entries entries{
      {"zero-offset", {"target", {"room", "ladder", "boards", "l-room"}, make<ZeroOffset>}},
      {"range-scale", {"range_mm", {"ladder", "room", "boards", "l-room", "furnished"}, make<RangeScale>}},
      {"range-walk", {"intensity", {"ladder", "reflectance-ladder", "boards"}, make<RangeWalk>}},
      {"saturation", {"intensity", {"reflectance-ladder", "ladder"}, make<Saturation>}},
      {"cyclic-error", {"range_mm", {"ladder", "room", "l-room"}, make<CyclicError>}},
      {"time-quantisation", {"range_mm", {"room", "boards"}, make<TimeQuantisation>}},
      {"near-field", {"range_mm", {"ladder", "box"}, make<NearField>}},
      {"window-reflection", {"beam_deg", {"box"}, make<WindowReflection>}},
      {"incidence-bias", {"incidence_deg", {"room", "boards", "corridor", "furnished"}, make<IncidenceBias>}},
      {"subsurface", {"target", {"room", "boards"}, make<Subsurface>}},
      {"warm-up", {"time_s", {"warmup", "heat-cycle"}, make<WarmUp>}},
      {"temperature", {"temperature_c", {"heat-cycle", "warmup"}, make<Temperature>}},
      {"multipath", {"target", {"room"}, make<Multipath>}},
      {"crosstalk", {"beam_deg", {"panels"}, make<Crosstalk>}},
      {"air-index", {"range_mm", {"ladder"}, make<AirIndex>}},
      {"encoder-eccentricity",
       {"beam_deg",
        {"room", "boards", "settle", "l-room", "corridor", "furnished"},
        make<EncoderEccentricity>}},
      {"encoder-second-harmonic",
       {"beam_deg", {"room", "boards", "l-room", "furnished"}, make<EncoderSecondHarmonic>}},
      {"angle-scale", {"beam_deg", {"room", "boards", "l-room"}, make<AngleScale>}},
      {"index-offset", {"beam_deg", {"room"}, make<IndexOffset>}},
      {"angle-jitter", {"range_rate", {"room", "boards", "corridor", "l-room"}, make<AngleJitter>}},
      {"lidar-arm", {"stage_deg", {"room", "boards", "l-room"}, make<LidarArm>}},
      {"scan-plane-tilt", {"beam_deg", {"room"}, make<ScanPlaneTilt>}},
      {"facet-wobble", {"scan_seq", {"room", "warmup"}, make<FacetWobble>}},
      {"stage-periodic", {"stage_deg", {"two-sided", "room"}, make<StagePeriodic>}},
      {"stage-scale", {"stage_deg", {"room", "boards", "l-room", "corridor"}, make<StageScale>}},
      {"stage-eccentricity", {"stage_deg", {"room"}, make<StageEccentricity>}},
      {"backlash", {"approach", {"room", "two-sided", "boards", "l-room", "furnished"}, make<Backlash>}},
      {"settling", {"scan_seq", {"settle"}, make<Settling>}},
      {"motion-skew", {"stage_rate_deg_s", {"turning"}, make<MotionSkew>}},
      {"time-offset", {"stage_rate_deg_s", {"turning"}, make<TimeOffset>}},
      {"target-offset", {"target", {"room", "boards", "l-room", "furnished"}, make<TargetOffset>}},
      {"target-tilt", {"target", {"room", "boards", "furnished"}, make<TargetTilt>}},
      {"target-curvature", {"target", {"room", "boards"}, make<TargetCurvature>}},
      {"mixed-pixel", {"edge_distance_deg", {"edge", "panels"}, make<MixedPixel>}},
      {"range-noise", {"range_mm", {"room", "ladder", "furnished"}, make<RangeNoise>}},
      {"intensity-noise",
       {"intensity", {"ladder", "room", "reflectance-ladder", "l-room"}, make<IntensityNoise>}},
      {"sunlight", {"beam_deg", {"warmup", "room"}, make<Sunlight>}},
      {"correlated-noise", {"time_s", {"ladder", "warmup", "room", "l-room"}, make<CorrelatedNoise>}},
      {"rounding", {"range_mm", {"room", "ladder"}, make<Rounding>}},
      {"outliers", {"target", {"room", "ladder", "l-room", "furnished"}, make<Outliers>}},
      {"dropout", {"intensity", {"ladder", "room"}, make<Dropout>}}};
  return entries;
}

}  // namespace

std::shared_ptr<Cause> make_cause(const std::string& id) {
  for (const Entries* entries : {&catalogue(), &outside_the_catalogue()})
    for (const auto& [name, entry] : *entries) {
      if (name != id) continue;
      auto cause = entry.make();
      cause->id = id;
      cause->coordinate = entry.coordinate;
      return cause;
    }
  throw std::invalid_argument("unknown kind '" + id + "'; --list shows them");
}

const std::vector<std::pair<std::string, std::vector<std::string>>>& cause_scenes() {
  static const auto list = [] {
    std::vector<std::pair<std::string, std::vector<std::string>>> all;
    for (const Entries* entries : {&catalogue(), &outside_the_catalogue()})
      for (const auto& [name, entry] : *entries) all.emplace_back(name, entry.scenes);
    return all;
  }();
  return list;
}

}  // namespace challenge
