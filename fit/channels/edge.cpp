// SPDX-License-Identifier: MIT
#include "fit/explain/model/transitions.hpp"

namespace fit::explain::channels {
namespace {

using Eigen::Index;
using model::Transition;

/// Edges, each in every capture that shows it: by how much the angles of its beams scatter, deg^2. A wide
/// beam and angles that are drawn for every scan look alike there, and add.
class Edges final : public model::WidthRows {
 public:
  explicit Edges(std::vector<Transition> list) : WidthRows(model::widths_of(list)), list_(std::move(list)) {}
  [[nodiscard]] double response(Index, const Effect& effect) const override {
    return (effect.footprint_rad * effect.footprint_rad + effect.scan_angle_variance_rad2 +
            effect.beam_angle_variance_rad2) *
           deg_per_rad * deg_per_rad;
  }
  [[nodiscard]] SpreadCurve picture(const Eigen::VectorXd& before, const Eigen::VectorXd& after) const {
    return model::shares_along(list_, possible(before), possible(after));
  }

 private:
  std::vector<Transition> list_;
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
    return std::make_unique<Edges>(std::move(list));
  };
  kind.picture = [](const model::ChannelRows& rows, const Eigen::VectorXd& before,
                    const Eigen::VectorXd& after) {
    return static_cast<const Edges&>(rows).picture(before, after);
  };
  return kind;
}

}  // namespace fit::explain::channels
