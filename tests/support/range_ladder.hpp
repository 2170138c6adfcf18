// SPDX-License-Identifier: MIT
#pragma once
// Sessions of flat targets at many distances and greys, by a lidar whose range errors are known.

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "rig/fitting/fitting.hpp"
#include "rig/session/session_store.hpp"
#include "tests/support/test_folder.hpp"

namespace range_ladder {

/// What the simulated lidar gets wrong: the published distance error (source A, equation 15) and a confluent
/// exponential of the echo's strength.
inline double distance_error(double mm) {
  const double w = -1.341e-4;
  return 919.7 - 966.6 * std::cos(w * mm) + 52.28 * std::cos(2 * w * mm) + 777 * std::sin(w * mm) -
         326.3 * std::sin(2 * w * mm);
}
inline double intensity_error(double counts) { return (25 - 0.012 * counts) * std::exp(-0.0016 * counts); }
inline double counts_of(double reflectance, double mm) {
  return 2400 * reflectance * (1 + std::pow(200 / 3000.0, 2)) / (1 + std::pow(mm / 3000, 2));
}

inline constexpr const char* bench_text = R"({"schema": "bench/1",
  "lidar": {"model": "UST-10LX", "steps": 1081, "front_step": 540, "step_deg": 0.25, "scan_hz": 40,
            "mount": {"x_mm": 0, "y_mm": 0, "yaw_deg": {"value": 0, "u": 0.1}}},
  "targets": [{"name": "sample", "from_mm": [200, -100], "to_mm": [200, 100], "u_mm": 0, "u_deg": 0.1}]})";

/// A session of captures by the beam straight ahead.
class Ladder {
 public:
  Ladder(const std::string& path, unsigned seed, double sigma_mm)
      : path_(path), random_(seed), sigma_(sigma_mm) {
    std::filesystem::remove(path);
    store_ = std::make_unique<rig::SessionStore>(path, rig::SessionStore::Mode::create);
    store_->set("bench", bench_text);
    store_->set("lidar", R"({"PROD":"UST-10LX","SERI":"H1234567","FIRM":"1.2"})");
    store_->set("created_utc", "2026-05-04T10:00:00Z");
    store_->set("procedure_name", "simulated ladder");
  }
  void capture(double mm, double reflectance, long scans) {
    fit::CaptureInfo info;
    info.step = "at " + std::to_string(static_cast<int>(mm));
    info.target = "sample", info.target_shift_mm = mm - 200, info.reflectance = reflectance;
    info.first_step = info.last_step = 540;
    const auto id = store_->begin_capture(info);
    std::normal_distribution<double> normal;
    const double counts = counts_of(reflectance, mm);
    for (long seq = 0; seq < scans; ++seq) {
      const double shown = std::max(1.0, std::round(counts * (1 + 0.01 * normal(random_))));
      const double range = mm + distance_error(mm) + intensity_error(shown) + sigma_ * normal(random_);
      const std::uint16_t r = static_cast<std::uint16_t>(std::lround(range)),
                          i = static_cast<std::uint16_t>(shown);
      store_->add_scan(id, {seq, seq * 25, seq * 25000, {&r, 1}, {&i, 1}, {}});
    }
    store_->commit_capture(id);
  }
  rig::SessionStore& store() { return *store_; }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  std::mt19937_64 random_;
  double sigma_;
  std::unique_ptr<rig::SessionStore> store_;
};

}  // namespace range_ladder
