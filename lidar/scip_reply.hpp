// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "lidar/scip_frame.hpp"
#include "lidar/scip_request.hpp"

namespace lidar::scip {

// --- what a status says ----------------------------------------------------------------------------------

/// Whether a status means that the command was done, for that command ("02" of BM is: already on).
/// A status of letters (0A..0M) is always a refusal.
[[nodiscard]] bool succeeded(std::string_view command, std::string_view status);

/// A status in words, for messages: "0L: the sensor reports an internal fault".
[[nodiscard]] std::string describe_status(std::string_view command, std::string_view status);

// --- reading ---------------------------------------------------------------------------------------------

/// VV, PP or II as keys and values: {"MODL": "UST-10LX", ...}. Lines without ':' are passed over.
[[nodiscard]] std::map<std::string, std::string> decode_info(const Frame& frame);

/// A time stamp line: 4 letters (24 bits, ms) or 11 (microseconds, high-precision firmware).
struct Stamp {
  std::uint64_t value = 0;
  bool microseconds = false;
};

/// One scan as the device sent it: codes and far values are still in it.
struct RawScan {
  Stamp stamp;
  std::vector<std::uint32_t> range;      ///< Of the first echo of every step (or cluster).
  std::vector<std::uint32_t> intensity;  ///< Empty unless the command carries it.
  /// Further echoes (HD, HE, ND, NE): index of the step in `range`, its value, its intensity (0 without).
  struct Echo {
    std::size_t index;
    std::uint32_t range, intensity;
  };
  std::vector<Echo> further;
};

enum class ScanError {
  not_a_scan,    ///< The echo is not a scan command, or the status carries no data.
  no_stamp,      ///< The first line is not a time stamp.
  wrong_length,  ///< The data do not hold a whole number of values, or not as many as the echo asks for.
};
[[nodiscard]] const char* to_string(ScanError error);

/// Decodes GD GS GE MD MS ME HD HE ND NE (and their % forms). `into` keeps its memory between calls.
[[nodiscard]] tl::expected<void, ScanError> decode_scan(const Frame& frame, RawScan& into);

/// Values in an answer to this request: one for each cluster of steps.
[[nodiscard]] int value_count(const Request& request);

/// The time of a TM1 answer.
[[nodiscard]] tl::expected<Stamp, ScanError> decode_time(const Frame& frame);

// --- writing (the simulated device) -----------------------------------------------------------------------

/// Echo, status and nothing else.
[[nodiscard]] std::string status_reply(std::string_view echo, std::string_view status);

/// VV, PP, II: lines "KEY:value;" with the sum over "KEY:value".
[[nodiscard]] std::string info_reply(std::string_view echo,
                                     std::span<const std::pair<std::string, std::string>> lines);

/// An answer of one line (TM1, %ST).
[[nodiscard]] std::string line_reply(std::string_view echo, std::string_view status, std::string_view line);

/// Appends a scan message; `intensity` empty for commands without. `digits` letters a value (2 or 3).
void append_scan_reply(std::string& out, std::string_view echo, std::string_view status,
                       std::uint32_t stamp_ms, std::span<const std::uint32_t> range,
                       std::span<const std::uint32_t> intensity, int digits);

}  // namespace lidar::scip
