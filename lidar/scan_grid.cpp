// SPDX-License-Identifier: MIT
#include "lidar/scan_grid.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lidar {
namespace {

constexpr double period_tolerance = 0.01;       // of the nominal period; real motors stay within 0.2 %
constexpr double least_start_wander_ms = 2e-4;  // a second, before anything else is known of a motor
constexpr double least_period_wander_ms = 1e-5;
// Of each scan. Without it, one that is early by some microseconds where stamps pass to the next millisecond
// would say that the period is a whole number of milliseconds.
constexpr double least_jitter_ms = 0.010;
constexpr double widening_interval_ms = 2000;
constexpr double largest_misfit_ms = 2;   // beyond, it is another grid
constexpr double wander_memory = 0.99;    // of the wandering that was seen, a second
constexpr double cut_share = 0.02;        // of the polygon's width: less is not worth a cut
constexpr std::size_t many_corners = 10;  // more hardly say anything that matters
constexpr double smallest_side_ms = 2e-5;
constexpr std::size_t most_corners = 20;  // a period of whole milliseconds would gather more and more

}  // namespace

ScanGrid::ScanGrid(double nominal_period_ms)
    : nominal_period_ms_(nominal_period_ms),
      start_wander_ms_(least_start_wander_ms),
      period_wander_ms_(least_period_wander_ms) {
  centre_.period = nominal_period_ms;
}

void ScanGrid::restart() { begun_ = false; }

void ScanGrid::set_step(double step_ms) {
  if (step_ms != step_ms_) restart();
  step_ms_ = step_ms;
}

void ScanGrid::begin(std::uint64_t stamp_ms) {
  const double least = nominal_period_ms_ * (1 - period_tolerance),
               most = nominal_period_ms_ * (1 + period_tolerance);
  polygon_ = {{0, least}, {step_ms_, least}, {step_ms_, most}, {0, most}};
  begun_ = true;
  stamp_ms_ = stamp_ms;
  turns_ = gap_ms_ = 0;
  since_widened_ms_ = 0;
  summarise();
}

ScanGrid::Start ScanGrid::add(std::uint64_t stamp_ms) {
  const double gap_ms = static_cast<double>(stamp_ms - stamp_ms_);
  if (!begun_ || stamp_ms <= stamp_ms_) {
    begin(stamp_ms);
  } else {
    stamp_ms_ = stamp_ms;
    advance(gap_ms);
  }
  const double variance = start_variance_ + turns_ * (2 * covariance_ + turns_ * period_variance_);
  return {static_cast<double>(stamp_ms) + centre_.later(turns_, gap_ms_), std::sqrt(std::max(0.0, variance))};
}

/// Brings the polygon to the newest scan.
void ScanGrid::rebase() {
  for (Point& corner : polygon_) corner.start = corner.later(turns_, gap_ms_);
  turns_ = gap_ms_ = 0;
}

/// Goes on to the scan that was stamped `gap_ms` later and cuts the polygon to what that stamp allows.
void ScanGrid::advance(double gap_ms) {
  since_widened_ms_ += gap_ms;
  const double turns = std::round(gap_ms / centre_.period);
  turns_ += turns;
  gap_ms_ += gap_ms;
  const bool widens = since_widened_ms_ > widening_interval_ms;
  if (widens) {
    rebase();
    const double seconds = since_widened_ms_ / 1000;
    widen(start_wander_ms_ * seconds, period_wander_ms_ * seconds);
    const double kept = std::pow(wander_memory, seconds);
    start_wander_ms_ = std::max(least_start_wander_ms, kept * start_wander_ms_);
    period_wander_ms_ = std::max(least_period_wander_ms, kept * period_wander_ms_);
    since_widened_ms_ = 0;
  }
  double low = 1e300, high = -1e300;
  for (const Point& corner : polygon_) {
    const double start = corner.later(turns_, gap_ms_);
    low = std::min(low, start);
    high = std::max(high, start);
  }
  const double least_ms = -least_jitter_ms, most_ms = step_ms_ + least_jitter_ms;
  const double misfit = std::max({0.0, least_ms - high, low - most_ms});
  if (turns < 1 || misfit > largest_misfit_ms || high - low > nominal_period_ms_ / 2) return begin(stamp_ms_);
  const double slack = cut_share * (high - low);
  if (!widens && low > least_ms - slack && high < most_ms + slack) return;
  rebase();
  if (misfit > 0) {
    start_wander_ms_ = std::max(1.5 * start_wander_ms_, misfit);
    period_wander_ms_ = std::max(1.5 * period_wander_ms_, misfit / 40);
    widen(misfit + start_wander_ms_, period_wander_ms_);
    low -= misfit + start_wander_ms_;
    high += misfit + start_wander_ms_;
  }
  if (low < least_ms) cut(least_ms, 1);
  if (high > most_ms) cut(most_ms, -1);
  summarise();
}

