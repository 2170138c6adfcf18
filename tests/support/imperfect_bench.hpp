// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "rig/session/session_store.hpp"
#include "tests/support/test_folder.hpp"
#include "tests/unit/fit/plain_bench.hpp"

/// Benches whose stage, lidar and targets are off by what a bench file may not know, drawn anew for every
/// seed from the usual sizes. Written in plane trigonometry alone, so that it can judge the calibrations.
namespace imperfect {

using plain_bench::degree;
using plain_bench::Point;

/// What is really there. Sizes are those of the catalogue of mechanisms.
struct Truth {
  plain_bench::Mount mount;
  double stage_scale = 0, stage_sine_rad = 0, stage_cosine_rad = 0, backlash_rad = 0;
  double beam_sine_rad = 0, beam_cosine_rad = 0;
  double offset_mm = 0, range_scale = 0, walk_mm = 0, walk_counts = 500;
  double window_rad =
      0.05 * degree;         ///< In which a beam wavers at an edge; of a Gaussian response, 98 % of it.
  bool is_gaussian = false;  ///< Its response; else a straight one.

  /// True angle of the stage where it was commanded to `rad`, coming from below.
  [[nodiscard]] double stage(double rad) const {
    return rad * (1 + stage_scale) + stage_sine_rad * std::sin(rad) + stage_cosine_rad * std::cos(rad) -
           backlash_rad / 2;
  }
  [[nodiscard]] double beam(double rad) const {
    return rad + beam_sine_rad * std::sin(rad) + beam_cosine_rad * std::cos(rad);
  }
  [[nodiscard]] double range_error(double mm, double counts) const {
    return offset_mm + range_scale * mm + walk_mm * std::exp(-counts / walk_counts);
  }
  /// The stage's axis in the lidar's frame.
  [[nodiscard]] Point centre() const {
    return -Point(mount.x_mm, mount.y_mm) * std::polar(1.0, -mount.yaw_deg * degree);
  }
};

/// `x_mm`, `y_mm`, `yaw_deg`: the bench file's mount; the truth lies about it by `u_mm`, `u_deg`.
struct Expected {
  double x_mm = 0, y_mm = 0, u_mm = 15, u_yaw_deg = 0.3;
};

inline Truth draw(std::mt19937_64& random, const Expected& expected) {
  std::normal_distribution<double> normal;
  const auto of = [&](double u) { return u * normal(random); };
  Truth truth;
  truth.mount = {expected.x_mm + of(expected.u_mm), expected.y_mm + of(expected.u_mm),
                 of(expected.u_yaw_deg)};
  truth.stage_scale = of(2e-3);
  truth.stage_sine_rad = of(0.05 * degree / std::sqrt(2.0)),
  truth.stage_cosine_rad = of(0.05 * degree / std::sqrt(2.0));
  truth.backlash_rad = std::abs(of(0.1 * degree));
  truth.beam_sine_rad = of(0.15 * degree / std::sqrt(2.0)),
  truth.beam_cosine_rad = of(0.15 * degree / std::sqrt(2.0));
  truth.offset_mm = of(12), truth.range_scale = of(3e-3), truth.walk_mm = of(25);
  truth.walk_counts = std::exp(std::uniform_real_distribution<double>(std::log(200), std::log(1200))(random));
  truth.window_rad = std::uniform_real_distribution<double>(0.02, 0.08)(random) * degree;
  truth.is_gaussian = std::bernoulli_distribution(0.5)(random);
  return truth;
}

/// A session recorded on such a bench.
class Bench {
 public:
  static constexpr double resolution_rad = 0.01 * degree;  ///< Of the stage, as its bench file says.
  struct Wall {
    plain_bench::Wall at;
    double reflectance = 0.85;
  };

  Bench(const std::string& path, const std::string& bench_file, const Truth& truth, std::vector<Wall> walls,
        std::uint64_t seed)
      : truth_(truth),
        walls_(std::move(walls)),
        random_(seed),
        store_(std::make_unique<rig::SessionStore>(path, rig::SessionStore::Mode::create)) {
    store_->set("bench", bench_file);
    store_->set("lidar", R"({"PROD":"UST-10LX","SERI":"H1"})");
    store_->set("created_utc", "2026-05-04T10:00:00Z");
  }
  std::vector<Wall>& walls() { return walls_; }

