// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <map>
#include <string>

#include "fit/explain/model/hypothesis.hpp"
#include "plain_bench.hpp"
#include "synthetic_recording.hpp"

namespace mechanism_test {
namespace {

using plain_bench::degree;
using plain_bench::Point;

/// One beam of one scan, in the symbols of docs/method/mechanisms.md.
struct Beam {
  double r = 1500, I = 800, i = 0;  ///< True range, intensity, incidence.
  double a = 0, th = 0;             ///< Beam and stage angle.
  double t = 0, T = 0;              ///< Since power-on, s; temperature less that of the first capture, K.
  double since_move = 0, s = 0;     ///< Time, s: since the last move, and within the scan.
  double rate = 0;                  ///< Of the stage, rad/s.
  int approach = 0, seq = 0;
  double along = 0, half = 1000;  ///< Place on the target from its middle; half its length.
  int along_grows = 1;            ///< With the beam angle (1) or against it (-1).
  bool round = false;             ///< The target is a post.
  double corner = 1e9;            ///< To the inner corner.
  /// What lies aside, with halos midway between two: ranges less the own by their light, those that come
  /// apart, and the squares over 150 mm of those that do not.
  double pull = 0, apart = 0, front = 0;
  double spread = 0;  ///< Mean range of a beam of 0.2 deg by its light, less the own.

