// SPDX-License-Identifier: MIT
#include "sim/model_engine.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "fit/bench/empirical.hpp"
#include "fit/bench/radiometer.hpp"
#include "fit/bench/scene.hpp"
#include "fit/known_mechanisms.hpp"
#include "fit/mechanism.hpp"
#include "sim/polar_random.hpp"
#include "sim/simple_engine.hpp"
#include "sim/stage_follower.hpp"

namespace sim {
namespace {

/// Echoes of front and back merge to one where the gap is below about this (half of a 2 ns pulse's length).
constexpr double usual_merging_mm = 150;

std::vector<fit::Active> active_mechanisms(const fit::Bench& bench) {
  fit::demand_catalogued(bench);
  return fit::known_to_be_at_work(bench);
}

class ModelEngine : public Engine {
 public:
  ModelEngine(fit::Bench bench, std::uint64_t seed)
      : bench_(std::move(bench)),
        options_(simple_options(bench_)),
        described_(fit::described_intensity(bench_)),
        claim_(fit::claimed_intensity(bench_)),
        stands_(bench_.targets.size()),
        scene_(bench_, stands_),
        active_(active_mechanisms(bench_)),
        merging_mm_(fit::described_merging(bench_).value_or(usual_merging_mm)),
        strays_(fit::described_strays(bench_)),
        random_(seed),
        memory_(static_cast<std::size_t>(bench_.lidar.steps)) {
    for (double& state : memory_) state = random_.normal();
    for (fit::EmpiricalFunction& f : fit::empirical_functions(bench_))
      if (f.acts_on == "far_share") far_share_ = std::move(f);
    if (described_) relative_noise_ = described_->relative_noise;
    if (claim_ && !claim_->stated[fit::IntensityLaw::gain]) claim_.reset();
    if (claim_) {
      relative_noise_ = claim_->relative_noise.value_or(relative_noise_);
    }
    // A law that is stated without corrections acts by its claim alone.
    std::erase_if(active_, [](const fit::Active& one) {
      return one.mechanism->corrects_a_statement &&
             std::ranges::all_of(one.values, [](double value) { return value == 0; });
    });
    const auto dims = [](const fit::Active& one) {
      return one.mechanism->observable == fit::Observable::intensity;
    };
    std::ranges::copy_if(active_, std::back_inserter(dimming_), dims);
    std::erase_if(active_, dims);
    for (const fit::Active& one : active_)
      if (displaces(one))
        stands_[static_cast<std::size_t>(one.target)] += one.mechanism->displaces(one.values);
    std::erase_if(active_, displaces);
    scene_ = fit::Scene(bench_, stands_);
    put_ = stands_;
  }

  void set_scene(const SceneState& state) override {
    for (std::size_t i = 0; i < stands_.size(); ++i) {
      if (bench_.targets[i].name != state.target) continue;
      stands_[i].out_mm = put_[i].out_mm + state.target_shift_mm;
      stands_[i].moved = state.target_shift_mm != 0;
      stands_[i].reflectance = state.reflectance >= 0 ? std::optional(state.reflectance) : std::nullopt;
    }
    scene_ = fit::Scene(bench_, stands_);
    temperature_c_ = state.temperature_c;
    seen_from_ = std::numeric_limits<double>::quiet_NaN();
  }

  void switched_on(double time_s) override { on_since_s_ = time_s; }

  void scan(double scan_s, const StageAt& stage_at, std::span<std::uint32_t> range_mm,
            std::span<std::uint32_t> intensity) override {
    last_move_.follow(scan_s, stage_at);
    if (first_temperature_c_ < -1e3) first_temperature_c_ = temperature_c_;
    const StageMoment stage = stage_at(scan_s);
    prepare(stage.angle_rad);
    scan_normal_ = random_.normal();
    for (std::size_t step = 0; step < range_mm.size(); ++step)
      measure(step, scan_s, stage, range_mm[step], intensity[step]);
    ++scans_;
  }

 private:
  [[nodiscard]] Eigen::Vector2d origin(double stage_rad) const {
    const fit::Mount& mount = bench_.lidar.mount;
    const double c = std::cos(stage_rad), s = std::sin(stage_rad);
    return {c * mount.x_mm.value - s * mount.y_mm.value, s * mount.x_mm.value + c * mount.y_mm.value};
  }

  [[nodiscard]] double counts(const fit::Hit& hit) const {
    const int target = hit.target;
    const double facing = hit.cosine, range = hit.range_mm, rho = scene_.reflectance(target);
    if (claim_) return claim_->law.counts(rho, facing, range);
    if (described_)
      return described_->law.counts(rho, facing, range) *
             described_->gain(bench_.targets[static_cast<std::size_t>(target)].name, rho);
    const double falloff = 1 + std::pow(range / options_.intensity_falloff_mm, 2);
    const double reference = 1 + std::pow(200 / options_.intensity_falloff_mm, 2);
    return options_.intensity_at_reference * std::min(1.0, rho * facing * reference / falloff);
  }

