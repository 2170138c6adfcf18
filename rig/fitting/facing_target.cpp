// SPDX-License-Identifier: MIT
#include "rig/fitting/facing_target.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "fit/echo.hpp"
#include "fit/numeric/median.hpp"
#include "fit/numeric/number_format.hpp"

namespace rig {
namespace {

using Eigen::Vector2d;

/// The flat piece that holds the beam square on the board: from where along the board to where, and how far
/// what is seen beyond lies behind it (negative: in front); NaN where nothing is.
struct Face {
  double from_mm = 0, to_mm = 0, behind_left_mm = std::nan(""), behind_right_mm = std::nan("");
};

/// Medians of the depth over bins one beam wide, followed from the middle to both sides as long as they do
/// not jump by more than twice the scatter of single samples, and never by less than 15 mm. None when nothing
/// is seen there.
std::optional<Face> face_of(const std::vector<Vector2d>& seen, const FacingTarget& board, double bin_mm) {
  constexpr double least_step_mm = 15;
  const Vector2d along(-board.normal.y(), board.normal.x());
  std::map<long, std::vector<double>> bins;
  for (const Vector2d& p : seen) bins[std::lround(along.dot(p) / bin_mm)].push_back(board.normal.dot(p));
  if (bins.empty()) return std::nullopt;
  // Noise carries a few samples of the outermost beams farther out, the longest alone.
  constexpr double own_beam = 0.25;  // of the usual number in a bin
  std::vector<double> counts;
  for (const auto& [place, depths] : bins) counts.push_back(static_cast<double>(depths.size()));
  const double fewest = own_beam * fit::median_of(counts);
  std::erase_if(bins, [&](const auto& bin) { return static_cast<double>(bin.second.size()) < fewest; });
  struct Bin {
    double at_mm, depth_mm;
  };
  std::vector<Bin> profile;
  std::vector<double> scatter;
  for (auto& [place, depths] : bins) {
    const double middle = fit::median_of(depths);
    profile.push_back({static_cast<double>(place) * bin_mm, middle});
    for (double& depth : depths) depth = std::abs(depth - middle);
    if (depths.size() >= 5) scatter.push_back(1.4826 * fit::median_of(depths));
  }
  const double step_mm = std::max(least_step_mm, 2 * fit::median_of(scatter));
  const auto nearest = static_cast<std::size_t>(
      std::ranges::min_element(profile, {}, [](const Bin& b) { return std::abs(b.at_mm); }) -
      profile.begin());
  if (std::abs(profile[nearest].at_mm) > 3 * bin_mm) return std::nullopt;
  // Against the median of the last five of the face: one bin between two surfaces does not hide a step.
  const auto follow = [&](std::ptrdiff_t direction, double& behind_mm) {
    std::size_t last = nearest;
    for (std::ptrdiff_t i = static_cast<std::ptrdiff_t>(nearest) + direction;
         i >= 0 && i < std::ssize(profile); i += direction) {
      std::vector<double> recent;
      for (std::ptrdiff_t k = i - direction; std::ssize(recent) < 5 && k >= 0 && k < std::ssize(profile) &&
                                             (k - static_cast<std::ptrdiff_t>(nearest)) * direction >= 0;
           k -= direction)
        recent.push_back(profile[static_cast<std::size_t>(k)].depth_mm);
      const double jump = profile[static_cast<std::size_t>(i)].depth_mm - fit::median_of(recent);
      if (std::abs(jump) > step_mm) {
        // What lies well beyond the step, not the beam that sees both.
        const std::ptrdiff_t beyond =
            std::clamp<std::ptrdiff_t>(i + 2 * direction, 0, std::ssize(profile) - 1);
        behind_mm = profile[static_cast<std::size_t>(beyond)].depth_mm - fit::median_of(recent);
        break;
      }
      last = static_cast<std::size_t>(i);
    }
    return profile[last].at_mm;
  };
  Face face;
  face.to_mm = follow(+1, face.behind_left_mm) + 0.5 * bin_mm;
  face.from_mm = follow(-1, face.behind_right_mm) - 0.5 * bin_mm;
  return face;
}

std::string step_in_target(const Face& face) {
  std::string said;
  const auto side = [&](double behind_mm, double at_mm, const char* where) {
    if (std::isfinite(behind_mm))
      said += (said.empty() ? "" : "; ") + std::string("from ") + fit::format_fixed(std::abs(at_mm), 0) +
              " mm to the " + where + " of the square beam on, it lies " +
              fit::format_fixed(std::abs(behind_mm), 0) + " mm " +
              (behind_mm > 0 ? "farther away" : "nearer");
  };
  side(face.behind_left_mm, face.to_mm, "left");
  side(face.behind_right_mm, face.from_mm, "right");
  return said;
}

/// Errors of neighbouring beams go together (surface, walk error): ten samples count as one.
constexpr double samples_in_one = 10;
constexpr double least_u_rad = 1e-4;
constexpr std::size_t least_points = 50;

/// A sample on the target, and the direction of its beam.
struct Echo {
  double direction_rad, range_mm;
  [[nodiscard]] Vector2d point() const {
    return range_mm * Vector2d(std::cos(direction_rad), std::sin(direction_rad));
  }
};

/// Turns a plane's normal until it is square on the points. `slope` of depth against place along the target.
SeenNormal normal_of_plane(std::vector<Vector2d> seen, const FacingTarget& board, double bin_mm) {
  const SeenNormal by_bench{board.normal_rad, board.u_normal_rad, false, {}};
  const Vector2d along(-board.normal.y(), board.normal.x());
  std::string said;
  if (const auto face = face_of(seen, board, bin_mm)) {
    said = step_in_target(*face);
    std::erase_if(seen, [&](const Vector2d& p) {
      const double at = along.dot(p);
      return at < face->from_mm || at > face->to_mm;
    });
  }
  double slope = 0, sigma = 0, spread = 0;
  for (int round = 0; round < 4; ++round) {
    if (seen.size() < least_points) return {by_bench.rad, by_bench.u_rad, false, said};
    const auto n = static_cast<double>(seen.size());
    Vector2d mean = Vector2d::Zero();
    for (const Vector2d& p : seen) mean += p / n;
    double square = 0, product = 0, residual = 0;
    for (const Vector2d& p : seen) {
      const double t = along.dot(p - mean), q = board.normal.dot(p - mean);
      square += t * t, product += t * q;
    }
    if (square <= 0) return {by_bench.rad, by_bench.u_rad, false, said};
    slope = product / square;
    const auto off = [&](const Vector2d& p) {
      return board.normal.dot(p - mean) - slope * along.dot(p - mean);
    };
    for (const Vector2d& p : seen) residual += off(p) * off(p);
    sigma = std::sqrt(residual / n), spread = std::sqrt(square / n);
    std::erase_if(seen, [&](const Vector2d& p) { return std::abs(off(p)) > 3.5 * sigma + 0.5; });
  }
  const double u =
      std::max(least_u_rad, sigma / spread / std::sqrt(static_cast<double>(seen.size()) / samples_in_one));
  if (u >= by_bench.u_rad) return {by_bench.rad, by_bench.u_rad, false, said};
  return {board.normal_rad - std::atan(slope), u, true, said};
}

/// Bearing of a circle's centre: least squares of the ranges by Gauss-Newton, their common offset free.
SeenNormal bearing_of_circle(std::vector<Echo> seen, const FacingTarget& board) {
  const SeenNormal by_bench{board.normal_rad, board.u_normal_rad, false, {}};
  double bearing = board.normal_rad, u = by_bench.u_rad;
  for (int round = 0; round < 6; ++round) {
    std::erase_if(seen,
                  [&](const Echo& e) { return !std::isfinite(board.excess_mm(e.direction_rad - bearing)); });
    if (seen.size() < least_points) return by_bench;
    const auto n = static_cast<double>(seen.size());
    const auto left = [&](const Echo& e) {
      return e.range_mm - board.distance_mm - board.excess_mm(e.direction_rad - bearing);
    };
    const auto slope = [&](const Echo& e) { return -board.excess_per_rad(e.direction_rad - bearing); };
    double mean_left = 0, mean_slope = 0, square = 0, product = 0, residual = 0;
    for (const Echo& e : seen) mean_left += left(e) / n, mean_slope += slope(e) / n;
    for (const Echo& e : seen) {
      square += std::pow(slope(e) - mean_slope, 2);
      product += (slope(e) - mean_slope) * (left(e) - mean_left);
    }
    if (square <= 0) return by_bench;
    bearing += product / square;
    for (const Echo& e : seen) residual += std::pow(left(e) - mean_left, 2);
    const double sigma = std::sqrt(residual / n);
    u = std::max(least_u_rad, sigma / std::sqrt(square / samples_in_one));
    std::erase_if(seen, [&](const Echo& e) { return std::abs(left(e) - mean_left) > 3.5 * sigma + 0.5; });
  }
  if (u >= by_bench.u_rad) return by_bench;
  return {bearing, u, true, {}};
}

}  // namespace

bool FacingTarget::meets(double direction_rad) const {
  const Vector2d ray(std::cos(direction_rad), std::sin(direction_rad));
  const double facing = ray.dot(normal);
  if (facing < 0.2) return false;
  const Vector2d at = ray * (distance_mm / facing), along = to - from;
  const double place = (at - from).dot(along) / along.squaredNorm();
  return place > 0.1 && place < 0.9;
}

double FacingTarget::excess_mm(double off_rad) const {
  if (radius_mm <= 0) return distance_mm * (1 / std::cos(off_rad) - 1);
  const double centre_mm = distance_mm + radius_mm, aside_mm = centre_mm * std::sin(off_rad);
  return centre_mm * std::cos(off_rad) - std::sqrt(radius_mm * radius_mm - aside_mm * aside_mm) - distance_mm;
}

double FacingTarget::excess_per_rad(double off_rad) const {
  if (radius_mm <= 0) return distance_mm * std::sin(off_rad) / std::pow(std::cos(off_rad), 2);
  const double centre_mm = distance_mm + radius_mm, aside_mm = centre_mm * std::sin(off_rad);
  return aside_mm *
         (centre_mm * std::cos(off_rad) / std::sqrt(radius_mm * radius_mm - aside_mm * aside_mm) - 1);
}

FacingTarget facing_target(const fit::Target& target, const fit::CaptureInfo& capture,
                           const fit::Mount& mount) {
  const double stage = capture.stage_readback_rad.value_or(capture.stage_rad);
  const Vector2d origin = Eigen::Rotation2Dd(stage) * Vector2d(mount.x_mm.value, mount.y_mm.value);
  const Eigen::Rotation2Dd to_lidar(-stage - mount.yaw_rad.value);
  const Vector2d shift = target.outward_normal() * capture.target_shift_mm;
  FacingTarget out;
  out.u_normal_rad = std::hypot(target.u_rad, mount.yaw_rad.u);
  if (target.round) {
    const Vector2d centre = to_lidar * (target.round->centre_mm + shift - origin);
    out.radius_mm = target.round->radius_mm;
    out.normal = centre.normalized();
    out.distance_mm = centre.norm() - out.radius_mm;
    const Vector2d across = out.radius_mm * Vector2d(-out.normal.y(), out.normal.x());
    out.from = out.distance_mm * out.normal - across, out.to = out.distance_mm * out.normal + across;
    out.u_normal_rad =
        std::hypot(mount.yaw_rad.u, std::hypot(target.u_mm, mount.x_mm.u, mount.y_mm.u) / centre.norm());
  } else {
    out.from = to_lidar * (target.from_mm + shift - origin);
    out.to = to_lidar * (target.to_mm + shift - origin);
    out.normal = to_lidar * target.outward_normal();
    out.distance_mm = out.normal.dot(out.from);
    if (out.distance_mm < 0) out.normal = -out.normal, out.distance_mm = -out.distance_mm;
  }
  out.normal_rad = std::atan2(out.normal.y(), out.normal.x());
  const Vector2d on_stage = Eigen::Rotation2Dd(mount.yaw_rad.value) * out.normal;
  out.u_mount_mm = std::hypot(on_stage.x() * mount.x_mm.u, on_stage.y() * mount.y_mm.u);
  return out;
}

SeenNormal seen_normal(const fit::Recording& recording, std::size_t index, const FacingTarget& board) {
  constexpr long most_scans = 400;  // Reading a long capture twice would cost.
  const fit::CaptureInfo& capture = recording.captures()[index];
  // A few neighbouring beams say nothing of a direction.
  if (capture.beams() < 8) return {board.normal_rad, board.u_normal_rad, false, {}};
  std::vector<Echo> seen;
  long scans = 0;
  double step_rad = 0;
  recording.for_each_scan(index, [&](const fit::ScanView& scan) {
    if (++scans > most_scans) return;
    const fit::BeamAngles angles(recording.bench().lidar, capture, scan.geometry);
    step_rad = std::abs(angles.step_rad());
    for (std::size_t k = 0; k < scan.range_mm.size(); ++k) {
      const Echo echo{angles.at_rad(k), static_cast<double>(scan.range_mm[k])};
      if (echo.range_mm == 0 || echo.range_mm >= fit::first_error_code_mm || !board.meets(echo.direction_rad))
        continue;
      // Something else stands in front, or nothing: not the target.
      const double off_mm = board.radius_mm > 0 ? echo.range_mm - board.distance_mm -
                                                      board.excess_mm(echo.direction_rad - board.normal_rad)
                                                : board.normal.dot(echo.point()) - board.distance_mm;
      if (std::abs(off_mm) < 0.1 * board.distance_mm + 60) seen.push_back(echo);
    }
  });
  if (board.radius_mm > 0) return bearing_of_circle(std::move(seen), board);
  std::vector<Vector2d> points;
  for (const Echo& echo : seen) points.push_back(echo.point());
  return normal_of_plane(std::move(points), board, std::max(1.0, board.distance_mm * step_rad));
}

}  // namespace rig
