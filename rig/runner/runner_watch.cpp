// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <limits>

#include "fit/median.hpp"
#include "rig/runner/runner_impl.hpp"
#include "rig/runner/scan_gate.hpp"

namespace rig {
namespace {

constexpr int scans_of_a_check = 10;
constexpr double between_attempts_s = 2;
// Of a device that sends as fast as it is read: two checks a second are enough for an eye.
constexpr double between_checks_s = 0.5;

/// The echoes of the beams that are checked, collected until they can be judged.
class Echoes {
 public:
  explicit Echoes(std::size_t beams) : ranges_(beams), levels_(beams) {}
  /// `offset`: index of the first of these beams within the scan.
  void add(const lidar::Scan& scan, std::size_t offset) {
    ++scans_;
    for (std::size_t i = 0; i < ranges_.size() && offset + i < scan.range_mm.size(); ++i) {
      if (scan.range_mm[offset + i] == 0) continue;
      ranges_[i].push_back(scan.range_mm[offset + i]);
      if (offset + i < scan.intensity.size()) levels_[i].push_back(scan.intensity[offset + i]);
    }
  }
  [[nodiscard]] bool enough() const { return scans_ >= scans_of_a_check; }
  /// Medians of the beams that had an echo in half of the scans.
  [[nodiscard]] BeamMedians seen() const {
    constexpr double none = std::numeric_limits<double>::quiet_NaN();
    BeamMedians seen;
    for (std::size_t i = 0; i < ranges_.size(); ++i) {
      const bool sure = ranges_[i].size() >= scans_of_a_check / 2;
      seen.range_mm.push_back(sure ? fit::median_of(std::vector(ranges_[i])) : none);
      seen.intensity.push_back(sure && !levels_[i].empty() ? fit::median_of(std::vector(levels_[i])) : none);
    }
    return seen;
  }

 private:
  std::vector<std::vector<double>> ranges_, levels_;
  int scans_ = 0;
};

bool is_cancellation(const std::exception_ptr& why) {
  try {
    std::rethrow_exception(why);
  } catch (const boost::system::system_error& error) {
    return error.code() == asio::error::operation_aborted;
  } catch (...) {
    return false;
  }
}

CaptureRequest steps_of(const Expectation& expected, const fit::LidarGeometry& lidar) {
  CaptureRequest request;
  if (expected.of_target) {
    request.last_step = lidar.steps - 1;
    return request;
  }
  const double step_deg = lidar.step_rad * fit::deg_per_rad;
  request.first_step = static_cast<int>(std::lround(lidar.front_step + expected.from_deg / step_deg));
  request.last_step = static_cast<int>(std::lround(lidar.front_step + expected.to_deg / step_deg));
  return request;
}

}  // namespace

awaitable<Runner::Impl::Observation> Runner::Impl::observe(Expectation expected) {
  const CaptureRequest request = steps_of(expected, known_bench.lidar);
  Echoes echoes(static_cast<std::size_t>(request.last_step - request.first_step + 1));
  ScanGate gate(request, known_bench.lidar.scan_hz);
  int failures = 0;
  while (!echoes.enough()) {
    const lidar::Scan scan = co_await next_scan(stream_for(request, 0), &gate, failures);
    if (!gate.takes(scan, 0)) {
      if (gate.hopeless()) {
        co_await reconnect_for_unfit_scans(request, failures);
      }
      continue;
    }
    failures = 0;
    echoes.add(scan, 0);
    show(scan);
  }
  co_await stop_stream();
  co_return judge(expected, request.first_step, echoes.seen());
}

Runner::Impl::Observation Runner::Impl::judge(const Expectation& expected, int first_step,
                                              const BeamMedians& seen) const {
  if (expected.of_target) return judge_target(expected, seen);
  std::vector<double> medians, x, y;
  for (std::size_t i = 0; i < seen.range_mm.size(); ++i) {
    if (!std::isfinite(seen.range_mm[i])) continue;
    medians.push_back(seen.range_mm[i]);
    const double angle = known_bench.lidar.beam_angle(first_step + static_cast<double>(i));
    x.push_back(medians.back() * std::cos(angle));
    y.push_back(medians.back() * std::sin(angle));
  }
  if (medians.size() * 2 < seen.range_mm.size())
    return Observation(false, "the rig sees nothing there (no echo from most beams, with the stage at " +
                                  rounded_text(position_deg, 2) + " deg).");
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

double Runner::Impl::largest_deviation_from_line(const std::vector<double>& x, const std::vector<double>& y) {
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

awaitable<void> Runner::Impl::pause_for(double seconds) { co_await parts.clock.sleep(seconds); }

awaitable<void> Runner::Impl::never() {
  asio::steady_timer timer(co_await asio::this_coro::executor, asio::steady_timer::time_point::max());
  co_await timer.async_wait(asio::use_awaitable);
}

awaitable<void> Runner::Impl::watch_bench(std::optional<Expectation> until) {
  const bool is_attended = !parts.operator_.unattended() && connected;
  bool lost = false;
  while (is_attended) {
    std::exception_ptr why;
    try {
      if (lost) {
        co_await connect_lidar();
        lost = false;
        ++state.reconnects;
        time.lidar_began_anew();
        note("info", "lidar is back");
      }
      co_await watch_stream(until);
    } catch (...) {
      why = std::current_exception();
    }
    // The driver has reset the cancellation state for its last words to the device: only the exception tells.
    if (is_cancellation(why) || answered || operator_failed || aborted) co_return;
    if (!lost)
      note("warning", "lidar lost: " + words_of(why) + " Check its power and cable; rig keeps trying.");
    lost = true;
    streaming = false;
    show(Observation(false, "the lidar does not answer."));
    changed();
    co_await pause_for(between_attempts_s);
  }
  co_await never();
}

awaitable<void> Runner::Impl::watch_stream(std::optional<Expectation> until) {
  const fit::LidarGeometry& lidar = known_bench.lidar;
  const CaptureRequest wanted = until ? steps_of(*until, lidar) : CaptureRequest();
  const auto beams = static_cast<std::size_t>(until ? wanted.last_step - wanted.first_step + 1 : 0);
  while (true) {
    // A start that is cancelled half-way leaves the device streaming as well.
    streaming = true;
    co_await parts.lidar.start(whole_scan(lidar));
    Echoes echoes(beams);
    bool enough = false;
    while (!enough) {
      const lidar::Scan scan = co_await parts.lidar.next();
      show(scan);
      echoes.add(scan, static_cast<std::size_t>(std::max(0, wanted.first_step - scan.first_step)));
      if (echoes.enough()) {
        if (until) show(judge(*until, wanted.first_step, echoes.seen()));
        echoes = Echoes(beams);
        enough = time.follows_lidar();
      }
      changed();
    }
    co_await end_stream();
    co_await pause_for(between_checks_s);
  }
}

void Runner::Impl::show(const Observation& observed) {
  if (!state.prompt) return;
  state.prompt->check = observed.good ? "" : observed.text;
  state.prompt->seen = observed.good ? observed.text : "";
  state.prompt->to_go_mm = observed.to_go_mm;
}

awaitable<void> Runner::Impl::end_watch() {
  std::exception_ptr why;
  try {
    co_await end_stream();
  } catch (...) {
    why = std::current_exception();
  }
  // The next step connects anew.
  if (why) note("warning", "lidar lost: " + words_of(why));
}

}  // namespace rig
