// SPDX-License-Identifier: MIT
// Concealed physics as world files for the causal engine of sim/. What an effect does to this session is not
// written down anywhere: the engine runs without noise, with and without the cause, and the difference is
// what the oracle is given.
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <stdexcept>

#include "concealed.hpp"
#include "sim/world.hpp"

namespace challenge {
namespace {

using nlohmann::json;

// ---- the device without faults
// -------------------------------------------------------------------------------

struct PowerSpan {
  double low = 1e9, high = 0;
};

/// Smallest and largest echo of the session, to put thresholds where they matter.
PowerSpan power_span(const Session& session) {
  const World world(session, {}, session.truth);
  PowerSpan span;
  for (std::size_t c = 0; c < session.captures.size(); ++c) {
    const Capture& capture = session.captures[c];
    for (int step = capture.first_step; step <= capture.last_step; step += 5) {
      const Sight sight = world.look(world.moment(c, 0, step));
      if (sight.wall < 0 || std::abs(sight.incidence) > 80 * degree) continue;
      span.low = std::min(span.low, sight.power);
      span.high = std::max(span.high, sight.power);
    }
  }
  return span;
}

struct Window {
  int first = 0, last = 1080;
};

/// Steps that any capture uses. A turning stage needs the whole scan's timing, and so does a ringing one.
Window window_of(const Session& session) {
  if (session.scene == "turning" || session.scene == "settle") return {};
  Window window{session.steps, 0};
  for (const Capture& capture : session.captures) {
    window.first = std::min(window.first, capture.first_step);
    window.last = std::max(window.last, capture.last_step);
  }
  return window;
}

json pair_of(const Vector& v) { return {v.x(), v.y()}; }

/// A device whose only imperfection is the counter's jitter: beams like needles, no walk left, no heat.
json plain_world(const Session& session) {
  const Window window = window_of(session);
  json targets = json::array(), truth = json::object();
  for (std::size_t i = 0; i < session.walls.size(); ++i) {
    const Wall& wall = session.walls[i];
    // Walls of a closed room meet wherever they really stand: what sticks out is hidden behind the next one.
    const Vector beyond = wall.closed ? Vector(60 * (wall.to - wall.from).normalized()) : Vector::Zero();
    targets.push_back({{"name", wall.name},
                       {"from_mm", pair_of(wall.from - beyond)},
                       {"to_mm", pair_of(wall.to + beyond)},
                       {"reflectance", wall.reflectance}});
    truth[wall.name] = {{"offset_mm", session.truth.offset_mm[i]},
                        {"tilt_deg", session.truth.tilt_rad[i] / degree}};
  }
  const PowerSpan span = power_span(session);
  return {{"schema", "world/1"},
          {"bench",
           {{"schema", "bench/1"},
            {"lidar",
             {{"model", "UST-10LX"},
              {"steps", window.last - window.first + 1},
              {"front_step", session.front_step - window.first},
              {"step_deg", session.step_deg},
              {"scan_hz", session.scan_hz}}},
            {"targets", targets}}},
          {"truth",
           {{"mount_x_mm", session.truth.x_mm},
            {"mount_y_mm", session.truth.y_mm},
            {"mount_yaw_deg", session.truth.yaw_rad / degree},
            {"targets", truth}}},
          {"beam", {{"long_mrad", 0}, {"short_mrad", 0}, {"aperture_mm", 0}}},
          {"receiver",
           {{"threshold", 0.2 * span.low},
            {"noise", 0},
            {"overlap_mm", 80},
            {"counts_exponent", session.radiometer.exponent},
            {"counts_noise", session.claims_intensity ? session.counts_noise : 0.0}}},
          {"counter", {{"jitter_ns", session.sigma_mm / light_mm_per_ns}}},
          {"rotor", {{"rolling", false}}},
          {"heat", {{"rise_fast_k", 0}, {"rise_slow_k", 0}, {"slow_s", 1}}}};
}

// ---- recording
// -----------------------------------------------------------------------------------------------

/// Where the stage is: it arrives at every capture half a second after leaving the one before.
class Motion {
 public:
  explicit Motion(const Session& session)
      : session_(session), early_s_(session.scene == "settle" ? 0 : 0.1) {}
  [[nodiscard]] sim::StageMoment at(double time) const {
    std::size_t i = 0;
    while (i + 1 < session_.captures.size() && time >= leaves_before(session_.captures[i + 1])) ++i;
    const Capture& capture = session_.captures[i];
    const double rate_there = capture.rate_deg_s * degree;
    // Before the first scan the stage has arrived, or come up to the speed at which it turns through the
    // capture.
    const double begins = capture.since_power_on_s - early_s_,
                 target = capture.stage_deg * degree - rate_there * early_s_;
    if (time >= begins) return {target + rate_there * (time - begins), rate_there};
    double from = target - degree;
    if (i > 0) {
      const Capture& before = session_.captures[i - 1];
      from = (before.stage_deg + before.rate_deg_s * (leaves_before(capture) - before.since_power_on_s)) *
             degree;
    }
    const double leaves = leaves_before(capture);
    if (time < leaves) return {from, 0};
    const double rate = (target - from) / (begins - leaves);
    return {from + rate * (time - leaves), rate};
  }

