// SPDX-License-Identifier: MIT
// Concealed causes that shift ranges: pulses on thresholds, counters, glass, air.
#include <algorithm>
#include <cmath>

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
    return {{"reach_mm", reach_mm}, {"centre_deg", centre / degree}};  // the width is no bell's
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

struct Subsurface : OnOneTarget {  // light enters one material and returns late
  double range(const Moment&, const Sight& sight, const World&) const override {
    return sight.wall == wall ? strength * 5 : 0;
  }
  json parameters() const override { return {{"target", name}, {"depth_mm", 5 * strength}}; }
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

}  // namespace

const Entries& causes_of_range() {
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
      {"air-index", {"range_mm", {"ladder"}, make<AirIndex>}}};
  return entries;
}

}  // namespace challenge
