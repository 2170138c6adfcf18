// SPDX-License-Identifier: MIT
#include "lidar/scan_receiver.hpp"

#include <algorithm>

#include "lidar/encoding.hpp"

namespace lidar {
namespace {

constexpr std::string_view scan_status = "99b\n";
constexpr std::size_t count_digits = 2, stamp_line = 6;  // four characters, their sum and LF

}  // namespace

std::uint16_t largest_range_mm(int max_range_mm) {
  return static_cast<std::uint16_t>(std::clamp(max_range_mm, 0, 65534));
}

bool ScanReceiver::can_take(const ScanCommand& command) {
  return command.continuous && !command.multi_echo && !command.microseconds &&
         command.format != ScanFormat::distance2;
}

ScanReceiver::ScanReceiver(const ScanCommand& command, const std::string& text, int min_range_mm,
                           int max_range_mm, Kernel kernel)
    : echo_begin_(build_line(Request(command))), echo_end_(text.empty() ? "\n" : ";" + text + "\n") {
  echo_begin_.resize(echo_begin_.size() - count_digits);
  echo_end_ += scan_status;
  shape_.values = static_cast<std::size_t>(command.values());
  shape_.with_intensity = command.format == ScanFormat::distance_intensity;
  shape_.least_mm = static_cast<std::uint16_t>(std::clamp(min_range_mm, 0, 65535));
  shape_.most_mm = largest_range_mm(max_range_mm);
  kernel_ = kernel;
  message_bytes_ =
      echo_begin_.size() + count_digits + echo_end_.size() + stamp_line + shape_.bytes() + 1;  // LF
}

std::optional<std::uint32_t> ScanReceiver::take(std::string_view bytes, Scan& scan) const {
  if (message_bytes_ == 0 || bytes.size() < message_bytes_) return std::nullopt;
  const std::string_view end = bytes.substr(echo_begin_.size() + count_digits, echo_end_.size());
  if (!bytes.starts_with(echo_begin_) || end != echo_end_ || bytes[message_bytes_ - 1] != '\n')
    return std::nullopt;
  const std::string_view count = bytes.substr(echo_begin_.size(), count_digits);
  if (!std::all_of(count.begin(), count.end(), [](char c) { return c >= '0' && c <= '9'; }))
    return std::nullopt;
  const std::string_view stamp =
      bytes.substr(echo_begin_.size() + count_digits + echo_end_.size(), stamp_line);
  const std::optional<std::uint64_t> time = decode_value(stamp.substr(0, 4));
  if (!time || checksum(stamp.substr(0, 4)) != stamp[4] || stamp[5] != '\n') return std::nullopt;
  scan.range_mm.resize(shape_.values);
  scan.intensity.resize(shape_.with_intensity ? shape_.values : 0);
  if (!decode_lines(kernel_, stamp.data() + stamp_line, shape_, scan.range_mm.data(), scan.intensity.data()))
    return std::nullopt;
  return static_cast<std::uint32_t>(*time);
}

}  // namespace lidar