  /// Counts of an echo and of a receiver that are changed, instead of so many.
  [[nodiscard]] double dimmed(double counts, const fit::Effect& e) const {
    if (dimming_.empty()) return counts;
    const double stronger = claim_ ? claim_->law.stronger(counts, e.log_echo) : counts * std::exp(e.log_echo);
    return stronger * std::exp(e.log_intensity);
  }

  /// What does not change from scan to scan while the stage stands.
  void prepare(double stage_rad) {
    if (stage_rad == seen_from_) return;
    seen_from_ = stage_rad;
    const Eigen::Vector2d here = origin(stage_rad);
    const std::vector<fit::Edge>& edges = edges_from(here);
    sights_.assign(static_cast<std::size_t>(bench_.lidar.steps), {});
    lawful_.assign(sights_.size(), 0);
    for (std::size_t step = 0; step < sights_.size(); ++step) {
      const double beam = bench_.lidar.beam_angle(static_cast<double>(step));
      const double bearing = stage_rad + bench_.lidar.mount.yaw_rad.value + beam;
      const fit::Hit hit = scene_.look(here, bearing);
      if (hit.target < 0) {
        sights_[step].bearing_rad = bearing;
        continue;
      }
      fit::Circumstances& c = sights_[step];
      scene_.describe(here, bearing, hit, edges, c);
      c.beam_rad = beam;
      c.stage_rad = stage_rad;
      c.beam_time_s = bench_.lidar.beam_time_s(static_cast<double>(step));
      c.intensity = lawful_[step] = counts(hit);
    }
  }

  static bool displaces(const fit::Active& one) { return one.target >= 0 && one.mechanism->displaces; }

  [[nodiscard]] static fit::Effect effect(const std::vector<fit::Active>& active,
                                          const fit::Circumstances& c) {
    fit::Effect sum;
    for (const fit::Active& one : active) {
      if (one.target >= 0 && one.target != c.target) continue;
      sum += one.mechanism->act(c, one.values);
    }
    return sum;
  }

  [[nodiscard]] double noise(std::size_t step, const fit::Effect& e) {
    const double variance = e.variance_mm2 > 0 ? e.variance_mm2 : options_.sigma_mm * options_.sigma_mm;
    double white = random_.normal();
    if (e.ar1_share > 0) {
      double& state = memory_[step];
      const double rho = std::clamp(e.ar1_rho, 0.0, 0.9999);
      state = rho * state + std::sqrt(1 - rho * rho) * random_.normal();
      white = std::sqrt(e.ar1_share) * state + std::sqrt(std::max(0.0, 1 - e.ar1_share)) * white;
    }
    return std::sqrt(variance) * white;
  }

  /// As the optical centre sees them, wherever mechanisms have it.
  [[nodiscard]] const std::vector<fit::Edge>& edges_from(const Eigen::Vector2d& place) {
    if (place != edges_seen_from_) {
      edges_ = scene_.edges(place);
      edges_seen_from_ = place;
    }
    return edges_;
  }

  /// At an edge an echo comes from the front, the back, or, where the gap is short, from between.
  [[nodiscard]] fit::Hit mix(const fit::Hit& hit, const Eigen::Vector2d& from, double bearing,
                             double footprint) {
    if (footprint <= 0) return hit;
    const fit::Edge* edge = fit::nearest_edge(edges_from(from), bearing);
    if (!edge || edge->far_target < 0) return hit;
    const double inside = fit::wrap_angle(bearing - edge->bearing_rad) * edge->near_side;
    double front_share = 0;
    if (far_share_) {  // as it was measured
      const double at = inside * fit::deg_per_rad;
      if (at < far_share_->at.front() || at > far_share_->at.back()) return hit;
      front_share = 1 - far_share_->value_at(at);
    } else {
      if (std::abs(inside) > 4 * footprint) return hit;
      front_share = 0.5 * std::erfc(-inside / footprint / std::sqrt(2.0));
    }
    // Each surface where this very beam would meet it: both may be slanted.
    const fit::Hit front = scene_.look_at(edge->near_target, from, bearing),
                   back = scene_.look_at(edge->far_target, from, bearing);
    if (front.target < 0 || back.target < 0 || back.range_mm <= front.range_mm) return hit;
    if (back.range_mm - front.range_mm < merging_mm_) {
      fit::Hit merged = front_share > 0.5 ? front : back;
      merged.range_mm = front_share * front.range_mm + (1 - front_share) * back.range_mm;
      return merged;
    }
    return random_.uniform() < front_share ? front : back;
  }

