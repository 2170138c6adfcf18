// SPDX-License-Identifier: MIT
// The joint least-squares fit of fit_wall().
#include <algorithm>
#include <array>
#include <functional>
#include <stdexcept>

#include "fit/numeric/angle.hpp"
#include "fit/numeric/dense.hpp"
#include "fit/numeric/median.hpp"
#include "fit/range/wall_parts.hpp"

namespace fit::wall_parts {
namespace {

using Eigen::Vector2d;
using Vector6 = Eigen::Matrix<double, 6, 1>;
constexpr int most_effects = 12;
/// The six joint parameters, then the deviations in units of their standard uncertainty.
using JointVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 6 + most_effects, 1>;
using JointMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6 + most_effects, 6 + most_effects>;

/// One residual of the joint fit: how far the mean of a beam ends before its wall, in units of range.
struct JointRow {
  double error = 0, weight = 0;
  JointVector slope;
};

/// What a deviation does to a beam, for one standard uncertainty.
struct WallDeviation {
  double stage_rad = 0, beam_rad = 0, range_mm = 0;
};

struct JointEffect {
  AccuracyLine line;
  std::function<WallDeviation(const Station&, const WallBeam&)> act;
};

std::vector<JointEffect> effects_of(const DeviceAccuracy& accuracy) {
  std::vector<JointEffect> out;
  const auto lines = accuracy_in_words(accuracy);
  const auto add = [&](Systematic DeviceAccuracy::*member, const auto& act) {
    const double u = (accuracy.*member).u;
    if (u <= 0) return;
    const auto line = std::ranges::find(lines, member, &AccuracyLine::member);
    out.push_back({*line, [act, u](const Station& s, const WallBeam& b) { return act(s, b, u); }});
  };
  add(&DeviceAccuracy::stage_scale, [](const Station& s, const WallBeam&, double u) {
    return WallDeviation{.stage_rad = u * s.stage_rad};
  });
  add(&DeviceAccuracy::stage_backlash_rad, [](const Station& s, const WallBeam&, double u) {
    return WallDeviation{.stage_rad = -u / 2 * s.approach};
  });
  for (const bool sine : {true, false}) {
    const auto wave = [sine](double rad) { return (sine ? std::sin(rad) : std::cos(rad)) / std::sqrt(2.0); };
    add(&DeviceAccuracy::stage_eccentricity_rad, [wave](const Station& s, const WallBeam&, double u) {
      return WallDeviation{.stage_rad = u * wave(s.stage_rad)};
    });
    add(&DeviceAccuracy::beam_eccentricity_rad, [wave](const Station&, const WallBeam& b, double u) {
      return WallDeviation{.beam_rad = u * wave(b.angle)};
    });
  }
  add(&DeviceAccuracy::range_offset_mm,
      [](const Station&, const WallBeam&, double u) { return WallDeviation{.range_mm = u}; });
  add(&DeviceAccuracy::range_scale,
      [](const Station&, const WallBeam& b, double u) { return WallDeviation{.range_mm = u * b.range}; });
  for (int curve = 0; curve < walk_curves; ++curve)
    add(&DeviceAccuracy::range_walk_mm, [curve](const Station&, const WallBeam& b, double u) {
      return WallDeviation{
          .range_mm = b.counts > 0 ? u / std::sqrt(double{walk_curves}) * walk_curve(curve, b.counts) : 0};
    });
  return out;
}

struct WallModel {
  const WallInBench* walls;
  const std::vector<JointEffect>* effects;
  JointVector at;

  /// All deviations of a beam together, and `each` for one standard uncertainty.
  [[nodiscard]] WallDeviation deviation(const Station& station, const WallBeam& beam,
                                        std::array<WallDeviation, most_effects>& each) const {
    const double normal = walls[beam.wall].line.normal_rad + (beam.wall == 1 ? at[5] : 0);
    const double distance = at[3 + beam.wall];
    // They go with the range to be expected: with the noisy one, shorter ranges would have less noise.
    WallBeam expected = beam;
    const double shown_turn = normal - station.stage_rad;
    expected.range = (distance - at[1] * std::cos(shown_turn) - at[2] * std::sin(shown_turn)) /
                     std::max(0.1, std::cos(shown_turn - at[0] - beam.angle));
    WallDeviation off;
    for (std::size_t k = 0; k < effects->size(); ++k) {
      each[k] = (*effects)[k].act(station, expected);
      const double size = at[6 + static_cast<Eigen::Index>(k)];
      off.stage_rad += size * each[k].stage_rad;
      off.beam_rad += size * each[k].beam_rad;
      off.range_mm += size * each[k].range_mm;
    }
    return off;
  }

