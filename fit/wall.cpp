// SPDX-License-Identifier: MIT
#include "fit/wall.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <functional>
#include <iterator>
#include <numeric>
#include <stdexcept>

#include "fit/angle.hpp"
#include "fit/dense.hpp"
#include "fit/median.hpp"

namespace fit {
namespace {

using Eigen::Vector2d;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;
constexpr int most_effects = 12;
/// The six joint parameters, then the deviations in units of their standard uncertainty.
using JointVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 6 + most_effects, 1>;
using JointMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6 + most_effects, 6 + most_effects>;

/// The mean range of one beam over the scans of a capture, and the wall it sees.
struct WallBeam {
  double angle = 0, range = 0, scans = 0, counts = 0;
  double off_mm = 0;  ///< Deviation of the range, once it was found.
  int wall = -1;
  [[nodiscard]] Vector2d point() const { return {range * std::cos(angle), range * std::sin(angle)}; }
};

struct Station {
  double stage_rad = 0;
  double off_rad = 0;  ///< Deviation of that angle, once it was found.
  int approach = 0;
  std::vector<WallBeam> beams;
  std::vector<std::vector<std::uint16_t>> scans;  ///< Those that make points of the trajectory.
};

/// Mean of the samples near their median: what passes by now and then does not count.
void set_mean(WallBeam& beam, std::vector<double>& samples) {
  if (samples.empty()) return;
  const double middle = median_of(samples);
  std::vector<double> deviations;
  for (const double value : samples) deviations.push_back(std::abs(value - middle));
  const double gate = std::max(5.0, 5 * 1.4826 * median_of(deviations));
  double sum = 0;
  for (const double value : samples) {
    if (std::abs(value - middle) > gate) continue;
    sum += value;
    ++beam.scans;
  }
  beam.range = sum / beam.scans;
}

Station read_station(const Recording& recording, std::size_t index, std::size_t most_scans) {
  const CaptureInfo& capture = recording.captures()[index];
  const LidarGeometry& lidar = recording.bench().lidar;
  Station station;
  station.stage_rad = capture.stage_readback_rad.value_or(capture.stage_rad);
  station.approach = capture.approach;
  std::vector<std::vector<double>> samples;
  std::vector<double> counts, echoes;
  recording.for_each_scan(index, [&](const ScanView& scan) {
    if (scan.geometry) return;  // Scans whose beams differ cannot be averaged beam by beam.
    samples.resize(std::max(samples.size(), scan.range_mm.size()));
    counts.resize(samples.size()), echoes.resize(samples.size());
    for (std::size_t k = 0; k < scan.range_mm.size(); ++k) {
      if (scan.range_mm[k] < 20) continue;
      samples[k].push_back(scan.range_mm[k]);
      if (k < scan.intensity.size()) counts[k] += scan.intensity[k], echoes[k] += 1;
    }
    if (station.scans.size() < most_scans)
      station.scans.emplace_back(scan.range_mm.begin(), scan.range_mm.end());
  });
  station.beams.resize(samples.size());
  for (std::size_t k = 0; k < samples.size(); ++k) {
    station.beams[k].angle = lidar.beam_angle(capture.step_of(static_cast<int>(k)));
    set_mean(station.beams[k], samples[k]);
    if (echoes[k] > 0) station.beams[k].counts = counts[k] / echoes[k];
  }
  return station;
}

/// Lines in a station, longest first, with the beams on them.
struct DetectedLine {
  LineFit fit;
  std::vector<std::size_t> beams;
};

std::vector<DetectedLine> lines_of(const Station& station, double tolerance) {
  std::vector<std::size_t> left;
  for (std::size_t k = 0; k < station.beams.size(); ++k)
    if (station.beams[k].scans > 0) left.push_back(k);
  std::vector<DetectedLine> lines;
  RansacOptions options;
  options.tolerance = tolerance;
  while (lines.size() < 6 && left.size() >= 20) {
    std::vector<Vector2d> points;
    for (const std::size_t k : left) points.push_back(station.beams[k].point());
    const auto found = find_line(points, options);
    if (!found || found->inliers.size() < 20) break;
    DetectedLine line{found->fit, {}};
    for (const std::size_t i : found->inliers) line.beams.push_back(left[i]);
    std::vector<std::size_t> rest;
    std::set_difference(left.begin(), left.end(), line.beams.begin(), line.beams.end(),
                        std::back_inserter(rest));
    left = std::move(rest);
    lines.push_back(std::move(line));
  }
  return lines;
}

/// Beams at the ends of a run may see an edge or the corner.
std::vector<std::size_t> without_ends(const std::vector<std::size_t>& beams, std::size_t ends = 3) {
  std::vector<std::size_t> kept;
  for (std::size_t first = 0; first < beams.size();) {
    std::size_t last = first;
    while (last + 1 < beams.size() && beams[last + 1] <= beams[last] + 2) ++last;
    for (std::size_t i = first + ends; i + ends <= last; ++i) kept.push_back(beams[i]);
    first = last + 1;
  }
  return kept;
}

/// Marks each beam with the wall it sees: the line in which `wall` is expected, if there is one.
void assign(Station& station, const WallInBench* walls, double yaw, const WallOptions& options) {
  for (const DetectedLine& line : lines_of(station, options.tolerance_mm)) {
    for (int j = 0; j < 2; ++j) {
      const double expected = walls[j].line.normal_rad - station.stage_rad - yaw;
      if (std::abs(wrap_angle(line.fit.line.normal_rad - expected)) > 15 * rad_per_deg) continue;
      if (std::abs(line.fit.line.distance_mm - walls[j].line.distance_mm) > 400) continue;
      const bool taken = std::ranges::any_of(station.beams, [j](const WallBeam& b) { return b.wall == j; });
      if (taken) continue;
      for (const std::size_t k : without_ends(line.beams)) station.beams[k].wall = j;
    }
  }
}

// --- the boards ---------------------------------------------------------------------------------------

WallInBench in_bench(const Target& target) {
  const Vector2d n = target.outward_normal();
  return {target.name, {std::atan2(n.y(), n.x()), n.dot(target.from_mm)}, target.u_rad};
}

/// Without boards in the bench: the two longest square lines of the station nearest to stage angle 0, taken
/// to stand parallel and square to the stage's zero (the patent's premise).
void walls_from(const Station& station, double yaw, WallInBench* walls) {
  const auto lines = lines_of(station, 20);
  const auto place = [&](const DetectedLine& line) {
    const double normal = line.fit.line.normal_rad + station.stage_rad + yaw;
    return Line2{std::round(normal / (pi / 2)) * (pi / 2), line.fit.line.distance_mm};
  };
  for (std::size_t a = 0; a < lines.size(); ++a)
    for (std::size_t b = a + 1; b < lines.size(); ++b) {
      const Line2 first = place(lines[a]), second = place(lines[b]);
      if (std::abs(std::cos(first.normal_rad - second.normal_rad)) > 0.1) continue;
      const bool swap = std::abs(wrap_angle(second.normal_rad)) < std::abs(wrap_angle(first.normal_rad));
      walls[0] = {"front wall", swap ? second : first, 0};
      walls[1] = {"side wall", swap ? first : second, 0};
      return;
    }
  throw std::invalid_argument(
      "The bench names no two boards at a right angle, and none were found in the scan nearest to stage "
      "angle 0. "
      "Add both boards to the bench file, or name them with the options front and side");
}

void find_walls(const Bench& bench, const Station& nearest_zero, const WallOptions& options, WallFit& fit) {
  std::vector<const Target*> boards;
  for (const std::string& name : {options.front, options.side}) {
    if (name.empty()) continue;
    const Target* target = bench.target(name);
    if (!target) throw std::invalid_argument("The bench has no board named " + name);
    boards.push_back(target);
  }
  for (const Target& target : bench.targets) {
    if (boards.size() >= 2) break;
    if (std::ranges::find(boards, &target) != boards.end()) continue;
    const bool square =
        boards.empty() || std::abs(boards[0]->outward_normal().dot(target.outward_normal())) < 0.2;
    if (square) boards.push_back(&target);
  }
  if (boards.size() < 2) {
    walls_from(nearest_zero, bench.lidar.mount.yaw_rad.value, fit.walls);
    fit.notes.push_back(
        "The bench names no two boards at a right angle: the two longest walls at stage angle 0 were taken "
        "to "
        "stand parallel and square to the stage's zero.");
    return;
  }
  for (int j = 0; j < 2; ++j) fit.walls[j] = in_bench(*boards[static_cast<std::size_t>(j)]);
}

// --- joint least squares ------------------------------------------------------------------------------

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
  add(&DeviceAccuracy::stage_scale,
      [](const Station& s, const WallBeam&, double u) { return WallDeviation{.stage_rad = u * s.stage_rad}; });
  add(&DeviceAccuracy::stage_backlash_rad,
      [](const Station& s, const WallBeam&, double u) { return WallDeviation{.stage_rad = -u / 2 * s.approach}; });
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
      return WallDeviation{.range_mm = b.counts > 0 ? u / std::sqrt(double{walk_curves}) * walk_curve(curve, b.counts)
                                                : 0};
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

void check_turned(const std::vector<Station>& stations) {
  double widest = 0;
  for (const Station& a : stations)
    for (const Station& b : stations)
      widest = std::max(widest, std::abs(wrap_angle(a.stage_rad - b.stage_rad)));
  if (widest < 5 * rad_per_deg)
    throw std::invalid_argument(
        "The captures do not tell the lidar's offset from the distances of the walls: the stage hardly "
        "turned "
        "between them. Capture at stage angles at least 20 deg apart, better over the whole turn");
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
      beam.range -= off.range_mm;
      beam.angle += off.beam_rad;
    }
}

void fit_joint(std::vector<Station>& stations, double yaw, const Mount& mount,
               const DeviceAccuracy& accuracy, WallFit& fit) {
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
  if (sums.captures >= 8) {
    // Stage errors and the beams' own errors are common to a capture: where captures scatter more than their
    // beams allow, that scatter counts.
    const auto captures = static_cast<double>(sums.captures);
    fit.capture_freedom = std::max(1.0, captures - 6);
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
    fit.effects.push_back({effects[static_cast<std::size_t>(k)].line, {model.at[6 + k], std::sqrt(u2)}, share});
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

// --- the patent's ways --------------------------------------------------------------------------------

/// Both walls and the square beams of one scan.
WallObservation observation_of(const Station& station, std::size_t capture, const WallInBench* walls,
                               double yaw, const std::function<double(std::size_t)>& range) {
  WallObservation observation;
  observation.stage_rad = station.stage_rad;
  observation.off_rad = station.off_rad;
  observation.capture = capture;
  for (int j = 0; j < 2; ++j) {
    std::vector<Vector2d> points;
    const double square = walls[j].line.normal_rad - station.stage_rad - station.off_rad - yaw;
    double nearest = 1;
    for (std::size_t k = 0; k < station.beams.size(); ++k) {
      const WallBeam& beam = station.beams[k];
      const double mm = range(k);
      if (beam.wall != j || mm < 20 || std::abs(mm - beam.range) > 150) continue;
      points.emplace_back(mm * std::cos(beam.angle), mm * std::sin(beam.angle));
      const double off = std::abs(wrap_angle(beam.angle - square));
      if (off > 1 * rad_per_deg || off >= nearest) continue;
      nearest = off;
      observation.square_range_mm[j] = mm;
    }
    if (points.size() >= 20) observation.walls[j] = fit_line(points);
  }
  return observation;
}

/// Where the lidar is in the wall frame, from its distances to both walls. The frame's axes point away from
/// the walls and towards them; its origin is the corner.
Vector2d position_from(const WallInBench* walls, double corner, double front_mm, double side_mm) {
  Eigen::Matrix2d normals;
  normals.row(0) = walls[0].line.normal();
  const Line2 side{walls[1].line.normal_rad + corner, 0};
  normals.row(1) = side.normal();
  return normals.inverse() * Vector2d(-front_mm, -side_mm);
}

/// Direction of the offset: the phase at which the positions run round the circle's centre.
Estimate phase_of(const Circle& circle, const std::vector<Vector2d>& points,
                  const std::vector<double>& stages, const std::vector<std::size_t>& inliers, double rms) {
  double c = 0, s = 0;
  for (const std::size_t i : inliers) {
    const Vector2d arm = points[i] - circle.centre;
    const double angle = std::atan2(arm.y(), arm.x()) - stages[i];
    c += std::cos(angle), s += std::sin(angle);
  }
  const double n = std::max<double>(1, static_cast<double>(inliers.size()));
  return {std::atan2(s, c), rms / (std::max(1e-9, circle.radius) * std::sqrt(n))};
}

/// Both circles through the positions: the geometric one after RANSAC, and the algebraic one through the
/// same.
void add_circles(const std::string& way, const std::vector<Vector2d>& points,
                 const std::vector<double>& stages, bool algebraic_too, WallFit& fit) {
  WallCircle geometric{way, std::nullopt, {}, {}, points.size(), 0};
  const auto found = find_circle(points, 20, 10, 2000);
  if (found) {
    geometric.circle = found->fit;
    geometric.inliers = found->inliers.size();
    geometric.radius_mm = {found->fit.circle.radius, std::sqrt(found->fit.covariance(2, 2))};
    geometric.direction_rad = phase_of(found->fit.circle, points, stages, found->inliers, found->fit.rms);
  }
  fit.ways.push_back(geometric);
  if (!found || !algebraic_too) return;
  std::vector<Vector2d> kept;
  for (const std::size_t i : found->inliers) kept.push_back(points[i]);
  WallCircle algebraic = geometric;
  algebraic.way = way + ", algebraic circle";
  algebraic.circle = fit_circle_algebraic(kept);
  algebraic.radius_mm = {algebraic.circle->circle.radius, std::sqrt(algebraic.circle->covariance(2, 2))};
  algebraic.direction_rad =
      phase_of(algebraic.circle->circle, points, stages, found->inliers, algebraic.circle->rms);
  fit.ways.push_back(algebraic);
}

/// The stage angle at which the front wall is nearest, as the patent reads the direction of the offset.
void add_nearest_angle(WallFit& fit) {
  double least = 1e18, at = 0;
  for (const WallObservation& observation : fit.means) {
    if (!observation.walls[0] || observation.walls[0]->line.distance_mm >= least) continue;
    least = observation.walls[0]->line.distance_mm;
    at = observation.stage_rad;
  }
  if (least > 1e17) return;
  WallCircle way{"stage angle at which the front wall is nearest", std::nullopt, {}, {}, fit.means.size(), 0};
  way.direction_rad = {wrap_angle(fit.walls[0].line.normal_rad - at), 0};
  fit.ways.push_back(way);
}

void patent_angle(WallFit& fit) {
  std::vector<double> slopes;
  double from_lines = 0;
  for (const WallObservation& observation : fit.means) {
    if (std::abs(wrap_angle(observation.stage_rad)) > 0.05 * rad_per_deg || !observation.walls[0]) continue;
    slopes.push_back(wrap_angle(fit.walls[0].line.normal_rad - observation.stage_rad - observation.off_rad -
                                observation.walls[0]->line.normal_rad));
    from_lines += observation.walls[0]->covariance(0, 0);
  }
  fit.repeats = slopes.size();
  if (slopes.empty()) return;
  const auto n = static_cast<double>(slopes.size());
  const double mean = std::accumulate(slopes.begin(), slopes.end(), 0.0) / n;
  double squares = 0;
  for (const double slope : slopes) squares += (slope - mean) * (slope - mean);
  const double between = n >= 3 ? std::sqrt(squares / (n - 1) / n) : 0;
  fit.patent_angle_rad = {mean, std::max(between, std::sqrt(from_lines) / n)};
}

void fit_patent(const std::vector<Station>& stations, WallFit& fit) {
  const double yaw = fit.joint[0];
  std::vector<double> stages, single_stages;
  for (std::size_t i = 0; i < stations.size(); ++i) {
    const Station& station = stations[i];
    const auto observation = [&](const std::function<double(std::size_t)>& range) {
      return observation_of(station, i, fit.walls, yaw, range);
    };
    fit.means.push_back(observation([&](std::size_t k) { return station.beams[k].range; }));
    for (const auto& scan : station.scans) {
      const WallObservation now = observation(
          [&](std::size_t k) { return k < scan.size() ? double(scan[k]) - station.beams[k].off_mm : 0; });
      if (now.walls[0] && now.walls[1]) {
        fit.trajectory.push_back(position_from(fit.walls, fit.joint[5], now.walls[0]->line.distance_mm,
                                               now.walls[1]->line.distance_mm));
        stages.push_back(station.stage_rad + station.off_rad);
      }
      if (now.square_range_mm[0] > 0 && now.square_range_mm[1] > 0) {
        fit.single_beam.push_back(
            position_from(fit.walls, fit.joint[5], now.square_range_mm[0], now.square_range_mm[1]));
        single_stages.push_back(station.stage_rad + station.off_rad);
      }
    }
  }
  patent_angle(fit);
  add_circles("both walls in every scan, geometric circle", fit.trajectory, stages, true, fit);
  add_circles("patent: one square beam a wall, geometric circle", fit.single_beam, single_stages, true, fit);
  add_nearest_angle(fit);
}

}  // namespace

WallFit fit_wall(const std::vector<const Recording*>& recordings, const WallOptions& options) {
  WallFit fit;
  std::vector<Station> stations;
  std::size_t moving = 0, shifted = 0;
  for (const Recording* recording : recordings)
    for (std::size_t i = 0; i < recording->captures().size(); ++i) {
      const CaptureInfo& capture = recording->captures()[i];
      if (is_turning(capture)) {
        ++moving;
      } else if (capture.target_shift_mm != 0) {
        ++shifted;
      } else {
        stations.push_back(read_station(*recording, i, options.scans_per_capture));
      }
    }
  if (moving + shifted > 0)
    fit.notes.push_back(std::to_string(moving + shifted) +
                        " captures were left out: the stage turned, or a board was shifted.");
  if (stations.empty() || recordings.empty())
    throw std::invalid_argument("There is no capture with the stage at rest");
  const Bench& bench = recordings.front()->bench();
  const auto nearest = std::ranges::min_element(
      stations, {}, [](const Station& s) { return std::abs(wrap_angle(s.stage_rad)); });
  find_walls(bench, *nearest, options, fit);
  const double yaw = bench.lidar.mount.yaw_rad.value;
  for (Station& station : stations) assign(station, fit.walls, yaw, options);
  check_turned(stations);
  fit_joint(stations, yaw, bench.lidar.mount, options.accuracy, fit);
  fit_patent(stations, fit);
  return fit;
}

}  // namespace fit
