// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "sim/causal/heat.hpp"
#include "sim/causal/optics.hpp"
#include "sim/causal/receiver.hpp"
#include "sim/causal/rotor.hpp"
#include "sim/causal/scene.hpp"
#include "sim/causal/turntable.hpp"
#include "sim/polar_random.hpp"
#include "sim/stage_follower.hpp"
#include "sim/world.hpp"

namespace sim {
namespace {

using namespace causal;

/// The whole chain: stage, rotor, optics, receiver, counter, firmware.
class CausalEngine : public Engine {
 public:
  CausalEngine(World world, std::uint64_t seed, std::vector<double>* exact_mm,
               std::vector<double>* exact_counts)
      : world_(std::move(world)),
        exact_mm_(exact_mm),
        exact_counts_(exact_counts),
        scene_(world_),
        optics_(world_, scene_),
        receiver_(world_),
        rotor_(world_.rotor, world_.bench.lidar),
        heat_(world_.heat),
        turntable_(world_.stage),
        random_(seed),
        mount_(world_.mount_x_mm.value_or(world_.bench.lidar.mount.x_mm.value),
               world_.mount_y_mm.value_or(world_.bench.lidar.mount.y_mm.value)),
        yaw_(world_.mount_yaw_rad.value_or(world_.bench.lidar.mount.yaw_rad.value)),
        memory_(static_cast<std::size_t>(world_.bench.lidar.steps)),
        wander_(random_.normal()) {
    for (double& state : memory_) state = random_.normal();
    if (world_.counter.jitter_memory > 0) {
      for (int step = 0; step < world_.bench.lidar.steps; ++step) jitter_state_.push_back(random_.normal());
    }
  }

  void scan(double scan_s, const std::function<StageMoment(double)>& stage_at,
            std::span<std::uint32_t> range_mm, std::span<std::uint32_t> intensity) override {
    heat_.advance(scan_s - on_since_s_, room_c_);
    scene_.at(scan_s - on_since_s_);
    if (!is_knocked_ && scan_s - on_since_s_ >= world_.knock.from_s) {
      is_knocked_ = true;
      mount_ += Eigen::Vector2d(world_.knock.x_mm, world_.knock.y_mm);
      yaw_ += world_.knock.yaw_rad;
      turned_to_ = std::nan("");  // the origin is asked for anew
    }
    rotor_.turn(scans_++);
    begin(scan_s, stage_at);
    if (world_.receiver.stray > 0) survey(range_mm.size());
    if (exact_mm_) exact_mm_->assign(range_mm.size(), std::nan(""));
    if (exact_counts_) exact_counts_->assign(range_mm.size(), std::nan(""));
    for (std::size_t step = 0; step < range_mm.size(); ++step)
      measure(step, scan_s, range_mm[step], intensity[step]);
    if (world_.firmware.median > 1) smooth(range_mm);
    last_scan_s_ = scan_s;
  }

  void set_scene(const SceneState& state) override {
    scene_.set(state);
    room_c_ = state.temperature_c;
    heat_.hold(room_c_, state.held_s);
  }

  void switched_on(double time_s) override {
    on_since_s_ = time_s;
    heat_ = causal::Heat(world_.heat);
  }

  void stage_moves(double time_s, const StageMoment& stage) override {
    turntable_.drive(time_s, stage.angle_rad, stage.rate_rad_s);
  }

 private:
  static constexpr std::size_t knots = 17;

  /// Draws what is common to the scan, and follows the stage through it.
  void begin(double scan_s, const std::function<StageMoment(double)>& stage_at) {
    const double rho = std::exp(-std::max(0.0, scan_s - last_scan_s_) / world_.receiver.wander_memory_s);
    wander_ = rho * wander_ + std::sqrt(1 - rho * rho) * random_.normal();
    jitter_ = world_.rotor.index_jitter_rad > 0 ? world_.rotor.index_jitter_rad * random_.normal() : 0;
    if (world_.stage.ring_rad > 0) {  // begins at the moment the stage stopped
      follow_stage(last_scan_s_, scan_s, stage_at, [this](double time_s, const StageMoment& moment) {
        turntable_.drive(time_s, moment.angle_rad, moment.rate_rad_s);
      });
    }
    const double span = world_.rotor.rolling ? beam_s(static_cast<double>(world_.bench.lidar.steps - 1)) : 0;
    for (std::size_t i = 0; i < knots; ++i) {
      const double time = scan_s + span * static_cast<double>(i) / (knots - 1);
      const StageMoment moment = stage_at(time - world_.stage.late_s);
      turntable_.drive(time, moment.angle_rad, moment.rate_rad_s);
      table_[i] = turntable_.table_rad(time, moment.angle_rad);
    }
  }

  [[nodiscard]] double beam_s(double step) const { return world_.bench.lidar.beam_time_s(step); }

