// SPDX-License-Identifier: MIT
#include "fit/motion/icp.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "fit/numeric/dense.hpp"
#include "fit/numeric/median.hpp"

namespace fit {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

Vector2d turned_left(const Vector2d& v) { return {-v.y(), v.x()}; }

/// Second moments of a run of points, in one pass.
struct Moments {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  void add(const Vector2d& d) {
    n += 1, x += d.x(), y += d.y();
    xx += d.x() * d.x(), xy += d.x() * d.y(), yy += d.y() * d.y();
  }
};

/// The line through points with these moments: unit normal, and how thick the points lie about it.
struct LocalLine {
  Vector2d centre, normal;
  double thick = 0, length = 0;
};

LocalLine line_of(const Moments& m) {
  const double cx = m.x / m.n, cy = m.y / m.n;
  const double xx = m.xx / m.n - cx * cx, xy = m.xy / m.n - cx * cy, yy = m.yy / m.n - cy * cy;
  const double half = 0.5 * (xx + yy), root = std::hypot(0.5 * (xx - yy), xy);
  const double along = 0.5 * std::atan2(2 * xy, xx - yy);
  return {{cx, cy},
          {-std::sin(along), std::cos(along)},
          std::sqrt(std::max(0.0, half - root)),
          std::sqrt(half + root)};
}

/// Adds neighbours on one side until they are too far away or the surface breaks off.
void add_side(Moments& moments, std::span<const Vector2d> sweep, std::size_t at, int direction,
              double radius_mm) {
  constexpr int most = 12;
  const Vector2d& origin = sweep[at];
  // Dense sweeps are thinned so that the radius is covered by a bounded number of points.
  const auto next = [&](std::size_t i, int step) {
    const std::ptrdiff_t n = static_cast<std::ptrdiff_t>(i) + direction * step;
    return n >= 0 && n < static_cast<std::ptrdiff_t>(sweep.size()) ? static_cast<std::size_t>(n)
                                                                   : sweep.size();
  };
  const std::size_t neighbour = next(at, 1);
  if (neighbour == sweep.size()) return;
  const double spacing = std::max(0.1, (sweep[neighbour] - origin).norm());
  const int stride = std::max(1, static_cast<int>(radius_mm / (spacing * most)));
  std::size_t i = at;
  for (int k = 0; k < most; ++k) {
    i = next(i, stride);
    if (i == sweep.size() || (sweep[i] - origin).squaredNorm() > radius_mm * radius_mm) return;
    moments.add(sweep[i] - origin);
  }
}

}  // namespace

std::vector<OrientedPoint> orient_sweep(std::span<const Vector2d> sweep, double radius_mm) {
  std::vector<OrientedPoint> points(sweep.size());
  for (std::size_t i = 0; i < sweep.size(); ++i) {
    points[i].at_mm = sweep[i];
    // Far away, beams lie farther apart than the radius: reach for two on each side.
    const double gap = std::max(i > 0 ? (sweep[i] - sweep[i - 1]).norm() : 0.0,
                                i + 1 < sweep.size() ? (sweep[i + 1] - sweep[i]).norm() : 0.0);
    const double radius = std::min(3 * radius_mm, std::max(radius_mm, 2.5 * gap));
    Moments moments;
    moments.add(Vector2d::Zero());
    add_side(moments, sweep, i, -1, radius);
    add_side(moments, sweep, i, +1, radius);
    if (moments.n < 4) continue;
    const LocalLine line = line_of(moments);
    if (line.thick > 0.25 * line.length) continue;
    points[i].normal = line.normal;
    points[i].at_mm += line.normal * line.normal.dot(line.centre);
  }
  return points;
}

/// Cells of equal size over the points' bounding box; a cell's points lie side by side.
struct PointCloud::Grid {
  std::vector<OrientedPoint> points;
  Vector2d low = Vector2d::Zero();
  double cell_mm = 1;
  int columns = 0, rows = 0;
  std::vector<std::uint32_t> first;  ///< Of each cell in `sorted`, and the end of the last.
  struct Entry {
    Vector2d at_mm;
    std::uint32_t index;
  };
  std::vector<Entry> sorted;