  [[nodiscard]] double counts(const plain_bench::Met& met) const {
    return 2400 * walls_[met.wall].reflectance * std::cos(met.incidence_rad) /
           (1 + std::pow(met.range_mm / 3000, 2));
  }
  /// What the beam `beam_rad` meets while the stage is commanded to `stage_rad`, its range without noise.
  [[nodiscard]] std::optional<plain_bench::Met> look(double stage_rad, double beam_rad,
                                                     double jitter_rad = 0) const {
    std::vector<plain_bench::Wall> plain;
    for (const Wall& wall : walls_) plain.push_back(wall.at);
    auto met =
        plain_bench::look(plain, truth_.mount, truth_.stage(stage_rad), truth_.beam(beam_rad) + jitter_rad);
    if (met) met->range_mm += truth_.range_error(met->range_mm, counts(*met));
    return met;
  }

  void capture(fit::CaptureInfo info, int scans, double sigma_mm = 8) {
    info.approach = 1;
    const auto beams = static_cast<std::size_t>(info.last_step - info.first_step + 1);
    struct Seen {
      double range = 0, counts = 0;
    };
    std::vector<std::array<Seen, 2>> seen(beams);  // At either end of the window in which a beam wavers.
    std::vector<double> share(beams, 1);           // Of the response, before the edge.
    const double sigma_rad = truth_.window_rad / (2 * 2.326348);
    // A stage stops within half of its resolution.
    std::uniform_real_distribution<double> within(-resolution_rad / 2, resolution_rad / 2);
    const double stage_rad = info.stage_rad + within(random_);
    for (std::size_t k = 0; k < beams; ++k) {
      const double beam_rad = (info.first_step + static_cast<int>(k) - 540) * 0.25 * degree,
                   half = truth_.is_gaussian ? 4 * sigma_rad : truth_.window_rad / 2;
      const auto first = look(stage_rad, beam_rad, -half), last = look(stage_rad, beam_rad, half);
      const auto middle = look(stage_rad, beam_rad);
      const auto as_seen = [&](const auto& met) { return met ? Seen{met->range_mm, counts(*met)} : Seen{}; };
      const bool same = first.has_value() == last.has_value() && (!first || first->wall == last->wall);
      seen[k] =
          same ? std::array{as_seen(middle), as_seen(middle)} : std::array{as_seen(first), as_seen(last)};
      if (same) continue;
      double low = -half, high = half;
      for (int i = 0; i < 40; ++i) {
        const double at = (low + high) / 2;
        const auto met = look(stage_rad, beam_rad, at);
        const bool like_first = met.has_value() == first.has_value() && (!met || met->wall == first->wall);
        (like_first ? low : high) = at;
      }
      share[k] = truth_.is_gaussian ? std::erfc(-low / sigma_rad / std::numbers::sqrt2) / 2
                                    : (low + half) / (2 * half);
    }
    const auto id = store_->begin_capture(info);
    std::normal_distribution<double> noise(0, sigma_mm);
    std::uniform_real_distribution<double> even;
    std::vector<std::uint16_t> range(beams), intensity(beams);
    for (int seq = 0; seq < scans; ++seq) {
      for (std::size_t k = 0; k < beams; ++k) {
        const Seen& now = seen[k][share[k] >= 1 || even(random_) < share[k] ? 0 : 1];
        range[k] = now.range > 0
                       ? static_cast<std::uint16_t>(std::lround(std::max(1.0, now.range + noise(random_))))
                       : 0;
        intensity[k] =
            static_cast<std::uint16_t>(std::lround(now.counts * (1 + 0.01 * noise(random_) / sigma_mm)));
      }
      store_->add_scan(id, {seq, 25 * seq, 25000 * seq, range, intensity, {}});
    }
    store_->commit_capture(id);
  }

  /// Commanded angle, between the two, at which the beam changes from wall 0 to something else.
  [[nodiscard]] double edge(double beam_rad, double from_rad, double to_rad) const {
    const auto on = [&](double stage) {
      const auto met = look(stage, beam_rad);
      return met && met->wall == 0;
    };
    const bool begins = on(from_rad);
    for (int i = 0; i < 60; ++i) {
      const double at = (from_rad + to_rad) / 2;
      (on(at) == begins ? from_rad : to_rad) = at;
    }
    return (from_rad + to_rad) / 2;
  }
  rig::SessionStore& store() { return *store_; }

 private:
  Truth truth_;
  std::vector<Wall> walls_;
  std::mt19937_64 random_;
  std::unique_ptr<rig::SessionStore> store_;
};

}  // namespace imperfect
