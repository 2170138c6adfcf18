// SPDX-License-Identifier: MIT
#include "sim/ust_device.hpp"

#include <algorithm>
#include <cmath>

#include "lidar/scip_reply.hpp"
#include "lidar/scip_text.hpp"

namespace sim {

namespace scip = lidar::scip;

namespace {

constexpr double frame_s = 1e-3;        // a UST hands scans over on the next 1 ms frame (urg_stamped README)
constexpr double restart_window_s = 1;  // the second RB must come within it (hokuyolx)

std::string with_count(scip::Request request, int remaining) {
  request.count = remaining;
  return request.text();
}

/// Each output is the least of `cluster` neighbouring steps; codes count only where there is nothing else.
std::uint32_t least(std::span<const std::uint32_t> range, std::size_t from, std::size_t to, std::size_t& at) {
  const auto is_code = [](std::uint32_t value) { return value < 21 || value >= 65533; };
  at = from;
  for (std::size_t i = from + 1; i < to; ++i)
    if (!is_code(range[i]) && (is_code(range[at]) || range[i] < range[at])) at = i;
  return range[at];
}

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
  const auto request = scip::parse_request(line);
  if (!request) return scip::status_reply(line, request.error());
  const std::string& command = request->command;
  if (command != "RB") first_restart_s_ = -1;
  if (command == "VV") return identify(line);
  if (command == "II") return state(line, now_s);
  if (command == "%ST")
    return scip::line_reply(line, "00",
                            adjusting_time_ ? "002"
                            : stream_       ? "004"
                            : laser_on_     ? "003"
                                            : "000");
  if (command == "RB") return restart(line, now_s);
  if (command == "RS" || command == "RT") return reset(line, now_s);
  if (command == "TM") return time_adjust(line, request->parameters, now_s);
  if (adjusting_time_) return scip::status_reply(line, "10");
  if (command == "PP") return parameters(line);
  if (command == "QT") {
    stream_.reset();
    laser_on_ = false;
    return scip::status_reply(line, "00");
  }
  if (command == "BM") {
    if (stream_) return scip::status_reply(line, "10");
    return scip::status_reply(line, std::exchange(laser_on_, true) ? "02" : "00");
  }
  // A UST-20LX gives no answer at all to the multi-echo commands (urg_library #33).
  if (command == "HD" || command == "HE" || command == "ND" || command == "NE") return "";
  if (command == "GD" || command == "GS" || command == "GE") return single_scan(line, *request, now_s);
  if (command == "MD" || command == "MS" || command == "ME") return start_stream(line, *request, now_s);
  return scip::status_reply(line, command == "%TM" || command == "%MD" || command == "%ME" ? "0E" : "0F");
}

std::string UstDevice::identify(std::string_view echo) const {
  const std::vector<std::pair<std::string, std::string>> lines = {{"VEND", "Hokuyo Automatic Co., Ltd."},
                                                                  {"PROD", identity_.model},
                                                                  {"FIRM", identity_.firmware},
                                                                  {"PROT", "SCIP 2.2"},
                                                                  {"SERI", identity_.serial}};
  return scip::info_reply(echo, lines);
}

std::string UstDevice::parameters(std::string_view echo) const {
  const int steps_per_turn = static_cast<int>(std::lround(2 * fit::pi / lidar_.step_rad));
  const int rpm = static_cast<int>(std::lround(lidar_.scan_hz * 60));
  const std::vector<std::pair<std::string, std::string>> lines = {{"MODL", identity_.model},
                                                                  {"DMIN", "20"},
                                                                  {"DMAX", "30000"},
                                                                  {"ARES", std::to_string(steps_per_turn)},
                                                                  {"AMIN", "0"},
                                                                  {"AMAX", std::to_string(lidar_.steps - 1)},
                                                                  {"AFRT", std::to_string(lidar_.front_step)},
                                                                  {"SCAN", std::to_string(rpm)}};
  return scip::info_reply(echo, lines);
}

std::string UstDevice::state(std::string_view echo, double now_s) const {
  char time[8];
  std::snprintf(time, sizeof time, "%06X", stamp_ms(now_s));
  const int rpm = static_cast<int>(std::lround(lidar_.scan_hz * 60));
  const std::vector<std::pair<std::string, std::string>> lines = {
      {"MODL", identity_.model},
      {"LASR", laser_on_ ? "ON" : "OFF"},
      {"SCSP", std::to_string(rpm)},
      {"MESM", stream_ ? "Measuring by Sensitive Mode" : "Idle"},
      {"SBPS", "Ethernet 100[Mbps]"},
      {"TIME", time},
      {"STAT", "sensor is working normally"}};
  return scip::info_reply(echo, lines);
}

std::string UstDevice::time_adjust(std::string_view echo, const std::string& digit, double now_s) {
  if (digit == "0") {
    if (stream_) return scip::status_reply(echo, "10");
    laser_on_ = false;
    return scip::status_reply(echo, std::exchange(adjusting_time_, true) ? "02" : "00");
  }
  // Real sensors answer TM1 outside the mode as well (urg_stamped's simulator).
  if (digit == "1") return scip::line_reply(echo, "00", scip::encode(stamp_ms(now_s), 4));
  if (digit == "2") return scip::status_reply(echo, std::exchange(adjusting_time_, false) ? "00" : "03");
  return scip::status_reply(echo, "01");
}

std::string UstDevice::check_steps(const scip::Request& request) const {
  if (request.last_step >= lidar_.steps) return "04";
  if (request.last_step < request.first_step) return "05";
  return "";
}

std::string UstDevice::single_scan(std::string_view echo, const scip::Request& request, double now_s) {
  if (!laser_on_ && !stream_) return scip::status_reply(echo, "10");
  if (const std::string wrong = check_steps(request); !wrong.empty()) return scip::status_reply(echo, wrong);
  const double measured_s = lidar_.beam_time_s(lidar_.steps);
  const auto index = std::max<std::int64_t>(
      0, static_cast<std::int64_t>(std::floor((now_s - measured_s) / identity_.scan_period_s)));
  std::string out;
  measure(request, index, std::string(echo), "00", out);
  return out;
}

std::string UstDevice::start_stream(std::string_view echo, const scip::Request& request, double now_s) {
  if (const std::string wrong = check_steps(request); !wrong.empty()) return scip::status_reply(echo, wrong);
  laser_on_ = true;
  stream_ = Stream{request, request.count, request.count == 0,
                   static_cast<std::int64_t>(std::ceil(now_s / identity_.scan_period_s)) + 1};
  return scip::status_reply(echo, "00");
}

double UstDevice::next_scan_ready_s(double now_s) {
  const double period = identity_.scan_period_s;
  const auto ready = [&](std::int64_t index) {
    const double complete = static_cast<double>(index) * period + lidar_.beam_time_s(lidar_.steps);
    return std::ceil(complete / frame_s) * frame_s;
  };
  while (ready(stream_->next_index) < now_s - period) stream_->next_index += stream_->request.skip + 1;
  return ready(stream_->next_index);
}

void UstDevice::append_next_scan(std::string& out) {
  Stream& stream = *stream_;
  if (!stream.endless) --stream.remaining;
  measure(stream.request, stream.next_index,
          with_count(stream.request, stream.endless ? 0 : stream.remaining), "99", out);
  stream.next_index += stream.request.skip + 1;
  if (stream.endless || stream.remaining > 0) return;
  stream_.reset();
  laser_on_ = false;
}

void UstDevice::measure(const scip::Request& request, std::int64_t scan_index, const std::string& echo,
                        std::string_view status, std::string& out) {
  const double scan_s = static_cast<double>(scan_index) * identity_.scan_period_s;
  engine_->scan(scan_s, stage_at_, range_, intensity_);
  ++scans_made_;
  scan_end_s_ = scan_s + identity_.scan_period_s;
  const auto cluster = static_cast<std::size_t>(std::max(request.cluster, 1));
  const auto first = static_cast<std::size_t>(request.first_step),
             past = static_cast<std::size_t>(request.last_step) + 1;
  std::span<std::uint32_t> range(range_), intensity(intensity_);
  std::size_t count = past - first;
  if (cluster == 1) {
    range = range.subspan(first, count);
    intensity = intensity.subspan(first, count);
  } else {  // in place: the output never overtakes the input
    count = 0;
    for (std::size_t from = first; from < past; from += cluster, ++count) {
      std::size_t at = from;
      const std::uint32_t value = least(range_, from, std::min(from + cluster, past), at);
      const std::uint32_t counts = intensity_[at];
      range_[count] = value;
      intensity_[count] = counts;
    }
    range = range.first(count);
    intensity = intensity.first(count);
  }
  const int letters = request.command[1] == 'S' ? 2 : 3;
  if (letters == 2)
    for (std::uint32_t& value : range) value = std::min<std::uint32_t>(value, 4095);
  scip::append_scan_reply(out, echo, status, stamp_ms(scan_s), range,
                          request.command[1] == 'E' ? intensity : std::span<std::uint32_t>{}, letters);
}

std::string UstDevice::reset(std::string_view echo, double now_s) {
  disconnected();
  timer_zero_s_ = now_s;
  clock_offset_ms_ = 0;
  return scip::status_reply(echo, "00");
}

std::string UstDevice::restart(std::string_view echo, double now_s) {
  const bool second = first_restart_s_ >= 0 && now_s - first_restart_s_ <= restart_window_s;
  first_restart_s_ = now_s;
  if (!second) return scip::status_reply(echo, "01");
  reboot_requested_ = true;
  return scip::status_reply(echo, "00");
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