 private:
  static constexpr double move_s = 0.5;
  static double leaves_before(const Capture& capture) { return capture.since_power_on_s - move_s; }
  const Session& session_;
  double early_s_;  ///< Where it is seen to settle, the first scan begins as it stops.
};

/// Runs the engine through the session.
class Bench {
 public:
  Bench(const Session& session, const json& world, std::uint64_t seed)
      : session_(session),
        window_(window_of(session)),
        motion_(session),
        engine_(sim::make_causal_engine(sim::parse_world(world.dump()), seed, &exact_, &counts_)),
        range_(static_cast<std::size_t>(window_.last - window_.first + 1)),
        intensity_(range_.size()) {
    stage_at_ = [this](double time) { return motion_.at(time); };
  }

  /// Captures in order, and scans within them.
  void scan(std::size_t index, int seq) {
    const Capture& capture = session_.captures[index];
    if (static_cast<int>(index) != placed_) {
      place(capture);
      placed_ = static_cast<int>(index);
    }
    engine_->scan(capture.since_power_on_s + capture.first_scan_s + seq / session_.scan_hz, stage_at_, range_,
                  intensity_);
  }
  [[nodiscard]] std::size_t index(int step) const { return static_cast<std::size_t>(step - window_.first); }
  [[nodiscard]] double exact_mm(int step) const { return exact_[index(step)]; }
  [[nodiscard]] double exact_counts(int step) const { return counts_[index(step)]; }
  [[nodiscard]] std::uint32_t range(int step) const { return range_[index(step)]; }
  [[nodiscard]] std::uint32_t intensity(int step) const { return intensity_[index(step)]; }

 private:
  void place(const Capture& capture) {
    sim::SceneState state;
    state.temperature_c = capture.temperature_c;
    if (shifted_ >= 0) {  // back to its place
      state.target = session_.walls[static_cast<std::size_t>(shifted_)].name;
      engine_->set_scene(state);
    }
    if (capture.target >= 0) {
      state.target = session_.walls[static_cast<std::size_t>(capture.target)].name;
      state.target_shift_mm = capture.shift_mm;
      state.reflectance = capture.reflectance;
    }
    engine_->set_scene(state);
    shifted_ = capture.target;
  }

  const Session& session_;
  Window window_;
  Motion motion_;
  std::vector<double> exact_, counts_;
  std::unique_ptr<sim::Engine> engine_;
  std::function<sim::StageMoment(double)> stage_at_;
  std::vector<std::uint32_t> range_, intensity_;
  int placed_ = -1, shifted_ = -1;
};

/// Ranges of every beam (or logarithms of its counts) without noise: one row a capture, or a scan.
class Table {
 public:
  Table() = default;
  Table(const Session& session, json world, bool each_scan, bool of_counts = false) : each_scan_(each_scan) {
    world["counter"]["jitter_ns"] = 0;
    world["receiver"]["noise"] = 0;
    world["receiver"]["counts_noise"] = 0;
    if (world.contains("air")) world["air"]["dust_per_m"] = 0;
    if (world.contains("light")) world.erase("light");
    world["rotor"]["index_jitter_deg"] = 0;
    Bench bench(session, world, 1);
    for (std::size_t c = 0; c < session.captures.size(); ++c) {
      const Capture& capture = session.captures[c];
      auto& rows = rows_.emplace_back();
      for (int seq = 0; seq < (each_scan ? capture.scans : 1); ++seq) {
        bench.scan(c, seq);
        auto& row = rows.emplace_back();
        for (int step = capture.first_step; step <= capture.last_step; ++step)
          row.push_back(
              static_cast<float>(of_counts ? std::log(bench.exact_counts(step)) : bench.exact_mm(step)));
      }
    }
  }
  [[nodiscard]] double at(const Moment& m) const {
    const auto& rows = rows_[m.capture_index];
    const auto& row = rows[each_scan_ ? static_cast<std::size_t>(m.seq) : 0];
    return static_cast<double>(row[static_cast<std::size_t>(m.step - m.capture->first_step)]);
  }

