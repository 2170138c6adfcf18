// SPDX-License-Identifier: MIT

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "fit/explain/spread/other_patterns.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"
#include "fit/explain/spread/unseen.hpp"

namespace fit::explain::spread {
namespace {

/// A damped wave of the stage's angle: the real part of (value[0] + i value[1]) exp(-t / tau + 2 pi i f t),
/// rad.
struct Swing {
  double tau_s = 0.1, frequency_hz = 0;
  Eigen::Vector2d value = Eigen::Vector2d::Zero();
  double gain = 0;
};

/// Sectors of scans after a move, whose mean angles in every capture are not known.
class AfterMoves {
 public:
  AfterMoves(const std::vector<Group>& groups, std::vector<Sector>& sectors) {
    for (Sector& s : sectors)
      if (s.approach != 0 && s.wvv > 0) rows_.push_back(&s);
    for (std::size_t i = 0; i < rows_.size(); ++i) blocks_[{rows_[i]->group, rows_[i]->number}].push_back(i);
    for (const Sector* s : rows_)
      precision_.push_back(1 / typical_variance(groups[static_cast<std::size_t>(s->group)]));
  }

  [[nodiscard]] bool are_enough() const { return rows_.size() >= 60; }

  /// The swing that explains most.
  [[nodiscard]] Swing best() const {
    Swing best;
    const auto look = [&](double tau, double hz) {
      const Swing swing = fit(tau, hz);
      if (swing.gain > best.gain) best = swing;
    };
    for (const double tau : {0.05, 0.1, 0.2, 0.4, 1.0})
      for (double hz = 0; hz < 19.5; hz += 0.5) look(tau, hz);
    double step_tau = 1.4, step_hz = 0.3;
    for (int pass = 0; pass < 12; ++pass) {
      const double tau = best.tau_s, hz = best.frequency_hz;
      for (const double t : {tau / step_tau, tau * step_tau}) look(std::clamp(t, 0.02, 3.0), hz);
      for (const double f : {hz - step_hz, hz + step_hz}) look(best.tau_s, std::clamp(f, 0.0, 19.9));
      if (best.tau_s == tau && best.frequency_hz == hz) {
        step_tau = std::sqrt(step_tau);
        step_hz /= 2;
      }
    }
    return best;
  }

  /// Of its two values, tau and frequency, all four together: a swing that fades sooner seems to begin
  /// larger.
  [[nodiscard]] Eigen::Matrix4d covariance(const Swing& swing) const {
    const double tau = swing.tau_s, hz = swing.frequency_hz;
    const auto angle = [&](double t, double f) { return Eigen::VectorXd(wave(t, f) * swing.value); };
    constexpr double share = 0.02, aside_hz = 0.02;
    Eigen::MatrixXd slopes(static_cast<Eigen::Index>(rows_.size()), 4);
    slopes.leftCols(2) = wave(tau, hz);
    slopes.col(2) = (angle(tau * (1 + share), hz) - angle(tau * (1 - share), hz)) / (2 * share * tau);
    slopes.col(3) = (angle(tau, hz + aside_hz) - angle(tau, hz - aside_hz)) / (2 * aside_hz);
    Eigen::Matrix4d information = Eigen::Matrix4d::Zero();
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const Eigen::Vector4d x = slopes.row(static_cast<Eigen::Index>(i)).transpose();
      information += precision_[i] * rows_[i]->wvv * x * x.transpose();
    }
    // What cannot be known better than by its order of magnitude stays finite.
    information(2, 2) += 1 / (tau * tau);
    information(3, 3) += 1 / (0.5 * 0.5 + 1 / (tau * tau));
    return information.inverse();
  }

  /// Of the log-likelihood, by a swing that was found elsewhere.
  [[nodiscard]] double gain_of(const Swing& swing) const {
    const auto [along, square] = parabola(swing.tau_s, swing.frequency_hz);
    return along.dot(swing.value) - 0.5 * swing.value.dot(square * swing.value);
  }

