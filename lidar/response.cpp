// SPDX-License-Identifier: MIT
#include "lidar/response.hpp"

#include <algorithm>

#include "lidar/encoding.hpp"

namespace lidar {

namespace {

constexpr std::size_t block = 64;  // Characters of data in a full line.

void append_head(std::string& out, std::string_view echo, std::string_view status) {
  out += echo;
  out += '\n';
  append_checked_line(out, status);
}

std::string build_line_response(std::string_view echo, std::string_view status, std::string_view line) {
  std::string out;
  append_head(out, echo, status);
  append_checked_line(out, line);
  out += '\n';
  return out;
}

void append_clipped(std::string& out, std::uint32_t value, int characters) {
  append_value(out, std::min(value, (1u << 6 * characters) - 1), characters);
}

std::string encode_payload(const ScanCommand& command, const ScanData& data) {
  const bool with_intensity = command.format == ScanFormat::distance_intensity;
  const int characters = command.format == ScanFormat::distance2 ? 2 : 3;
  std::string payload;
  payload.reserve(data.range_mm.size() * (with_intensity ? 7 : 4));
  std::size_t step = 0;
  int echoes_left = 0;
  for (std::size_t i = 0; i < data.range_mm.size(); ++i) {
    if (command.multi_echo) {
      const bool same_step = echoes_left > 0;
      if (same_step) {
        payload += '&';
      } else {
        echoes_left = data.echoes.empty() ? 1 : std::max<int>(1, data.echoes[step++]);
      }
      --echoes_left;
    }
    append_clipped(payload, data.range_mm[i], characters);
    if (with_intensity) append_clipped(payload, data.intensity[i], 3);
  }
  return payload;
}

}  // namespace

std::string build_status_response(std::string_view echo, std::string_view status) {
  std::string out;
  append_head(out, echo, status);
  out += '\n';
  return out;
}

std::string build_key_value_response(std::string_view echo, std::string_view status,
                                     std::span<const std::pair<std::string, std::string>> values) {
  std::string out;
  append_head(out, echo, status);
  for (const auto& [key, value] : values) {
    const std::string line = key + ":" + value;
    out += line + ";" + checksum(line) + "\n";
  }
  out += '\n';
  return out;
}

std::string build_text_response(std::string_view echo, std::string_view status, std::string_view text) {
  return build_line_response(echo, status, text);
}

std::string build_time_response(std::string_view echo, std::uint64_t time, bool microseconds) {
  std::string line;
  append_value(line, time, microseconds ? 11 : 4);
  return build_line_response(echo, "00", line);
}

void append_scan_response(std::string& out, std::string_view echo, std::string_view status,
                          const ScanCommand& command, const ScanData& data) {
  append_head(out, echo, status);
  std::string stamp;
  append_value(stamp, data.stamp, command.microseconds ? 11 : 4);
  append_checked_line(out, stamp);
  const std::string payload = encode_payload(command, data);
  for (std::size_t at = 0; at < payload.size(); at += block) {
    append_checked_line(out, std::string_view(payload).substr(at, block));
  }
  out += '\n';
}

void merge_clusters(int cluster, std::uint32_t min_range_mm, std::uint32_t max_range_mm,
                    std::vector<std::uint32_t>& range_mm, std::vector<std::uint32_t>& intensity) {
  if (cluster <= 1) return;
  const auto is_code = [&](std::uint32_t range) { return range < min_range_mm || range > max_range_mm; };
  const auto width = static_cast<std::size_t>(cluster);
  std::size_t out = 0;
  for (std::size_t first = 0; first < range_mm.size(); first += width) {
    std::size_t best = first;
    for (std::size_t i = first + 1; i < std::min(first + width, range_mm.size()); ++i) {
      const bool better = is_code(range_mm[best]) ? !is_code(range_mm[i])
                                                  : !is_code(range_mm[i]) && range_mm[i] < range_mm[best];
      if (better) best = i;
    }
    range_mm[out] = range_mm[best];
    if (!intensity.empty()) intensity[out] = intensity[best];
    ++out;
  }
  range_mm.resize(out);
  if (!intensity.empty()) intensity.resize(out);
}

}  // namespace lidar
