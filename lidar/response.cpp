// SPDX-License-Identifier: MIT
#include "lidar/response.hpp"

#include <algorithm>
#include <vector>

#include "lidar/encoding.hpp"

namespace lidar {

namespace {

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

/// The number, or the largest that so many characters can hold.
template <int characters>
char* put(char* at, std::uint32_t value) {
  value = std::min(value, (1u << 6 * characters) - 1);
  for (int shift = 6 * (characters - 1); shift >= 0; shift -= 6)
    *at++ = static_cast<char>((value >> shift & 0x3F) + 0x30);
  return at;
}

template <int characters>
char* put_values(char* at, const ScanCommand& command, const ScanData& data) {
  const bool with_intensity = command.format == ScanFormat::distance_intensity;
  std::size_t step = 0;
  int echoes_left = 0;
  for (std::size_t i = 0; i < data.range_mm.size(); ++i) {
    if (command.multi_echo) {
      if (echoes_left > 0)
        *at++ = '&';
      else
        echoes_left = data.echoes.empty() ? 1 : std::max<int>(1, data.echoes[step++]);
      --echoes_left;
    }
    at = put<characters>(at, data.range_mm[i]);
    if (with_intensity) at = put<3>(at, data.intensity[i]);
  }
  return at;
}

/// A line with its sum and LF. The sum needs its lowest 6 bits only, so that bytes may add up as bytes, many
/// at a time.
char* put_line(char* at, const char* data, std::size_t size) {
  std::uint8_t sum = 0;
  for (std::size_t i = 0; i < size; ++i) sum = static_cast<std::uint8_t>(sum + data[i]);
  at = std::copy_n(data, size, at);
  *at++ = static_cast<char>((sum & 0x3F) + 0x30);
  *at++ = '\n';
  return at;
}

/// The values, in lines of 64 characters, each with its sum.
void append_payload(std::string& out, const ScanCommand& command, const ScanData& data) {
  constexpr std::size_t most_characters = 7;  // of a step: '&', range and intensity
  std::vector<char> values(most_characters * data.range_mm.size());
  const char* const end = command.format == ScanFormat::distance2
                              ? put_values<2>(values.data(), command, data)
                              : put_values<3>(values.data(), command, data);
  const auto size = static_cast<std::size_t>(end - values.data());
  const std::size_t had = out.size(), lines = (size + line_characters - 1) / line_characters;
  out.resize(had + size + 2 * lines);
  char* to = out.data() + had;
  const char* from = values.data();
  for (; from + line_characters <= end; from += line_characters) to = put_line(to, from, line_characters);
  if (from < end) put_line(to, from, static_cast<std::size_t>(end - from));
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
  append_payload(out, command, data);
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