 private:
  bool each_scan_ = false;
  std::vector<std::vector<std::vector<float>>> rows_;
};

// ---- causes
// --------------------------------------------------------------------------------------------------

/// What is drawn once for a cause.
struct Shape {
  double a = 0, b = 0, c = 0, d = 0;  ///< Uniform, 0 to 1.
  double sign = 1;
  PowerSpan power;
  std::size_t wall = 0;
};

/// One kind of concealed physics: the keys of a world file that make it, by its strength.
struct Kind {
  std::string id;
  std::vector<std::string> scenes;
  std::function<json(const Session&, const Shape&, double strength)> keys;
  std::function<json(const Session&, const Shape&, double strength)> parameters;  ///< As fit/ names them.
  double largest = 1e6;
  bool sized = true;
  bool each_scan = false;
  bool shifts = true;  ///< Shows in means, which the engine tells.
  bool closed_wall = true;
};

double phase_deg(double x) { return 360 * x - 180; }
double log_between(double x, double low, double high) { return low * std::pow(high / low, x); }
const std::string& name_of(const Session& session, const Shape& shape) {
  return session.walls[shape.wall].name;
}
json of_target(const Session& session, const Shape& shape, const char* key, double value) {
  return {{"truth", {{"targets", {{name_of(session, shape), {{key, value}}}}}}}};
}
json nothing_known(const Session&, const Shape&, double) { return json::object(); }

const std::vector<Kind>& kinds() {
  using S = const Session&;
  using D = const Shape&;
  static const std::vector<Kind> all{
      {"zero-offset",
       {"room", "ladder", "boards"},
       [](S, D d, double s) {
         return json{{"housing", {{"delay_ns", d.sign * 0.05 * s}}}};
       },
       [](S, D d, double s) {
         return json{{"offset_mm", d.sign * 0.05 * s * light_mm_per_ns}};
       }},
      {"range-scale",
       {"ladder", "room", "boards"},
       [](S, D d, double s) {
         return json{{"counter", {{"ppm", d.sign * 1000 * s}}}};
       },
       [](S, D d, double s) {
         return json{{"scale", d.sign * 1e-3 * s}};
       },
       100},
      {"range-walk",
       {"ladder", "reflectance-ladder", "boards"},
       [](S, D d, double s) {
         return json{{"receiver", {{"compensation", 1 - 0.03 * s}}},
                     {"pulse", {{"rise_ns", 1.5 + 1.5 * d.a}}}};
       },
       nothing_known,
       33},
      {"saturation",
       {"reflectance-ladder", "ladder"},
       [](S, D d, double s) {
         const double clip = std::max(1.5 * d.power.low, d.power.high * (0.15 + 0.2 * d.a));
         return json{{"receiver", {{"clip", clip}}}, {"pulse", {{"rise_ns", 0.2 * s}}}};
       },
       nothing_known,
       40},
      {"cyclic-error",
       {"ladder", "room"},
       [](S, D d, double s) {
         const double period = log_between(d.a, 350, 2500);
         return json{{"counter",
                      {{"leak", std::min(1.0, 0.004 * s * d.power.low)},
                       {"leak_mhz", 1e3 * light_mm_per_ns / period},
                       {"leak_phase_deg", phase_deg(d.b)}}}};
       },
       [](S, D d, double) {
         return json{{"period_mm", log_between(d.a, 350, 2500)}};
       },
       25},
      {"near-field",
       {"ladder", "box"},
       [](S, D d, double s) {
         return json{
             {"housing", {{"flash", d.sign * 0.04 * s * d.power.low}, {"flash_decay_ns", 1.2 + 2 * d.a}}}};
       },
       [](S, D d, double) {
         return json{{"reach_mm", (1.2 + 2 * d.a) * light_mm_per_ns}};
       },
       40},
      {"window-reflection",
       {"box"},
       [](S, D d, double s) {
         return json{{"housing",
                      {{"glint", d.sign * 0.04 * s * d.power.low},
                       {"flash_decay_ns", 1.2 + 2 * d.a},
                       {"glint_centre_deg", -90 + 180 * d.b},
                       {"glint_width_deg", 12 + 20 * d.c}}}};
       },
       [](S, D d, double) {
         return json{{"centre_deg", -90 + 180 * d.b}};
       },
       40},
      {"incidence-bias",
       {"room"},
       [](S, D, double s) {
         const double width = 4 * std::sqrt(s);
         return json{{"beam", {{"long_mrad", width}, {"short_mrad", width}}},
                     {"pulse", {{"rise_ns", 0.4}}},
                     {"receiver", {{"timing", "fraction"}, {"fraction", 0.5}}}};
       },
       nothing_known,
       60},
      {"subsurface",
       {"room", "boards"},
       [](S x, D d, double s) { return of_target(x, d, "depth_mm", 5 * s); },
       [](S x, D d, double s) {
         return json{{"target", name_of(x, d)}, {"depth_mm", 5 * s}};
       },
       60},
      {"warm-up",
       {"warmup", "heat-cycle"},
       [](S, D d, double s) {
         return json{{"heat",
                      {{"delay_ps_per_k", d.sign * 3.3 * s},
                       {"rise_fast_k", 3 * d.a},
                       {"rise_slow_k", 10 - 3 * d.a},
                       {"fast_s", 60 + 120 * d.b},
                       {"slow_s", 400 + 700 * d.c}}}};
       },
       [](S, D d, double s) {
         return json{{"amplitude_mm", d.sign * 33e-3 * s * light_mm_per_ns}};
       }},
      {"temperature",
       {"heat-cycle", "warmup"},
       [](S x, D d, double s) {
         return json{
             {"heat", {{"delay_ps_per_k", d.sign * 3.3 * s}, {"reference_c", x.captures[0].temperature_c}}}};
       },
       [](S, D d, double s) {
         return json{{"slope_mm_per_k", d.sign * 3.3e-3 * s * light_mm_per_ns}};
       }},
      {"multipath",
       {"room"},
       [](S x, D, double s) {
         json targets = json::object();
         for (const Wall& wall : x.walls)
           targets[wall.name] = {{"gloss", std::min(0.95, 0.2 * std::sqrt(s))}};
         return json{{"truth", {{"targets", targets}}}};
       },
       nothing_known,
       22},
      {"crosstalk",
       {"panels"},
       [](S, D d, double s) {
         return json{
             {"receiver", {{"stray", std::min(1.0, 0.004 * s)}, {"stray_width_deg", 0.5 + 0.7 * d.a}}}};
       },
       nothing_known,
       250},
      {"air-index",
       {"ladder"},
       [](S, D, double s) {
         return json{{"air", {{"index_error", 2.7e-4 * s}}}};
       },
       [](S, D, double s) {
         return json{{"index_error", 2.7e-4 * s}};
       },
       300},
      {"encoder-eccentricity",
       {"room", "boards", "settle"},
       [](S, D d, double s) {
         return json{{"rotor", {{"disk_offset", 1e-3 * s}, {"disk_phase_deg", phase_deg(d.a)}}}};
       },
       [](S, D d, double s) {
         return json{{"amplitude_deg", 1e-3 * s / degree}, {"phase_deg", phase_deg(d.a)}};
       },
       200},
      {"encoder-second-harmonic",
       {"room", "boards"},
       [](S, D d, double s) {
         return json{{"rotor",
                      {{"disk_lean_deg", 2 * std::atan(std::sqrt(5e-4 * s)) / degree},
                       {"disk_lean_phase_deg", phase_deg(d.a)}}}};
       },
       [](S, D d, double s) {
         return json{{"amplitude_deg", 5e-4 * s / degree},
                     {"phase_deg", std::remainder(2 * phase_deg(d.a), 360)}};
       },
       100},
      {"angle-scale",
       {"room", "boards"},
       [](S, D d, double s) {
         return json{{"rotor", {{"speed_error", d.sign * 5e-4 * s}}}};
       },
       [](S, D d, double s) {
         return json{{"scale", d.sign * 5e-4 * s}};
       },
       200},
      {"index-offset",
       {"room"},
       [](S x, D d, double s) {
         return json{{"truth", {{"mount_yaw_deg", x.truth.yaw_rad / degree + d.sign * 0.5 * s}}}};
       },
       [](S, D d, double s) {
         return json{{"offset_deg", d.sign * 0.5 * s}};
       }},
      {"angle-jitter",
       {"room", "boards"},
       [](S, D, double s) {
         return json{{"rotor", {{"index_jitter_deg", 0.05 * s}}}};
       },
       [](S, D, double s) {
         return json{{"sigma_deg", 0.05 * s}};
       },
       80,
       true,
       false,
       false},
      {"lidar-arm",
       {"room", "boards"},
       [](S x, D d, double s) {
         const double to = phase_deg(d.a) * degree;
         return json{{"truth",
                      {{"mount_x_mm", x.truth.x_mm + 5 * s * std::cos(to)},
                       {"mount_y_mm", x.truth.y_mm + 5 * s * std::sin(to)}}}};
       },
       nothing_known,
       40},
      {"scan-plane-tilt",
       {"room"},
       [](S, D d, double s) {
         return json{{"rotor", {{"plane_tilt_deg", std::sqrt(s)}, {"plane_axis_deg", phase_deg(d.a) / 2}}}};
       },
       [](S, D, double s) {
         return json{{"tilt_squared_deg2", s}};
       },
       400},
      {"facet-wobble",
       {"room", "warmup"},
       [](S, D d, double s) {
         const int faces = 2 + static_cast<int>(3.99 * d.a);
         json list = json::array();
         double sum = 0;
         for (int i = 0; i < faces; ++i) {
           const double x = i + 1 < faces ? 3 * s * std::cos(i * (2 + d.b) + 6 * d.c) : -sum;
           sum += x;
           list.push_back({{"range_mm", x}});
         }
         return json{{"rotor", {{"facets", list}}}};
       },
       [](S, D d, double) {
         return json{{"facets", 2 + static_cast<int>(3.99 * d.a)}};
       },
       1e3,
       true,
       true},
      {"stage-periodic",
       {"two-sided", "room"},
       [](S, D d, double s) {
         static constexpr int teeth[] = {120, 144, 180};
         return json{{"stage",
                      {{"worm_deg", 0.01 * s},
                       {"worm_teeth", teeth[static_cast<int>(2.99 * d.a)]},
                       {"worm_phase_deg", phase_deg(d.b)},
                       {"worm_second", 0.15 * d.c}}}};
       },
       [](S, D d, double s) {
         static constexpr double period[] = {3, 2.5, 2};
         return json{{"amplitude_deg", 0.01 * s}, {"period_deg", period[static_cast<int>(2.99 * d.a)]}};
       },
       400},
      {"stage-scale",
       {"room", "boards"},
       [](S, D d, double s) {
         return json{{"stage", {{"scale", d.sign * 1e-3 * s}}}};
       },
       [](S, D d, double s) {
         return json{{"scale", d.sign * 1e-3 * s}};
       },
       90},
      {"stage-eccentricity",
       {"room"},
       [](S, D d, double s) {
         return json{{"stage", {{"runout_mm", 0.3 * s}, {"runout_phase_deg", phase_deg(d.a)}}}};
       },
       [](S, D, double s) {
         return json{{"amplitude_mm", 0.3 * s}};
       }},
      {"backlash",
       {"room", "two-sided", "boards"},
       [](S, D, double s) {
         return json{{"stage", {{"play_deg", 0.05 * s}}}};
       },
       [](S, D, double s) {
         return json{{"width_deg", 0.05 * s}};
       },
       150},
      {"settling",
       {"settle"},
       [](S, D d, double s) {
         // The mirror sweeps while the table rings.
         return json{{"rotor", {{"rolling", true}}},
                     {"stage",
                      {{"ring_deg", 0.03 * s}, {"ring_hz", 3 + 7 * d.a}, {"ring_decay_s", 0.1 + 0.4 * d.b}}}};
       },
       [](S, D d, double s) {
         return json{{"amplitude_deg", 0.03 * s}, {"frequency_hz", 3 + 7 * d.a}, {"tau_s", 0.1 + 0.4 * d.b}};
       },
       200,
       true,
       true},
      {"motion-skew",
       {"turning"},
       [](S, D, double) {
         return json{{"rotor", {{"rolling", true}}}};
       },
       [](S, D, double) {
         return json{{"share", 1}};
       },
       3,
       true,
       true},
      {"time-offset",
       {"turning"},
       [](S, D d, double s) {
         return json{{"stage", {{"late_ms", d.sign * 10 * s}}}};
       },
       [](S, D d, double s) {
         return json{{"offset_ms", -d.sign * 10 * s}};
       },
       1e3,
       true,
       true},
      {"target-offset",
       {"room", "boards"},
       [](S x, D d, double s) {
         return of_target(x, d, "offset_mm", x.truth.offset_mm[d.wall] + d.sign * 5 * s);
       },
       [](S x, D d, double s) {
         return json{{"target", name_of(x, d)}, {"offset_mm", d.sign * 5 * s}};
       },
       12},
      {"target-tilt",
       {"room", "boards"},
       [](S x, D d, double s) {
         return of_target(x, d, "tilt_deg", x.truth.tilt_rad[d.wall] / degree + d.sign * 0.3 * s);
       },
       [](S x, D d, double s) {
         return json{{"target", name_of(x, d)}, {"tilt_deg", d.sign * 0.3 * s}};
       },
       4},
      {"target-curvature",
       {"room", "boards"},
       [](S x, D d, double s) { return of_target(x, d, "sagitta_mm", d.sign * 3 * s); },
       [](S x, D d, double s) {
         return json{{"target", name_of(x, d)}, {"sagitta_mm", d.sign * 3 * s}};
       },
       20},
      {"mixed-pixel",
       {"edge"},
       [](S, D d, double) {
         return json{{"beam", {{"long_mrad", 8 + 8 * d.a}, {"short_mrad", 2.5}}},
                     {"receiver", {{"echo", "strongest"}}}};
       },
       [](S, D d, double) {
         return json{{"width_deg", (8 + 8 * d.a) / 4e3 / degree}};
       },
       1,
       false},
      {"range-noise",
       {"room", "ladder"},
       [](S x, D, double s) {
         return json{
             {"counter", {{"jitter_ns", std::sqrt(x.sigma_mm * x.sigma_mm + 4 * s) / light_mm_per_ns}}}};
       },
       [](S, D, double s) {
         return json{{"extra_sigma_mm", 2 * std::sqrt(s)}};
       },
       1e4,
       true,
       false,
       false},
      {"intensity-noise",
       {"ladder", "room", "reflectance-ladder"},
       [](S, D d, double s) {
         return json{{"receiver",
                      {{"noise", std::min(0.5, 0.02 * std::sqrt(s) * d.power.low)}, {"timing", "fraction"}}}};
       },
       nothing_known,
       400,
       true,
       false,
       false},
      {"sunlight",
       {"warmup", "room"},
       [](S x, D d, double s) {
         const bool narrow = x.scene == "warmup";
         return json{{"light",
                      {{"suns",
                        {{{"centre_deg", (narrow ? 50 : 110) * (2 * d.a - 1)},
                          {"width_deg", 8 + 15 * d.b},
                          {"noise", std::min(0.5, 0.01 * std::sqrt(s) * d.power.low)}}}}}}};
       },
       [](S x, D d, double) {
         const bool narrow = x.scene == "warmup";
         return json{{"centre_deg", (narrow ? 50 : 110) * (2 * d.a - 1)}};
       },
       400,
       true,
       false,
       false},
      {"correlated-noise",
       {"ladder", "warmup", "room"},
       [](S, D, double s) {
         return json{{"counter", {{"jitter_memory", std::min(0.98, 0.1 * s)}}}};
       },
       [](S, D, double s) {
         return json{{"rho", std::min(0.98, 0.1 * s)}};
       },
       9.8,
       true,
       false,
       false},
      {"rounding",
       {"room", "ladder"},
       [](S, D d, double) {
         return json{{"firmware", {{"step_mm", 4 + std::floor(8 * d.a)}}}};
       },
       [](S, D d, double) {
         return json{{"step_mm", 4 + std::floor(8 * d.a)}};
       },
       1,
       false,
       false,
       false},
      {"outliers",
       {"room", "ladder"},
       [](S, D, double s) {
         return json{{"air", {{"dust_per_m", std::min(0.2, 0.002 * s)}}}};
       },
       nothing_known,
       100,
       true,
       false,
       false},
      {"dropout",
       {"ladder", "room"},
       [](S, D d, double s) {
         // Counted in the noise's standard deviations from where hardly any echo is lost, so that losses grow
         // smoothly.
         const double noise = 0.004 * d.power.low;
         return json{{"receiver", {{"threshold", d.power.low + (s - 5) * noise}, {"noise", noise}}}};
       },
       nothing_known,
       30},
      {"radiometry",
       {"ladder", "boards", "room", "reflectance-ladder"},
       [](S x, D d, double s) {
         if (d.a < 0.4) return json{{"receiver", {{"overlap_mm", 80 * (1 + 0.5 * s)}}}};
         return json{{"receiver", {{"counts_exponent", x.radiometer.exponent * (1 + d.sign * 0.02 * s)}}}};
       },
       [](S x, D d, double s) {
         if (d.a < 0.4) return json{{"overlap_mm", 80 * (1 + 0.5 * s)}};
         const double now = x.radiometer.exponent * (1 + d.sign * 0.02 * s);
         return json{{"range_power", 2 * now}, {"incidence_power", now}, {"reflectance_power", now}};
       },
       25},
      {"window-dirt",
       {"room", "boards"},
       [](S x, D d, double s) {
         const bool narrow = x.scene == "warmup";
         return json{{"housing",
                      {{"dirt",
                        {{{"centre_deg", (narrow ? 45 : 110) * (2 * d.a - 1)},
                          {"width_deg", 3 + 12 * d.b},
                          {"loss", 1 - std::exp(-0.01 * s)}}}}}}};
       },
       [](S x, D d, double) {
         return json{{"centre_deg", (x.scene == "warmup" ? 45 : 110) * (2 * d.a - 1)},
                     {"width_deg", (3 + 12 * d.b) / std::sqrt(2.0)}};
       },
       120},
      {"specular",
       {"room", "boards"},
       [](S x, D d, double s) {
         json one = of_target(x, d, "specular", 0.1 * s);
         one["truth"]["targets"][name_of(x, d)]["specular_width_deg"] = 2 + 8 * d.b;
         return one;
       },
       [](S x, D d, double) {
         return json{{"target", name_of(x, d)}};
       },
       500},
      {"unknown-stripe",
       {"room", "boards"},
       [](S x, D d, double s) {
         const double along = 400 * (2 * d.a - 1);
         const double grey = x.walls[d.wall].reflectance * std::exp(-0.02 * s);
         json stripe{{"from_mm", along - 120}, {"to_mm", along + 120}, {"reflectance", grey}};
         json world;
         world["truth"]["targets"][name_of(x, d)]["stripes"] = json::array({stripe});
         return world;
       },
       nothing_known,
       100},
      {"unknown-ripple",
       {"room", "settle"},
       [](S, D d, double s) {
         return json{
             {"rotor", {{"ripple_deg", 0.05 * s}, {"ripple_order", 4 + static_cast<int>(4.99 * d.a)}}}};
       },
       nothing_known,
       90},
      {"unknown-angle-step",
       {"room"},
       [](S, D d, double s) {
         return json{{"rotor", {{"lost_slit_deg", 0.1 * s}, {"lost_slit_at_deg", -80 + 160 * d.a}}}};
       },
       nothing_known,
       40},
      {"unknown-sawtooth",
       {"room"},
       [](S, D d, double s) {
         return json{{"rotor", {{"interpolation_deg", 0.05 * s}, {"slits", 9 + static_cast<int>(16 * d.a)}}}};
       },
       nothing_known,
       90}};
  return all;
}

bool is_unknown(const std::string& id) { return id.starts_with("unknown-"); }

/// Kinds that show in the intensity, and where.
const std::map<std::string, std::string>& lights() {
  static const std::map<std::string, std::string> table{{"radiometry", "range_mm"},
                                                        {"window-dirt", "beam_deg"},
                                                        {"specular", "incidence_deg"},
                                                        {"unknown-stripe", "target"}};
  return table;
}

/// A kind at work in the engine; its effect on the session is measured whenever its strength changes.
class WorldCause : public Cause {
 public:
  explicit WorldCause(const Kind& kind) : kind_(kind) {
    id = kind.id;
    if (lights().contains(id)) {
      coordinate = lights().at(id);
      observable = "intensity";
      return;
    }
    coordinate = is_unknown(id) ? "beam_deg" : make_cause(id)->coordinate;
    observable = is_unknown(id) ? "range-mean" : make_cause(id)->observable;
  }