  [[nodiscard]] Beam beam(std::size_t step) {
    const double at =
        world_.rotor.rolling
            ? static_cast<double>(step) / static_cast<double>(world_.bench.lidar.steps - 1) * (knots - 1)
            : 0;
    const auto knot = std::min(knots - 2, static_cast<std::size_t>(at));
    const double table = table_[knot] + (at - static_cast<double>(knot)) * (table_[knot + 1] - table_[knot]);
    if (table != turned_to_) {
      turned_to_ = table;
      const double c = std::cos(table), s = std::sin(table);
      origin_ = Eigen::Vector2d(c * mount_.x() - s * mount_.y(), s * mount_.x() + c * mount_.y());
      origin_ += turntable_.axis_mm(table);
    }
    const Rotor::Direction& direction = rotor_.direction(step);
    Beam beam;
    beam.origin = origin_;
    beam.device = world_.bench.lidar.beam_angle(static_cast<double>(step));
    beam.bearing = table + yaw_ + direction.angle + jitter_;
    beam.rise = direction.rise;
    if (world_.stage.wobble_rad != 0) beam.rise += turntable_.rise(table, beam.bearing);
    for (const World::Housing::Dirt& dirt : world_.housing.dirt) {
      if (dirt.there < 1 && random_.uniform() >= dirt.there) continue;
      const double x = (beam.device - dirt.centre_rad) / dirt.width_rad;
      beam.loss = 1 - (1 - beam.loss) * (1 - dirt.loss * std::exp(-x * x));
    }
    return beam;
  }

  /// Where every beam's middle goes: what stray light of the neighbours brings.
  void survey(std::size_t steps) {
    neighbours_.assign(steps, {});
    for (std::size_t step = 0; step < steps; ++step) {
      optics_.trace(beam(step), echoes_);
      Echo sum;
      for (const Echo& echo : echoes_) {
        sum.amplitude += echo.amplitude;
        sum.t_ns += echo.amplitude * echo.t_ns;
      }
      if (sum.amplitude > 0) sum.t_ns /= sum.amplitude;
      sum.pulse = &receiver_.pulse();
      neighbours_[step] = sum;
    }
  }

  void add_stray(std::size_t step) {
    const double pitch = world_.bench.lidar.step_rad;
    const int reach = std::min(40, static_cast<int>(3 * world_.receiver.stray_width_rad / pitch));
    for (int side = -reach; side <= reach; ++side) {
      const auto other = static_cast<std::ptrdiff_t>(step) + side;
      if (side == 0 || other < 0 || other >= static_cast<std::ptrdiff_t>(neighbours_.size())) continue;
      Echo echo = neighbours_[static_cast<std::size_t>(other)];
      const double x = side * pitch / world_.receiver.stray_width_rad;
      echo.amplitude *= world_.receiver.stray * std::exp(-x * x);
      constexpr double anything = 1e-4;  // of the threshold
      if (echo.amplitude > anything * world_.receiver.threshold) echoes_.push_back(echo);
    }
    std::ranges::sort(echoes_, {}, &Echo::t_ns);
  }

  /// Noise and interference at the comparator while this beam is out.
  [[nodiscard]] Disturbance disturb(std::size_t step, double scan_s, double first_ns) {
    const World::Receiver& r = world_.receiver;
    const double time = scan_s + (world_.rotor.rolling ? beam_s(static_cast<double>(step)) : 0);
    const double angle = world_.bench.lidar.beam_angle(static_cast<double>(step));
    double variance = r.noise * r.noise + r.photon_noise * r.photon_noise * r.threshold;
    for (const World::Light::Sun& sun : world_.light.suns) {
      if (time < sun.from_s || time > sun.to_s) continue;
      const double seen_at = angle + sun.in_room * table_.front();
      const double x = fit::wrap_angle(seen_at - sun.centre_rad) / sun.width_rad;
      const double noise = sun.noise * std::exp(-x * x);
      variance += noise * noise;
    }
    double& state = memory_[step];
    state = r.memory > 0 ? r.memory * state + std::sqrt(1 - r.memory * r.memory) * random_.normal()
                         : random_.normal();
    Disturbance d;
    const double sigma = std::sqrt(variance);
    d.threshold = sigma * state + r.wander * wander_;
    d.peak = sigma * random_.normal();
    if (world_.light.lamp != 0) {
      // A lamp flickers at twice the mains' frequency; given as the flicker itself.
      d.threshold -= world_.light.lamp * std::sin(2 * fit::pi * world_.light.lamp_hz * time);
    }
    if (world_.counter.leak != 0) {
      d.threshold -= world_.counter.leak * std::sin(2 * fit::pi * world_.counter.leak_mhz * 1e-3 * first_ns +
                                                    world_.counter.leak_phase_rad);
    }
    d.flash = world_.housing.flash;
    if (world_.housing.glint != 0) {
      const double x = (angle - world_.housing.glint_centre_rad) / world_.housing.glint_width_rad;
      d.flash += world_.housing.glint * std::exp(-x * x);
    }
    return d;
  }

