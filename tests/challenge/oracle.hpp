// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

#include "world.hpp"

namespace challenge {

/// What one who knows the concealed physics exactly would see of it in a session.
///
/// Signal-to-noise: twice the expected log-likelihood ratio between "with" and "without", square-rooted. For
/// a shift of the means it is the length of the shift in units of the standard error of every cell, after the
/// nuisances (mount, offset and tilt of every target) have been re-fitted by weighted least squares under
/// their priors. Variances, echo states (lost, stray, other surface), whole-scan angles and memory between
/// scans add their own expected log-likelihood ratios.
class Oracle {
 public:
  /// Cells are thinned to about `cells` (and weighted up again); every scan has its own cells if one of
  /// `causes` differs from scan to scan.
  Oracle(const Session& session, const Causes& causes, std::size_t cells = 20000);

  struct Verdict {
    double snr = 0, mean = 0, variance = 0, states = 0, memory = 0, jitter = 0, intensity = 0;
    double snr_with_free_nuisances = 0;  ///< Without the priors: what the data alone say.
    double rms_before_mm = 0, rms_floor_mm = 0;
    double log_likelihood_gain = 0;
    Eigen::VectorXd shift;        ///< Projected mean shift of every cell, mm.
    Eigen::VectorXd information;  ///< Squared signal-to-noise of every cell.
  };
  [[nodiscard]] Verdict judge(const Causes& causes) const;
  /// Signal-to-noise of the mean shift of `cause` that is left when each of `rivals`, of any size, may take
  /// what it can. One number for each rival.
  [[nodiscard]] std::vector<double> left_by(const Causes& cause, const std::vector<Causes>& rivals) const;

  struct Interval {
    double from, to;
  };
  /// Where along its coordinate of formats.md a cause is seen: thirtieths of its span in which the SNR is
  /// above half of the best one's.
  [[nodiscard]] std::vector<Interval> located(const Verdict& verdict, const Cause& cause) const;

 private:
  struct Cell {
    std::size_t capture;
    int seq, step;
    double weight;  ///< Samples it stands for.
    Expectation plain;
    double lever;  ///< mm per rad of beam angle.
    bool usable;   ///< Means may be compared: no edge near, not grazing.
  };
  [[nodiscard]] Eigen::VectorXd shift(const World& world) const;
  /// What is left of the means when mount and walls are fitted to them to all orders, and its squared
  /// signal-to-noise, what the priors resist with included.
  struct Refit {
    Eigen::VectorXd left, beta;  ///< mm of every cell; nuisances in standard deviations of their priors.
    double squares = 0;
  };
  [[nodiscard]] Refit left_at(const Eigen::VectorXd& beta, const std::vector<Expectation>& seen,
                              double stiffness) const;
  [[nodiscard]] Refit refit(const std::vector<Expectation>& seen, bool with_priors,
                            const Eigen::VectorXd& beta) const;
  [[nodiscard]] Eigen::VectorXd project(const Eigen::VectorXd& shift) const;
  /// Squared signal-to-noise in the logarithm of intensity, after the claimed law's coefficients and every
  /// wall's reflectance have been re-fitted under their uncertainties; added to `information`.
  [[nodiscard]] double intensity(const Causes& causes, Eigen::VectorXd& information) const;
  [[nodiscard]] double coordinate(const Cell& cell, const Cause& cause, const World& plain) const;

  const Session& session_;
  std::vector<Cell> cells_;
  Eigen::VectorXd weight_;    ///< Samples / variance; 0 where means are not compared.
  Eigen::MatrixXd nuisance_;  ///< Derivative of every cell's mean by every nuisance over its prior.
  Eigen::MatrixXd inverse_with_, inverse_without_;
};

/// Scales the cause until the oracle sees it at `snr` (at less if the cause cannot grow any more). Throws
/// std::runtime_error when the session does not show it at all.
void calibrate(const std::shared_ptr<Cause>& cause, Session& session, double snr);

}  // namespace challenge
