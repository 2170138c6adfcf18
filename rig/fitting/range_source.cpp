// SPDX-License-Identifier: MIT
#include "rig/fitting/range_source.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <optional>

#include "fit/median.hpp"
#include "rig/errors.hpp"
#include "rig/session/step_in_words.hpp"

namespace rig {
namespace {

using Eigen::Vector2d;

std::string text(double value, const char* format) {
  char out[64];
  std::snprintf(out, sizeof out, format, value);
  return out;
}

/// The target as it stood during a capture, in the lidar's frame.
struct Board {
  Vector2d from, to, normal;
  double distance_mm = 0, normal_rad = 0;
  double u_mount_mm = 0;  ///< Of the distance, by where the lidar sits on the stage.
};

Board board_of(const fit::Target& target, const fit::CaptureInfo& capture, const fit::Mount& mount) {
  const double stage = capture.stage_readback_rad.value_or(capture.stage_rad);
  const Vector2d origin = Eigen::Rotation2Dd(stage) * Vector2d(mount.x_mm.value, mount.y_mm.value);
  const Eigen::Rotation2Dd to_lidar(-stage - mount.yaw_rad.value);
  const Vector2d shift = target.outward_normal() * capture.target_shift_mm;
  Board board;
  board.from = to_lidar * (target.from_mm + shift - origin);
  board.to = to_lidar * (target.to_mm + shift - origin);
  board.normal = to_lidar * target.outward_normal();
  board.distance_mm = board.normal.dot(board.from);
  if (board.distance_mm < 0) board.normal = -board.normal, board.distance_mm = -board.distance_mm;
  board.normal_rad = std::atan2(board.normal.y(), board.normal.x());
  const Vector2d on_stage = Eigen::Rotation2Dd(-stage) * target.outward_normal();
  board.u_mount_mm = std::hypot(on_stage.x() * mount.x_mm.u, on_stage.y() * mount.y_mm.u);
  return board;
}

/// Whether a beam in this direction meets the middle part of the board.
bool meets(const Board& board, double direction_rad) {
  const Vector2d ray(std::cos(direction_rad), std::sin(direction_rad));
  const double facing = ray.dot(board.normal);
  if (facing < 0.2) return false;
  const Vector2d at = ray * (board.distance_mm / facing), along = board.to - board.from;
  const double place = (at - board.from).dot(along) / along.squaredNorm();
  return place > 0.1 && place < 0.9;
}

struct Angles {
  double first_rad, step_rad;
};
Angles angles_of(const fit::ScanView& scan, const fit::CaptureInfo& capture,
                 const fit::LidarGeometry& lidar) {
  if (scan.geometry) return {scan.geometry->first_rad, scan.geometry->step_rad};
  // A cluster's value stands for the middle of its steps.
  return {lidar.beam_angle(capture.first_step + (capture.cluster - 1) / 2.0),
          lidar.step_rad * capture.cluster};
}

struct Normal {
  double rad = 0, u_rad = 0;
  bool from_data = false;
  std::string said;  ///< Where the target is not what the bench file says.
};

/// The flat piece that holds the beam square on the board: from where along the board to where, and how far what
/// is seen beyond lies behind it (negative: in front); NaN where nothing is.
struct Face {
  double from_mm = 0, to_mm = 0, behind_left_mm = std::nan(""), behind_right_mm = std::nan("");
};

/// Medians of the depth over bins one beam wide, followed from the middle to both sides as long as they do not jump by
/// more than twice the scatter of single samples, and never by less than 15 mm. None when nothing is seen there.
std::optional<Face> face_of(const std::vector<Vector2d>& seen, const Board& board, double bin_mm) {
  constexpr double least_step_mm = 15;
  const Vector2d along(-board.normal.y(), board.normal.x());
  std::map<long, std::vector<double>> bins;
  for (const Vector2d& p : seen) bins[std::lround(along.dot(p) / bin_mm)].push_back(board.normal.dot(p));
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
  if (profile.empty()) return std::nullopt;
  const double step_mm = std::max(least_step_mm, 2 * fit::median_of(scatter));
  const auto nearest = static_cast<std::size_t>(
      std::ranges::min_element(profile, {}, [](const Bin& b) { return std::abs(b.at_mm); }) - profile.begin());
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
        const std::ptrdiff_t beyond = std::clamp<std::ptrdiff_t>(i + 2 * direction, 0, std::ssize(profile) - 1);
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
      said += (said.empty() ? "" : "; ") + std::string("from ") + text(std::abs(at_mm), "%.0f") + " mm to the " + where +
              " of the square beam on, it lies " + text(std::abs(behind_mm), "%.0f") + " mm " +
              (behind_mm > 0 ? "farther away" : "nearer");
  };
  side(face.behind_left_mm, face.to_mm, "left");
  side(face.behind_right_mm, face.from_mm, "right");
  return said;
}

/// Direction of the board's normal from what was seen of it, if that is better than the bench knows it.
Normal normal_of(const fit::Recording& recording, std::size_t index, const Board& board, double bench_u_rad) {
  const fit::CaptureInfo& capture = recording.captures()[index];
  const Normal by_bench{board.normal_rad, bench_u_rad, false, {}};
  // A few neighbouring beams say nothing of a direction; reading a long capture twice would cost.
  if (capture.beams() < 8) return by_bench;
  std::vector<Vector2d> seen;
  long scans = 0;
  double step_rad = 0;
  recording.for_each_scan(index, [&](const fit::ScanView& scan) {
    if (++scans > 400) return;
    const Angles angles = angles_of(scan, capture, recording.bench().lidar);
    step_rad = std::abs(angles.step_rad);
    for (std::size_t k = 0; k < scan.range_mm.size(); ++k) {
      const double direction = angles.first_rad + static_cast<double>(k) * angles.step_rad;
      if (scan.range_mm[k] == 0 || scan.range_mm[k] >= 65500 || !meets(board, direction)) continue;
      const double range = scan.range_mm[k];
      const Vector2d point(range * std::cos(direction), range * std::sin(direction));
      // Something else stands in front, or nothing: not the board.
      if (std::abs(board.normal.dot(point) - board.distance_mm) < 0.1 * board.distance_mm + 60)
        seen.push_back(point);
    }
  });
  // Depth against place along the board, as the bench has it: a slope is a turn of the normal.
  const Vector2d along(-board.normal.y(), board.normal.x());
  std::string said;
  if (const auto face = face_of(seen, board, std::max(1.0, board.distance_mm * step_rad))) {
    said = step_in_target(*face);
    std::erase_if(seen, [&](const Vector2d& p) {
      const double at = along.dot(p);
      return at < face->from_mm || at > face->to_mm;
    });
  }
  double slope = 0, sigma = 0, spread = 0;
  for (int round = 0; round < 4; ++round) {
    if (seen.size() < 50) return {by_bench.rad, by_bench.u_rad, false, said};
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
  const double angle = board.normal_rad - std::atan(slope);
  // Errors of neighbouring beams go together (surface, walk error): count ten samples as one.
  const double u = std::max(1e-4, sigma / spread / std::sqrt(static_cast<double>(seen.size()) / 10));
  if (u >= bench_u_rad) return {by_bench.rad, by_bench.u_rad, false, said};
  return {angle, u, true, said};
}

/// Per scan the beam nearest to the normal; false when none is within one and a half steps of it.
struct SquareBeam {
  std::vector<fit::Sample> samples;
  double sum_rad = 0, sum_secant = 0, step_rad = 0;
  long scans = 0;
};
SquareBeam square_beam(const fit::Recording& recording, std::size_t index, double normal_rad) {
  const fit::CaptureInfo& capture = recording.captures()[index];
  SquareBeam out;
  recording.for_each_scan(index, [&](const fit::ScanView& scan) {
    ++out.scans;
    const Angles angles = angles_of(scan, capture, recording.bench().lidar);
    const long last = static_cast<long>(scan.range_mm.size()) - 1;
    if (last < 0) return;
    // A full turn may begin or end just beside the normal: the beam may be the first, the last or neither.
    const double turns = 2 * fit::pi / std::abs(angles.step_rad);
    double place = fit::wrap_angle(normal_rad - angles.first_rad) / angles.step_rad;
    if (place < 0) place += turns;
    const auto off_of = [&](long k) {
      return fit::wrap_angle(angles.first_rad + static_cast<double>(k) * angles.step_rad - normal_rad);
    };
    long k = 0;
    for (const long candidate : {std::min(std::lround(place), last), last})
      if (std::abs(off_of(candidate)) < std::abs(off_of(k))) k = candidate;
    const double off = off_of(k);
    if (std::abs(off) > 1.5 * std::abs(angles.step_rad)) return;
    const auto at = static_cast<std::size_t>(k);
    out.samples.push_back(
        {scan.range_mm[at], at < scan.intensity.size() ? scan.intensity[at] : std::uint16_t{0}});
    out.sum_rad += normal_rad + off;
    out.step_rad = std::abs(angles.step_rad);
    out.sum_secant += 1 / std::cos(off) - 1;
  });
  return out;
}

/// The target a capture is about; without a name, the nearest one that the capture's beams meet squarely.
const fit::Target* target_of(const fit::Bench& bench, const fit::CaptureInfo& capture) {
  if (capture.target) return bench.target(*capture.target);
  const fit::Target* nearest = nullptr;
  double least = 1e300;
  for (const fit::Target& target : bench.targets) {
    const Board board = board_of(target, capture, bench.lidar.mount);
    if (meets(board, board.normal_rad) && board.distance_mm < least)
      least = board.distance_mm, nearest = &target;
  }
  return nearest;
}

/// The captures that were left out, by reason, in the order in which the reasons came up.
using LeftOut = std::vector<std::pair<std::string, std::vector<std::string>>>;

void leave_out(LeftOut& left_out, const std::string& capture, const std::string& reason) {
  for (auto& [known, captures] : left_out)
    if (known == reason) return captures.push_back(capture);
  left_out.emplace_back(reason, std::vector<std::string>{capture});
}

/// One line a reason: a search for edges has a hundred captures that see none squarely.
std::string in_words(const LeftOut::value_type& group) {
  const auto& [reason, captures] = group;
  if (captures.size() == 1) return captures.front() + " was left out: " + reason;
  return std::to_string(captures.size()) + " captures were left out, from " + captures.front() + " to " +
         captures.back() + ": " + reason;
}

std::optional<RangeCapture> read_capture(const fit::Recording& recording, std::size_t index,
                                         RangeSource& source, LeftOut& left_out) {
  const fit::CaptureInfo& capture = recording.captures()[index];
  const fit::Bench& bench = recording.bench();
  const std::string name = "capture " + std::to_string(capture.id) +
                           (capture.step.empty() ? "" : " (" + step_in_words(capture.step) + ")");
  if (fit::is_turning(capture)) return std::nullopt;
  const fit::Target* target = target_of(bench, capture);
  if (!target) {
    leave_out(left_out, name,
              "the bench file has no target " +
                  (capture.target ? "'" + *capture.target + "'" : "that its beams meet squarely"));
    return std::nullopt;
  }
  const Board board = board_of(*target, capture, bench.lidar.mount);
  const double bench_u = std::hypot(target->u_rad, bench.lidar.mount.yaw_rad.u);
  const Normal normal = normal_of(recording, index, board, std::max(bench_u, 1e-5));
  const SquareBeam beam = square_beam(recording, index, normal.rad);
  if (beam.samples.size() < 20) {
    leave_out(left_out, name, "fewer than 20 samples of the beam that is square on '" + target->name + "'");
    return std::nullopt;
  }
  RangeCapture out;
  out.label = capture.step.empty() ? std::to_string(capture.id) : step_in_words(capture.step);
  out.target = target->name;
  out.true_mm = board.distance_mm;
  out.normal_deg = normal.rad * fit::deg_per_rad, out.u_normal_deg = normal.u_rad * fit::deg_per_rad;
  out.normal_from_data = normal.from_data;
  const auto n = static_cast<double>(beam.samples.size());
  out.beam_deg = fit::wrap_angle(beam.sum_rad / n) * fit::deg_per_rad;
  out.oblique_mm = board.distance_mm * beam.sum_secant / n;
  out.u_placement_mm = target->u_mm, out.u_mount_mm = board.u_mount_mm;
  out.temperature_c = capture.temperature_c;
  out.beam_step_deg = beam.step_rad * fit::deg_per_rad;
  out.reflectance = capture.reflectance ? capture.reflectance : target->reflectance;
  out.paper = fit::select_most_frequent(beam.samples);
  out.robust = fit::select_robust(beam.samples);
  out.scans = beam.scans;
  if (out.paper.kept < 1) {
    leave_out(left_out, name, "no valid sample");
    return std::nullopt;
  }
  if (!normal.said.empty())
    source.notes.push_back(name + ": '" + target->name + "' is not one flat face as the bench file says: " + normal.said +
                           ". Only the face of the square beam was used; correct the target's ends");
  const double off = std::abs(fit::wrap_angle(normal.rad - board.normal_rad));
  if (normal.from_data && off > 4 * bench_u)
    source.contradictions.push_back(name + ": '" + target->name + "' is turned by " +
                           text(off * fit::deg_per_rad, "%.1f") +
                           " deg from where the bench file says; correct its mount yaw or the target");
  if (std::abs(out.paper.mean_mm - out.true_mm) > 0.1 * out.true_mm + 60)
    source.contradictions.push_back(name + ": the beam sees " + text(out.paper.mean_mm, "%.0f") +
                           " mm where the bench file puts '" + target->name + "' at " +
                           text(out.true_mm, "%.0f") + " mm; check the true distance");
  return out;
}

}  // namespace

RangeSource read_ranges(const std::vector<FitSource>& sources) {
  RangeSource out;
  LeftOut left_out;
  for (const FitSource& source : sources) {
    const auto recording = source.session->recording();
    for (std::size_t i = 0; i < recording->captures().size(); ++i)
      if (auto capture = read_capture(*recording, i, out, left_out))
        out.captures.push_back(std::move(*capture));
  }
  for (const auto& group : left_out) out.notes.push_back(in_words(group));
  if (!out.captures.empty()) return out;
  std::string why;
  for (const auto* all : {&out.notes, &out.contradictions})
    for (const std::string& note : *all) why += "\n  " + note;
  throw MeasurementError("no capture looks squarely at a target whose distance is known" + why +
                         "\nThe bench file must hold the target, and captures of a range ladder its shift.");
}

}  // namespace rig
