// SPDX-License-Identifier: MIT
#include "oracle.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace challenge {
namespace {

/// Expected log-likelihood ratio of a normal sample whose variance grew from 1 to `ratio`.
double variance_information(double ratio) { return 0.5 * (ratio - 1 - std::log(ratio)); }

/// The same for echo states. A small floor stands for what no model foresees. Which surface a beam without
/// width meets is geometry, not a state: only a beam with a footprint is judged by it.
double state_information(const Expectation& with, const Expectation& plain) {
  constexpr double floor = 3e-4;
  const bool footprint = with.far_share + with.between_share > 0;
  if (!footprint && with.lost == plain.lost && with.stray == plain.stray) return 0;
  const double valid = (1 - with.lost) * (1 - with.stray);
  const double other = with.sight.wall == plain.sight.wall ? with.far_share : 1 - with.far_share;
  const double seen[] = {with.lost, (1 - with.lost) * with.stray, valid * with.between_share,
                         footprint && with.between_share == 0 ? valid * other : 0};
  double sum = 0, rest = 1;
  for (const double p : seen) {
    sum += (p + floor) * std::log((p + floor) / floor);
    rest -= p + floor;
  }
  if (rest > 1e-9) sum += rest * std::log(rest / (1 - 4 * floor));
  return std::max(0.0, sum);
}

/// Entropy lost per sample by memory: minus half the mean logarithm of the spectrum of unit-variance noise.
double memory_information(const std::vector<std::pair<double, double>>& memory) {
  constexpr int steps = 512;
  double white = 1, sum = 0;
  for (const auto& component : memory) white -= component.first;
  for (int i = 0; i < steps; ++i) {
    const double w = pi * (i + 0.5) / steps;
    double power = white;
    for (const auto& [share, rho] : memory) {
      power += share * (1 - rho * rho) / (1 - 2 * rho * std::cos(w) + rho * rho);
    }
    sum += std::log(power);
  }
  return -0.5 * sum / steps;
}

/// "Without priors" is ten times the stated uncertainties: farther off, geometry is another one.
constexpr double loose = 1e-2;

Nuisance moved(const Session& session, std::size_t index) {
  Nuisance nuisance = session.truth;
  const std::size_t walls = session.walls.size();
  if (index == 0) nuisance.x_mm += 0.1;
  if (index == 1) nuisance.y_mm += 0.1;
  if (index == 2) nuisance.yaw_rad += 1e-4;
  if (index >= 3 && index < 3 + walls) nuisance.offset_mm[index - 3] += 0.1;
  if (index >= 3 + walls) nuisance.tilt_rad[index - 3 - walls] += 1e-4;
  return nuisance;
}

/// Prior standard deviations over the step that moved() makes.
double prior(const Session& session, std::size_t index) {
  const std::size_t walls = session.walls.size();
  if (index < 2) return session.u_mount_mm / 0.1;
  if (index == 2) return session.u_yaw_deg * degree / 1e-4;
  if (index < 3 + walls) return session.walls[index - 3].u_mm / 0.1;
  return session.walls[index - 3 - walls].u_deg * degree / 1e-4;
}

/// The truth with every nuisance moved by that many of its prior's standard deviations.
Nuisance displaced(const Session& session, const Eigen::VectorXd& beta) {
  Nuisance nuisance = session.truth;
  const std::size_t walls = session.walls.size();
  nuisance.x_mm += beta[0] * session.u_mount_mm;
  nuisance.y_mm += beta[1] * session.u_mount_mm;
  nuisance.yaw_rad += beta[2] * session.u_yaw_deg * degree;
  for (std::size_t w = 0; w < walls; ++w) {
    nuisance.offset_mm[w] += beta[static_cast<Eigen::Index>(3 + w)] * session.walls[w].u_mm;
    nuisance.tilt_rad[w] += beta[static_cast<Eigen::Index>(3 + walls + w)] * session.walls[w].u_deg * degree;
  }
  return nuisance;
}

}  // namespace