  void draw(Session& session, Random& random) override {
    for (double* x : {&shape_.a, &shape_.b, &shape_.c, &shape_.d}) *x = random.uniform(0, 1);
    shape_.sign = random.sign();
    shape_.power = power_span(session);
    shape_.wall = static_cast<std::size_t>(random.integer(0, static_cast<int>(session.walls.size()) - 1));
    // Gloss shows on targets that are seen square on from somewhere.
    for (std::size_t i = 0;
         id == "specular" && i < session.walls.size() && !faces(session.walls[shape_.wall]); ++i)
      shape_.wall = (shape_.wall + 1) % session.walls.size();
    for (const Capture& capture : session.captures) rates_.push_back(capture.rate_deg_s);
    plain_ = Table(session, plain_world(session), kind_.each_scan);
    if (shows_in_intensity()) plain_light_ = Table(session, plain_world(session), false, true);
  }

  void build(Session& session) override {
    session_ = &session;
    counted_.reset();
    if (id == "motion-skew") {  // its strength is how fast the stage turns
      for (std::size_t i = 0; i < rates_.size(); ++i) session.captures[i].rate_deg_s = rates_[i] * strength;
      plain_ = Table(session, plain_world(session), true);
    }
    const json world = add_to(plain_world(session));
    if (kind_.shifts) with_ = Table(session, world, kind_.each_scan);
    if (shows_in_intensity()) light_ = Table(session, world, false, true);
    if (id == "intensity-noise" || id == "sunlight") probe(session, world);
  }

