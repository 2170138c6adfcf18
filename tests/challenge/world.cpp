// SPDX-License-Identifier: MIT
#include "world.hpp"

#include <algorithm>
#include <cmath>

namespace challenge {

std::vector<Segment> standing_walls(const Session& session, const Nuisance& nuisance,
                                    const std::vector<Displacement>& displaced) {
  std::vector<Segment> walls;
  for (std::size_t i = 0; i < session.walls.size(); ++i) {
    const Wall& wall = session.walls[i];
    const Vector stated = (wall.to - wall.from).normalized();
    Vector outward(stated.y(), -stated.x());
    if (outward.dot(wall.from) < 0) outward = -outward;
    const Displacement moved = displaced.empty() ? Displacement{} : displaced[i];
    const double angle = nuisance.tilt_rad[i] + moved.turned_rad;
    const Vector along(stated.x() * std::cos(angle) - stated.y() * std::sin(angle),
                       stated.x() * std::sin(angle) + stated.y() * std::cos(angle));
    const Vector middle = (wall.from + wall.to) / 2 + (nuisance.offset_mm[i] + moved.away_mm) * outward;
    const double length = (wall.to - wall.from).norm();
    Segment segment{middle - along * length / 2,
                    middle + along * length / 2,
                    along,
                    Vector(-along.y(), along.x()),
                    outward,
                    length,
                    wall.reflectance,
                    wall.closed};
    segment.last_mm = length;
    walls.push_back(segment);
  }
  std::vector<Segment*> outline;
  for (Segment& segment : walls)
    if (segment.closed) outline.push_back(&segment);
  for (std::size_t i = 0; i < outline.size(); ++i) {
    Segment& own = *outline[i];
    const auto crossed_by = [&](const Segment& other) {
      return other.normal.dot(other.from - own.from) / other.normal.dot(own.along);
    };
    own.first_mm = crossed_by(*outline[(i + outline.size() - 1) % outline.size()]);
    own.last_mm = crossed_by(*outline[(i + 1) % outline.size()]);
  }
  return walls;
}

World::World(const Session& session, Causes causes, Nuisance nuisance)
    : session_(session), causes_(std::move(causes)), nuisance_(std::move(nuisance)) {
  for (const auto& cause : causes_) footprint_ = std::max(footprint_, cause->footprint());
}

Moment World::moment(std::size_t capture, int seq, int step) const {
  Moment moment;
  moment.capture = &session_.captures[capture];
  moment.capture_index = capture;
  moment.seq = seq;
  moment.step = step;
  moment.alpha = session_.beam_rad(step);
  moment.beam_s = session_.beam_time_s(step);
  moment.since_move = moment.capture->first_scan_s + seq / session_.scan_hz;
  moment.since_power_on = moment.capture->since_power_on_s + seq / session_.scan_hz;
  return moment;
}

const std::vector<Segment>& World::standing(std::size_t capture_index) const {
  std::vector<Displacement> displaced(session_.walls.size());
  double moved_in_all = 0;  // a cause's strength may have changed since
  for (std::size_t i = 0; i < displaced.size(); ++i) {
    for (const auto& cause : causes_) {
      const Displacement own = cause->displaced(static_cast<int>(i));
      displaced[i].away_mm += own.away_mm;
      displaced[i].turned_rad += own.turned_rad;
    }
    moved_in_all += displaced[i].away_mm + displaced[i].turned_rad;
  }
  if (standing_capture_ == capture_index && standing_moved_ == moved_in_all) return standing_;
  standing_capture_ = capture_index;
  standing_moved_ = moved_in_all;
  const Capture& capture = session_.captures[capture_index];
  const auto moved = static_cast<std::size_t>(capture.target);  // beyond all walls if there is none
  if (moved < displaced.size()) displaced[moved].away_mm += capture.shift_mm;
  standing_ = standing_walls(session_, nuisance_, displaced);
  if (moved < standing_.size() && capture.reflectance >= 0)
    standing_[moved].reflectance = capture.reflectance;
  return standing_;
}

Sight World::look(const Moment& moment, double extra_angle) const {
  double stage = moment.capture->stage_deg * degree;
  // The session's convention: a turning stage is where it is when the scan is stamped, for all its beams.
  stage += moment.capture->rate_deg_s * degree * moment.seq / session_.scan_hz;
  double beam = moment.alpha + extra_angle;
  for (const auto& cause : causes_) {
    stage += cause->stage(moment);
    beam += cause->beam(moment);
  }
  const double c = std::cos(stage), s = std::sin(stage);
  Vector origin(c * nuisance_.x_mm - s * nuisance_.y_mm, s * nuisance_.x_mm + c * nuisance_.y_mm);
  for (const auto& cause : causes_) origin += cause->origin(moment, stage);
  const double bearing = stage + nuisance_.yaw_rad + beam;
  const Vector ray(std::cos(bearing), std::sin(bearing));

  Sight sight;
  double nearest = 1e12;
  const auto& segments = standing(moment.capture_index);
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const Segment& segment = segments[i];
    const double facing = segment.normal.dot(ray);
    if (std::abs(facing) < 1e-9) continue;
    const double distance = segment.normal.dot(segment.from - origin) / facing;
    if (distance <= 1 || distance >= nearest) continue;
    const double place = segment.along.dot(origin + distance * ray - segment.from);
    if (place < segment.first_mm || place > segment.last_mm) continue;
    nearest = distance;
    sight.wall = static_cast<int>(i);
    sight.range_mm = distance;
    sight.incidence = std::atan2(segment.along.dot(ray), std::abs(facing));
    sight.along_mm = place - segment.length / 2;
    sight.end_mm = std::min(place, segment.length - place);
    const double near = distance * distance;
    const double overlap = near / (near + 80.0 * 80.0);
    sight.power = segment.reflectance * std::abs(facing) * 1e6 / near * overlap * overlap;
  }
  sight.counts = session_.radiometer.counts(sight.power);
  return sight;
}

