// SPDX-License-Identifier: MIT
#include "sim/causal/receiver.hpp"

#include <algorithm>
#include <cmath>

namespace sim::causal {
namespace {

/// Where a signal that is below `level` at `low` and above it at `high` crosses it (Illinois variant of the
/// false position).
template <typename Signal>
double crossing(const Signal& signal, double low, double high, double level) {
  double a = signal(low) - level, b = signal(high) - level;
  if (a >= 0) return low;
  if (b <= 0) return high;
  int side = 0;
  for (int i = 0; i < 30 && high - low > 1e-5; ++i) {
    const double middle = (low * b - high * a) / (b - a);
    const double value = signal(middle) - level;
    if (std::abs(value) < 1e-5 * level + 1e-12) return middle;
    if (value < 0) {
      low = middle;
      a = value;
      if (side == -1) b /= 2;
      side = -1;
    } else {
      high = middle;
      b = value;
      if (side == 1) a /= 2;
      side = 1;
    }
  }
  return (low + high) / 2;
}

/// The summit near `top` by parabolas through three places that draw together.
template <typename Signal>
void refine(const Signal& signal, double top, double step, double& peak) {
  for (int pass = 0; pass < 3; ++pass, step /= 4) {
    const double left = signal(top - step), here = signal(top), right = signal(top + step);
    const double bend = left - 2 * here + right;
    if (bend >= 0) return;
    const double aside = std::clamp(0.5 * (left - right) / bend, -1.0, 1.0);
    if (std::abs(aside) < 1e-3) return;
    top += aside * step;
    peak = std::max(peak, signal(top));
  }
}

}  // namespace

Receiver::Receiver(const World& world)
    : settings_(world.receiver),
      flash_decay_ns_(world.housing.flash_decay_ns),
      pulse_(world.pulse.shape, world.pulse.rise_ns),
      strongest_(settings_.echo == "strongest"),
      fraction_(settings_.timing == "fraction"),
      centre_(settings_.timing == "centre"),
      clips_(false) {
  // The firmware's table was made in the factory with lone echoes of every strength, none of them clipped.
  constexpr int points = 1200;
  nominal_first_ = std::log(settings_.threshold * 1.0005);
  nominal_step_ = (std::log(1e4) - nominal_first_) / (points - 1);
  for (int i = 0; i < points; ++i) {
    const Echo echo{0, std::exp(nominal_first_ + i * nominal_step_), &pulse_};
    nominal_.push_back(raw(std::span(&echo, 1), {}, 1).t_ns);
  }
  reference_ns_ = nominal_ns(1);
  clips_ = settings_.clip < 1e8;
}

double Receiver::nominal_ns(double peak) const {
  const double x = std::clamp((std::log(std::max(peak, 1e-12)) - nominal_first_) / nominal_step_, 0.0,
                              static_cast<double>(nominal_.size()) - 1.001);
  const auto i = static_cast<std::size_t>(x);
  const double f = x - static_cast<double>(i);
  return nominal_[i] + f * (nominal_[i + 1] - nominal_[i]);
}

/// Soft clipping: the output bends over within a few per cent of the rail.
double Receiver::clipped(double signal) const {
  if (!clips_ || signal <= 0.3 * settings_.clip) return signal;
  const double x = signal / settings_.clip;
  const double x4 = x * x * x * x;
  return signal / std::sqrt(std::sqrt(1 + x4));
}

/// Finds where the comparator goes up and down next, from `from` on; false when it stays down.
template <typename Signal>
bool Receiver::next_event(const Signal& signal, std::span<const Echo> echoes, double threshold, double& from,
                          Event& event) const {
  const double step = 0.5 * pulse_.rise_ns();
  const double first = echoes.front().t_ns, last = echoes.back().t_ns;
  double begin = from;
  if (from <= first) {
    // Up to the first echo's peak every sub-ray rises, so one look there tells whether it crosses.
    const double start = std::max(from, first + pulse_.begins_ns());
    if (signal(first) >= threshold) {
      event.up = crossing(signal, start, first, threshold);
      begin = first;
    } else {
      begin = first;
      event.up = -1e300;
    }
  } else {
    event.up = -1e300;
  }
  double t = begin, before = begin;
  std::size_t next = 0;
  while (event.up < -1e299) {
    before = t;
    t += step;
    double tail = last;
    for (const Echo& echo : echoes) tail = std::max(tail, echo.t_ns + echo.pulse->ends_ns());
    if (t > tail) return false;
    // Over silence straight to the next echo.
    while (next < echoes.size() && echoes[next].t_ns + pulse_.begins_ns() < t) ++next;
    const double here = signal(t);
    if (here < 1e-9 && next < echoes.size()) t = std::max(t, echoes[next].t_ns + pulse_.begins_ns());
    if (here >= threshold) event.up = crossing(signal, before, t, threshold);
  }
  // On to the last echo's peak, or until the comparator falls before it.
  double place = std::max(event.up, t), top = place;
  event.peak = std::max(signal(place), threshold);
  while (place < last) {
    place = std::min(last, place + step);
    const double here = signal(place);
    if (here < threshold) {
      refine(signal, top, step / 2, event.peak);
      event.down = place;
      from = place;
      return true;
    }
    if (here > event.peak) {
      event.peak = here;
      top = place;
    }
  }
  double ahead = signal(place + step);
  while (ahead > event.peak) {  // a tail, or sub-rays that add up after the last one
    event.peak = ahead;
    place += step;
    top = place;
    ahead = signal(place + step);
  }
  refine(signal, top, step / 2, event.peak);
  double down = place + step, above = place;
  if (centre_ || strongest_) {
    while (signal(down) >= threshold) {
      above = down;
      down += step;
    }
    double lo = above, hi = down;
    for (int i = 0; i < 20; ++i) {
      const double middle = (lo + hi) / 2;
      (signal(middle) >= threshold ? lo : hi) = middle;
    }
    down = (lo + hi) / 2;
  }
  event.down = down;
  from = down + step;
  return true;
}

/// The moment that is counted as the echo of an event.
template <typename Signal>
double Receiver::timed(const Signal& signal, const Event& event, double disturbance) const {
  if (centre_) return (event.up + event.down) / 2;
  if (!fraction_) return event.up;
  const double level = settings_.fraction * event.peak + disturbance;
  const double step = 0.5 * pulse_.rise_ns();
  double t = event.up;
  if (signal(t) >= level) return t;
  for (int i = 0; i < 200; ++i) {
    if (signal(t + step) >= level) return crossing(signal, t, t + step, level);
    t += step;
  }
  return event.up;
}

Reading Receiver::raw(std::span<const Echo> echoes, const Disturbance& disturbance, double gain) const {
  Reading reading;
  if (echoes.empty()) return reading;
  const double fired = pulse_.begins_ns();
  const auto signal = [&](double t) {
    double sum = 0;
    for (const Echo& echo : echoes) sum += echo.amplitude * (*echo.pulse)(t - echo.t_ns);
    sum *= gain;
    if (disturbance.flash != 0 && t > fired)
      sum += disturbance.flash * std::exp((fired - t) / flash_decay_ns_);
    return clipped(sum);
  };
  // Noise at the comparator is the same as a threshold that shakes; on a fraction of the peak it shakes the
  // same.
  const double threshold = settings_.threshold + (fraction_ ? 0 : disturbance.threshold);
  if (threshold <= 0) return reading;
  double from = echoes.front().t_ns + pulse_.begins_ns();
  Event event, best;
  while (next_event(signal, echoes, threshold, from, event)) {
    if (!reading.found || event.peak > best.peak) best = event;
    reading.found = true;
    if (!strongest_) break;
  }
  if (!reading.found) return reading;
  reading.peak = best.peak;
  reading.t_ns = timed(signal, best, disturbance.threshold);
  return reading;
}

Reading Receiver::detect(std::span<const Echo> echoes, const Disturbance& disturbance, double gain) const {
  Reading reading = raw(echoes, disturbance, gain);
  if (!reading.found) return reading;
  reading.peak = std::max(settings_.threshold, reading.peak + disturbance.peak);
  reading.t_ns -=
      settings_.compensation * nominal_ns(reading.peak) + (1 - settings_.compensation) * reference_ns_;
  return reading;
}

}  // namespace sim::causal