Oracle::Oracle(const Session& session, const Causes& causes, std::size_t cells) : session_(session) {
  const bool turns =
      std::ranges::any_of(session.captures, [](const Capture& c) { return c.rate_deg_s != 0; });
  const bool each_scan =
      turns || std::ranges::any_of(causes, [](const auto& cause) { return cause->differs_within_capture(); });
  std::size_t all = 0;
  for (const Capture& c : session.captures) {
    all += static_cast<std::size_t>(c.last_step - c.first_step + 1) *
           (each_scan ? static_cast<std::size_t>(c.scans) : 1);
  }
  const int stride = std::max(1, static_cast<int>((all + cells - 1) / cells));
  const World plain(session, {}, session.truth);
  for (std::size_t c = 0; c < session.captures.size(); ++c) {
    const Capture& capture = session.captures[c];
    const int groups = each_scan ? capture.scans : 1;
    for (int group = 0; group < groups; ++group) {
      const int seq = each_scan ? group : capture.scans / 2;
      const int phase = static_cast<int>(c * 7 + static_cast<std::size_t>(group) * 3) % stride;
      for (int step = capture.first_step + phase; step <= capture.last_step; step += stride) {
        Cell cell{c, seq, step, static_cast<double>(stride) * capture.scans / groups, {}, 0, true};
        const Moment moment = plain.moment(c, seq, step);
        cell.plain = plain.expect(moment);
        if (cell.plain.sight.wall < 0) continue;
        const Sight left = plain.look(moment, 2e-3), right = plain.look(moment, -2e-3);
        cell.lever = (left.range_mm - right.range_mm) / 4e-3;
        cell.usable = left.wall == right.wall && std::abs(cell.plain.sight.incidence) < 80 * degree;
        cells_.push_back(cell);
      }
    }
  }
  const auto n = static_cast<Eigen::Index>(cells_.size());
  const std::size_t parameters = 3 + 2 * session.walls.size();
  weight_.resize(n);
  nuisance_.resize(n, static_cast<Eigen::Index>(parameters));
  for (Eigen::Index i = 0; i < n; ++i) {
    const Cell& cell = cells_[static_cast<std::size_t>(i)];
    weight_[i] = cell.usable ? cell.weight / cell.plain.variance_mm2 : 0;
  }
  for (std::size_t p = 0; p < parameters; ++p) {
    const World other(session, {}, moved(session, p));
    nuisance_.col(static_cast<Eigen::Index>(p)) = shift(other) * prior(session, p);
  }
  Eigen::MatrixXd normal = nuisance_.transpose() * weight_.asDiagonal() * nuisance_;
  const auto size = normal.rows();
  const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(size, size);
  inverse_with_ = (normal + one).ldlt().solve(one);
  inverse_without_ = (normal + loose * one).ldlt().solve(one);
}

Eigen::VectorXd Oracle::shift(const World& world) const {
  Eigen::VectorXd result(static_cast<Eigen::Index>(cells_.size()));
  for (std::size_t i = 0; i < cells_.size(); ++i) {
    const Cell& cell = cells_[i];
    const Expectation with = world.expect(world.moment(cell.capture, cell.seq, cell.step));
    const double step = with.mean_mm - cell.plain.mean_mm;
    // A beam that now meets another wall says nothing about how far the first one is.
    const bool comparable = cell.usable && with.sight.wall == cell.plain.sight.wall && std::abs(step) < 300;
    result[static_cast<Eigen::Index>(i)] = comparable ? step : 0;
  }
  return result;
}

Eigen::VectorXd Oracle::project(const Eigen::VectorXd& shift) const {
  const Eigen::VectorXd right = nuisance_.transpose() * weight_.cwiseProduct(shift);
  return shift - nuisance_ * (inverse_with_ * right);
}

Oracle::Refit Oracle::left_at(const Eigen::VectorXd& beta, const std::vector<Expectation>& seen,
                              double stiffness) const {
  const World other(session_, {}, displaced(session_, beta));
  Refit now;
  now.left = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(cells_.size()));
  for (std::size_t i = 0; i < cells_.size(); ++i) {
    const Cell& cell = cells_[i];
    if (!cell.usable) continue;
    const Expectation without = other.expect(other.moment(cell.capture, cell.seq, cell.step));
    // A beam that meets another wall then says nothing about how far the first one is.
    const bool comparable =
        seen[i].sight.wall == cell.plain.sight.wall && without.sight.wall == cell.plain.sight.wall;
    const double step = seen[i].mean_mm - without.mean_mm;
    if (comparable && std::abs(step) < 300) now.left[static_cast<Eigen::Index>(i)] = step;
  }
  now.beta = beta;
  now.squares = now.left.dot(weight_.cwiseProduct(now.left)) + stiffness * beta.squaredNorm();
  return now;
}