  [[nodiscard]] fit::Circumstances circumstances() const {
    fit::Circumstances c;
    c.range_mm = r;
    c.intensity = I;
    c.incidence_rad = i;
    c.cos_incidence = std::cos(i);
    c.beam_rad = a;
    c.stage_rad = th;
    c.clock_s = c.time_s = t;
    c.temperature_k = T;
    c.since_move_s = since_move;
    c.beam_time_s = s;
    c.stage_rate_rad_s = rate;
    c.approach = approach;
    c.seq = seq;
    c.along_mm = along;
    c.half_length_mm = half;
    c.along_sign = along_grows;
    c.round = round;
    c.corner_mm = corner;
    c.pull_mm = {pull / 2, pull * 2 / 3, pull * 4 / 3};
    c.pull_apart_mm = {apart / 2, apart * 2 / 3, apart * 4 / 3};
    c.pull_front_mm = {front / 2, front * 2 / 3, front * 4 / 3};
    c.spread_mm = {spread / 4, spread, 4 * spread};
    return c;
  }
};

/// An equation of docs/method/mechanisms.md with the values that it is tried with.
struct Equation {
  std::map<std::string, double> values;
  std::function<fit::Effect(const Beam&)> effect;
};

fit::Effect range(double mm) { return {.range_mm = mm}; }
fit::Effect beam(double rad) { return {.beam_rad = rad}; }
fit::Effect stage(double rad) { return {.stage_rad = rad}; }
fit::Effect origin(Point mm) { return {.origin_mm = {mm.real(), mm.imag()}}; }
double bell(double degrees, double width) { return std::exp(-std::pow(degrees / width, 2) / 2); }
const Point at_once{0, 1};

/// By how much farther a wall is met that is turned about its middle, from the crossing of two lines.
double turned(const Beam& x, double by_rad) {
  const Point upward = std::polar(1.0, 90 * degree - x.i);  // along the wall, with growing beam angle
  const Point middle = x.r - static_cast<double>(x.along_grows) * x.along * upward;
  const Point now = upward * std::polar(1.0, by_rad);
  return middle.real() - middle.imag() / now.imag() * now.real() - x.r;
}

/// How far a surface goes away from the viewer: of a post, by the angle at its middle.
double moved(const Beam& x, double out, double aside) {
  return x.round ? (Point(out, aside) * std::polar(1.0, 90 * degree * x.along / x.half)).real() : out;
}

/// A ray of a leaning fan, its climb and its bearing by rotation in space.
fit::Effect leaning(const Beam& x, double tilt, double axis) {
  const double along = std::cos(x.a - axis), across = std::sin(x.a - axis);
  const double level = along * std::cos(tilt);  // of the component that leans
  return {.range_mm = x.r * (1 / std::hypot(level, across) - 1),
          .beam_rad = std::atan2(across, level) - (x.a - axis)};
}

// clang-format off
const std::map<std::string, Equation>& equations() {
  static const std::map<std::string, Equation> list{
      {"zero-offset", {{{"offset_mm", 7}}, [](const Beam&) { return range(7); }}},
      {"range-scale", {{{"scale", 2e-3}}, [](const Beam& x) { return range(2e-3 * x.r); }}},
      {"range-walk", {{{"amplitude_mm", 20}, {"intensity_scale", 400}, {"exponent", 1}, {"power", 0.5}},
                      [](const Beam& x) { return range(200 / std::sqrt(x.I) * std::exp(-x.I / 400)); }}},
      {"saturation", {{{"slope_mm_per_100_counts", 5}, {"threshold_counts", 900}, {"room_counts", 5000}, {"level_counts", 800}},
                      [](const Beam& x) {  // a L = 5 mm / 100 * 800
                        const double above = 60 * std::log(1 + std::exp((x.I - 900) / 60));
                        return range(40 * (std::pow(1 - above / 5000, 5000.0 / 800) - 1));
                      }}},
      {"cyclic-error", {{{"amplitude_mm", 6}, {"phase_deg", 25}, {"period_mm", 700}},
                        [](const Beam& x) { return range(6 * std::sin((360 * x.r / 700 + 25) * degree)); }}},
      {"time-quantisation", {{{"share", 1}, {"bin_mm", 10}, {"zero", 0.3}},
        [](const Beam& x) { return range(10 * std::floor((x.r + 3) / 10 + 0.5) - x.r - 3); }}},
      {"near-field", {{{"amplitude_mm", 15}, {"reach_mm", 300}, {"by_echo", 0.5}},
                      [](const Beam& x) { return range(15 * std::exp(-x.r / 300) * std::sqrt(x.I / 1000)); }}},
      {"window-reflection",
       {{{"amplitude_mm", 30}, {"reach_mm", 500}, {"centre_deg", 20}, {"width_deg", 15}, {"by_echo", -1}},
        [](const Beam& x) {
          return range(30 * std::exp(-x.r / 500) * bell(x.a / degree - 20, 15) * 1000 / x.I);
        }}},
      {"incidence-bias", {{{"amplitude_mm", 4}, {"divergence", 0.3}, {"width_at_side", 0.2}, {"stretch", 0.4},
                          {"trigger", 0.5}},
        [](const Beam& x) {  // pulse 1, spot sqrt(0.4) deep at 45 deg, threshold at exp(-2) of the peak
          const double wide2 = (0.7 + 0.3 * x.r / 2000 * x.r / 2000) *
                               std::norm(Point(std::cos(x.a), 0.2 * std::sin(x.a)));
          const auto front = [](double deep) {  // 1 / length: the peak that light of one pulse reaches
            const double length = std::hypot(1, deep);
            return length * std::sqrt(2 * std::log(std::exp(2) / length));
          };
          const double of_square = 0.75;  // d front / d deep^2 where it is shallow, where front is 2
          return range(4 / 0.4 * (front(std::sqrt(0.4 * wide2) * std::tan(x.i)) - 2) / of_square);
        }}},
      {"subsurface", {{{"depth_mm", 8}, {"at_grazing", 1.2}}, [](const Beam& x) {
          return range(8 * std::exp(std::log(1.2) * std::sin(x.i) * std::sin(x.i)));
        }}},
      {"warm-up", {{{"amplitude_mm", 10}, {"tau_s", 600}},
                   [](const Beam& x) { return range(10 * (1 - std::exp(-x.t / 600))); }}},
      {"temperature", {{{"slope_mm_per_k", 0.7}}, [](const Beam& x) { return range(0.7 * x.T); }}},
      {"multipath", {{{"amplitude_mm", 25}, {"reach_mm", 200}, {"gloss", 0}},
                     [](const Beam& x) { return range(25 * std::exp(-x.corner / 200)); }}},
      {"crosstalk", {{{"leak", 0.02}, {"reach_deg", 0.7 * std::sqrt(2)}, {"timing", -0.5}},  // midway between two halos
                     [](const Beam& x) { return range(0.02 * (x.pull + 2 * x.apart)); }}},
      {"air-index", {{{"index_error", 1e-4}, {"index_error_per_k", 1e-6}},
                     [](const Beam& x) { return range((1e-4 + 1e-6 * x.T) * x.r); }}},

      {"encoder-eccentricity", {{{"amplitude_deg", 0.2}, {"phase_deg", 40}},
        [](const Beam& x) { return beam(0.2 * degree * std::sin(x.a + 40 * degree)); }}},
      {"encoder-second-harmonic", {{{"amplitude_deg", 0.1}, {"phase_deg", 40}},
        [](const Beam& x) { return beam(0.1 * degree * std::sin(2 * x.a + 40 * degree)); }}},
      {"angle-scale", {{{"scale", 2e-3}}, [](const Beam& x) { return beam(2e-3 * x.a); }}},
      {"index-offset", {{{"offset_deg", 0.1}}, [](const Beam&) { return beam(0.1 * degree); }}},
      {"angle-jitter", {{{"sigma_deg", 0.1}, {"own_share", 0.25}},
        [](const Beam&) {
          return fit::Effect{.scan_angle_variance_rad2 = 0.75 * std::pow(0.1 * degree, 2),
                             .beam_angle_variance_rad2 = 0.25 * std::pow(0.1 * degree, 2)};
        }}},
      {"lidar-arm", {{{"x_mm", 12}, {"y_mm", -5}},
        [](const Beam& x) { return origin(Point(12, -5) * std::exp(at_once * x.th)); }}},
      {"scan-plane-tilt", {{{"tilt_squared_deg2", 1}, {"axis_deg", 30}, {"share_of_mount", 1}},
        [](const Beam& x) { return leaning(x, 1 * degree, 30 * degree); }}},
      {"facet-wobble", {{{"amplitude_mm", 3}, {"phase_deg", 20}, {"facets", 3}},
        [](const Beam& x) { return range(3 * std::sin((120 * (x.seq % 3) + 20) * degree)); }}},
      {"stage-periodic", {{{"amplitude_deg", 0.05}, {"phase_deg", 10}, {"period_deg", 72}},
        [](const Beam& x) { return stage(0.05 * degree * std::sin(360 * x.th / 72 + 10 * degree)); }}},
      {"stage-scale", {{{"scale", 2e-3}}, [](const Beam& x) { return stage(2e-3 * x.th); }}},
      {"stage-eccentricity", {{{"amplitude_mm", 2}, {"phase_deg", 40}},
        [](const Beam& x) {
          return origin(2.0 * Point(std::cos(x.th + 40 * degree), std::sin(x.th + 40 * degree)));
        }}},
      {"backlash", {{{"width_deg", 0.1}}, [](const Beam& x) { return stage(-0.05 * degree * x.approach); }}},
      {"settling", {{{"amplitude_deg", 0.06}, {"phase_deg", 0}, {"tau_s", 0.2}, {"frequency_hz", 4}, {"share_of_direction", 1}},
        [](const Beam& x) {  // from the side that the stage came from
          return stage(0.06 * degree * x.approach * std::exp(-x.since_move / 0.2) *
                       std::cos(360 * degree * 4 * x.since_move));
        }}},
      {"motion-skew", {{{"share", 1}}, [](const Beam& x) { return stage(x.rate * x.s); }}},
      {"time-offset", {{{"offset_ms", 15}}, [](const Beam& x) { return stage(x.rate * 0.015); }}},
      {"target-offset", {{{"offset_mm", 5}, {"aside_mm", -3}},
        [](const Beam& x) { return range(moved(x, 5, -3) / std::cos(x.i)); }}},
      {"target-radius", {{{"thicker_mm", 5}}, [](const Beam& x) { return range(-5 / std::cos(x.i)); }}},
      {"target-tilt", {{{"tilt_deg", 0.5}}, [](const Beam& x) { return range(turned(x, 0.5 * degree)); }}},
      {"mount-moved", {{{"x_mm", 2}, {"y_mm", -1}, {"yaw_deg", 0.2}, {"from_s", 50}},
        [](const Beam& x) {
          if (x.t < 50) return fit::Effect{};
          fit::Effect e = origin(Point(2, -1) * std::exp(at_once * x.th));
          e.beam_rad = 0.2 * degree;
          return e;
        }}},
      {"target-moved", {{{"offset_mm", 4}, {"turn_deg", 0.3}, {"aside_mm", 2}, {"from_s", 50}, {"to_s", 5000}},
        [](const Beam& x) {
          const double out = x.round ? moved(x, 4, 2) : 4 - x.along_grows * 0.3 * degree * x.along;
          return range(x.t < 50 || x.t > 5000 ? 0 : out / std::cos(x.i));
        }}},
      {"target-curvature", {{{"sagitta_mm", 3}},
        [](const Beam& x) { return range(3 * (1 - std::pow(x.along / x.half, 2)) / std::cos(x.i)); }}},

      // By all of its light, which is twice as wide as a beam of 0.2 deg: four times as much.
      {"mixed-pixel", {{{"width_deg", 0.4}, {"mixing", 0.25}, {"averaging", 0.5}}, [](const Beam& x) {
          return fit::Effect{
              .range_mm = 0.5 * 4 * x.spread, .footprint_rad = 0.1 * degree, .light_rad = 0.4 * degree};
        }}},
      {"range-noise", {{{"sigma_mm", 4}}, [](const Beam&) { return fit::Effect{.variance_mm2 = 16}; }}},
      {"intensity-noise", {{{"sigma_mm_at_100_counts", 3}, {"exponent", 1}},
        [](const Beam& x) { return fit::Effect{.variance_mm2 = 900 / x.I}; }}},
      {"sunlight", {{{"sigma_mm", 6}, {"centre_deg", 20}, {"width_deg", 15}, {"from_s", 500}, {"to_s", 1500},
                     {"lost", 0.1}, {"exponent", 2}, {"edge_exponent", 4}, {"in_room", 1}},
        [](const Beam& x) {
          const double away = std::remainder((x.a + x.th) / degree - 20, 360) / 15;
          const double light = x.t >= 500 && x.t <= 1500 ? std::exp(-away * away * away * away / 2) : 0;
          return fit::Effect{.variance_mm2 = 36e6 * light / x.I / x.I, .lost = 0.1 * light};
        }}},
      {"local-noise", {{{"sigma_mm", 6}, {"centre_deg", 20}, {"width_deg", 15}, {"exponent", 4}},
        [](const Beam& x) {
          const double away = std::remainder(x.a / degree - 20, 360) / 15;
          return fit::Effect{.variance_mm2 = 36 * std::exp(-away * away * away * away / 2)};
        }}},
      {"local-loss", {{{"lost", 0.1}, {"centre_deg", 20}, {"width_deg", 15}, {"exponent", 4}},
        [](const Beam& x) {
          const double away = std::remainder(x.a / degree - 20, 360) / 15;
          return fit::Effect{.lost = 0.1 * std::exp(-away * away * away * away / 2)};
        }}},
      {"incidence-noise", {{{"sigma_mm", 3}, {"range_exponent", 1}},
        [](const Beam& x) { return fit::Effect{.variance_mm2 = 9 * std::pow(std::tan(x.i), 2) * x.r / 1000}; }}},
      {"correlated-noise", {{{"rho", 0.7}, {"share", 0.4}},
        [](const Beam&) { return fit::Effect{.ar1_rho = 0.7, .ar1_share = 0.4}; }}},
      {"rounding", {{{"step_mm", 5}}, [](const Beam&) { return fit::Effect{.output_step_mm = 5}; }}},
      {"outliers", {{{"fraction", 0.01}, {"lost_each", 0.05}, {"with_range", 0.5}},
        [](const Beam& x) {
          const double share = 0.01 * std::sqrt(x.r / 2000);
          return fit::Effect{.lost = 0.05 * share, .stray = share};
        }}},
      {"dropout", {{{"intensity_min", 300}, {"width", 50}, {"scatter_mm", 2}},
        [](const Beam& x) {  // twice as strong as the threshold: 2 mm / sqrt(ln 2); within 1.9 widths: as there
          const double above = std::max(std::log(x.I / 300), 95.0 / 300);
          return fit::Effect{.variance_mm2 = 4 / above, .lost = 1 - 0.5 * (1 + std::erf((x.I - 300) / 50 / std::sqrt(2.0)))};
        }}},
      {"radiometry", {{{"log_gain", 0.3}, {"range_exponent", 0.2}, {"response_exponent", 0.1}, {"incidence_exponent", 0.15},
          {"reflectance_exponent", 0.25}, {"overlap", 0.4}, {"compression", 0.5}, {"curvature", 0.02}},
        [](const Beam& x) {
          const double r = x.r / 1000, cosine = std::cos(x.i), grey = 0.5;
          const double echo = std::exp(0.3) / std::pow(r, 0.2) * std::pow(grey * cosine / (r * r), 0.1) * std::pow(cosine, 0.15) *
                                std::pow(grey, 0.25) / (1 + 0.4 * std::pow(0.5 / r, 2)),
                       counts = std::exp(0.02 * std::pow(std::log(x.I / 300), 2)) /
                                std::sqrt(1 + 0.5 * std::pow(x.I / 1000, 2));
          return fit::Effect{.log_echo = std::log(echo), .log_intensity = std::log(counts)};
        }}},
      {"window-dirt", {{{"loss", 0.3}, {"centre_deg", 20}, {"width_deg", 15}},
        [](const Beam& x) {
          return fit::Effect{.log_echo = std::log(1 - 0.3 * bell(x.a / degree - 20, 15))};
        }}},
      {"specular", {{{"gain", 3}, {"width_deg", 10}},
        [](const Beam& x) {
          return fit::Effect{.log_echo = std::log(1 + 3 * std::exp(-std::pow(x.i / degree / 10, 2)))};
        }}},
  };
  return list;
}
// clang-format on

std::vector<double> values_of(const fit::Mechanism& mechanism, const Equation& equation) {
  std::map<std::string, fit::Estimate> given;
  for (const auto& [name, value] : equation.values) given[name] = {value, 0};
  CHECK(given.size() == mechanism.parameters.size());
  for (const fit::Parameter& p : mechanism.parameters) CHECK(given.contains(p.name));
  return mechanism.values(given);
}

/// All that an effect says, in one row.
std::vector<double> changes_of(const fit::Effect& e) {
  return {e.range_mm,
          e.beam_rad,
          e.stage_rad,
          e.origin_mm.x(),
          e.origin_mm.y(),
          e.variance_mm2,
          e.ar1_rho,
          e.ar1_share,
          e.lost,
          e.scan_angle_variance_rad2,
          e.beam_angle_variance_rad2,
          e.scan_range_variance_mm2,
          e.own_range_variance_mm2,
          e.shared_by_neighbours,
          e.stray,
          e.footprint_rad,
          e.light_rad,
          e.output_step_mm,
          e.log_echo,
          e.log_intensity};
}

/// Beams that differ in all that anything may depend on.
std::vector<Beam> all_sorts() {
  std::vector<Beam> list;
  for (int n = 0; n < 24; ++n) {
    const double x = n / 24.0;
    list.push_back({.r = 150 + 3000 * x,
                    .I = 2000 - 1900 * x,
                    .i = (-70 + 140 * std::fmod(7 * x, 1)) * degree,
                    .a = (-130 + 260 * std::fmod(5 * x, 1)) * degree,
                    .th = (-170 + 340 * x) * degree,
                    .t = 30 + 2000 * x,
                    .T = 12 * x,
                    .since_move = 0.5 * x,
                    .s = 0.0187 * std::fmod(5 * x, 1),
                    .rate = (n % 2 == 0 ? 20 : -35) * degree,
                    .approach = n % 3 - 1,
                    .seq = n,
                    .along = 900 * std::sin(9 * x),
                    .half = 1000,
                    .along_grows = n % 2 == 0 ? 1 : -1,
                    .round = n % 5 == 4,
                    .corner = 20 + 500 * x,
                    .pull = 300 * std::sin(5 * x),
                    .apart = 400 * std::sin(3 * x),
                    .front = -100 * x,
                    .spread = -5 * x});
  }
  return list;
}

/// A wall ahead, one to the left that joins it, and a board in front of the first.
const std::vector<plain_bench::Wall> scene{
    {{2000, -1500}, {2000, 900}}, {{2000, 900}, {-800, 900}}, {{1300, -700}, {1250, -300}}};
const plain_bench::Mount mount{12, -7, 25};

/// Seen four times, by every second beam: from both sides, cold and warm, and while the stage turns.
SyntheticRecording small_scene() {
  const fit::Bench bench =
      fit::parse_bench(R"({"schema": "bench/1", "lidar": {"steps": 541, "front_step": 270,
    "step_deg": 0.5, "scan_hz": 40, "mount": {"x_mm": 12, "y_mm": -7, "yaw_deg": 25}}, "targets": [
    {"name": "ahead", "from_mm": [2000, -1500], "to_mm": [2000, 900]},
    {"name": "left", "from_mm": [2000, 900], "to_mm": [-800, 900]},
    {"name": "board", "from_mm": [1300, -700], "to_mm": [1250, -300]}]})");
  SyntheticRecording recording(
      bench, [](const fit::CaptureInfo& capture, std::int64_t, auto& range, auto& counts) {
        for (std::size_t k = 0; k < range.size(); ++k) {
          const double a = (static_cast<double>(k) - 270) * 0.5 * degree;
          const auto met = plain_bench::look(scene, mount, capture.stage_rad, a);
          range[k] = met ? static_cast<std::uint16_t>(std::lround(met->range_mm)) : 0;
          counts[k] = 800;
        }
      });
  for (int i = 0; i < 4; ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = std::vector{0.0, 22.0, -31.0, 14.0}[static_cast<std::size_t>(i)] * degree;
    capture.approach = i % 2 == 0 ? 1 : -1;
    capture.since_power_on_s = 30 + 400 * i;
    capture.temperature_c = 22 + 2 * i;
    capture.stage_rate_rad_s = i == 3 ? 20 * degree : 0;
    capture.last_step = 540;
    recording.add(capture, 1);
  }
  return recording;
}