  /// n . (R(stage) (m + rho u(yaw + alpha))) = D, divided by the cosine of incidence: noise is that of range.
  /// Angles are those shown and their deviations, the range is the one shown less its own.
  [[nodiscard]] JointRow row(const Station& station, const WallBeam& beam) const {
    const double normal = walls[beam.wall].line.normal_rad + (beam.wall == 1 ? at[5] : 0);
    const double distance = at[3 + beam.wall];
    std::array<WallDeviation, most_effects> each;
    const WallDeviation off = deviation(station, beam, each);
    const double mount_turn = normal - station.stage_rad - off.stage_rad,
                 beam_turn = mount_turn - at[0] - beam.angle - off.beam_rad;
    const double c = std::cos(beam_turn), s = std::sin(beam_turn);
    const double mc = std::cos(mount_turn), ms = std::sin(mount_turn);
    const double range = beam.range - off.range_mm;
    const double ending = at[1] * mc + at[2] * ms + range * c;
    JointRow out;
    out.error = (ending - distance) / c;
    out.slope.setZero(at.size());
    out.slope[0] = range * s;
    out.slope[1] = mc;
    out.slope[2] = ms;
    out.slope[3 + beam.wall] = -1;
    const double by_stage = at[1] * ms - at[2] * mc + range * s;
    if (beam.wall == 1) out.slope[5] = -by_stage;
    for (std::size_t k = 0; k < effects->size(); ++k)
      out.slope[6 + static_cast<Eigen::Index>(k)] =
          each[k].stage_rad * by_stage + each[k].beam_rad * range * s - each[k].range_mm * c;
    out.slope /= c;
    out.weight = c > 0.2 ? beam.scans : 0;
    return out;
  }
};

struct JointSums {
  JointMatrix information;
  JointVector gradient;
  JointMatrix scatter;  ///< Of the captures' contributions to the gradient.
  double squares = 0;
  std::size_t rows = 0, captures = 0;
};

/// `scale`: standard deviation of one range; residuals beyond 2.5 of it count less (Huber).
JointSums accumulate(const WallModel& model, const std::vector<Station>& stations, double scale) {
  JointSums sums;
  const Eigen::Index n = model.at.size();
  sums.information.setZero(n, n), sums.gradient.setZero(n), sums.scatter.setZero(n, n);
  for (const Station& station : stations) {
    JointVector own = JointVector::Zero(n);
    bool any = false;
    for (const WallBeam& beam : station.beams) {
      if (beam.wall < 0) continue;
      const JointRow row = model.row(station, beam);
      if (row.weight <= 0) continue;
      const double size = std::abs(row.error) * std::sqrt(row.weight) / scale;
      const double w = row.weight * (size > 2.5 ? 2.5 / size : 1);
      sums.information.noalias() += w * row.slope * row.slope.transpose();
      own -= w * row.error * row.slope;
      sums.squares += w * row.error * row.error;
      ++sums.rows;
      any = true;
    }
    sums.gradient += own;
    sums.scatter += own * own.transpose();
    sums.captures += any;
  }
  return sums;
}

double scale_of(const WallModel& model, const std::vector<Station>& stations) {
  std::vector<double> sizes;
  for (const Station& station : stations)
    for (const WallBeam& beam : station.beams) {
      if (beam.wall < 0) continue;
      const JointRow row = model.row(station, beam);
      if (row.weight > 0) sizes.push_back(std::abs(row.error) * std::sqrt(row.weight));
    }
  return sizes.empty() ? 1 : std::max(1e-3, 1.4826 * median_of(sizes));
}

void check_observable(const JointSums& sums, std::size_t stations) {
  if (sums.rows < 50)
    throw std::invalid_argument(
        "The two walls were seen by only " + std::to_string(sums.rows) + " beams in " +
        std::to_string(stations) +
        " captures at rest. Check that the boards stand where the bench file says and nothing hides them");
  const Vector6 size = sums.information.diagonal().head<6>().cwiseSqrt();
  if (!(size.minCoeff() > 0))
    throw std::invalid_argument(
        "One of the two walls was not seen in any capture at rest. Check where the "
        "boards stand, and the names given as front and side");
}

/// Takes the deviations that were found off what the simpler ways are given.
void take_off(const WallModel& model, std::vector<Station>& stations) {
  std::array<WallDeviation, most_effects> each;
  for (Station& station : stations)
    for (WallBeam& beam : station.beams) {
      if (beam.wall < 0) continue;
      const WallDeviation off = model.deviation(station, beam, each);
      station.off_rad = off.stage_rad;
      beam.off_mm = off.range_mm;
      beam.off_rad = off.beam_rad;
      beam.range -= off.range_mm;
      beam.angle += off.beam_rad;
    }
}

}  // namespace

void check_turned(const std::vector<Station>& stations) {
  double widest = 0;
  for (const Station& a : stations)
    for (const Station& b : stations)
      widest = std::max(widest, std::abs(wrap_angle(a.stage_rad - b.stage_rad)));
  if (widest < 5 * rad_per_deg)
    throw std::invalid_argument(
        "The captures cannot separate the lidar's offset from the distances of the walls: the stage hardly "
        "turned "
        "between them. Capture at stage angles at least 20 deg apart, better over the whole turn");
}

void fit_joint(std::vector<Station>& stations, double yaw, const Mount& mount, const DeviceAccuracy& accuracy,
               WallFit& fit) {
  const std::vector<JointEffect> effects = effects_of(accuracy);
  const auto count = static_cast<Eigen::Index>(effects.size());
  WallModel model{fit.walls, &effects, JointVector::Zero(6 + count)};
  model.at.head<6>() << yaw, mount.x_mm.value, mount.y_mm.value, fit.walls[0].line.distance_mm,
      fit.walls[1].line.distance_mm, 0;
  // Deviations count in their standard uncertainties: before anything is seen, each is 0 +- 1.
  const auto with_expected = [&](JointSums& sums, double variance) {
    sums.information.diagonal().tail(count).array() += variance;
    sums.gradient.tail(count) -= variance * model.at.tail(count);
  };
  double scale = 1e6;  // first round: plain least squares
  for (int round = 0; round < 30; ++round) {
    JointSums sums = accumulate(model, stations, scale);
    if (round == 0) check_observable(sums, stations.size());
    with_expected(sums, std::pow(round == 0 ? 10 : scale, 2));
    const JointVector step = dense::solve_symmetric(sums.information, sums.gradient);
    model.at += step;
    scale = scale_of(model, stations);
    if (round > 3 && step.cwiseAbs().maxCoeff() < 1e-9) break;
  }
  JointSums sums = accumulate(model, stations, scale);
  fit.joint = model.at.head<6>();
  fit.beams = sums.rows;
  const double variance = sums.squares / std::max(1.0, static_cast<double>(sums.rows) - 6);
  fit.range_noise_mm = std::sqrt(variance);
  const JointMatrix seen = sums.information;
  with_expected(sums, variance);
  const JointMatrix inverse = dense::inverse(sums.information);
  JointMatrix from_ranges = variance * inverse * seen * inverse;
  fit.from_noise = from_ranges.topLeftCorner<6, 6>();
  if (sums.captures >= 8) {
    // Stage errors and the beams' own errors are common to a capture: where captures scatter more than their
    // beams allow, that scatter counts: the sandwich over clusters, each parameter's sum of which misses one
    // (Cameron & Miller, J. Human Resources 50 (2015) 317).
    const auto captures = static_cast<double>(sums.captures);
    fit.capture_freedom = captures - 1;
    const JointMatrix between = inverse * sums.scatter * inverse * captures / fit.capture_freedom;
    const JointVector widen =
        between.diagonal().cwiseQuotient(from_ranges.diagonal()).cwiseMax(1).cwiseSqrt();
    fit.capture_inflation = widen.head<6>().maxCoeff();
    from_ranges = widen.asDiagonal() * from_ranges * widen.asDiagonal();
  }
  fit.from_ranges = from_ranges.topLeftCorner<6, 6>();
  fit.covariance = fit.from_ranges;
  for (Eigen::Index k = 0; k < count; ++k) {
    // Of what is not known of a deviation beforehand, the captures leave this much.
    const Vector6 share = variance * inverse.col(6 + k).head<6>();
    double u2 = from_ranges(6 + k, 6 + k);
    for (Eigen::Index j = 0; j < count; ++j) u2 += std::pow(variance * inverse(6 + k, 6 + j), 2);
    fit.effects.push_back(
        {effects[static_cast<std::size_t>(k)].line, {model.at[6 + k], std::sqrt(u2)}, share});
    fit.covariance += share * share.transpose();
  }
  if (count > 0) take_off(model, stations);
  const Vector2d m = model.at.segment<2>(1);
  const Eigen::Matrix2d c = fit.covariance.block<2, 2>(1, 1);
  const double r = std::max(1e-9, m.norm());
  const Vector2d radial = m / r, tangential(-radial.y(), radial.x());
  fit.radius_mm = {r, std::sqrt(radial.dot(c * radial))};
  fit.direction_rad = {std::atan2(m.y(), m.x()), std::sqrt(tangential.dot(c * tangential)) / r};
}

}  // namespace fit::wall_parts