double World::add_causes(const Moment& moment, const Sight& sight) const {
  double sum = 0;
  for (const auto& cause : causes_) sum += cause->range(moment, sight, *this);
  return sum;
}

Expectation World::expect(const Moment& moment, double extra_angle) const {
  Expectation cell;
  cell.sight = look(moment, extra_angle);
  if (footprint_ > 0) cell = mixed(moment, extra_angle, cell.sight);
  if (cell.sight.wall < 0) return cell;
  const double added = add_causes(moment, cell.sight);
  if (cell.far_share + cell.between_share == 0) cell.mean_mm = cell.sight.range_mm;
  cell.mean_mm += added;
  cell.far_mm += added;
  cell.variance_mm2 = session_.sigma_mm * session_.sigma_mm + 1.0 / 12;
  for (const auto& cause : causes_) {
    cell.variance_mm2 += cause->variance(moment, cell.sight, *this);
    cell.lost = 1 - (1 - cell.lost) * (1 - cause->lost(moment, cell.sight));
    cell.stray = 1 - (1 - cell.stray) * (1 - cause->stray(moment, cell.sight));
    const double q = cause->bins_mm();
    if (q > 0) cell.mean_mm = q * std::floor(cell.mean_mm / q + 0.5);
    const double step = cause->output_step_mm();
    if (step > 1) cell.variance_mm2 += step * step / 12;
  }
  return cell;
}

/// Sub-rays across the beam (uniform disk seen edge on) share the power; speckle makes each surface's echo
/// fluctuate from shot to shot. Two echoes closer than the pulse are one, at their centre of gravity.
Expectation World::mixed(const Moment& moment, double extra_angle, const Sight& centre) const {
  Expectation cell;
  cell.sight = centre;
  cell.mean_mm = centre.range_mm;
  constexpr int rays = 25;
  double power[2] = {0, 0}, range[2] = {0, 0}, total = 0;
  int walls[2] = {-1, -1};
  Sight seen[2];
  for (int i = 0; i < rays; ++i) {
    const double x = -1 + (2.0 * i + 1) / rays;
    const double weight = std::sqrt(1 - x * x);
    const Sight sight = look(moment, extra_angle + x * footprint_ / 2);
    total += weight;
    if (sight.wall < 0) continue;
    const int slot = walls[0] < 0 || walls[0] == sight.wall ? 0 : 1;
    walls[slot] = sight.wall;
    seen[slot] = sight;
    power[slot] += weight * sight.power;
    range[slot] += weight * sight.power * sight.range_mm;
  }
  if (walls[1] < 0) return cell;
  for (int slot = 0; slot < 2; ++slot) {
    range[slot] /= power[slot];
    power[slot] /= total;
  }
  const int near = range[0] < range[1] ? 0 : 1, far = 1 - near;
  cell.sight = seen[near];
  cell.sight.range_mm = range[near];
  cell.mean_mm = range[near];
  cell.far_mm = range[far];
  bool merged = false;
  for (const auto& cause : causes_) {
    if (cause->footprint() > 0) merged = cause->merges(range[far] - range[near]);
  }
  // Log-normal speckle of 30 % on both echoes: the stronger one wins when they are apart.
  const double doubt = std::log(power[far] / power[near]) / (0.3 * std::sqrt(2.0));
  cell.far_share = 0.5 * std::erfc(-doubt / std::sqrt(2.0));
  if (merged) {
    const double share = power[far] / (power[near] + power[far]);
    cell.between_share = 1;
    cell.far_share = 0;
    cell.mean_mm += share * (range[far] - range[near]);
  }
  return cell;
}