  /// The angle after moves, as if all had gone forwards, deg, along the time since then.
  [[nodiscard]] SpreadCurve curve(const Swing& swing) const {
    SpreadCurve curve;
    curve.shows = "stage angle after a move, from its mean";
    curve.unit = "deg";
    curve.observable = Observable::range_mean;
    curve.coordinate = Coordinate::time;
    curve.along = "time since the move (s)";
    std::vector<std::size_t> order(rows_.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::ranges::sort(order, {}, [&](std::size_t i) { return rows_[i]->since_move_s; });
    const Eigen::VectorXd angles = wave(swing.tau_s, swing.frequency_hz) * swing.value;
    constexpr std::size_t points = 60;
    const std::size_t each = rows_.size() / points + 1;
    for (std::size_t first = 0; first < order.size(); first += each) {
      double weight = 0, time_s = 0, seen = 0, swings = 0;
      for (std::size_t k = first; k < std::min(order.size(), first + each); ++k) {
        const std::size_t i = order[k];
        const Sector& row = *rows_[i];
        const double known = precision_[i] * row.wvv;
        weight += known;
        time_s += known * row.since_move_s;
        seen += precision_[i] * row.wdv * row.approach;
        swings += known * row.approach * angles[static_cast<Eigen::Index>(i)];
      }
      curve.add(time_s / weight, {seen / weight * deg_per_rad, deg_per_rad / std::sqrt(weight)}, 0,
                swings / weight * deg_per_rad);
    }
    return curve;
  }

  void take_off(const Swing& swing) {
    const Eigen::MatrixXd waves = wave(swing.tau_s, swing.frequency_hz);
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const double angle = waves.row(static_cast<Eigen::Index>(i)).dot(swing.value);
      rows_[i]->wd -= rows_[i]->wv * angle;
      rows_[i]->wdv -= rows_[i]->wvv * angle;
    }
  }

 private:
  /// Both waves of value one at every row, rad, less their means in the row's capture.
  [[nodiscard]] Eigen::MatrixXd wave(double tau, double hz) const {
    Eigen::MatrixXd wave(static_cast<Eigen::Index>(rows_.size()), 2);
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const double t = rows_[i]->since_move_s, size = rows_[i]->approach * std::exp(-t / tau);
      wave(static_cast<Eigen::Index>(i), 0) = size * std::cos(2 * pi * hz * t);
      wave(static_cast<Eigen::Index>(i), 1) = -size * std::sin(2 * pi * hz * t);
    }
    for (const auto& [key, list] : blocks_) {
      Eigen::RowVector2d mean = Eigen::RowVector2d::Zero();
      for (const std::size_t i : list) mean += wave.row(static_cast<Eigen::Index>(i));
      mean /= static_cast<double>(list.size());
      for (const std::size_t i : list) wave.row(static_cast<Eigen::Index>(i)) -= mean;
    }
    return wave;
  }

  /// The log-likelihood of both waves' sizes is a parabola: its slope and curvature where they are nought.
  struct Parabola {
    Eigen::Vector2d along = Eigen::Vector2d::Zero();
    Eigen::Matrix2d square = Eigen::Matrix2d::Zero();
  };
  [[nodiscard]] Parabola parabola(double tau, double hz) const {
    const Eigen::MatrixXd waves = wave(tau, hz);
    Parabola sum;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const Eigen::Vector2d x = waves.row(static_cast<Eigen::Index>(i)).transpose();
      sum.square.noalias() += precision_[i] * rows_[i]->wvv * x * x.transpose();
      sum.along += precision_[i] * rows_[i]->wdv * x;
    }
    return sum;
  }

  [[nodiscard]] Swing fit(double tau, double hz) const {
    auto [along, square] = parabola(tau, hz);
    square.diagonal().array() += 1e-9 + 1e-9 * square.diagonal().maxCoeff();
    const Eigen::Vector2d value = square.inverse() * along;
    return {tau, hz, value, 0.5 * along.dot(value)};
  }

  std::vector<Sector*> rows_;
  std::map<std::pair<int, int>, std::vector<std::size_t>> blocks_;  ///< Rows by group and sector.
  std::vector<double> precision_;                                   ///< Of a sample, mm^-2.
};

