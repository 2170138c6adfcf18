// SPDX-License-Identifier: MIT
// Concealed causes in mirror, stage and targets: disks off their axes, gears with play, boards that bend.
#include <algorithm>
#include <cmath>

#include "cause_entry.hpp"

namespace challenge {
namespace {

using nlohmann::json;

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

struct TargetOffset : OnOneTarget {  // a board stands elsewhere
  double out = 1;
  void draw(Session& session, Random& random) override {
    OnOneTarget::draw(session, random);
    out = away(session.truth.offset_mm[static_cast<std::size_t>(wall)]);
  }
  Displacement displaced(int which) const override {
    return which == wall ? Displacement{out * strength * 5, 0} : Displacement{};
  }
  json parameters() const override { return {{"target", name}, {"offset_mm", out * 5 * strength}}; }
};

struct TargetTilt : OnOneTarget {
  double out = 1;  // 1: counter-clockwise
  void draw(Session& session, Random& random) override {
    OnOneTarget::draw(session, random);
    out = away(session.truth.tilt_rad[static_cast<std::size_t>(wall)]);
  }
  double largest_strength() const override { return 40; }
  Displacement displaced(int which) const override {
    return which == wall ? Displacement{0, out * strength * 0.3 * degree} : Displacement{};
  }
  json parameters() const override { return {{"target", name}, {"tilt_deg", out * 0.3 * strength}}; }
};

struct TargetCurvature : OnOneTarget {  // a board bent to a circle between its supports
  double length = 1000;
  void draw(Session& session, Random& random) override {
    OnOneTarget::draw(session, random);
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

}  // namespace

const Entries& causes_of_geometry() {
  static const Entries entries{
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
      {"target-curvature", {"target", {"room", "boards"}, make<TargetCurvature>}}};
  return entries;
}

}  // namespace challenge