void World::scan(std::size_t capture_index, int seq, Random& random, Noise& noise,
                 std::vector<std::uint16_t>& range, std::vector<std::uint16_t>& intensity) const {
  const Capture& capture = session_.captures[capture_index];
  const auto beams = static_cast<std::size_t>(capture.last_step - capture.first_step + 1);
  range.assign(beams, 0);
  intensity.assign(beams, 0);
  double angle = 0, step = 1;
  std::vector<std::pair<double, double>> memory;
  bool common = false;
  for (const auto& cause : causes_) {
    if (cause->scan_angle_sigma() > 0) angle += cause->scan_angle_sigma() * random.normal();
    step = std::max(step, cause->output_step_mm());
    const auto own = cause->memory();
    if (!own.empty()) {
      memory = own;
      common = cause->memory_is_common();
    }
  }
  if (seq == 0 || noise.state.size() != memory.size()) {
    noise.state.assign(memory.size(), std::vector<double>(common ? 1 : beams));
    for (auto& row : noise.state) {
      for (double& value : row) value = random.normal();
    }
  } else {
    for (std::size_t m = 0; m < memory.size(); ++m) {
      const double rho = memory[m].second, rest = std::sqrt(1 - rho * rho);
      for (double& value : noise.state[m]) value = rho * value + rest * random.normal();
    }
  }
  double white = 1;
  for (const auto& component : memory) white -= component.first;
  white = std::sqrt(std::max(0.0, white));
  const double sixth = session_.sigma_mm * session_.sigma_mm;

  for (std::size_t i = 0; i < beams; ++i) {
    const Expectation cell =
        expect(moment(capture_index, seq, capture.first_step + static_cast<int>(i)), angle);
    if (cell.sight.wall < 0) continue;
    if (cell.lost > 0 && random.chance(cell.lost)) continue;
    double value = cell.mean_mm;
    double power = cell.sight.power;
    if (cell.between_share > 0) {
      const double gap = cell.far_mm - cell.sight.range_mm;
      const double share = gap > 0 ? std::clamp((value - cell.sight.range_mm) / gap, 0.001, 0.999) : 0;
      const double odds = share / (1 - share) * std::exp(0.3 * std::sqrt(2.0) * random.normal());
      value = cell.sight.range_mm + gap * odds / (1 + odds);
    } else if (cell.far_share > 0 && random.chance(cell.far_share)) {
      value = cell.far_mm;
    }
    double unit = white * random.normal();
    for (std::size_t m = 0; m < memory.size(); ++m) {
      unit += std::sqrt(memory[m].first) * noise.state[m][common ? 0 : i];
    }
    const double extra =
        std::max(0.0, cell.variance_mm2 - 1.0 / 12 - sixth - (step > 1 ? step * step / 12 : 0));
    value += session_.sigma_mm * unit;
    if (extra > 0) value += std::sqrt(extra) * random.normal();
    if (cell.stray > 0 && random.chance(cell.stray)) {
      for (const auto& cause : causes_) {
        if (cause->stray(moment(capture_index, seq, capture.first_step + static_cast<int>(i)), cell.sight) >
            0) {
          value = cause->stray_range(cell.sight, random);
        }
      }
      power *= 0.3;
    }
    value = step * std::floor(value / step + 0.5);
    range[i] = static_cast<std::uint16_t>(std::clamp(value, 0.0, 65000.0));
    const double counts = session_.radiometer.counts(power);
    intensity[i] = static_cast<std::uint16_t>(
        std::clamp(counts + (2 + 0.005 * counts) * random.normal() + 0.5, 0.0, 65535.0));
  }
}

PowerSpan power_span(const Session& session, double steepest_rad) {
  const World world(session, {}, session.truth);
  PowerSpan span;
  for (std::size_t c = 0; c < session.captures.size(); ++c) {
    const Capture& capture = session.captures[c];
    for (int step = capture.first_step; step <= capture.last_step; step += 5) {
      const Sight sight = world.look(world.moment(c, 0, step));
      if (sight.wall < 0 || std::abs(sight.incidence) > steepest_rad) continue;
      span.low = std::min(span.low, sight.power);
      span.high = std::max(span.high, sight.power);
    }
  }
  return span;
}

}  // namespace challenge
