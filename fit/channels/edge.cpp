// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/explain/model/channel.hpp"
#include "fit/explain/model/transitions.hpp"

namespace fit::explain::channels {
namespace {

using Eigen::Index;
using model::Transition;

/// Edges, each in every capture that shows it: by how much the angles of its beams scatter, deg^2. A wide
/// beam and angles that are drawn for every scan look alike there, and add.
class Edges final : public model::ChannelRows {
 public:
  explicit Edges(std::vector<Transition> list) : list_(std::move(list)), raised_(fair_place()) {
    base_.columns.resize(this->Edges::rows(), 0);
  }

  [[nodiscard]] Index rows() const override { return static_cast<Index>(list_.size()); }
  [[nodiscard]] const Circumstances& at(Index row) const override { return of(row).at(); }
  [[nodiscard]] int capture(Index row) const override { return of(row).capture(); }
  [[nodiscard]] double response(Index, const Effect& effect) const override {
    return (effect.footprint_rad * effect.footprint_rad + effect.scan_angle_variance_rad2 +
            effect.beam_angle_variance_rad2) *
           deg_per_rad * deg_per_rad;
  }
  [[nodiscard]] const model::Columns& base() const override { return base_; }
  [[nodiscard]] double offset(Index) const override { return Transition::hard_deg2; }
  [[nodiscard]] double statistic(Index row) const override { return of(row).best_deg2(); }
  [[nodiscard]] double log_likelihood(const Eigen::VectorXd& eta) const override {
    return log_likelihoods(eta).sum();
  }
  [[nodiscard]] Eigen::VectorXd log_likelihoods(const Eigen::VectorXd& eta) const override {
    return each(eta, &Transition::log_likelihood);
  }
  [[nodiscard]] Eigen::VectorXd raised(const Eigen::VectorXd& eta) const override {
    return eta.cwiseMax(raised_);
  }
  [[nodiscard]] Eigen::VectorXd possible(Eigen::VectorXd eta) const override {
    return eta.cwiseMax(Transition::hard_deg2);
  }
  [[nodiscard]] Eigen::MatrixXd whitened(Eigen::MatrixXd columns, const Eigen::VectorXd& eta) const override {
    return each(eta, &Transition::information).cwiseSqrt().asDiagonal() * columns;
  }
  [[nodiscard]] Eigen::VectorXd white_residual(const Eigen::VectorXd& eta) const override {
    return each(eta, &Transition::score).cwiseQuotient(each(eta, &Transition::information).cwiseSqrt());
  }
  [[nodiscard]] SpreadCurve picture(const Eigen::VectorXd& before, const Eigen::VectorXd& after) const {
    return model::shares_along(list_, possible(before), possible(after));
  }

 private:
  [[nodiscard]] const Transition& of(Index row) const { return list_[static_cast<std::size_t>(row)]; }
  [[nodiscard]] Eigen::VectorXd each(const Eigen::VectorXd& eta,
                                     double (Transition::*of_one)(double) const) const {
    Eigen::VectorXd values(rows());
    for (Index i = 0; i < rows(); ++i) values[i] = (of(i).*of_one)(eta[i]);
    return values;
  }

  /// Where the parabola of all edges promises of a width what their likelihood gives: at the best width it
  /// promises far less, as the likelihood falls by the logarithm.
  [[nodiscard]] double fair_place() const {
    const auto all = [&](double variance, double (Transition::*of_one)(double) const) {
      return each(Eigen::VectorXd::Constant(rows(), variance), of_one).sum();
    };
    const double hard = Transition::hard_deg2, best = pooled_deg2(list_),
                 gain = all(best, &Transition::log_likelihood) - all(hard, &Transition::log_likelihood);
    double fair = best, off = 1e300;
    constexpr double finer = 0.8;
    for (double v = best; v > hard; v *= finer) {
      const double information = all(v, &Transition::information),
                   along = all(v, &Transition::score) + information * (v - hard),
                   promised = along * along / information / 2;
      if (std::abs(promised - gain) >= off) continue;
      off = std::abs(promised - gain);
      fair = v;
    }
    return fair;
  }

  std::vector<Transition> list_;
  double raised_;
  model::Columns base_;
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