  /// A grain in the beam answers before the target and takes little from it.
  void add_dust() {
    const double reach = echoes_.empty() ? 10000 : echoes_.front().t_ns * light_mm_per_ns;
    if (random_.uniform() >= 1 - std::exp(-world_.air.dust_per_m * reach / 1000)) return;
    const double range = reach * random_.uniform();
    const double power = 0.02 * (0.2 + random_.uniform()) * 1e6 / (range * range + 1e4);
    echoes_.insert(echoes_.begin(), {range / light_mm_per_ns, power, &receiver_.pulse()});
  }

  void measure(std::size_t step, double scan_s, std::uint32_t& range_mm, std::uint32_t& intensity) {
    const Beam out = beam(step);
    optics_.trace(out, echoes_);
    if (world_.receiver.stray > 0) add_stray(step);
    if (world_.air.dust_per_m > 0) add_dust();
    range_mm = no_echo;
    intensity = 0;
    if (echoes_.empty()) return;
    const Disturbance disturbance = disturb(step, scan_s, echoes_.front().t_ns);
    const Reading reading = receiver_.detect(echoes_, disturbance, heat_.gain());
    if (!reading.found) return;
    intensity =
        counts(reading.peak,
               world_.receiver.counts_noise > 0 ? 1 + world_.receiver.counts_noise * random_.normal() : 1);
    if (exact_counts_) (*exact_counts_)[step] = exact_counts(reading.peak);
    double t = reading.t_ns + world_.housing.delay_ns + heat_.delay_ns();
    if (world_.counter.jitter_ns > 0) t += world_.counter.jitter_ns * counter_noise(step);
    if (world_.counter.bin_ns > 0) t = world_.counter.bin_ns * std::floor(t / world_.counter.bin_ns + 0.5);
    const double range = t * light_mm_per_ns * (1 + 1e-6 * world_.counter.ppm) + rotor_.facet_mm();
    if (exact_mm_) (*exact_mm_)[step] = range;
    if (range < 21) {
      range_mm = too_near;
      return;
    }
    const double rounded = world_.firmware.step_mm * std::floor(range / world_.firmware.step_mm + 0.5);
    range_mm = rounded > 30000 ? no_echo : static_cast<std::uint32_t>(rounded);
  }

  [[nodiscard]] double counter_noise(std::size_t step) {
    const double rho = world_.counter.jitter_memory, white = random_.normal();
    if (rho <= 0) return white;
    return jitter_state_[step] = rho * jitter_state_[step] + std::sqrt(1 - rho * rho) * white;
  }

  [[nodiscard]] double exact_counts(double peak) const {
    const World::Receiver& r = world_.receiver;
    const double raw = r.counts * std::pow(peak, r.counts_exponent);
    return raw / std::hypot(1, raw / r.counts_full);
  }
  [[nodiscard]] std::uint32_t counts(double peak, double noise) const {
    return static_cast<std::uint32_t>(std::clamp(exact_counts(peak) * noise, 0.0, 65000.0));
  }

  /// Median over neighbouring beams, codes left out.
  void smooth(std::span<std::uint32_t> range) {
    const std::vector<std::uint32_t> raw(range.begin(), range.end());
    const auto half = static_cast<std::ptrdiff_t>(world_.firmware.median / 2);
    std::vector<std::uint32_t> window;
    for (std::ptrdiff_t i = 0; i < static_cast<std::ptrdiff_t>(raw.size()); ++i) {
      if (raw[static_cast<std::size_t>(i)] == no_echo || raw[static_cast<std::size_t>(i)] == too_near)
        continue;
      window.clear();
      for (auto j = std::max<std::ptrdiff_t>(0, i - half);
           j <= std::min<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(raw.size()) - 1, i + half); ++j) {
        const std::uint32_t value = raw[static_cast<std::size_t>(j)];
        if (value != no_echo && value != too_near) window.push_back(value);
      }
      std::ranges::nth_element(window, window.begin() + static_cast<std::ptrdiff_t>(window.size() / 2));
      range[static_cast<std::size_t>(i)] = window[window.size() / 2];
    }
  }

  World world_;
  std::vector<double>*exact_mm_, *exact_counts_;
  Scene scene_;
  Optics optics_;
  Receiver receiver_;
  Rotor rotor_;
  Heat heat_;
  Turntable turntable_;
  PolarRandom random_;
  Eigen::Vector2d mount_;
  bool is_knocked_ = false;
  double yaw_;
  std::vector<double> memory_, jitter_state_;
  double wander_, jitter_ = 0;
  double room_c_ = 25, on_since_s_ = 0;
  double last_scan_s_ = 0;
  std::size_t scans_ = 0;
  std::array<double, knots> table_{};
  double turned_to_ = 1e300;
  Eigen::Vector2d origin_ = Eigen::Vector2d::Zero();
  std::vector<Echo> echoes_, neighbours_;
};

}  // namespace

std::unique_ptr<Engine> make_causal_engine(const World& world, std::uint64_t seed,
                                           std::vector<double>* exact_mm, std::vector<double>* exact_counts) {
  return std::make_unique<CausalEngine>(world, seed, exact_mm, exact_counts);
}

}  // namespace sim
