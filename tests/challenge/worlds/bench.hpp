// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "sim/world.hpp"
#include "world.hpp"
#include "worlds/device.hpp"

namespace challenge {

/// Where the stage is: it arrives at every capture half a second after leaving the one before.
class Motion {
 public:
  explicit Motion(const Session& session);
  [[nodiscard]] sim::StageMoment at(double time_s) const;

 private:
  const Session& session_;
  double early_s_;  ///< Where it is seen to settle, the first scan begins as it stops.
};

/// Runs the engine through the session.
class Bench {
 public:
  Bench(const Session& session, const nlohmann::json& world, std::uint64_t seed);

  /// Captures in order, and scans within them.
  void scan(std::size_t index, int seq);
  [[nodiscard]] std::size_t index(int step) const { return static_cast<std::size_t>(step - window_.first); }
  [[nodiscard]] double exact_mm(int step) const { return exact_[index(step)]; }
  [[nodiscard]] double exact_counts(int step) const { return counts_[index(step)]; }
  [[nodiscard]] std::uint32_t range(int step) const { return range_[index(step)]; }
  [[nodiscard]] std::uint32_t intensity(int step) const { return intensity_[index(step)]; }

 private:
  void place(const Capture& capture);

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
  Table(const Session& session, nlohmann::json world, bool each_scan, bool of_counts = false);
  [[nodiscard]] double at(const Moment& moment) const;

 private:
  bool each_scan_ = false;
  std::vector<std::vector<std::vector<float>>> rows_;
};

}  // namespace challenge
