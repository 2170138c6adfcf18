// SPDX-License-Identifier: MIT
#include "rig/import/plausibility.hpp"

#include <algorithm>
#include <cmath>

#include "fit/numeric/angle.hpp"
#include "fit/numeric/number_format.hpp"

namespace rig {
namespace {

constexpr double least_rate_ratio = 0.7, most_rate_ratio = 1.4, most_distance_ratio = 3;
constexpr std::size_t scans_looked_ahead = 1000;
// The fastest of scanning lidars turn 200 times a second; who takes a scan by hand rarely takes one in 10 s.
constexpr double least_interval_s = 1.0 / 500, most_interval_s = 10;
constexpr double least_pause_s = 60, most_pause_ratio = 3;  ///< A recording was stopped, or a clock was set.
/// Intervals, as where two messages changed places; a clock that was set is farther back.
constexpr double most_disorder = 1.5;
/// A hundredth above a full turn: drivers state steps that are a little too wide.
constexpr double most_fan_rad = 1.01 * 2 * fit::pi;
// Finer steps than the finest lidars have (0.014 deg, along a full turn) in a fan that would be radians.
constexpr double most_fan_of_radians_deg = 2 * fit::pi * 1.01, finest_step_deg = 0.02;
// Quarters of pi to 3 in 10,000: the step was rounded to four digits or more. Few beams hit them by chance.
constexpr double quarter_tolerance = 3e-4;
constexpr std::size_t least_beams_of_quarters = 10;
// Bounds that no robot of a laboratory comes near: 72 km/h, one and a half turns a second, and wheels of
// 100 mm radius at 36 km/h. Other units miss them by factors of 57 and more.
constexpr double most_speed_m_s = 20, most_turn_rad_s = 10, most_wheel_rad_s = 100;

template <class T>
T middle_of(std::vector<T> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double distance_m(const fit::TrackPose& a, const fit::TrackPose& b) {
  return 1e-3 * std::hypot(*b.x_mm - *a.x_mm, *b.y_mm - *a.y_mm);
}

}  // namespace

void Plausibility::Speed::add(std::int64_t stamp_ns, double way) {
  const double elapsed_s = since_ns_ ? 1e-9 * static_cast<double>(stamp_ns - *since_ns_) : 0;
  if (!since_ns_ || elapsed_s < 0) {
    since_ns_ = stamp_ns;
    way_ = 0;
    return;
  }
  way_ += way;
  if (elapsed_s <= 0) return;
  unfinished_ = static_cast<float>(way_ / elapsed_s);
  if (elapsed_s < 1) return;
  if (unfinished_ > 0) windows_.push_back(unfinished_);
  since_ns_ = stamp_ns;
  way_ = 0;
  unfinished_ = 0;
}

double Plausibility::Speed::high() const {
  if (windows_.empty()) return unfinished_;
  std::vector<float> windows = windows_;
  const auto at = windows.begin() + static_cast<std::ptrdiff_t>(windows.size() * 9 / 10);
  std::nth_element(windows.begin(), at, windows.end());
  return *at;
}

void Plausibility::pose(std::int64_t stamp_ns, const fit::TrackPose& pose) {
  if (last_track_ns_)
    track_interval_s_.push_back(static_cast<float>(1e-9 * static_cast<double>(stamp_ns - *last_track_ns_)));
  last_track_ns_ = stamp_ns;
  if (pose.x_mm && pose.y_mm) {
    travel_.add(stamp_ns, last_pose_ ? distance_m(*last_pose_, pose) : 0);
    if (pose.heading_rad)
      turn_.add(stamp_ns, last_pose_ && last_pose_->heading_rad
                              ? std::abs(fit::wrap_angle(*pose.heading_rad - *last_pose_->heading_rad))
                              : 0);
    last_pose_ = pose;
  }
  if (pose.wheel_left_rad && pose.wheel_right_rad) {
    wheels_.add(stamp_ns, last_wheels_
                              ? std::max(std::abs(*pose.wheel_left_rad - *last_wheels_->wheel_left_rad),
                                         std::abs(*pose.wheel_right_rad - *last_wheels_->wheel_right_rad))
                              : 0);
    last_wheels_ = pose;
  }
}

void Plausibility::scan(const ImportedScan& scan) {
  if (scans_ == 0)
    first_ns_ = scan.stamp_ns;
  else
    interval_s_.push_back(static_cast<float>(1e-9 * static_cast<double>(scan.stamp_ns - last_ns_)));
  last_ns_ = scan.stamp_ns;
  ++scans_;
  const double swept_rad = std::abs(scan.geometry.step_rad) * static_cast<double>(scan.range_mm.size());
  if (scan.geometry.scan_s && *scan.geometry.scan_s > 0 && swept_rad > 0) {
    turn_s_sum_ += *scan.geometry.scan_s * 2 * fit::pi / swept_rad;
    ++timed_;
  }
  if (scan.range_mm.size() > 1) {
    const double fan_rad = std::abs(scan.geometry.step_rad) * static_cast<double>(scan.range_mm.size() - 1);
    if (fan_rad > widest_fan_rad_) {
      widest_fan_rad_ = fan_rad;
      widest_step_rad_ = std::abs(scan.geometry.step_rad);
      widest_beams_ = scan.range_mm.size();
    }
  }
  std::vector<std::uint16_t> ahead;
  for (std::size_t k = 0; k < scan.range_mm.size(); ++k) {
    if (scan.range_mm[k] == 0) continue;
    ++echoes_;
    const double angle = scan.geometry.first_rad + static_cast<double>(k) * scan.geometry.step_rad;
    if (std::abs(fit::wrap_angle(angle)) < 10 * fit::rad_per_deg) ahead.push_back(scan.range_mm[k]);
  }
  if (!ahead.empty() && ahead_mm_.size() < scans_looked_ahead)
    ahead_mm_.push_back(middle_of(std::move(ahead)));
}

std::optional<double> Plausibility::usual_interval_s() const {
  if (interval_s_.size() < 2) return std::nullopt;
  return middle_of(interval_s_);
}

std::optional<double> Plausibility::stamped_hz() const {
  const auto interval_s = usual_interval_s();
  if (!interval_s || *interval_s < least_interval_s) return std::nullopt;
  return 1 / *interval_s;
}

std::optional<std::string> Plausibility::impossible() const {
  if (widest_fan_rad_ <= most_fan_rad) return std::nullopt;
  return "Its " + std::to_string(widest_beams_) + " beams of " +
         fit::format_fixed(widest_step_rad_ * fit::deg_per_rad, 3) + " deg each would sweep " +
         fit::format_fixed(widest_fan_rad_ * fit::deg_per_rad, 0) +
         " deg, more than a full turn: the unit of the angles is another (angle_deg and angle_rad in "
         "--columns), or --step-deg is wrong.";
}

void Plausibility::doubt_times(std::vector<std::string>& doubts) const {
  const std::string unit =
      " Check the unit of the times, and name it with --columns time_ms,... (or time_s, "
      "time_us, time_ns).";
  if (scans_ > 2 && first_ns_ == last_ns_ && std::ranges::all_of(interval_s_, [](float s) { return s == 0; }))
    doubts.push_back("All its scans carry the same time, so motion cannot be reconstructed from them.");
  else if (const auto interval_s = usual_interval_s();
           interval_s && *interval_s > 0 && (*interval_s < least_interval_s || *interval_s > most_interval_s))
    doubts.push_back("Its scans are stamped " + fit::format_fixed(1000 * *interval_s, 3) + " ms apart (" +
                     fit::format_fixed(1 / *interval_s, 3) + " Hz), which is no rate of a lidar (" +
                     fit::format_fixed(1 / most_interval_s, 1) + " to " +
                     fit::format_fixed(1 / least_interval_s, 0) + " Hz)." + unit);
  else if (interval_s && timed_ > 0) {
    const double turn_s = turn_s_sum_ / static_cast<double>(timed_);
    // Stamps that come in bursts have the right mean, stamps with pauses the right middle.
    const double mean_s = 1e-9 * static_cast<double>(last_ns_ - first_ns_) / static_cast<double>(scans_ - 1);
    const auto contradicts = [&](double s) {
      return s < least_rate_ratio * turn_s || s > most_rate_ratio * turn_s;
    };
    if (contradicts(*interval_s) && contradicts(mean_s))
      doubts.push_back(
          "Its scans are stamped " + fit::format_fixed(1000 * *interval_s, 2) + " ms apart (" +
          fit::format_fixed(1 / std::max(1e-9, *interval_s), 2) + " Hz), but the lidar is said to turn in " +
          fit::format_fixed(1000 * turn_s, 2) + " ms (" + fit::format_fixed(1 / turn_s, 2) +
          " Hz): one of the two is wrong, or scans were left out. Give the lidar's rate with --scan-hz, "
          "or the unit of the times with --columns time_ms,...");
  }
  const double usual_s = usual_interval_s().value_or(0);
  const auto back = [&](float s) { return s < 0 && -s > most_disorder * usual_s; };
  if (const std::string sentence = scans_where(back, "are stamped earlier than the scan before", "by");
      !sentence.empty())
    doubts.push_back(sentence +
                     " Put the rows in the order of their times, or import recordings that were joined as "
                     "files of their own.");
  if (track_interval_s_.size() > 1)
    if (const double track_s = middle_of(track_interval_s_); track_s > most_interval_s)
      doubts.push_back("Its wheels or poses are stamped " + fit::format_fixed(track_s, 1) +
                       " s apart, too far for a drive." + unit);
}

void Plausibility::doubt_angles(std::vector<std::string>& doubts) const {
  const double fan_deg = widest_fan_rad_ * fit::deg_per_rad, step_deg = widest_step_rad_ * fit::deg_per_rad;
  if (widest_beams_ < 2 || fan_deg > most_fan_of_radians_deg) return;
  bool quarters = false;  // Of pi, from the first beam to the last, or with the step that closes a turn.
  for (const double swept : {fan_deg, fan_deg + step_deg}) {
    const double count = swept / (fit::pi / 4);
    quarters = quarters || (std::round(count) >= 1 &&
                            std::abs(count - std::round(count)) < quarter_tolerance * std::round(count));
  }
  if (step_deg >= finest_step_deg && !(quarters && widest_beams_ >= least_beams_of_quarters)) return;
  doubts.push_back("Its beams sweep " + fit::format_fixed(fan_deg, 4) + " deg in steps of " +
                   fit::format_fixed(step_deg, 5) +
                   " deg: these are likely radians. Name the unit with --columns (angle_rad), or give "
                   "--first-deg and --step-deg in degrees.");
}

void Plausibility::doubt_speeds(std::vector<std::string>& doubts) const {
  const auto check = [&](const Speed& speed, double most, const std::string& what, const std::string& unit,
                         const std::string& remedy) {
    if (speed.high() <= most) return;
    doubts.push_back(what + fit::format_fixed(speed.high(), 0) + unit + ", more than the " +
                     fit::format_fixed(most, 0) + unit + " of any robot: " + remedy +
                     " or the times are in another unit. Name the units with --columns.");
  };
  check(travel_, most_speed_m_s, "Its poses move at ", " m/s", "x and y (x_m, x_mm)");
  check(turn_, most_turn_rad_s, "Its poses turn at ", " rad/s", "the heading (heading_rad, heading_deg)");
  check(wheels_, most_wheel_rad_s, "Its wheels turn at ", " rad/s",
        "the wheels' angles (left_rad, left_deg), --ticks-a-turn");
}

std::vector<std::string> Plausibility::notes() const {
  const double usual_s = usual_interval_s().value_or(0);
  const auto same = [](float s) { return s == 0; };
  const auto back = [&](float s) { return s < 0 && -s <= most_disorder * usual_s; };
  const auto pause = [&](float s) { return s > std::max(least_pause_s, most_pause_ratio * usual_s); };
  std::vector<std::string> notes;
  for (const auto& sentence : {scans_where(same, "carry the time of the scan before", ""),
                               scans_where(back, "are stamped a little earlier than the scan before", "by"),
                               scans_where(pause, "come after a pause", "after")})
    if (!sentence.empty()) notes.push_back(sentence);
  return notes;
}

/// The scans after such an interval, in a sentence; "" where there are none.
std::string Plausibility::scans_where(const std::function<bool(float)>& interval_is, const std::string& what,
                                      const std::string& by) const {
  const auto first = std::ranges::find_if(interval_s_, interval_is);
  if (first == interval_s_.end()) return "";
  return std::to_string(std::ranges::count_if(interval_s_, interval_is)) + " of its " +
         std::to_string(scans_) + " scans " + what + "; the first is scan " +
         std::to_string(first - interval_s_.begin() + 2) +
         (by.empty() ? "." : ", " + by + " " + fit::format_fixed(std::abs(*first), 3) + " s.");
}

std::vector<std::string> Plausibility::doubts(std::optional<double> true_mm) const {
  std::vector<std::string> doubts;
  if (scans_ > 0 && echoes_ == 0)
    doubts.push_back("Every range of its " + std::to_string(scans_) +
                     " scans is 0 (no echo): the unit may be another, or the columns. For a table, name unit "
                     "and columns with "
                     "--columns, e.g. --columns time_s,range_m*360.");
  doubt_times(doubts);
  doubt_angles(doubts);
  doubt_speeds(doubts);
  if (true_mm && !ahead_mm_.empty()) {
    const double seen_mm = middle_of(ahead_mm_), ratio = *true_mm / seen_mm;
    if (ratio > most_distance_ratio || ratio < 1 / most_distance_ratio)
      doubts.push_back(
          "The true distance is given as " + fit::format_fixed(*true_mm, 0) +
          " mm, but ahead of the lidar (0 deg) the ranges are about " + fit::format_fixed(seen_mm, 0) +
          " mm: one of the two is in another unit, or the target stands elsewhere. Check --true-mm, which "
          "takes millimetres, and the names of the files.");
  }
  return doubts;
}

}  // namespace rig
