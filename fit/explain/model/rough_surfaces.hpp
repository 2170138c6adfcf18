// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Dense>
#include <map>
#include <vector>

namespace fit::explain::model {

/// Small bumps of targets, seen from wherever their place is seen: a random effect of places. A tree of
/// stretches along every target stands for a random walk, whose variance grows with the distance: every
/// stretch lies off by an amount of its own, out along the normal, and its parts by amounts of theirs.
class RoughSurfaces {
 public:
  /// Of every target, the standard deviation of the difference of two places a metre apart.
  using Steps = std::map<int, double>;
  struct Place {
    int target = 0, group = 0;
    double along_mm = 0;
    double weight = 0;  ///< What a mm of range does to the row, whose own noise is one ...
    double slope = 0;   ///< ... and a mm out along the normal.
  };
  /// The rows on every stretch of one length.
  struct Level {
    double length_mm = 0;
    std::vector<std::vector<Eigen::Index>> stretches;
  };
  /// Of all lengths, the shortest first. One place for each row.
  [[nodiscard]] static std::vector<Level> tree_of(const std::vector<Place>& places);

  RoughSurfaces(const std::vector<Place>& places, const std::vector<Level>& tree, Steps steps_mm);

  /// Rows of unit noise divided by the square root of the covariance. Disjoint stretches are divided out one
  /// after the other, the finest first: every coarser one holds whole finer ones.
  void whiten(Eigen::MatrixXd& columns) const;
  [[nodiscard]] double log_determinant() const;
  /// The part of a target's rows in it.
  [[nodiscard]] double log_determinant_of(int target) const;
  [[nodiscard]] const Steps& steps_mm() const { return steps_mm_; }
  /// Of one place of a target, on all lengths together, mm^2.
  [[nodiscard]] double variance_mm2(int target) const;

 private:
  struct Stretch {
    std::size_t first, last;  ///< Of `rows_` and `z_`.
    double shrink;            ///< (1 - 1 / sqrt(1 + z'z)) / z'z.
  };
  void whiten(Eigen::Ref<Eigen::VectorXd> column) const;

  std::vector<Stretch> stretches_;
  std::vector<Eigen::Index> rows_;
  std::vector<double> z_;
  Steps steps_mm_;
  std::map<int, double> log_determinants_;  ///< By target.
};

/// Surfaces, and of each target that is rougher than the others or than boards are, the log-likelihood that
/// that gains.
struct LikeliestSurfaces {
  RoughSurfaces surfaces;
  std::map<int, double> odd;
};

/// Surfaces with which residuals of unit noise are the most likely, by a prior around what a good board has,
/// within three of its standard deviations; a target that is clearly unlike the others has a size of its own.
/// What is left over may be something else's, which differs little within one target: a line along each, in
/// every group, says nothing. What strains the prior by more than a form costs is no board; a size of its own
/// is a form.
[[nodiscard]] LikeliestSurfaces likeliest_surfaces(const std::vector<RoughSurfaces::Place>& places,
                                                   const Eigen::VectorXd& residual);

}  // namespace fit::explain::model
