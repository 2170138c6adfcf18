// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cstddef>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "fit/explain/model/transitions.hpp"

namespace fit::explain::channels {
namespace {

using Eigen::Index;
using model::Transition;

/// Of every capture, when scans came after the stage's move, s.
using TimesOfCaptures = std::map<int, std::vector<double>>;

/// A few of every capture: enough to see an angle change.
TimesOfCaptures times_of(const Reduced& reduced) {
  constexpr std::size_t enough = 12;
  std::map<int, std::map<int, double>> scans;  // by capture and number
  for (const Sector& s : reduced.sectors)
    scans[reduced.group_of(s).capture].try_emplace(s.seq, s.since_move_s);
  TimesOfCaptures times;
  for (const auto& [capture, all] : scans) {
    const std::size_t each = std::max<std::size_t>(1, all.size() / enough);
    std::size_t k = 0;
    for (const auto& [seq, time_s] : all)
      if (k++ % each == 0) times[capture].push_back(time_s);
  }
  return times;
}

/// Edges, each in every capture that shows it: by how much the angles of its beams scatter, deg^2. A wide
/// beam and angles that are drawn for every scan, or change from scan to scan, look alike there, and add.
class Edges final : public model::WidthRows {
 public:
  Edges(const Reduced& reduced, std::vector<Transition> list, TimesOfCaptures times)
      : WidthRows(model::widths_of(reduced, list)), list_(std::move(list)), times_(std::move(times)) {}
  /// An angle that changes from scan to scan widens an edge.
  [[nodiscard]] bool sees(Coordinate) const override { return true; }
  [[nodiscard]] std::span<const double> times_s(Index row) const override {
    const auto times = times_.find(capture(row));
    return times == times_.end() ? std::span<const double>() : times->second;
  }
  [[nodiscard]] double offset(Index row) const override {
    return WidthRows::offset(row) + list_[static_cast<std::size_t>(row)].scattered_deg2;
  }
  [[nodiscard]] double response(Index, const Effect& effect) const override {
    return (effect.footprint_rad * effect.footprint_rad + effect.scan_angle_variance_rad2 +
            effect.beam_angle_variance_rad2) *
           deg_per_rad * deg_per_rad;
  }
  [[nodiscard]] std::optional<SpreadCurve> picture(const Eigen::VectorXd& before,
                                                   const Eigen::VectorXd& after) const override {
    return model::shares_along(list_, feasible(before), feasible(after));
  }

 private:
  std::vector<Transition> list_;
  TimesOfCaptures times_;
};

}  // namespace

model::ChannelKind make_edge() {
  model::ChannelKind kind;
  kind.id = "edge";
  kind.observable = Observable::range_distribution;
  kind.has_forms = false;
  kind.rows = [](const Reduced& reduced, const MeanNoise&) -> std::unique_ptr<model::ChannelRows> {
    std::vector<Transition> list = model::transitions(reduced);
    if (list.empty()) return nullptr;
    return std::make_unique<Edges>(reduced, std::move(list), times_of(reduced));
  };
  return kind;
}

}  // namespace fit::explain::channels