/// Mean range of a beam of 0.2 deg by its light, less the range of its middle; beside an edge 0.
double spread_of(const plain_bench::Met& met, const std::vector<plain_bench::Wall>& walls, double stage_rad,
                 double beam_rad, plain_bench::Deviation off) {
  double light = 0, sum_mm = 0;
  const double middle_rad = off.beam_rad;
  for (int k = -24; k <= 24; ++k) {
    const double aside_deg = 0.05 * k;
    off.beam_rad = middle_rad + aside_deg * degree;
    const auto other = plain_bench::look(walls, mount, stage_rad, beam_rad, off);
    if (!other) continue;
    const double gap = other->range_mm - met.range_mm;
    if (std::abs(gap) > 500) return 0;
    const double share = std::exp(-std::pow(aside_deg / 0.2, 2) / 2) * std::cos(other->incidence_rad) /
                         std::pow(other->range_mm, 2);
    light += share;
    sum_mm += share * gap;
  }
  return sum_mm / light;
}

/// What a cell's beam is, and what it meets if it deviates by that.
Beam of_cell(const fit::explain::Cell& cell, const fit::CaptureInfo& capture,
             const std::vector<plain_bench::Wall>& walls, const plain_bench::Deviation& off) {
  const auto met = plain_bench::look(walls, mount, capture.stage_rad, cell.beam_rad, off);
  REQUIRE(met);
  Beam x{.r = met->range_mm, .I = 800, .i = met->incidence_rad, .a = cell.beam_rad, .th = capture.stage_rad};
  x.t = *capture.since_power_on_s;
  x.T = *capture.temperature_c - 22;
  x.s = (cell.beam_rad + 135 * degree) / (360 * degree * 40);
  x.since_move = x.s;
  x.rate = capture.stage_rate_rad_s;
  x.approach = capture.approach;
  x.along = met->along_mm;
  x.half = std::abs(walls[met->wall].to - walls[met->wall].from) / 2;
  // The first wall ends where the second one begins.
  x.corner = met->wall == 0 ? x.half - x.along : met->wall == 1 ? x.half + x.along : 1e9;
  for (const double aside : {-1.0, -0.75, -0.5, -0.25, 0.25, 0.5, 0.75, 1.0}) {
    plain_bench::Deviation turned = off;
    turned.beam_rad += aside * degree;
    const auto other = plain_bench::look(walls, mount, capture.stage_rad, cell.beam_rad, turned);
    if (!other) continue;
    const double halo = (std::exp2(-std::pow(aside / 0.7, 2)) + std::exp2(-std::pow(aside / 1.4, 2))) / 2,
                 gap = other->range_mm - met->range_mm;
    REQUIRE(std::abs(gap) < 500);
    const double light = std::cos(other->incidence_rad) / std::cos(met->incidence_rad) *
                         std::pow(met->range_mm / other->range_mm, 2);
    x.pull += light * halo * gap;
    x.front -= light * halo * std::pow(std::min(std::abs(gap), 150.0), 2) / 150;
  }
  x.spread = spread_of(*met, walls, capture.stage_rad, cell.beam_rad, off);
  return x;
}

}  // namespace