/// The polygon's Minkowski sum with a box: the hull of its corners, each moved to the box's four.
void ScanGrid::widen(double start, double period) {
  scratch_.clear();
  for (const Point& corner : polygon_)
    for (const double s : {-start, start})
      for (const double p : {-period, period}) scratch_.push_back({corner.start + s, corner.period + p});
  std::sort(scratch_.begin(), scratch_.end(), [](const Point& a, const Point& b) {
    return a.start < b.start || (a.start == b.start && a.period < b.period);
  });
  const auto turns_left = [](const Point& o, const Point& a, const Point& b) {
    return (a.start - o.start) * (b.period - o.period) - (a.period - o.period) * (b.start - o.start) > 0;
  };
  polygon_.clear();
  const auto add_chain = [&](auto first, auto last) {  // Andrew's monotone chain
    const std::size_t base = polygon_.size();
    for (; first != last; ++first) {
      while (polygon_.size() >= base + 2 && !turns_left(polygon_.end()[-2], polygon_.end()[-1], *first))
        polygon_.pop_back();
      polygon_.push_back(*first);
    }
    polygon_.pop_back();
  };
  add_chain(scratch_.begin(), scratch_.end());
  add_chain(scratch_.rbegin(), scratch_.rend());
}

/// Keeps what lies beyond a value of `start`, above it with sign 1 (Sutherland and Hodgman).
void ScanGrid::cut(double bound, double sign) {
  scratch_.clear();
  for (std::size_t i = 0; i < polygon_.size(); ++i) {
    const Point &here = polygon_[i], &next = polygon_[i + 1 < polygon_.size() ? i + 1 : 0];
    const double inside = sign * (here.start - bound), inside_next = sign * (next.start - bound);
    if (inside >= 0) scratch_.push_back(here);
    if ((inside >= 0) == (inside_next >= 0)) continue;
    const double share = inside / (inside - inside_next);
    scratch_.push_back({bound, here.period + share * (next.period - here.period)});
  }
  polygon_.swap(scratch_);
  if (polygon_.size() <= many_corners) return;
  // Corners that are almost the same say the same. What is lost is some nanoseconds.
  scratch_.clear();
  for (const Point& corner : polygon_)
    if (scratch_.empty() || std::abs(corner.start - scratch_.back().start) > smallest_side_ms ||
        std::abs(corner.period - scratch_.back().period) > smallest_side_ms / 1000)
      scratch_.push_back(corner);
  if (scratch_.size() >= 3) polygon_.swap(scratch_);
  while (polygon_.size() > most_corners && drop_side()) {
  }
}

/// Lets the two sides beside one meet, where that adds the least: no possible grid is lost.
bool ScanGrid::drop_side() {
  const std::size_t n = polygon_.size();
  double least = std::numeric_limits<double>::infinity();
  std::size_t dropped = 0;
  Point meeting{};
  for (std::size_t i = 0; i < n; ++i) {
    const Point &a = polygon_[i], &b = polygon_[(i + 1) % n], &c = polygon_[(i + 2) % n],
                &d = polygon_[(i + 3) % n];
    const auto cross = [](const Point& from, const Point& to, const Point& and_from, const Point& and_to) {
      return (to.start - from.start) * (and_to.period - and_from.period) -
             (to.period - from.period) * (and_to.start - and_from.start);
    };
    const double turn = cross(a, b, c, d), into = cross(b, c, c, d), before = cross(a, b, b, c);
    if (!(turn > 0 && into >= 0 && before >= 0)) continue;  // they do not meet on this side
    const double share = into / turn;
    const double added = share * before;
    if (added >= least) continue;
    least = added;
    dropped = i + 1;
    meeting = {b.start + share * (b.start - a.start), b.period + share * (b.period - a.period)};
  }
  if (std::isinf(least)) return false;
  polygon_[dropped % n] = meeting;
  polygon_.erase(polygon_.begin() + static_cast<std::ptrdiff_t>((dropped + 1) % n));
  return true;
}

/// Centre of mass of the polygon and its second moments: those of a uniform distribution over it.
void ScanGrid::summarise() {
  const Point& origin = polygon_.front();
  double area = 0, start = 0, period = 0, start_squared = 0, period_squared = 0, product = 0;
  for (std::size_t i = 1; i + 1 < polygon_.size(); ++i) {
    const double ax = polygon_[i].start - origin.start, ay = polygon_[i].period - origin.period;
    const double bx = polygon_[i + 1].start - origin.start, by = polygon_[i + 1].period - origin.period;
    const double triangle = ax * by - ay * bx;
    area += triangle;
    start += triangle * (ax + bx) / 3;
    period += triangle * (ay + by) / 3;
    start_squared += triangle * (ax * ax + ax * bx + bx * bx) / 6;
    period_squared += triangle * (ay * ay + ay * by + by * by) / 6;
    product += triangle * (2 * ax * ay + ax * by + bx * ay + 2 * bx * by) / 12;
  }
  if (!(area > 1e-18)) {  // a line or a point: its middle
    const auto [least, most] = std::minmax_element(
        polygon_.begin(), polygon_.end(), [](const Point& a, const Point& b) { return a.start < b.start; });
    centre_ = {(least->start + most->start) / 2, (least->period + most->period) / 2};
    const double width = most->start - least->start;
    start_variance_ = width * width / 12;
    period_variance_ = covariance_ = 0;
    return;
  }
  start /= area;
  period /= area;
  centre_ = {origin.start + start, origin.period + period};
  start_variance_ = start_squared / area - start * start;
  period_variance_ = period_squared / area - period * period;
  covariance_ = product / area - start * period;
}

}  // namespace lidar
