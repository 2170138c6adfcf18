// SPDX-License-Identifier: MIT
#include "rig/runner/bench_observer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "fit/numeric/median.hpp"
#include "rig/runner/echoes.hpp"
#include "rig/runner/granted_targets.hpp"

namespace rig {
namespace {

using boost::asio::awaitable;

std::string quoted(const std::string& name) { return "'" + name + "'"; }

double largest_deviation_from_line(const std::vector<double>& x, const std::vector<double>& y) {
  if (x.size() < 3) return 0;
  const double n = static_cast<double>(x.size());
  double mx = 0, my = 0, xx = 0, xy = 0, yy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) mx += x[i] / n, my += y[i] / n;
  for (std::size_t i = 0; i < x.size(); ++i) {
    xx += (x[i] - mx) * (x[i] - mx);
    xy += (x[i] - mx) * (y[i] - my);
    yy += (y[i] - my) * (y[i] - my);
  }
  const double along = 0.5 * std::atan2(2 * xy, xx - yy);
  double largest = 0;
  for (std::size_t i = 0; i < x.size(); ++i)
    largest = std::max(largest, std::abs(-std::sin(along) * (x[i] - mx) + std::cos(along) * (y[i] - my)));
  return largest;
}

CaptureRequest beams_between(const Expectation& expected, const fit::LidarGeometry& lidar) {
  CaptureRequest request;
  const double step_deg = lidar.step_rad * fit::deg_per_rad;
  request.first_step = static_cast<int>(std::lround(lidar.front_step + expected.from_deg / step_deg));
  request.last_step = static_cast<int>(std::lround(lidar.front_step + expected.to_deg / step_deg));
  return request;
}

}  // namespace

CaptureRequest beams_of(const Expectation& expected, const fit::LidarGeometry& lidar) {
  if (!expected.of_target) return beams_between(expected, lidar);
  CaptureRequest request;
  request.first_step = lidar.first_step;
  request.last_step = lidar.steps - 1;
  return request;
}

void BenchObserver::expect(Prompt& prompt) const {
  if (!prompt.until || !prompt.until->of_target || !prompt.place) return;
  const fit::Target* target = bench_.target(prompt.place->target);
  if (!target) return;
  fit::Target wanted = placed_.as_placed(*target);
  if (prompt.place->shift_mm) wanted = shifted(*target, *prompt.place->shift_mm);
  // As stated before it was placed: only what a prompt says can be compared with another surface.
  wanted.reflectance = prompt.place->reflectance;
  prompt.until->target = wanted;
}

bool BenchObserver::can_see(const fit::Target& target) const {
  if (!stage_.referenced()) return false;
  const auto ranges = expected_ranges_mm(bench_, target, stage_.deg() * fit::rad_per_deg);
  return std::ranges::any_of(ranges, [](double range) { return std::isfinite(range); });
}

awaitable<Observation> BenchObserver::observe(Expectation expected) {
  const CaptureRequest request = beams_of(expected, bench_.lidar);
  Echoes echoes(static_cast<std::size_t>(request.last_step - request.first_step + 1));
  ScanGate gate(request, bench_.lidar.scan_hz);
  int failures = 0;
  while (!echoes.enough()) {
    const lidar::Scan scan = co_await lidar_.next(stream_for(request, 0), &gate, failures);
    if (!gate.takes(scan, 0)) {
      if (gate.hopeless()) {
        co_await lidar_.reconnect_for_unfit_scans(request, failures);
      }
      continue;
    }
    failures = 0;
    echoes.add(scan, 0);
    lidar_.show(scan);
  }
  co_await lidar_.stop();
  co_return judge(expected, request.first_step, echoes.seen());
}

Observation BenchObserver::judge(const Expectation& expected, int first_step, const BeamMedians& seen) const {
  // Both are looked for by the lidar's own step numbers, which do not all begin at 0.
  BeamMedians from_zero;
  for (auto [values, all] :
       {std::pair(&seen.range_mm, &from_zero.range_mm), std::pair(&seen.intensity, &from_zero.intensity)}) {
    all->assign(static_cast<std::size_t>(std::max(0, first_step)), std::numeric_limits<double>::quiet_NaN());
    all->insert(all->end(), values->begin(), values->end());
  }
  Observation of_beams = expected.of_beams ? judge_beams(expected, from_zero.range_mm) : Observation();
  if (!expected.of_target) return of_beams;
  Observation of_target = judge_target(expected, from_zero);
  const bool beams_decide = expected.of_beams && (!of_target.in_view || (of_target.good && !of_beams.good));
  return beams_decide ? of_beams : of_target;
}