  bool shows_in_intensity() const override { return lights().contains(id); }
  double log_intensity(const Moment& moment) const override {
    return shows_in_intensity() ? light_.at(moment) - plain_light_.at(moment) : 0;
  }

  std::optional<double> counts(const Moment& moment) const override {
    if (!counted_) counted_ = Table(*session_, add_to(plain_world(*session_)), false, true);
    return std::exp(counted_->at(moment));
  }

  [[nodiscard]] json keys() const { return kind_.keys(*session_, shape_, strength); }
  [[nodiscard]] json add_to(json world) const {
    world.merge_patch(keys());
    return world;
  }

  bool has_size() const override { return kind_.sized; }
  double largest_strength() const override { return kind_.largest; }
  bool differs_within_capture() const override { return kind_.each_scan; }
  json parameters() const override { return kind_.parameters(*session_, shape_, strength); }

  double range(const Moment& moment, const Sight&, const World&) const override {
    if (!kind_.shifts || id == "mixed-pixel") return 0;
    const double shift = with_.at(moment) - plain_.at(moment);
    return std::isfinite(shift) && std::abs(shift) < 500 ? shift : 0;
  }
  double lost(const Moment& moment, const Sight& sight) const override {
    // At the end of a board a bent beam may miss it: that is no dropout.
    if (id != "dropout" || std::isnan(plain_.at(moment))) return 0;
    const json receiver = keys()["receiver"];
    const double above = sight.power - receiver["threshold"].get<double>();
    return std::erfc(above / receiver["noise"].get<double>() / std::sqrt(2.0)) / 2;
  }
  double variance(const Moment& moment, const Sight& sight, const World&) const override {
    if (id == "range-noise") return 4 * strength;
    if (id != "intensity-noise" && id != "sunlight") return 0;
    const double slope = (steeper_.at(moment) - plain_.at(moment)) / probe_;
    if (!std::isfinite(slope)) return 0;
    double noise = 0;
    if (id == "intensity-noise") {
      // The comparator works at half of the peak there, so the slope is that of the middle of the flank.
      noise = 0.02 * std::sqrt(strength) * shape_.power.low;
      const double middle = 2 / (0.5 * std::sqrt(2 * std::log(2.0)) * sight.power) * light_mm_per_ns;
      return middle * middle * noise * noise;
    }
    const json sun = keys()["light"]["suns"][0];
    const double x =
        (moment.alpha / degree - sun["centre_deg"].get<double>()) / sun["width_deg"].get<double>();
    noise = sun["noise"].get<double>() * std::exp(-x * x);
    return slope * slope * noise * noise;
  }
  double stray(const Moment&, const Sight& sight) const override {
    if (id != "outliers") return 0;
    return 1 - std::exp(-std::min(0.2, 0.002 * strength) * sight.range_mm / 1000);
  }
  double scan_angle_sigma() const override { return id == "angle-jitter" ? 0.05 * strength * degree : 0; }
  double footprint() const override { return id == "mixed-pixel" ? (8 + 8 * shape_.a) * 1e-3 : 0; }
  bool merges(double gap_mm) const override { return gap_mm < 600; }
  double output_step_mm() const override { return id == "rounding" ? 4 + std::floor(8 * shape_.a) : 1; }
  std::vector<std::pair<double, double>> memory() const override {
    if (id != "correlated-noise") return {};
    return {{1.0, std::min(0.98, 0.1 * strength)}};
  }