  /// What of a beam that wide meets the surface that answers, where the other one answers apart.
  [[nodiscard]] double light_share(const fit::Hit& hit, const Eigen::Vector2d& from, double bearing,
                                   double width_rad) {
    if (width_rad <= 0) return 1;
    const fit::Edge* edge = fit::nearest_edge(edges_from(from), bearing);
    if (!edge || (hit.target != edge->near_target && hit.target != edge->far_target)) return 1;
    if (edge->far_target >= 0 && edge->far_mm - edge->near_mm < merging_mm_) return 1;
    const double inside = fit::wrap_angle(bearing - edge->bearing_rad) * edge->near_side,
                 within = hit.target == edge->near_target ? inside : -inside;
    return 0.5 * std::erfc(-within / width_rad / std::sqrt(2.0));
  }

  [[nodiscard]] double stray_range(double target_mm) {
    if (strays_) return strays_->range_mm(random_.uniform(), target_mm);
    return options_.min_range_mm + (options_.max_range_mm - options_.min_range_mm) * random_.uniform();
  }

  void measure(std::size_t step, double scan_s, const StageMoment& stage, std::uint32_t& range_mm,
               std::uint32_t& intensity) {
    range_mm = no_echo;
    intensity = 0;
    fit::Circumstances& c = sights_[step];
    if (c.target < 0) return;
    c.clock_s = c.time_s = scan_s - on_since_s_ + c.beam_time_s;
    c.temperature_k = temperature_c_ - first_temperature_c_;
    c.since_move_s = last_move_.since_s(scan_s + c.beam_time_s);
    c.approach = last_move_.approach();
    c.stage_rate_rad_s = stage.rate_rad_s;
    c.seq = static_cast<int>(scans_ % 27720);  // whatever the number of facets
    // What dims an echo makes it walk, scatter and get lost as well.
    fit::Effect dims;
    if (!dimming_.empty()) {
      c.intensity = lawful_[step];
      dims = effect(dimming_, c);
      c.intensity = dimmed(c.intensity, dims);
    }
    const fit::Effect e = effect(active_, c);
    if (e.lost > 0 && random_.uniform() < e.lost) return;
    const double true_stage = stage.angle_rad + e.stage_rad;
    const double bearing =
        c.bearing_rad + e.stage_rad + e.beam_rad + std::sqrt(e.scan_angle_variance_rad2) * scan_normal_ +
        (e.beam_angle_variance_rad2 > 0 ? std::sqrt(e.beam_angle_variance_rad2) * random_.normal() : 0);
    const Eigen::Vector2d from = origin(true_stage) + e.origin_mm;
    const fit::Hit hit = mix(scene_.look(from, bearing), from, bearing, e.footprint_rad);
    if (hit.target < 0) return;
    double range = hit.range_mm + e.range_mm + noise(step, e);
    if (e.stray > 0 && random_.uniform() < e.stray) range = stray_range(hit.range_mm);
    if (range < options_.min_range_mm) {
      range_mm = too_near;
      return;
    }
    if (range > options_.max_range_mm) return;
    const double unit = e.output_step_mm > 1 ? e.output_step_mm : 1;
    range_mm = static_cast<std::uint32_t>(std::lround(unit * std::floor(range / unit + 0.5)));
    const double strength = light_share(hit, from, bearing, e.light_rad) * dimmed(counts(hit), dims);
    intensity = static_cast<std::uint32_t>(
        std::clamp(std::lround(strength * (1 + relative_noise_ * random_.normal())), 1L, 65000L));
  }

  fit::Bench bench_;
  SimpleOptions options_;
  std::optional<fit::DescribedIntensity> described_;
  std::optional<fit::IntensityClaim> claim_;
  std::vector<fit::Stands> stands_, put_;  ///< At present, and where the bench file's corrections have them.
  fit::Scene scene_;
  std::vector<fit::Active> active_, dimming_;
  double relative_noise_ = 0.01;
  std::optional<fit::EmpiricalFunction> far_share_;
  double merging_mm_ = usual_merging_mm;
  std::optional<fit::StrayPlaces> strays_;
  PolarRandom random_;
  std::vector<double> memory_;
  LastMove last_move_;
  double on_since_s_ = 0, temperature_c_ = 25, first_temperature_c_ = -1e9;
  double seen_from_ = std::numeric_limits<double>::quiet_NaN();
  double scan_normal_ = 0;
  std::int64_t scans_ = 0;
  std::vector<fit::Circumstances> sights_;
  std::vector<double> lawful_;  ///< Counts of every beam before anything dims them.
  std::vector<fit::Edge> edges_;
  Eigen::Vector2d edges_seen_from_ = Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
};

}  // namespace

std::unique_ptr<Engine> make_model_engine(const fit::Bench& bench, std::uint64_t seed) {
  return std::make_unique<ModelEngine>(bench, seed);
}

}  // namespace sim