Oracle::Refit Oracle::refit(const std::vector<Expectation>& seen, bool with_priors,
                            const Eigen::VectorXd& beta) const {
  const double stiffness = with_priors ? 1 : loose;
  const Eigen::MatrixXd& inverse = with_priors ? inverse_with_ : inverse_without_;
  Refit best = left_at(beta, seen, stiffness);
  // Before a wall that is met squarely, angles act to second order only: whole steps go back and forth there.
  double share = 1;
  for (int pass = 0; pass < 40 && share > 0.05; ++pass) {
    const Eigen::VectorXd step =
        inverse * (nuisance_.transpose() * weight_.cwiseProduct(best.left) - stiffness * best.beta);
    const Refit now = left_at(best.beta + share * step, seen, stiffness);
    const double gained = best.squares - now.squares;
    if (gained > 0) best = now;
    if (gained <= 0)
      share /= 2;
    else if (gained < 1e-4 * best.squares)
      break;
  }
  return best;
}

Oracle::Verdict Oracle::judge(const Causes& causes) const {
  const World world(session_, causes, session_.truth);
  std::vector<Expectation> seen;
  for (const Cell& cell : cells_)
    seen.push_back(world.expect(world.moment(cell.capture, cell.seq, cell.step)));
  Verdict verdict;
  const Refit fitted = refit(seen, true, Eigen::VectorXd::Zero(nuisance_.cols()));
  verdict.shift = fitted.left;
  verdict.mean = fitted.squares;
  verdict.snr_with_free_nuisances = std::sqrt(refit(seen, false, fitted.beta).squares);
  verdict.information = weight_.cwiseProduct(verdict.shift).cwiseProduct(verdict.shift);

  // The overall noise is known only as well as the bench says: its scale is fitted under that prior.
  const double u = 2 * session_.u_sigma_mm / session_.sigma_mm;
  double best = 1e300, scale = 1;
  for (double log_scale = -0.5; log_scale <= 6; log_scale += 0.01) {
    double sum = 0.5 * std::pow(log_scale / u, 2);
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      if (!cells_[i].usable) continue;
      const double ratio = seen[i].variance_mm2 / cells_[i].plain.variance_mm2;
      if (ratio == 1 && log_scale == 0) continue;
      sum += cells_[i].weight * variance_information(ratio / std::exp(log_scale));
    }
    if (sum < best) {
      best = sum;
      scale = std::exp(log_scale);
    }
  }
  verdict.variance = best < 1e-6 ? 0 : 2 * best;

  double samples = 0, squares = 0, floor = 0;
  for (std::size_t i = 0; i < cells_.size(); ++i) {
    const Cell& cell = cells_[i];
    const auto row = static_cast<Eigen::Index>(i);
    if (cell.usable) {
      const double own =
          2 * cell.weight * variance_information(seen[i].variance_mm2 / cell.plain.variance_mm2 / scale);
      if (verdict.variance > 0) verdict.information[row] += own;
      samples += cell.weight;
      squares += cell.weight * (seen[i].variance_mm2 + verdict.shift[row] * verdict.shift[row]);
      floor += cell.weight * seen[i].variance_mm2;
    }
    const double states = 2 * cell.weight * state_information(seen[i], cell.plain);
    verdict.states += states;
    verdict.information[row] += states;
  }
  verdict.rms_before_mm = std::sqrt(squares / std::max(1.0, samples));
  verdict.rms_floor_mm = std::sqrt(floor / std::max(1.0, samples));

  for (const auto& cause : causes) {
    if (cause->output_step_mm() > 1) {  // Multiples of the step only: each of the others is news.
      verdict.states += 2 * samples * std::log(cause->output_step_mm());
    }
    const double angle = cause->scan_angle_sigma();
    if (angle > 0) {
      std::vector<double> levers(session_.captures.size());
      for (const Cell& cell : cells_) {
        if (!cell.usable) continue;
        levers[cell.capture] += cell.weight / session_.captures[cell.capture].scans * cell.lever *
                                cell.lever / cell.plain.variance_mm2;
      }
      for (std::size_t c = 0; c < levers.size(); ++c) {
        const double s = angle * angle * levers[c];
        verdict.jitter += session_.captures[c].scans * (s - std::log1p(s));
      }
      for (std::size_t i = 0; i < cells_.size(); ++i) {
        const double s = angle * cells_[i].lever;
        verdict.information[static_cast<Eigen::Index>(i)] += weight_[static_cast<Eigen::Index>(i)] * s * s;
      }
    }
    const auto memory = cause->memory();
    if (!memory.empty()) {
      for (const Capture& capture : session_.captures) {
        const double beams = capture.last_step - capture.first_step + 1;
        if (cause->memory_is_common()) {
          double share = 0;
          for (const auto& component : memory) share += component.first;
          const double s = beams * share / std::max(1e-3, 1 - share);
          verdict.memory += capture.scans * (s - std::log1p(s));
        } else {
          verdict.memory += 2 * (capture.scans - 1) * beams * memory_information(memory);
        }
      }
    }
  }
  if (session_.claims_intensity) verdict.intensity = intensity(causes, verdict.information);
  const double squared =
      verdict.mean + verdict.variance + verdict.states + verdict.jitter + verdict.memory + verdict.intensity;
  verdict.snr = std::sqrt(squared);
  verdict.log_likelihood_gain = squared / 2;
  return verdict;
}