TEST_CASE("every mechanism of the catalogue does what its equation in docs/method/mechanisms.md says") {
  for (const auto& [id, equation] : equations()) {
    INFO(id);
    CHECK(fit::find_mechanism(id) != nullptr);
  }
  for (const fit::Mechanism& mechanism : fit::catalogue()) {
    INFO(mechanism.id
         << " needs an equation here, written from docs/method/mechanisms.md and not from its file");
    const auto found = equations().find(mechanism.id);
    REQUIRE(found != equations().end());
    const std::vector<double> values = values_of(mechanism, found->second);
    bool changes = false;
    for (const Beam& x : all_sorts()) {
      const std::vector<double> is = changes_of(mechanism.act(x.circumstances(), values)),
                                should = changes_of(found->second.effect(x)), none = changes_of({});
      // The fitter's tilt is of second order in the angle: of the next one a ten-thousandth is left.
      const double order = mechanism.id == "scan-plane-tilt" ? 3e-4 : 1e-9;
      for (std::size_t k = 0; k < is.size(); ++k) {
        INFO("its effect " << k << " of beam " << x.seq);
        CHECK(std::abs(is[k] - should[k]) <= order * std::abs(should[k]) + 1e-3 * order);
      }
      changes = changes || should != none;
    }
    CHECK(changes);
  }
}