 private:
  /// The perpendicular from the axis meets it.
  static bool faces(const Wall& wall) {
    const Vector along = (wall.to - wall.from).normalized();
    const double foot = -along.dot(wall.from);
    return foot > 100 && foot < (wall.to - wall.from).norm() - 100;
  }

  /// How far noise at the comparator moves the range: by a slightly higher threshold, without compensation.
  void probe(const Session& session, const json&) {
    json low = plain_world(session), high = low;
    low["receiver"]["compensation"] = high["receiver"]["compensation"] = 0;
    const double threshold = low["receiver"]["threshold"];
    probe_ = 1e-3 * threshold;
    // A trick against the changing reference of the firmware: the threshold is lifted by a constant flash.
    high["housing"] = {{"flash", -probe_}, {"flash_decay_ns", 1e9}};
    plain_ = Table(session, low, false);
    steeper_ = Table(session, high, false);
  }

  const Kind& kind_;
  Shape shape_;
  const Session* session_ = nullptr;
  std::vector<double> rates_;
  Table plain_, with_, steeper_, plain_light_, light_;
  mutable std::optional<Table> counted_;  ///< Logarithms of counts with the cause, once they are asked for.
  double probe_ = 1;
};

json world_of(const Session& session, const Causes& causes) {
  json world = plain_world(session);
  std::map<std::string, std::string> owner;
  for (const auto& cause : causes) {
    const json flat = dynamic_cast<const WorldCause&>(*cause).keys().flatten();
    for (const auto& [key, value] : flat.items()) {
      const auto [place, fresh] = owner.emplace(key, cause->id);
      if (!fresh)
        throw std::runtime_error(cause->id + " and " + place->second + " both set " + key.substr(1));
    }
    world = dynamic_cast<const WorldCause&>(*cause).add_to(world);
  }
  return world;
}

class WorldRecorder : public Recorder {
 public:
  WorldRecorder(const Session& session, const Causes& causes)
      : session_(session), world_(world_of(session, causes)) {}