/// Squared scatter of the angles of whole scans beside a swing of that gain, in units of their own noise; at
/// least 1.
double scatter_of_angles(const std::vector<Scan>& scans, double gain) {
  double excess = 0, count = 0;
  for (const Scan& s : scans) {
    if (s.information(1, 1) <= 0) continue;
    excess += s.score[1] * s.score[1] / s.information(1, 1);
    count += 1;
  }
  return count > 10 ? std::max(1.0, (excess - 2 * gain) / count) : 1;
}

std::map<std::string, Estimate> parameters_of(const Swing& swing, const Eigen::Matrix4d& covariance) {
  const Eigen::Vector2d& value = swing.value;
  const double amplitude = value.norm();
  const Eigen::Vector2d out = value / amplitude, across(-out.y(), out.x());
  const Eigen::Matrix2d of_size = covariance.topLeftCorner<2, 2>();
  return {{"amplitude_deg", {amplitude * deg_per_rad, std::sqrt(out.dot(of_size * out)) * deg_per_rad}},
          {"phase_deg",
           {std::atan2(value[1], value[0]) * deg_per_rad,
            std::sqrt(across.dot(of_size * across)) / amplitude * deg_per_rad}},
          {"tau_s", {swing.tau_s, std::sqrt(covariance(2, 2))}},
          {"frequency_hz", {swing.frequency_hz, std::sqrt(covariance(3, 3))}}};
}

/// The swing that sectors show, as a suspect.
struct Seen {
  Swing swing;
  Suspect suspect = suspected(ids::settling);
  double inflate = 1;  ///< Variance of angles, in units of their own noise.
};

/// What sectors gain by the swing that others show.
double unseen_gain(const std::vector<Group>& groups, std::vector<Sector> own, std::vector<Sector> others) {
  return AfterMoves(groups, own).gain_of(AfterMoves(groups, others).best());
}

Seen swing_in(const std::vector<Scan>& scans, const AfterMoves& rows) {
  Seen seen{rows.best()};
  const double gain = seen.swing.gain;
  // Random angles of whole scans look like a swing now and then: their spread is the noise to be beaten.
  const double inflate = seen.inflate = scatter_of_angles(scans, gain);
  Suspect& suspect = seen.suspect;
  suspect.gain = gain / inflate;
  suspect.evidence = suspect.gain - 2 * price_of_size(suspect.gain) - odds::against_place(suspect.gain, 3) -
                     odds::against_place(suspect.gain, 20);
  if (suspect.evidence >= accept_at)
    suspect.parameters = parameters_of(seen.swing, inflate * rows.covariance(seen.swing));
  return seen;
}

}  // namespace

double evidence_of_swing(const std::vector<Group>& groups, std::vector<Sector>& sectors) {
  const AfterMoves rows(groups, sectors);
  return rows.are_enough() ? swing_in(scans_of(groups, sectors), rows).suspect.evidence : -1;
}

void swinging(const std::vector<Group>& groups, std::vector<Sector>& sectors, SpreadResult& result) {
  AfterMoves rows(groups, sectors);
  if (!rows.are_enough()) return;
  const std::vector<Scan> scans = scans_of(groups, sectors);
  Seen seen = swing_in(scans, rows);
  if (seen.suspect.evidence < accept_at) return;
  // Where walls are met at a slant, mirror faces look like a stage that swings: of the two that which is more
  // evident is believed first, and the other by what is left.
  if (std::vector<Sector> rest = sectors; take_off_evident_faces(scans, seen.suspect.evidence, rest))
    seen = swing_in(scans_of(groups, rest), AfterMoves(groups, rest));
  if (seen.suspect.evidence < accept_at) return;
  const auto unseen = [&](const auto& own, const auto& others) {
    return unseen_gain(groups, own, others) / seen.inflate;
  };
  seen.suspect.held_out_gain = held_out_gain(
      sectors, unseen, [&](const Sector& s) { return groups[static_cast<std::size_t>(s.group)].capture; });
  result.accepted.push_back(seen.suspect);
  result.curves.push_back(rows.curve(seen.swing));
  rows.take_off(seen.swing);
}

}  // namespace fit::explain::spread