  explicit Grid(std::vector<OrientedPoint> given) : points(std::move(given)) {
    if (points.empty()) return;
    constexpr double least_cell_mm = 50, cells_a_point = 32;
    Vector2d high = low = points.front().at_mm;
    for (const OrientedPoint& p : points) low = low.cwiseMin(p.at_mm), high = high.cwiseMax(p.at_mm);
    const Vector2d size = high - low;
    // Few points far apart get larger cells: empty ones cost as well.
    const double most = cells_a_point * static_cast<double>(points.size()) + 1024;
    cell_mm = std::max({least_cell_mm, std::sqrt(size.x() * size.y() / most), size.maxCoeff() / most});
    columns = static_cast<int>(size.x() / cell_mm) + 1;
    rows = static_cast<int>(size.y() / cell_mm) + 1;
    first.assign(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows) + 1, 0);
    std::vector<std::uint32_t> cell_of(points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      cell_of[i] =
          static_cast<std::uint32_t>(row(points[i].at_mm.y()) * columns + column(points[i].at_mm.x()));
      ++first[cell_of[i] + 1];
    }
    for (std::size_t c = 1; c < first.size(); ++c) first[c] += first[c - 1];
    std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
    sorted.resize(points.size());
    for (std::size_t i = 0; i < points.size(); ++i)
      sorted[next[cell_of[i]]++] = {points[i].at_mm, static_cast<std::uint32_t>(i)};
  }

  // Of places near the points; others may lie outside 0 to columns, rows.
  [[nodiscard]] int column(double x) const { return static_cast<int>(std::floor((x - low.x()) / cell_mm)); }
  [[nodiscard]] int row(double y) const { return static_cast<int>(std::floor((y - low.y()) / cell_mm)); }

  /// Visits the entries of the cells of one row from one column to another.
  template <class Visit>
  void for_each_in(int at_row, int from, int to, Visit visit) const {
    from = std::max(from, 0), to = std::min(to, columns - 1);
    if (at_row < 0 || at_row >= rows || from > to) return;
    const auto start = static_cast<std::size_t>(at_row) * static_cast<std::size_t>(columns);
    const std::uint32_t begin = first[start + static_cast<std::size_t>(from)],
                        end = first[start + static_cast<std::size_t>(to) + 1];
    for (std::uint32_t k = begin; k < end; ++k) visit(sorted[k]);
  }
};

PointCloud::PointCloud() : PointCloud(std::vector<OrientedPoint>{}) {}
PointCloud::PointCloud(std::vector<OrientedPoint> points)
    : grid_(std::make_unique<Grid>(std::move(points))) {}
PointCloud::PointCloud(PointCloud&&) noexcept = default;
PointCloud& PointCloud::operator=(PointCloud&&) noexcept = default;
PointCloud::~PointCloud() = default;

const std::vector<OrientedPoint>& PointCloud::points() const { return grid_->points; }

const OrientedPoint* PointCloud::nearest(const Vector2d& at, double reach_mm) const {
  const Grid& grid = *grid_;
  if (grid.points.empty() || !at.allFinite()) return nullptr;
  // Rings of cells around the one of the place, until nothing nearer can lie in the next.
  double least = reach_mm * reach_mm;
  const OrientedPoint* found = nullptr;
  const Vector2d from_low = at - grid.low;
  if (from_low.x() < -reach_mm || from_low.y() < -reach_mm ||
      from_low.x() > grid.columns * grid.cell_mm + reach_mm ||
      from_low.y() > grid.rows * grid.cell_mm + reach_mm)
    return nullptr;
  const int column = grid.column(at.x()), row = grid.row(at.y());
  const Vector2d within = from_low - grid.cell_mm * Vector2d(column, row);
  const double to_edge =
      std::min({within.x(), within.y(), grid.cell_mm - within.x(), grid.cell_mm - within.y()});
  const auto visit = [&](const Grid::Entry& entry) {
    const double squared = (entry.at_mm - at).squaredNorm();
    if (squared <= least) least = squared, found = &grid.points[entry.index];
  };
  for (int ring = 0;; ++ring) {
    const double nearest_mm = ring == 0 ? 0 : to_edge + (ring - 1) * grid.cell_mm;
    if (nearest_mm * nearest_mm > least) break;
    if (ring == 0) {
      grid.for_each_in(row, column, column, visit);
      continue;
    }
    grid.for_each_in(row - ring, column - ring, column + ring, visit);
    grid.for_each_in(row + ring, column - ring, column + ring, visit);
    for (int r = row - ring + 1; r < row + ring; ++r) {
      grid.for_each_in(r, column - ring, column - ring, visit);
      grid.for_each_in(r, column + ring, column + ring, visit);
    }
  }
  return found;
}

std::vector<std::size_t> PointCloud::within(const Vector2d& at, double radius_mm) const {
  const Grid& grid = *grid_;
  std::vector<std::size_t> indices;
  if (grid.points.empty() || !at.allFinite()) return indices;
  const auto clamped = [](double cells, int most) {
    return static_cast<int>(std::clamp(std::floor(cells), -1.0, static_cast<double>(most)));
  };
  const Vector2d low = (at.array() - radius_mm - grid.low.array()) / grid.cell_mm,
                 high = (at.array() + radius_mm - grid.low.array()) / grid.cell_mm;
  for (int r = clamped(low.y(), grid.rows); r <= clamped(high.y(), grid.rows); ++r)
    grid.for_each_in(r, clamped(low.x(), grid.columns), clamped(high.x(), grid.columns),
                     [&](const Grid::Entry& entry) {
                       if ((entry.at_mm - at).squaredNorm() < radius_mm * radius_mm)
                         indices.push_back(entry.index);
                     });
  return indices;
}

