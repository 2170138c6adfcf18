// SPDX-License-Identifier: MIT
#include "sim/ust_device.hpp"

#include <algorithm>
#include <cmath>

#include "lidar/response.hpp"

namespace sim {

using lidar::Command;

namespace {

constexpr double frame_s =
    1e-3;  // a UST hands scans over on its timer's next 1 ms frame (urg_stamped README)
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
      intensity_(range_.size()) {
  clock_offset_ms_ = identity_.clock_start_ms;
}

std::uint32_t UstDevice::stamp_ms(double time_s) const {
  const double device_ms = (time_s - timer_zero_s_) * (1 + identity_.clock_ppm * 1e-6) * 1e3;
  return static_cast<std::uint32_t>((static_cast<std::int64_t>(std::floor(device_ms)) + clock_offset_ms_) &
                                    0xffffff);
}

std::string UstDevice::handle(std::string_view line, double now_s) {
  if (line.empty()) return "";
  const auto request = lidar::parse_request(line);
  if (!request) return lidar::build_status_response(line, lidar::status_of(request.error()));
  const Command command = request->command;
  if (command != Command::reboot) first_restart_s_ = -1;
  if (refuses_queries_ && stream_ && (command == Command::version || command == Command::information))
    return lidar::build_status_response(line, "10");
  switch (command) {
    case Command::version:
      return identify(line);
    case Command::information:
      return state(line, now_s);
    case Command::state:
      return lidar::build_text_response(line, "00",
                                        adjusting_time_ ? "002"
                                        : stream_       ? "004"
                                        : laser_on_     ? "003"
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
    default:
      break;
  }
  if (adjusting_time_) return lidar::build_status_response(line, "10");
  switch (command) {
    case Command::parameters:
      return parameters(line);
    case Command::quit:
      stream_.reset();
      laser_on_ = false;
      return lidar::build_status_response(line, "00");
    case Command::laser_on:
      if (stream_) return lidar::build_status_response(line, "10");
      return lidar::build_status_response(line, std::exchange(laser_on_, true) ? "02" : "00");
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

std::string UstDevice::identify(std::string_view echo) const {
  const KeyValues lines = {{"VEND", "Hokuyo Automatic Co., Ltd."},
                           {"PROD", identity_.model},
                           {"FIRM", identity_.firmware},
                           {"PROT", "SCIP 2.2"},
                           {"SERI", identity_.serial}};
  return lidar::build_key_value_response(echo, "00", lines);
}

std::string UstDevice::parameters(std::string_view echo) const {
  const int steps_per_turn = static_cast<int>(std::lround(2 * fit::pi / lidar_.step_rad));
  const int rpm = static_cast<int>(std::lround(lidar_.scan_hz * 60));
  const KeyValues lines = {{"MODL", identity_.model},
                           {"DMIN", "20"},
                           {"DMAX", "30000"},
                           {"ARES", std::to_string(steps_per_turn)},
                           {"AMIN", "0"},
                           {"AMAX", std::to_string(lidar_.steps - 1)},
                           {"AFRT", std::to_string(lidar_.front_step)},
                           {"SCAN", std::to_string(rpm)}};
  return lidar::build_key_value_response(echo, "00", lines);
}

std::string UstDevice::state(std::string_view echo, double now_s) const {
  char time[8];
  std::snprintf(time, sizeof time, "%06X", stamp_ms(now_s));
  const int rpm = static_cast<int>(std::lround(lidar_.scan_hz * 60));
  const KeyValues lines = {{"MODL", identity_.model},
                           {"LASR", laser_on_ ? "ON" : "OFF"},
                           {"SCSP", std::to_string(rpm)},
                           {"MESM", stream_ ? "Measuring by Sensitive Mode" : "Idle"},
                           {"SBPS", "Ethernet 100[Mbps]"},
                           {"TIME", time},
                           {"STAT", "sensor is working normally"}};
  return lidar::build_key_value_response(echo, "00", lines);
}

std::string UstDevice::time_adjust(std::string_view echo, Command command, double now_s) {
  if (command == Command::time_enter) {
    if (stream_) return lidar::build_status_response(echo, "10");
    laser_on_ = false;
    return lidar::build_status_response(echo, std::exchange(adjusting_time_, true) ? "02" : "00");
  }
  // Real sensors answer TM1 outside the mode as well (urg_stamped's simulator).
  if (command == Command::time_read) return lidar::build_time_response(echo, stamp_ms(now_s));
  return lidar::build_status_response(echo, std::exchange(adjusting_time_, false) ? "00" : "03");
}

std::string UstDevice::check_steps(const lidar::ScanCommand& scan) const {
  return scan.last_step >= lidar_.steps ? "04" : "";
}

std::string UstDevice::single_scan(std::string_view echo, const lidar::Request& request, double now_s) {
  if (!laser_on_ && !stream_) return lidar::build_status_response(echo, "10");
  if (const std::string wrong = check_steps(request.scan); !wrong.empty())
    return lidar::build_status_response(echo, wrong);
  const double measured_s = lidar_.beam_time_s(lidar_.steps);
  const auto index = std::max<std::int64_t>(
      0, static_cast<std::int64_t>(std::floor((now_s - measured_s) / identity_.scan_period_s)));
  std::string out;
  measure(request, index, std::string(echo), "00", out);
  return out;
}

std::string UstDevice::start_stream(std::string_view echo, const lidar::Request& request, double now_s) {
  if (const std::string wrong = check_steps(request.scan); !wrong.empty())
    return lidar::build_status_response(echo, wrong);
  laser_on_ = true;
  engine_->begin_stream();
  stream_ = Stream{request, request.scan.count, request.scan.count == 0,
                   static_cast<std::int64_t>(std::ceil(now_s / identity_.scan_period_s)) + 1};
  return lidar::build_status_response(echo, "00");
}

double UstDevice::next_scan_ready_s(double now_s) {
  const double period = identity_.scan_period_s;
  const auto ready = [&](std::int64_t index) {
    const double complete = static_cast<double>(index) * period + lidar_.beam_time_s(lidar_.steps);
    const double tick_s = frame_s / (1 + identity_.clock_ppm * 1e-6);
    return timer_zero_s_ + std::ceil((complete - timer_zero_s_) / tick_s) * tick_s;
  };
  while (ready(stream_->next_index) < now_s - period) stream_->next_index += stream_->request.scan.skip + 1;
  return ready(stream_->next_index);
}

void UstDevice::append_next_scan(std::string& out) {
  Stream& stream = *stream_;
  if (!stream.endless) --stream.remaining;
  measure(stream.request, stream.next_index,
          with_count(stream.request, stream.endless ? 0 : stream.remaining), "99", out);
  stream.next_index += stream.request.scan.skip + 1;
  if (stream.endless || stream.remaining > 0) return;
  stream_.reset();
  laser_on_ = false;
}

void UstDevice::measure(const lidar::Request& request, std::int64_t scan_index, const std::string& echo,
                        std::string_view status, std::string& out) {
  const double scan_s = static_cast<double>(scan_index) * identity_.scan_period_s;
  engine_->scan(scan_s, stage_at_, range_, intensity_);
  ++scans_made_;
  scan_end_s_ = scan_s + identity_.scan_period_s;
  const lidar::ScanCommand& scan = request.scan;
  const auto first = static_cast<std::ptrdiff_t>(scan.first_step),
             past = static_cast<std::ptrdiff_t>(scan.last_step) + 1;
  lidar::ScanData data;
  data.stamp = stamp_ms(scan_s);
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
  timer_zero_s_ = now_s;
  clock_offset_ms_ = 0;
  return lidar::build_status_response(echo, "00");
}

std::string UstDevice::restart(std::string_view echo, double now_s) {
  const bool second = first_restart_s_ >= 0 && now_s - first_restart_s_ <= restart_window_s;
  first_restart_s_ = now_s;
  if (!second) return lidar::build_status_response(echo, "01");
  reboot_requested_ = true;
  return lidar::build_status_response(echo, "00");
}

void UstDevice::reboot(double now_s) {
  disconnected();
  timer_zero_s_ = now_s;
  clock_offset_ms_ = 0;
  first_restart_s_ = -1;
}

void UstDevice::disconnected() {
  stream_.reset();
  laser_on_ = adjusting_time_ = false;
}

}  // namespace sim