Observation BenchObserver::judge_beams(const Expectation& expected,
                                       const std::vector<double>& range_mm) const {
  const CaptureRequest beams = beams_between(expected, bench_.lidar);
  std::vector<double> medians, x, y;
  for (int step = beams.first_step; step <= beams.last_step; ++step) {
    const double seen_mm = range_mm[static_cast<std::size_t>(step)];
    if (!std::isfinite(seen_mm)) continue;
    medians.push_back(seen_mm);
    const double angle = bench_.lidar.beam_angle(step);
    x.push_back(medians.back() * std::cos(angle));
    y.push_back(medians.back() * std::sin(angle));
  }
  if (static_cast<int>(medians.size()) * 2 < beams.last_step - beams.first_step + 1)
    return Observation(false, "the rig sees nothing there (no echo from most beams, with the stage at " +
                                  rounded_text(stage_.deg(), 2) + " deg).");
  const double seen_mm = fit::median_of(std::vector(medians));
  if (expected.within_mm && (seen_mm < expected.within_mm->first || seen_mm > expected.within_mm->second))
    return Observation(false, "the rig sees " + rounded_text(seen_mm, 1) + " mm, expected " +
                                  rounded_text(expected.within_mm->first, 1) + " to " +
                                  rounded_text(expected.within_mm->second, 1) + " mm.");
  const double rough_mm = largest_deviation_from_line(x, y);
  if (expected.flat_within_mm && rough_mm > *expected.flat_within_mm)
    return Observation(false, "what the rig sees is not flat: " + rounded_text(rough_mm, 0) +
                                  " mm off a straight line, " + to_text(*expected.flat_within_mm) +
                                  " mm allowed.");
  return Observation(true, "the rig sees " + rounded_text(seen_mm, 1) + " mm, as requested.");
}

Observation BenchObserver::judge_target(const Expectation& expected, const BeamMedians& seen) const {
  const fit::Target& target = *expected.target;
  std::vector<fit::Target> others;
  const auto granted = taken_for_granted(plan_, variables_, bench_);
  for (const fit::Target& each : bench_.targets)
    if (placed_.has_placed(each.name) || granted.contains(each.name))
      others.push_back(placed_.as_placed(each));
  const TargetDetection found =
      detect_target(bench_, target, others, stage_.deg() * fit::rad_per_deg, seen, expected.tolerance_mm);
  Observation observed;
  const bool silent = found.outcome == TargetDetection::Outcome::undetected && !expected.echo;
  observed.good = found.good() || silent;
  observed.in_view = found.outcome != TargetDetection::Outcome::out_of_view;
  observed.text = quoted(target.name) +
                  (silent         ? " cannot be checked: "
                   : found.good() ? " is in place: "
                                  : " is not in its place: ") +
                  found.words + ".";
  if (!observed.in_view) observed.text = quoted(target.name) + ": " + found.words + ".";
  const bool somewhere = found.outcome == TargetDetection::Outcome::in_place ||
                         found.outcome == TargetDetection::Outcome::misplaced;
  if (somewhere) observed.to_go_mm = found.to_go_mm;
  if (somewhere && std::isfinite(found.intensity)) observed.intensity = found.intensity;
  return observed;
}

std::string BenchObserver::wrong_surface(const Expectation& expected, const Observation& observed) {
  const fit::Target& target = *expected.target;
  if (!expected.surface || !target.reflectance || !observed.intensity) return "";
  return surfaces_.contradiction(target.name,
                                 {distance_mm(target), *target.reflectance, *observed.intensity});
}

void BenchObserver::remember_unchecked() {
  const auto add = [this](const std::string& name) {
    const fit::Target* target = bench_.target(name);
    if (!target) return;
    Expectation expected;
    expected.of_target = true;
    expected.target = placed_.as_placed(*target);
    check_later(expected);
  };
  for (const auto& [name, place] : placed_.placements()) add(name);
  for (const std::string& name : taken_for_granted(plan_, variables_, bench_)) add(name);
}

void BenchObserver::check_later(Expectation expected) {
  expected.of_beams = false;  // From elsewhere they see something else.
  unchecked_[expected.target->name] = std::move(expected);
}

std::vector<Expectation> BenchObserver::to_check_here() const {
  std::vector<Expectation> visible;
  for (const auto& [name, expected] : unchecked_)
    if (can_see(*expected.target)) visible.push_back(expected);
  return visible;
}

}  // namespace rig
