// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "lidar/request.hpp"

namespace lidar {

/// The sensor's side of SCIP: whole answers, for simulators. `echo` is the request's line exactly as it came.

/// An answer without data: echo, status, empty line.
[[nodiscard]] std::string build_status_response(std::string_view echo, std::string_view status);

/// VV, PP, II: lines "KEY:value;" with the sum over what stands before ';'.
[[nodiscard]] std::string build_key_value_response(
    std::string_view echo, std::string_view status,
    std::span<const std::pair<std::string, std::string>> values);

/// %ST and the like: one checked line of text.
[[nodiscard]] std::string build_text_response(std::string_view echo, std::string_view status,
                                              std::string_view text);

/// TM1 (4 characters of milliseconds, modulo 2^24) or %TM1 (11 of microseconds).
[[nodiscard]] std::string build_time_response(std::string_view echo, std::uint64_t time,
                                              bool microseconds = false);

/// What a scan answer carries. Values above the format's largest are clipped to it. With multi-echo,
/// `echoes[i]` (1 to 3) consecutive values belong to step i; empty means one each.
struct ScanData {
  std::uint64_t stamp = 0;  ///< Milliseconds modulo 2^24, or microseconds for %MD and %ME.
  std::span<const std::uint32_t> range_mm;
  std::span<const std::uint32_t>
      intensity;  ///< Used by formats with intensity only; then as long as range_mm.
  std::span<const std::uint8_t> echoes;
};

/// Appends one scan's answer: echo line, status ("99" for continuous scans, "00" for single ones), stamp,
/// data in lines of 64 with their sums, empty line. For continuous scans `echo` must already carry the number
/// of scans that remain.
void append_scan_response(std::string& out, std::string_view echo, std::string_view status,
                          const ScanCommand& command, const ScanData& data);

/// Smallest of each group of `cluster` neighbouring values, codes left out unless a group has nothing else
/// (S20 page 10): what a sensor does before it sends. A code is a range below `min_range_mm` or above
/// `max_range_mm`. Intensities follow the range that was chosen; an empty span stays empty.
void merge_clusters(int cluster, std::uint32_t min_range_mm, std::uint32_t max_range_mm,
                    std::vector<std::uint32_t>& range_mm, std::vector<std::uint32_t>& intensity);

}  // namespace lidar
