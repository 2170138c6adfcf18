// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>
#include <vector>

#include "lidar/frame_reader.hpp"
#include "lidar/request.hpp"

namespace lidar {

/// What is wrong with an answer's data.
enum class DataError {
  bad_checksum,     ///< A line's last character does not match the sum of the others.
  bad_character,    ///< A data byte outside 0x30 to 0x6F, or a control character in a text line.
  bad_line_length,  ///< A line of data that is empty or not 64 characters although another follows.
  bad_stamp,        ///< The time stamp does not have its 4 (or 11) characters.
  wrong_count,      ///< More or fewer values than the request asked for.
  bad_key_value,    ///< A line of VV, PP or II that is not KEY:value;
};
[[nodiscard]] std::string_view to_string(DataError error);

using KeyValues = std::vector<std::pair<std::string, std::string>>;

/// The lines of VV, PP and II in their order. The sum may stand over the text before ';', over the ';' too,
/// or over the text before a trailing "<-comment": firmwares differ. The comment stays in the value.
[[nodiscard]] tl::expected<KeyValues, DataError> decode_key_values(std::string_view body);

/// The first value of a key; an empty string when there is none.
[[nodiscard]] std::string value_of(const KeyValues& values, std::string_view key);

/// One checked line of text (%ST).
[[nodiscard]] tl::expected<std::string, DataError> decode_text(std::string_view body);

/// The answer of TM1 (4 characters, milliseconds) or %TM1 (11, microseconds).
[[nodiscard]] tl::expected<std::uint64_t, DataError> decode_time(std::string_view body,
                                                                 bool microseconds = false);

/// The TIME of II: 6 hexadecimal digits on USB sensors, 4 SCIP characters on the UST. Empty for anything
/// else.
[[nodiscard]] std::optional<std::uint32_t> decode_information_time(std::string_view value);

/// The sensor's raw numbers of one scan, codes included.
struct RawScan {
  std::uint64_t stamp = 0;               ///< Milliseconds modulo 2^24; microseconds for %MD and %ME.
  std::vector<std::uint32_t> range_mm;   ///< With multi-echo: all echoes of step 0, then of step 1 ...
  std::vector<std::uint32_t> intensity;  ///< As long as range_mm, or empty without intensity.
  std::vector<std::uint8_t> echoes;      ///< Multi-echo only: how many values each step has.
};

/// Decodes a scan answer's body for any scan command. `command` says the format and the number of values
/// (from the echo or from the request). The stamp may be 4 or 11 characters whatever the command says:
/// firmwares differ.
[[nodiscard]] tl::expected<RawScan, DataError> decode_scan(std::string_view body, const ScanCommand& command);

}  // namespace lidar