  void scan(std::size_t index, int seq, Random& random, std::vector<std::uint16_t>& range,
            std::vector<std::uint16_t>& intensity) override {
    if (!bench_)
      bench_ =
          std::make_unique<Bench>(session_, world_, static_cast<std::uint64_t>(random.integer(1, 1 << 30)));
    bench_->scan(index, seq);
    const Capture& capture = session_.captures[index];
    range.clear();
    intensity.clear();
    for (int step = capture.first_step; step <= capture.last_step; ++step) {
      const std::uint32_t value = bench_->range(step);
      range.push_back(value <= 4 || value >= 65000 ? std::uint16_t{0} : static_cast<std::uint16_t>(value));
      intensity.push_back(static_cast<std::uint16_t>(std::min(65535U, bench_->intensity(step))));
    }
  }

 private:
  const Session& session_;
  json world_;
  std::unique_ptr<Bench> bench_;
};

}  // namespace

std::shared_ptr<Cause> make_concealed(const std::string& id) {
  const auto found = std::ranges::find(kinds(), id, &Kind::id);
  if (found == kinds().end()) throw std::invalid_argument("unknown kind '" + id + "'; --list shows them");
  return std::make_shared<WorldCause>(*found);
}

const std::vector<std::pair<std::string, std::vector<std::string>>>& concealed_scenes() {
  static const auto list = [] {
    std::vector<std::pair<std::string, std::vector<std::string>>> names;
    for (const Kind& kind : kinds()) names.emplace_back(kind.id, kind.scenes);
    return names;
  }();
  return list;
}

/// The stage comes to the first capture from below.
void prepare(Session& session) {
  if (!session.captures.empty() && session.captures[0].approach == 0) session.captures[0].approach = 1;
}

/// The device's own law (docs/world.md), within what an operator knows of it.
void draw_claim(Session& session, Random& random) {
  session.claimed_gain = 900 * (1 + session.u_gain * random.normal());
  session.claimed_power = session.radiometer.exponent + session.u_power * random.normal();
  session.claimed_full = 2800;
  session.claimed_overlap_mm = 80;
  session.counts_noise = random.uniform(0.01, 0.05);
}

std::unique_ptr<Recorder> make_recorder(const Session& session, const Causes& causes) {
  return std::make_unique<WorldRecorder>(session, causes);
}

std::string world_file(const Session& session, const Causes& causes) {
  json world = world_of(session, causes);
  // Who serves it has the whole lidar that the session's bench describes, not only the steps that were used.
  world["bench"]["lidar"]["steps"] = session.steps;
  world["bench"]["lidar"]["front_step"] = session.front_step;
  return world.dump(1);
}

}  // namespace challenge