TEST_CASE(
    "stray light pulls by the front of the echo where receivers time that, and then nothing that comes "
    "apart") {
  const fit::Mechanism* crosstalk = fit::find_mechanism("crosstalk");
  REQUIRE(crosstalk);
  const std::vector<double> values =
      values_of(*crosstalk, {{{"leak", 0.02}, {"reach_deg", 0.7 * std::sqrt(2)}, {"timing", 0.5}}, {}});
  for (const Beam& x : all_sorts())
    CHECK(crosstalk->act(x.circumstances(), values).range_mm ==
          Approx(0.02 * (x.pull + 0.5 * x.front)).margin(1e-9));
}

TEST_CASE("ranges predicted with a mechanism are those that its equation makes in a small scene") {
  const SyntheticRecording recording = small_scene();
  const fit::explain::Nuisance as_stated(recording.bench());
  for (const fit::Mechanism& mechanism : fit::catalogue()) {
    if (!fit::explain::moves_means(mechanism) || mechanism.targets == fit::Targets::round) continue;
    INFO(mechanism.id);
    const Equation& equation = equations().at(mechanism.id);
    const std::vector<double> values = values_of(mechanism, equation);
    const int target = mechanism.one_target ? 1 : -1;
    fit::explain::Reduced reduced = fit::explain::reduce(recording, {});
    predict(reduced, as_stated, {{fit::not_owned(mechanism), values, target}}, false);
    double largest_mm = 0;
    int compared = 0;
    for (const fit::explain::Cell& cell : reduced.cells) {
      if (!cell.usable) continue;
      const fit::CaptureInfo& capture = recording.captures()[static_cast<std::size_t>(
          reduced.groups[static_cast<std::size_t>(cell.group)].capture)];
      const Beam plain = of_cell(cell, capture, scene, {});
      std::vector<plain_bench::Wall> walls = scene;
      plain_bench::Deviation off;
      const auto take = [&](const fit::Effect& e) {
        off = {0, e.beam_rad, e.stage_rad, {e.origin_mm.x(), e.origin_mm.y()}};
      };
      const bool on_it = target < 0 || cell.at.target == target;
      double should_mm = 0;
      if (mechanism.id == "target-offset" || mechanism.id == "target-tilt") {
        // The wall itself stands elsewhere: out along its normal, which is y here, or turned.
        plain_bench::Wall& wall = walls[1];
        const Point middle = (wall.from + wall.to) / 2.0, turn = std::polar(1.0, 0.5 * degree);
        const bool turns = mechanism.id == "target-tilt";
        for (Point* end : {&wall.from, &wall.to})
          *end = turns ? middle + (*end - middle) * turn : *end + Point(0, 5);
        should_mm = of_cell(cell, capture, on_it ? walls : scene, {}).r;
      } else {
        if (on_it) take(equation.effect(plain));
        const Beam there = of_cell(cell, capture, scene, off);
        should_mm = there.r + (on_it ? equation.effect(there).range_mm : 0);
      }
      // A leaning fan: to second order in its tilt.
      CHECK(cell.nominal_mm ==
            Approx(should_mm).margin(mechanism.id == "scan-plane-tilt" ? 2e-3 : 1e-6).epsilon(0));
      largest_mm = std::max(largest_mm, std::abs(should_mm - plain.r));
      ++compared;
    }
    CHECK(compared > 500);
    CHECK(largest_mm > 0.05);
  }
}

}  // namespace mechanism_test
