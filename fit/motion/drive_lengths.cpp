// SPDX-License-Identifier: MIT
#include "fit/motion/drive_lengths.hpp"

#include <algorithm>
#include <cmath>

#include "fit/numeric/angle.hpp"

namespace fit {
namespace {

/// The values for an endless way, of `value + c / multiple`, weighted by each length's own u.
Vector6 endless(const std::vector<DriveLength>& lengths, const std::vector<Vector6>& values) {
  Vector6 out;
  for (int p = 0; p < 6; ++p) {
    double w = 0, x = 0, y = 0, xx = 0, xy = 0;
    for (std::size_t i = 0; i < lengths.size(); ++i) {
      const double weight = 1 / std::max(1e-18, lengths[i].u[p] * lengths[i].u[p]);
      const double at = 1 / lengths[i].multiple, value = values[i][p];
      w += weight, x += weight * at, y += weight * value, xx += weight * at * at, xy += weight * at * value;
    }
    const double c = (w * xy - x * y) / (w * xx - x * x);
    out[p] = (y - c * x) / w;
  }
  return out;
}

}  // namespace

void choose_length(DriveFit& out, const std::vector<std::vector<WheelSample>>& samples,
                   const std::vector<OdometryFit>& fits, double range_scale) {
  const std::size_t segments = out.lengths.front().without.size();
  const bool several =
      out.lengths.size() >= 3 && segments >= 4 &&
      std::ranges::all_of(out.lengths, [&](const auto& l) { return l.without.size() == segments; });
  Vector6 tends_to = Vector6::Zero(), tends_to_u = Vector6::Zero();
  std::vector<Vector6> tends_without;
  if (several) {
    std::vector<Vector6> values;
    for (const DriveLength& length : out.lengths) values.push_back(length.values);
    tends_to = endless(out.lengths, values);
    for (std::size_t g = 0; g < segments; ++g) {
      for (std::size_t i = 0; i < values.size(); ++i) values[i] = out.lengths[i].without[g];
      tends_without.push_back(endless(out.lengths, values));
    }
    tends_to_u = jackknife(tends_without).diagonal().cwiseSqrt();
  }
  const auto drift_of = [&](const DriveLength& length) -> Vector6 {
    Vector6 drift = several ? Vector6(tends_to - length.values) : Vector6(Vector6::Zero());
    drift[5] = wrap_angle(drift[5]);
    return drift;
  };
  const auto expected = [&](const DriveLength& length) {
    Vector6 chance = Vector6::Zero();
    if (several) {
      std::vector<Vector6> difference;
      for (std::size_t g = 0; g < segments; ++g) difference.push_back(tends_without[g] - length.without[g]);
      chance = jackknife(difference).diagonal();
    }
    const Vector6 beyond = (drift_of(length).cwiseAbs2() - chance).cwiseMax(0);
    return (length.u.cwiseAbs2() + beyond).array().log().sum();
  };
  std::size_t best = 0;
  for (std::size_t i = 1; i < out.lengths.size(); ++i)
    if (expected(out.lengths[i]) < expected(out.lengths[best])) best = i;
  out.extrapolated = several && tends_to_u.cwiseAbs2().array().log().sum() < expected(out.lengths[best]);
  if (out.extrapolated) best = out.lengths.size() - 1;
  out.lengths[best].taken = true;
  out.samples = samples[best];
  out.odometry = fits[best];
  out.drift = drift_of(out.lengths[best]);
  Vector6 u = out.lengths[best].u;
  if (out.extrapolated) {
    out.odometry.robot = RobotGeometry::from(tends_to);
    u = tends_to_u;
  }
  out.jackknife_u = u;
  widen_to(out.odometry.covariance, (u.cwiseAbs2() + out.drift.cwiseAbs2() / 3).cwiseSqrt());
  // The lidar's scale is in every length alike, as a limit whose values are equally likely (GUM 4.3.7).
  Vector6 by_scale = range_scale / std::sqrt(3.0) * out.odometry.robot.vector();
  by_scale[5] = 0;
  out.odometry.covariance += by_scale * by_scale.transpose();
}

}  // namespace fit