double Oracle::intensity(const Causes& causes, Eigen::VectorXd& information) const {
  if (std::ranges::none_of(causes, [](const auto& cause) { return cause->shows_in_intensity(); })) return 0;
  const World plain(session_, {}, session_.truth);
  const auto n = static_cast<Eigen::Index>(cells_.size());
  const auto walls = static_cast<Eigen::Index>(session_.walls.size());
  Eigen::VectorXd shift = Eigen::VectorXd::Zero(n), weight = Eigen::VectorXd::Zero(n);
  Eigen::MatrixXd open = Eigen::MatrixXd::Zero(n, 5 + walls);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Cell& cell = cells_[static_cast<std::size_t>(i)];
    const Moment moment = plain.moment(cell.capture, cell.seq, cell.step);
    for (const auto& cause : causes) shift[i] += cause->log_intensity(moment);
    if (!cell.usable || !std::isfinite(shift[i])) {
      shift[i] = 0;
      continue;
    }
    const double rounding = 0.29 / std::max(1.0, cell.plain.sight.counts);
    // No law is right to better than half a per cent, whatever the number of scans.
    constexpr double law = 0.005;
    weight[i] = 1 / ((std::pow(session_.counts_noise, 2) + rounding * rounding) / cell.weight + law * law);
    open(i, 0) = session_.u_gain;
    const double r = cell.plain.sight.range_mm, o = session_.claimed_overlap_mm;
    const Capture& capture = session_.captures[cell.capture];
    const auto wall = static_cast<std::size_t>(cell.plain.sight.wall);
    const bool changed = capture.target == cell.plain.sight.wall && capture.reflectance >= 0;
    open(i, 1) = 2 * session_.u_power * std::log(r / 1000);
    open(i, 2) = session_.u_power * std::log(std::cos(cell.plain.sight.incidence));
    open(i, 3) =
        session_.u_power * std::log(changed ? capture.reflectance : session_.walls[wall].reflectance);
    open(i, 4) = session_.u_overlap_mm * 4 * session_.claimed_power * o / (r * r + o * o);
    open(i, 5 + cell.plain.sight.wall) = 0.05;
  }
  Eigen::MatrixXd normal = open.transpose() * weight.asDiagonal() * open;
  normal.diagonal().array() += 1;
  const Eigen::VectorXd left =
      shift - open * normal.ldlt().solve(open.transpose() * weight.cwiseProduct(shift));
  information += weight.cwiseProduct(left).cwiseProduct(left);
  return std::max(0.0, shift.dot(weight.cwiseProduct(left)));
}

std::vector<double> Oracle::left_by(const Causes& cause, const std::vector<Causes>& rivals) const {
  const Eigen::VectorXd own = shift(World(session_, cause, session_.truth));
  const Eigen::VectorXd own_left = project(own);
  const double total = own.dot(weight_.cwiseProduct(own_left));
  std::vector<double> left;
  for (const Causes& rival : rivals) {
    const Eigen::VectorXd other = shift(World(session_, rival, session_.truth));
    const Eigen::VectorXd other_left = project(other);
    const double cross = own.dot(weight_.cwiseProduct(other_left));
    const double size = other.dot(weight_.cwiseProduct(other_left));
    left.push_back(std::sqrt(std::max(0.0, total - (size > 1e-9 ? cross * cross / size : 0))));
  }
  return left;
}