Pose2 closed_form_motion(std::span<const Vector2d> from, std::span<const Vector2d> to) {
  Vector2d from_mean = Vector2d::Zero(), to_mean = Vector2d::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) from_mean += from[i], to_mean += to[i];
  from_mean /= static_cast<double>(from.size());
  to_mean /= static_cast<double>(from.size());
  Eigen::Matrix2d w = Eigen::Matrix2d::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) w += (to[i] - to_mean) * (from[i] - from_mean).transpose();
  // The turn that makes tr(R^T w) greatest: in the plane, Kabsch's algorithm needs no decomposition.
  const Pose2 turn{0, 0, std::atan2(w(1, 0) - w(0, 1), w(0, 0) + w(1, 1))};
  const Vector2d t = to_mean - turn * from_mean;
  return {t.x(), t.y(), turn.heading_rad};
}

Pose2 SpreadCorrection::at(double share) const {
  const Vector3d d = start + share * growth;
  const Pose2 turn{0, 0, d[2]};
  const Vector2d moved = pivot + d.head<2>() - turn * pivot;
  return {moved.x(), moved.y(), d[2]};
}

Vector2d SpreadCorrection::apply(const SpreadPoint& point) const {
  const Vector3d d = start + point.share * growth;
  const double c = std::cos(d[2]), s = std::sin(d[2]);
  const Vector2d arm = point.at_mm - pivot;
  return pivot + d.head<2>() + Vector2d(c * arm.x() - s * arm.y(), s * arm.x() + c * arm.y());
}

namespace {

struct Pair {
  double error = 0, share = 0;
  Vector3d row;  ///< Derivative of the error by a motion (mm, mm, rad about the pivot).
};

std::vector<Pair> make_pairs(const PointCloud& reference, std::span<const SpreadPoint> points,
                             const SpreadCorrection& correction, double reach_mm, std::size_t most) {
  std::vector<Pair> pairs;
  const std::size_t stride = std::max<std::size_t>(1, (points.size() + most - 1) / most);
  pairs.reserve(points.size() / stride + 1);
  for (std::size_t i = 0; i < points.size(); i += stride) {
    const Vector2d at = correction.apply(points[i]);
    const OrientedPoint* target = reference.nearest(at, reach_mm);
    if (!target || target->normal.isZero()) continue;
    const Vector2d& n = target->normal;
    pairs.push_back({n.dot(at - target->at_mm),
                     points[i].share,
                     {n.x(), n.y(), n.dot(turned_left(at - correction.pivot))}});
  }
  return pairs;
}

double robust_scale(const std::vector<Pair>& pairs, double least_mm) {
  std::vector<double> sizes;
  sizes.reserve(pairs.size());
  for (const Pair& pair : pairs) sizes.push_back(std::abs(pair.error));
  return std::max(least_mm, 1.4826 * median_of(sizes));
}

/// Normal equations of the six unknowns (start, growth).
struct Normal6 {
  Matrix6 information = Matrix6::Zero();
  Vector6 gradient = Vector6::Zero();
  Eigen::Matrix3d rigid = Eigen::Matrix3d::Zero();
};

Normal6 accumulate(const std::vector<Pair>& pairs, double scale, double points_per_fact) {
  Eigen::Matrix3d h0 = Eigen::Matrix3d::Zero(), h1 = h0, h2 = h0;
  Vector3d g0 = Vector3d::Zero(), g1 = g0;
  const double cut = 2.385 * scale, unit = 1 / (scale * scale * points_per_fact);
  for (const Pair& pair : pairs) {
    const double ratio = pair.error / cut, w = unit / (1 + ratio * ratio);  // Cauchy
    const Eigen::Matrix3d outer = w * pair.row * pair.row.transpose();
    h0 += outer;
    h1 += pair.share * outer;
    h2 += pair.share * pair.share * outer;
    const Vector3d g = w * pair.error * pair.row;
    g0 -= g;
    g1 -= pair.share * g;
  }
  Normal6 normal;
  normal.information << h0, h1, h1, h2;
  normal.gradient << g0, g1;
  normal.rigid = h0;
  return normal;
}

double observability_of(const Eigen::Matrix3d& rigid) {
  const double sum = rigid(0, 0) + rigid(1, 1);
  if (!(sum > 0)) return 0;
  // The heading counts by the lever at which the points see it.
  const double lever = std::sqrt(std::max(1e-9, rigid(2, 2) / sum));
  const Vector3d scale(1, 1, 1 / lever);
  const Eigen::VectorXd values =
      dense::symmetric_eigen(scale.asDiagonal() * rigid * scale.asDiagonal()).values;
  return std::max(0.0, values[0]) / std::max(1e-300, values[2]);
}

}  // namespace

