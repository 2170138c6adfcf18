// SPDX-License-Identifier: MIT
#include "sim/ust_device.hpp"

#include <algorithm>
#include <cmath>

#include "lidar/encoding.hpp"
#include "lidar/response.hpp"

namespace sim {

using lidar::Command;

namespace {

// A UST hands scans over on its timer's next 1 ms frame, firmware 4.0.0 to 4.0.2 on a 5 ms one, as it does
// answers (urg_stamped README).
constexpr double usual_frame_s = 1e-3, slow_frame_s = 5e-3;
constexpr double restart_window_s = 1;  // the second RB must come within it (hokuyolx)

constexpr std::uint32_t nearest_mm = 21, farthest_mm = 65532;  // what is neither code (manual, table 3)

std::string with_count(lidar::Request request, int remaining) {
  request.scan.count = remaining;
  return lidar::build_line(request);
}

using KeyValues = std::vector<std::pair<std::string, std::string>>;

}  // namespace

UstDevice::UstDevice(const fit::LidarGeometry& lidar, UstIdentity identity, std::shared_ptr<Engine> engine,
                     std::function<StageMoment(double)> stage_at)
    : lidar_(lidar),
      identity_(std::move(identity)),
      engine_(std::move(engine)),
      stage_at_(std::move(stage_at)),
      range_(static_cast<std::size_t>(lidar.steps)),
      intensity_(range_.size()),
      clock_(identity_.clock_ppm, identity_.scan_period_s, identity_.clock_start_ms) {}

double UstDevice::answers_at_s(std::string_view line, double now_s) const {
  double ready_s = now_s;
  const bool asks_for_scan = line.starts_with("G") && (laser_on_ || stream_) && !adjusting_time_;
  if (asks_for_scan) ready_s = std::max(ready_s, finished_s(latest_scan(now_s)));
  return has(UstHabit::slow_frame) ? clock_.next_frame_s(ready_s, slow_frame_s) : ready_s;
}

void UstDevice::switch_laser_on(double now_s) {
  if (!std::exchange(laser_on_, true)) laser_on_s_ = now_s;
}

double UstDevice::finished_s(std::int64_t index) const {
  return clock_.turn_begins_s(index) + lidar_.beam_time_s(lidar_.steps);
}

std::int64_t UstDevice::latest_scan(double now_s) const {
  return std::max(clock_.turn_from(laser_on_s_), clock_.turn_at(now_s - lidar_.beam_time_s(lidar_.steps)));
}

/// Whether it hears this request; what it waited for opens its ears again.
bool UstDevice::hears(const lidar::Request& request) {
  const bool resets = request.command == Command::reset || request.command == Command::reset_keep_speed ||
                      request.command == Command::reboot;
  const bool quits = request.command == Command::quit;
  if (resets || (quits && heeds_ == Heeds::quit_or_reset)) heeds_ = Heeds::all;
  return heeds_ == Heeds::all;
}

std::string UstDevice::handle(std::string_view line, double now_s) {
  if (line.empty()) return "";
  const auto request = lidar::parse_request(line);
  if (!request) return lidar::build_status_response(line, lidar::status_of(request.error()));
  const Command command = request->command;
  if (!hears(*request)) return "";
  if (command != Command::reboot) first_restart_s_ = -1;
  const bool queries = command == Command::version || command == Command::information;
  if (has(UstHabit::refuse_queries) && stream_ && queries) return lidar::build_status_response(line, "10");
  if (has(UstHabit::queries_stop_stream) && (queries || command == Command::parameters)) stream_.reset();
  if (in_error_ && !queries && command != Command::reboot && command != Command::state)
    return lidar::build_status_response(line, "0L");
  switch (command) {
    case Command::version:
      return identify(line);
    case Command::information:
      return state(line, now_s);
    case Command::state:
      return lidar::build_text_response(line, "00",
                                        in_error_         ? "900"
                                        : adjusting_time_ ? "002"
                                        : stream_         ? "004"
                                        : laser_on_       ? "003"
                                                          : "000");
    case Command::reboot:
      return restart(line, now_s);
    case Command::reset:
    case Command::reset_keep_speed:
      return reset(line, now_s);
    case Command::time_read:  // this firmware knows no microseconds
      if (request->microseconds) return lidar::build_status_response(line, "0E");
      [[fallthrough]];
    case Command::time_enter:
    case Command::time_leave:
      return time_adjust(line, command, now_s);
    case Command::quit:
      return quit(line);
    default:
      break;
  }
  if (adjusting_time_) return lidar::build_status_response(line, "10");
  switch (command) {
    case Command::parameters:
      return parameters(line);
    case Command::laser_on: {
      const bool was_on = laser_on_ || stream_;
      switch_laser_on(now_s);
      return lidar::build_status_response(line, was_on ? "02" : "00");
    }
    case Command::sleep:  // Until it is asked to measure again.
      switch_laser_off();
      return lidar::build_status_response(line, "00");
    case Command::scan:
      // A UST-20LX gives no answer at all to the multi-echo commands (urg_library #33).
      if (request->scan.multi_echo) return "";
      if (request->scan.microseconds) return lidar::build_status_response(line, "0E");
      return request->scan.continuous ? start_stream(line, *request, now_s)
                                      : single_scan(line, *request, now_s);
    default:
      return lidar::build_status_response(line, "0F");
  }
}

std::string UstDevice::quit(std::string_view echo) {
  if (adjusting_time_) {
    if (!has(UstHabit::quit_leaves_time)) return lidar::build_status_response(echo, "10");
    adjusting_time_ = false;
  }
  if (quits_ignored_ > 0) {
    --quits_ignored_;
    return "";
  }
  laser_on_ = false;
  const int more = std::exchange(scans_after_quit_, 0);
  if (more > 0 && streaming())
    stream_->closing = more;
  else
    stream_.reset();
  return lidar::build_status_response(echo, "00");
}

std::string UstDevice::identify(std::string_view echo) const {
  const KeyValues lines = {{"VEND", "rig-sim: simulated, not a device of Hokuyo Automatic Co., Ltd."},
                           {"PROD", identity_.model},
                           {"FIRM", identity_.firmware},
                           {"PROT", "SCIP 2.2"},
                           {"SERI", identity_.serial}};
  return lidar::build_key_value_response(echo, "00", lines);
}

std::string UstDevice::parameters(std::string_view echo) const {
  const int steps_per_turn = static_cast<int>(std::lround(2 * fit::pi / lidar_.step_rad));
  const int rpm = static_cast<int>(std::lround(lidar_.scan_hz * 60));
  KeyValues lines = {{"MODL", identity_.model},
                     {"DMIN", "20"},
                     {"DMAX", "30000"},
                     {"ARES", std::to_string(steps_per_turn)},
                     {"AMIN", std::to_string(lidar_.first_step)},
                     {"AMAX", std::to_string(lidar_.steps - 1)},
                     {"AFRT", std::to_string(lidar_.front_step)},
                     {"SCAN", std::to_string(rpm)}};
  if (has(UstHabit::reordered_parameters)) std::reverse(lines.begin(), lines.end());
  if (has(UstHabit::more_parameters)) lines.emplace_back("PROT", "SCIP 2.2");
  return lidar::build_key_value_response(echo, "00", lines);
}

std::string UstDevice::state(std::string_view echo, double now_s) const {
  std::string time;
  if (has(UstHabit::coded_time)) {
    lidar::append_value(time, clock_.stamp_ms(now_s), 4);
  } else {
    char digits[8];
    std::snprintf(digits, sizeof digits, "%06X", clock_.stamp_ms(now_s));
    time = digits;
  }
  const int rpm = static_cast<int>(std::lround(lidar_.scan_hz * 60));
  const KeyValues lines = {{"MODL", identity_.model},
                           {"LASR", laser_on_ ? "ON" : "OFF"},
                           {"SCSP", has(UstHabit::speed_in_words)
                                        ? "Initial(" + std::to_string(rpm) + "[rpm])<-Default setting by user"
                                        : std::to_string(rpm)},
                           {"MESM", stream_ ? "Measuring by Sensitive Mode" : "Idle"},
                           {"SBPS", "Ethernet 100[Mbps]"},
                           {"TIME", time},
                           {"STAT", in_error_               ? "sensor is in an error state"
                                    : has(UstHabit::unwell) ? "window is dirty"
                                                            : "sensor is working normally"}};
  if (!has(UstHabit::comments)) return lidar::build_key_value_response(echo, "00", lines);
  std::string out = lidar::build_status_response(echo, "00");
  out.pop_back();  // the empty line
  for (const auto& [key, value] : lines) {
    const std::string text = key + ":" + value;
    out += text + "<-" + key + ";" + lidar::checksum(text) + "\n";
  }
  return out + "\n";
}

std::string UstDevice::time_adjust(std::string_view echo, Command command, double now_s) {
  if (command == Command::time_enter) {
    if (stream_ || refuses_time_) return lidar::build_status_response(echo, "10");
    laser_on_ = false;
    const bool was_on = std::exchange(adjusting_time_, true) && !has(UstHabit::never_already);
    return lidar::build_status_response(echo, was_on ? "02" : "00");
  }
  if (command == Command::time_read) {
    // Real sensors answer TM1 outside the mode as well (urg_stamped's simulator).
    if (!adjusting_time_ && has(UstHabit::strict_time)) return lidar::build_status_response(echo, "04");
    return lidar::build_time_response(echo, clock_.stamp_ms(now_s));
  }
  const bool was_on = std::exchange(adjusting_time_, false) || has(UstHabit::never_already);
  return lidar::build_status_response(echo, was_on ? "00" : "03");
}

std::string UstDevice::check_steps(const lidar::ScanCommand& scan) const {
  return scan.last_step >= lidar_.steps || scan.first_step < lidar_.first_step ? "04" : "";
}

std::string UstDevice::single_scan(std::string_view echo, const lidar::Request& request, double now_s) {
  if (!laser_on_ && !stream_) return lidar::build_status_response(echo, "10");
  if (const std::string wrong = check_steps(request.scan); !wrong.empty())
    return lidar::build_status_response(echo, wrong);
  const std::int64_t index = latest_scan(now_s);
  std::string out;
  measure(request, index, std::string(echo), "00", out);
  scan_end_s_ = finished_s(index + 1);  // At full speed the next one to be asked for is another.
  return out;
}

std::string UstDevice::start_stream(std::string_view echo, const lidar::Request& request, double now_s) {
  if (const std::string wrong = check_steps(request.scan); !wrong.empty())
    return lidar::build_status_response(echo, wrong);
  switch_laser_on(now_s);
  engine_->begin_stream();
  stream_ = Stream();
  stream_->request = request;
  if (std::exchange(forgets_intensities_, false)) stream_->request.scan.format = lidar::ScanFormat::distance3;
  stream_->remaining = request.scan.count;
  stream_->endless = request.scan.count == 0;
  stream_->next_index = clock_.turn_from(now_s) + 1;
  return lidar::build_status_response(echo, "00");
}

void UstDevice::stall() {
  if (stream_) stream_->stalled = true;
}

void UstDevice::switch_laser_off() {
  stream_.reset();
  laser_on_ = false;
}

void UstDevice::set_error_state(bool on) {
  in_error_ = on;
  if (on) switch_laser_off();
}

void UstDevice::check_itself(double now_s, double seconds, const std::string& status) {
  if (stream_) stream_->notices = {{now_s, status}, {now_s + std::max(0.0, seconds), "98"}};
}

double UstDevice::next_scan_ready_s(double now_s) {
  if (!stream_->notices.empty()) return std::max(now_s, stream_->notices.front().due_s);
  const double frame_s = has(UstHabit::slow_frame) ? slow_frame_s : usual_frame_s;
  const auto ready = [&](std::int64_t index) { return clock_.next_frame_s(finished_s(index), frame_s); };
  while (ready(stream_->next_index) < now_s - identity_.scan_period_s)
    stream_->next_index += stream_->request.scan.skip + 1;
  return ready(stream_->next_index);
}

void UstDevice::append_next_scan(std::string& out) {
  Stream& stream = *stream_;
  if (!stream.notices.empty()) {
    const Notice notice = stream.notices.front();
    stream.notices.erase(stream.notices.begin());
    out += lidar::build_status_response(with_count(stream.request, stream.remaining), notice.status);
    scan_end_s_ = notice.due_s;
    // What the mirror passes meanwhile is not measured.
    stream.next_index = std::max(stream.next_index, clock_.turn_from(notice.due_s));
    return;
  }
  if (!stream.endless) --stream.remaining;
  measure(stream.request, stream.next_index,
          with_count(stream.request, stream.endless ? 0 : stream.remaining), "99", out);
  stream.next_index += stream.request.scan.skip + 1;
  const bool closed = stream.closing > 0 && --stream.closing == 0;
  if (!closed && (stream.endless || stream.remaining > 0)) return;
  stream_.reset();
  laser_on_ = false;
}

void UstDevice::measure(const lidar::Request& request, std::int64_t scan_index, const std::string& echo,
                        std::string_view status, std::string& out) {
  const double scan_s = clock_.turn_begins_s(scan_index);
  if (std::exchange(measured_index_, scan_index) != scan_index) {
    engine_->scan(scan_s, stage_at_, range_, intensity_);
    ++scans_made_;
  }
  scan_end_s_ = clock_.turn_begins_s(scan_index + 1);
  const lidar::ScanCommand& scan = request.scan;
  const auto first = static_cast<std::ptrdiff_t>(scan.first_step),
             past = static_cast<std::ptrdiff_t>(scan.last_step) + 1;
  lidar::ScanData data;
  data.stamp = clock_.stamp_ms(scan_s);
  if (scan.cluster > 1) {
    sent_range_.assign(range_.begin() + first, range_.begin() + past);
    sent_intensity_.assign(intensity_.begin() + first, intensity_.begin() + past);
    lidar::merge_clusters(scan.cluster, nearest_mm, farthest_mm, sent_range_, sent_intensity_);
    data.range_mm = sent_range_;
    data.intensity = sent_intensity_;
  } else {
    const auto count = static_cast<std::size_t>(past - first);
    data.range_mm = std::span(range_).subspan(static_cast<std::size_t>(first), count);
    data.intensity = std::span(intensity_).subspan(static_cast<std::size_t>(first), count);
  }
  lidar::append_scan_response(out, echo, status, scan, data);
}

std::string UstDevice::reset(std::string_view echo, double now_s) {
  disconnected();
  clock_.zero_timer(now_s);
  return lidar::build_status_response(echo, "00");
}

std::string UstDevice::restart(std::string_view echo, double now_s) {
  const bool second = first_restart_s_ >= 0 && now_s - first_restart_s_ <= restart_window_s;
  first_restart_s_ = now_s;
  if (!second) return lidar::build_status_response(echo, "01");
  reboot_requested_ = true;
  return has(UstHabit::silent_reboot) ? "" : lidar::build_status_response(echo, "00");
}

void UstDevice::reboot(double now_s) {
  disconnected();
  measured_index_ = no_scan;
  clock_.start(now_s);
  first_restart_s_ = -1;
  heeds_ = Heeds::all;
  in_error_ = false;
}

void UstDevice::disconnected() {
  stream_.reset();
  laser_on_ = adjusting_time_ = false;
}

}  // namespace sim
