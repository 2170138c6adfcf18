// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Dense>
#include <span>
#include <vector>

#include "fit/explain/model/scans.hpp"

namespace fit::explain::model {

/// What whole scans have at random beside their samples' noise, of the range or of the angle.
struct RandomOfScans {
  double fresh = 0,
         slow = 0;  ///< Variance of what is drawn anew for every scan, and of an AR(1), mm^2 or rad^2.
  double own = 0;   ///< Share of the samples' noise that is autoregressive, each beam's by itself.
  double rho = 0;   ///< Correlation from scan to scan, of both.
};

/// Of the autocorrelation of whole scans, what single beams do not show each by itself is the scan's.
[[nodiscard]] RandomOfScans random_of_scans(const Reduced& reduced, const ScatterOfScans& scatter);

/// Noise of what the parts of one group's scans show: their samples' own, and the range and the angle that
/// all parts of a scan share. Each of these may be drawn anew for every scan, and may be autoregressive from
/// scan to scan, AR(1). A filter in time leaves white noise, the innovations of Kalman (1960).
class NoiseOfScans {
 public:
  /// Of neighbouring rows from `first` on, scan after scan.
  NoiseOfScans(Eigen::Index first, std::span<const ScanPart> parts, const RandomOfScans& range,
               const RandomOfScans& angle);
  /// Divides their part of the columns by the square root of the covariance, less what the blocks' means
  /// explain: another channel has these.
  void whiten(Eigen::MatrixXd& columns) const;

 private:
  /// The filter at the rows of one scan, which are in units of their samples' noise.
  struct Step {
    Eigen::Index first, rows;
    Eigen::MatrixXd sees;              ///< Rows x states.
    Eigen::MatrixXd gain;              ///< States x rows, for the innovation.
    Eigen::LLT<Eigen::MatrixXd> root;  ///< Of the innovation's covariance.
  };
  void filter(Eigen::Ref<Eigen::MatrixXd> rows) const;

  Eigen::Index first_, rows_;
  Eigen::VectorXd weight_;  ///< One over the standard deviation of the samples' noise, of every row.
  Eigen::VectorXd keeps_;   ///< Of every state from scan to scan.
  std::vector<Step> steps_;
  Eigen::MatrixXd means_;  ///< Orthonormal columns.
};

}  // namespace fit::explain::model