double Oracle::coordinate(const Cell& cell, const Cause& cause, const World& plain) const {
  const std::string& name = cause.coordinate;
  const Capture& capture = session_.captures[cell.capture];
  if (name == "beam_deg") return session_.beam_rad(cell.step) / degree;
  if (name == "stage_deg") return capture.stage_deg;
  if (name == "range_mm") return cell.plain.sight.range_mm;
  if (name == "intensity")
    return cause.counts(plain.moment(cell.capture, cell.seq, cell.step)).value_or(cell.plain.sight.counts);
  if (name == "incidence_deg") return cell.plain.sight.incidence / degree;
  if (name == "edge_distance_deg") return cell.plain.sight.end_mm / cell.plain.sight.range_mm / degree;
  if (name == "time_s") return capture.since_power_on_s;
  if (name == "temperature_c") return capture.temperature_c;
  if (name == "approach") return capture.approach;
  if (name == "stage_rate_deg_s") return capture.rate_deg_s;
  if (name == "range_rate") return cell.lever;
  if (name == "scan_seq") return cell.seq;
  if (name == "target") return cell.plain.sight.wall;
  throw std::logic_error("no coordinate " + name);
}

std::vector<Oracle::Interval> Oracle::located(const Verdict& verdict, const Cause& cause) const {
  const World plain(session_, {}, session_.truth);
  std::vector<double> at;
  for (const Cell& cell : cells_) at.push_back(coordinate(cell, cause, plain));
  double low = 1e300, high = -1e300;  // without those that lose every echo
  for (const double x : at) {
    if (!std::isfinite(x)) continue;
    low = std::min(low, x);
    high = std::max(high, x);
  }
  constexpr int bins = 30;
  const double width = std::max(1e-9, (high - low) / bins);
  std::vector<double> information(bins);
  for (std::size_t i = 0; i < cells_.size(); ++i) {
    if (!std::isfinite(at[i])) continue;
    const int bin = std::min(bins - 1, static_cast<int>((at[i] - low) / width));
    information[static_cast<std::size_t>(bin)] += verdict.information[static_cast<Eigen::Index>(i)];
  }
  const double best = *std::ranges::max_element(information);
  std::vector<Interval> intervals;
  for (int bin = 0; bin < bins; ++bin) {
    if (information[static_cast<std::size_t>(bin)] < best / 4) continue;
    const double from = low + bin * width;
    if (!intervals.empty() && from - intervals.back().to < 2.5 * width) {
      intervals.back().to = from + width;
    } else {
      intervals.push_back({from, from + width});
    }
  }
  return intervals;
}

void calibrate(const std::shared_ptr<Cause>& shared, Session& session, double snr) {
  Cause& cause = *shared;
  const auto measure = [&](double strength) {
    cause.strength = std::min(strength, cause.largest_strength());
    cause.build(session);
    return Oracle(session, {shared}).judge({shared}).snr;
  };
  double strength = 1, reached = measure(strength), slope = 1;
  if (!cause.has_size()) return;
  for (int i = 0; i < 14 && std::abs(reached / snr - 1) > 0.02; ++i) {
    if (!(reached > 1e-6)) {
      if (strength > 1e4) throw std::runtime_error(cause.id + " does not show in the scene " + session.scene);
      reached = measure(strength *= 10);
      continue;
    }
    const double factor = std::clamp(std::pow(snr / reached, 1 / slope), 0.02, 50.0);
    const double before = reached;
    if (strength * factor > cause.largest_strength() && strength >= cause.largest_strength()) break;
    const double old = strength;
    strength = std::min(strength * factor, cause.largest_strength());
    reached = measure(strength);
    const double found = std::log(reached / before) / std::log(strength / old);
    if (std::isfinite(found)) slope = std::clamp(found, 0.3, 3.0);
  }
  // What shows as much at any strength is no effect of it, but of how finely the engine computes.
  constexpr double hardly_any = 1e-3;
  if (strength > hardly_any) return;
  if (measure(strength / 100) > reached / 2)
    throw std::runtime_error(cause.id + " does not grow with its strength in the scene " + session.scene);
  measure(strength);
}

}  // namespace challenge
