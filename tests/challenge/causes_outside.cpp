// SPDX-License-Identifier: MIT
// What no catalogue of a lidar's physics holds, made from causes as well: to be called unknown.
#include <algorithm>
#include <cmath>

#include "cause_entry.hpp"

namespace challenge {
namespace {

using nlohmann::json;

/// What rises and falls some times a turn of the mirror.
struct Lobes {
  int number = 5;
  double phase = 0;
  void draw(Random& random) {
    number = random.integer(3, 9);
    phase = random.uniform(-pi, pi);
  }
  [[nodiscard]] double at(double alpha) const { return std::sin(number * alpha + phase); }
};

struct UnknownLobes : Cause {
  Lobes lobes;
  void draw(Session&, Random& random) override { lobes.draw(random); }
  double range(const Moment& moment, const Sight&, const World&) const override {
    return strength * 3 * lobes.at(moment.alpha);
  }
  json parameters() const override { return {{"lobes", lobes.number}, {"amplitude_mm", 3 * strength}}; }
};

struct UnknownAngleStep : Cause {  // a slit of the code disk is missing: all later angles are off
  double at = 0;
  void draw(Session&, Random& random) override { at = random.uniform(-70, 70) * degree; }
  double beam(const Moment& moment) const override { return moment.alpha > at ? strength * 0.1 * degree : 0; }
  json parameters() const override { return {{"at_deg", at / degree}, {"step_deg", 0.1 * strength}}; }
};

struct UnknownRangeStep : Cause {  // the counter changes its clock source at one beam
  double at = 0;
  void draw(Session&, Random& random) override { at = random.uniform(-70, 70) * degree; }
  double range(const Moment& moment, const Sight&, const World&) const override {
    return moment.alpha > at ? strength * 3 : 0;
  }
  json parameters() const override { return {{"at_deg", at / degree}, {"step_mm", 3 * strength}}; }
};

struct UnknownBump : Cause {  // a scratch in the window
  double at = 0, width = 0.1;
  void draw(Session&, Random& random) override {
    at = random.uniform(-50, 50) * degree;
    width = random.uniform(4, 14) * degree;
  }
  double range(const Moment& moment, const Sight&, const World&) const override {
    const double x = (moment.alpha - at) / width;
    return std::abs(x) < 1 ? strength * 4 * (1 - x * x) * (1 - x * x) : 0;
  }
  json parameters() const override { return {{"at_deg", at / degree}, {"width_deg", width / degree}}; }
};

struct UnknownSawtooth : Cause {  // interpolation between coarse slits
  double period = 0.5;
  void draw(Session&, Random& random) override { period = random.uniform(24, 60) * degree; }
  double beam(const Moment& moment) const override {
    const double x = moment.alpha / period;
    return strength * 0.1 * degree * (x - std::floor(x) - 0.5);
  }
  json parameters() const override { return {{"period_deg", period / degree}}; }
};

struct UnknownParityDrift : Cause {  // every other scan drifts within a capture
  double range(const Moment& moment, const Sight&, const World&) const override {
    return moment.seq % 2 == 0 ? 0 : strength * 2 * (moment.seq + 1.0) / moment.capture->scans;
  }
  bool differs_within_capture() const override { return true; }
};

struct UnknownTimeWave : Cause {  // the air conditioning switches
  double period_s = 600, phase = 0;
  void draw(Session& session, Random& random) override {
    const double span = session.captures.back().since_power_on_s - session.captures.front().since_power_on_s;
    period_s = span / random.uniform(2.5, 6);
    phase = random.uniform(0, 1);
  }
  double range(const Moment& moment, const Sight&, const World&) const override {
    const double x = moment.since_power_on / period_s + phase;
    return strength * 3 * (std::abs(2 * (x - std::floor(x)) - 1) - 0.5);
  }
  json parameters() const override { return {{"period_s", period_s}}; }
};

struct UnknownTimeStep : Cause {  // something was knocked, once
  double at_s = 0;
  void draw(Session& session, Random& random) override {
    const double first = session.captures.front().since_power_on_s,
                 last = session.captures.back().since_power_on_s;
    at_s = first + (last - first) * random.uniform(0.25, 0.75);
  }
  double range(const Moment& moment, const Sight&, const World&) const override {
    return moment.since_power_on > at_s ? strength * 3 : 0;
  }
  json parameters() const override { return {{"at_s", at_s}}; }
};

struct UnknownStageSector : Cause {  // a cable pulls over part of the turn
  double from = 0, width = 60;
  void draw(Session&, Random& random) override {
    from = random.uniform(0, 260);
    width = random.uniform(50, 100);
  }
  double stage(const Moment& moment) const override {
    const double x = moment.capture->stage_deg - from;
    return x > 0 && x < width ? strength * 0.1 * degree * std::pow(std::sin(pi * x / width), 2) : 0;
  }
  json parameters() const override { return {{"from_deg", from}, {"to_deg", from + width}}; }
};

struct UnknownGainSwitch : Cause {  // the amplifier changes its range at one echo strength
  double at = 0.1;
  void draw(Session& session, Random& random) override {
    const auto [low, high] = power_span(session);
    at = low * std::pow(high / low, random.uniform(0.35, 0.65));
  }
  double range(const Moment&, const Sight& sight, const World&) const override {
    return sight.power > at ? strength * 3 : 0;
  }
};

struct UnknownNoise : Cause {  // more noise, by a law that no receiver has
  UnknownNoise() { observable = "range-variance"; }
  [[nodiscard]] virtual double where(const Moment&, const Sight&, const World&) const = 0;  ///< 0..1
  double variance(const Moment& moment, const Sight& sight, const World& world) const final {
    return strength * std::pow(world.session().sigma_mm, 2) * where(moment, sight, world);
  }
};

struct UnknownNoiseLobes : UnknownNoise {  // the mirror's motor disturbs the counter at some of its angles
  Lobes lobes;
  void draw(Session&, Random& random) override { lobes.draw(random); }
  double where(const Moment& moment, const Sight&, const World&) const override {
    return (1 + lobes.at(moment.alpha)) / 2;
  }
  json parameters() const override { return {{"lobes", lobes.number}}; }
};

struct UnknownNoiseStage : UnknownNoise {  // the cable shakes the lidar over part of the turn
  double from = 0, width = 90;
  void draw(Session&, Random& random) override {
    from = random.uniform(0, 260);
    width = random.uniform(60, 110);
  }
  double where(const Moment& moment, const Sight&, const World&) const override {
    const double x = moment.capture->stage_deg - from;
    return x > 0 && x < width;
  }
  json parameters() const override { return {{"from_deg", from}, {"to_deg", from + width}}; }
};

struct UnknownNoiseGrowth : UnknownNoise {  // a supply that ages while it runs
  double from_s = 0, span_s = 1;
  void draw(Session& session, Random&) override {
    from_s = session.captures.front().since_power_on_s;
    span_s = std::max(1.0, session.captures.back().since_power_on_s - from_s);
  }
  double where(const Moment& moment, const Sight&, const World&) const override {
    return std::clamp((moment.since_power_on - from_s) / span_s, 0.0, 1.0);
  }
};

struct UnknownNoiseRange : UnknownNoise {  // the counter's clock jitters: the later the echo, the more
  double longest_mm = 1;
  void draw(Session& session, Random&) override {
    const World world(session, {}, session.truth);
    for (std::size_t c = 0; c < session.captures.size(); ++c)
      for (int step = session.captures[c].first_step; step <= session.captures[c].last_step; step += 5)
        longest_mm = std::max(longest_mm, world.look(world.moment(c, 0, step)).range_mm);
  }
  double where(const Moment&, const Sight& sight, const World&) const override {
    return std::pow(sight.range_mm / longest_mm, 2);
  }
};

struct UnknownLoss : Cause {  // the line drops echoes, whatever their strength
  UnknownLoss() { observable = "dropout"; }
  double lost(const Moment&, const Sight&) const override { return std::min(0.5, 0.01 * strength); }
};

struct UnknownTail : Cause {  // late echoes: a long tail on one side
  double length_mm = 40;
  UnknownTail() { observable = "range-distribution"; }
  void draw(Session& session, Random& random) override {
    length_mm = session.sigma_mm * random.uniform(3, 8);
  }
  double stray(const Moment&, const Sight&) const override { return std::min(0.4, 0.05 * strength); }
  double stray_range(const Sight& sight, Random& random) const override {
    return sight.range_mm - length_mm * std::log(random.uniform(1e-9, 1));
  }
  json parameters() const override { return {{"length_mm", length_mm}}; }
};

}  // namespace

const Entries& outside_the_catalogue() {
  static const Entries entries{
      {"unknown-lobes", {"beam_deg", {"room", "settle"}, make<UnknownLobes>}},
      {"unknown-angle-step", {"beam_deg", {"room"}, make<UnknownAngleStep>}},
      {"unknown-range-step", {"beam_deg", {"room", "warmup"}, make<UnknownRangeStep>}},
      {"unknown-bump", {"beam_deg", {"room", "warmup"}, make<UnknownBump>}},
      {"unknown-sawtooth", {"beam_deg", {"room"}, make<UnknownSawtooth>}},
      {"unknown-parity-drift", {"scan_seq", {"settle", "room"}, make<UnknownParityDrift>}},
      {"unknown-time-wave", {"time_s", {"warmup"}, make<UnknownTimeWave>}},
      {"unknown-time-step", {"time_s", {"warmup", "room"}, make<UnknownTimeStep>}},
      {"unknown-stage-sector", {"stage_deg", {"room"}, make<UnknownStageSector>}},
      {"unknown-gain-switch", {"intensity", {"ladder", "reflectance-ladder"}, make<UnknownGainSwitch>}},
      {"unknown-noise-lobes", {"beam_deg", {"room", "warmup"}, make<UnknownNoiseLobes>}},
      {"unknown-noise-stage", {"stage_deg", {"room"}, make<UnknownNoiseStage>}},
      {"unknown-noise-growth", {"time_s", {"warmup", "room"}, make<UnknownNoiseGrowth>}},
      {"unknown-noise-range", {"range_mm", {"reflectance-ladder", "boards"}, make<UnknownNoiseRange>}},
      {"unknown-loss", {"target", {"reflectance-ladder", "room"}, make<UnknownLoss>}},
      {"unknown-tail", {"target", {"room", "ladder"}, make<UnknownTail>}}};
  return entries;
}

}  // namespace challenge
