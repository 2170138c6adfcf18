// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "worlds/bench.hpp"
#include "worlds/kind.hpp"

namespace challenge {

/// A kind at work in the engine; its effect on the session is measured whenever its strength changes.
class WorldCause : public Cause {
 public:
  explicit WorldCause(const Kind& kind);

  void draw(Session& session, Random& random) override;
  void build(Session& session) override;
  bool stand_beside(Session& session, const Cause& other) override;

  bool has_size() const override { return kind_.sized; }
  double largest_strength() const override { return kind_.largest; }
  bool differs_within_capture() const override { return kind_.each_scan; }
  json parameters() const override { return kind_.parameters(*session_, shape_, strength); }
  std::vector<std::string> also_makes() const override { return kind_.also_makes; }
  [[nodiscard]] json keys() const { return kind_.keys(*session_, shape_, strength); }
  [[nodiscard]] json add_to(json world) const;

  double range(const Moment& moment, const Sight&, const World&) const override;
  double lost(const Moment& moment, const Sight& sight) const override;
  double variance(const Moment& moment, const Sight& sight, const World&) const override;
  double stray(const Moment&, const Sight& sight) const override;
  double scan_angle_sigma() const override;
  double footprint() const override;
  bool merges(double gap_mm) const override { return gap_mm < 600; }
  double output_step_mm() const override;
  std::vector<std::pair<double, double>> memory() const override;
  bool shows_in_intensity() const override;
  double log_intensity(const Moment& moment) const override;
  std::optional<double> counts(const Moment& moment) const override;

 private:
  /// The world without the cause.
  [[nodiscard]] json without(const Session& session) const;
  void look_without(const Session& session);
  void probe(const Session& session);

  const Kind& kind_;
  Shape shape_;
  json others_ = json::object();  ///< Keys of what is concealed besides.
  const Session* session_ = nullptr;
  std::vector<double> rates_;
  Table plain_, with_, steeper_, plain_light_, light_;
  mutable std::optional<Table> counted_;  ///< Logarithms of counts with the cause, once they are asked for.
  double probe_ = 1;
};

}  // namespace challenge