SpreadResult match_spread(const PointCloud& reference, std::span<const SpreadPoint> points,
                          const Vector2d& pivot, const SpreadPrior& prior, const IcpOptions& options) {
  Matrix6 trust = Matrix6::Zero();
  trust.topLeftCorner<3, 3>() = prior.start_covariance.inverse();
  trust.bottomRightCorner<3, 3>() = prior.growth_u.cwiseAbs2().cwiseInverse().asDiagonal();
  SpreadResult result;
  result.correction.pivot = pivot;
  result.end_covariance = prior.start_covariance;
  result.end_covariance.diagonal() += prior.growth_u.cwiseAbs2();
  double reach = options.reach_mm;
  for (int i = 0; i < options.iterations && !result.converged; ++i) {
    const auto pairs = make_pairs(reference, points, result.correction, reach, options.most_points);
    result.pairs = pairs.size();
    if (pairs.size() < 10) return result;
    result.noise_mm = robust_scale(pairs, options.least_noise_mm);
    const Normal6 normal = accumulate(pairs, result.noise_mm, options.points_per_fact);
    Vector6 now;
    now << result.correction.start, result.correction.growth;
    const Matrix6 information = normal.information + trust;
    const Vector6 step = dense::solve_symmetric(information, normal.gradient - trust * now);
    result.correction.start += step.head<3>();
    result.correction.growth += step.tail<3>();
    result.iterations = i + 1;
    result.observability = observability_of(normal.rigid);
    const Matrix6 covariance = dense::inverse(information);
    result.end_covariance = covariance.topLeftCorner<3, 3>() + covariance.topRightCorner<3, 3>() +
                            covariance.bottomLeftCorner<3, 3>() + covariance.bottomRightCorner<3, 3>();
    reach = std::clamp(8 * result.noise_mm, 40.0, options.reach_mm);
    result.converged = i > 0 && step.head<2>().norm() + step.segment<2>(3).norm() < 0.05 &&
                       std::abs(step[2]) + std::abs(step[5]) < 5e-5;
  }
  return result;
}

IcpResult match_to_lines(const PointCloud& reference, std::span<const Vector2d> points, const Pose2& guess,
                         const PosePrior& prior, const IcpOptions& options) {
  std::vector<SpreadPoint> spread;
  spread.reserve(points.size());
  for (const Vector2d& p : points) spread.push_back({guess * p, 0});
  SpreadPrior rigid;
  rigid.start_covariance =
      Vector3d(prior.u_mm * prior.u_mm, prior.u_mm * prior.u_mm, prior.u_rad * prior.u_rad).asDiagonal();
  rigid.growth_u.setConstant(1e-9);
  const SpreadResult found = match_spread(reference, spread, guess.position(), rigid, options);
  IcpResult result;
  result.pose = found.correction.at(0) * guess;
  result.covariance = found.end_covariance;
  result.noise_mm = found.noise_mm;
  result.observability = found.observability;
  result.pairs = found.pairs;
  result.iterations = found.iterations;
  result.converged = found.converged;
  return result;
}

IcpResult match_to_points(const PointCloud& reference, std::span<const Vector2d> points, const Pose2& guess,
                          const IcpOptions& options) {
  IcpResult result;
  result.pose = guess;
  const std::size_t stride =
      std::max<std::size_t>(1, (points.size() + options.most_points - 1) / options.most_points);
  for (int i = 0; i < options.iterations && !result.converged; ++i) {
    std::vector<Vector2d> from, to;
    double squares = 0;
    for (std::size_t k = 0; k < points.size(); k += stride) {
      const Vector2d at = result.pose * points[k];
      const OrientedPoint* target = reference.nearest(at, options.reach_mm);
      if (!target) continue;
      from.push_back(at);
      to.push_back(target->at_mm);
      squares += (at - target->at_mm).squaredNorm();
    }
    result.pairs = from.size();
    if (from.size() < 10) return result;
    const Pose2 step = closed_form_motion(from, to);
    const Pose2 before = result.pose;
    result.pose = step * result.pose;
    result.noise_mm = std::sqrt(squares / static_cast<double>(from.size()));
    result.iterations = i + 1;
    result.converged =
        (result.pose.position() - before.position()).norm() < 0.05 && std::abs(step.heading_rad) < 5e-5;
  }
  return result;
}

}  // namespace fit
