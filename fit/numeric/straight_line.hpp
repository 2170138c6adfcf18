// SPDX-License-Identifier: MIT
#pragma once

namespace fit {

/// The straight line of y over x by least squares, point by point.
class StraightLine {
 public:
  void add(double x, double y, double weight = 1) {
    n_ += weight;
    const double dx = x - x_, dy = y - y_, before = (n_ - weight) / n_ * weight;
    xx_ += before * dx * dx;
    xy_ += before * dx * dy;
    yy_ += before * dy * dy;
    x_ += dx * weight / n_;
    y_ += dy * weight / n_;
  }
  /// How many were added, or the sum of their weights.
  [[nodiscard]] double points() const { return n_; }
  /// Sum of squares of x about its mean.
  [[nodiscard]] double spread() const { return xx_; }
  /// Of x, and of y.
  [[nodiscard]] double middle() const { return x_; }
  [[nodiscard]] double mean() const { return y_; }
  /// Not a number of fewer than two places.
  [[nodiscard]] double slope() const { return xy_ / xx_; }
  [[nodiscard]] double at(double x) const { return y_ + slope() * (x - x_); }
  /// Sum of squares of y about the line.
  [[nodiscard]] double off() const { return yy_ - slope() * xy_; }

 private:
  double n_ = 0, x_ = 0, y_ = 0, xx_ = 0, xy_ = 0, yy_ = 0;
};

}  // namespace fit
