// SPDX-License-Identifier: MIT
// Concealed causes of noise, of lost echoes and of strays.
#include <algorithm>
#include <cmath>

#include "cause_entry.hpp"

namespace challenge {
namespace {

using nlohmann::json;

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
  // Its width is no bell's standard width.
  json parameters() const override { return {{"centre_deg", centre / degree}}; }
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

}  // namespace

const Entries& causes_of_noise() {
  static const Entries entries{
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

}  // namespace challenge
