// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <istream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace rig {

/// The next line without its line end, whatever system wrote it. False at the end of the file, and for a line
/// of more than `longest` characters, which `too_long` then tells.
bool next_line(std::istream& in, std::string& line, bool& too_long, std::size_t longest = 4 << 20);

/// The pieces between separators; a separator at the very end makes no empty piece.
[[nodiscard]] std::vector<std::string_view> split(std::string_view text, char separator);

[[nodiscard]] std::string_view trimmed(std::string_view text);

/// The whole piece as a finite number, or nothing.
[[nodiscard]] std::optional<double> number_in(std::string_view text);

/// A range in millimetres as sessions hold it: 0 for codes (below 20, and from fit::first_error_code_mm on),
/// what is too far, and what is no number. Every importer's ranges come from here.
[[nodiscard]] std::uint16_t range_of(std::optional<double> mm);
/// An intensity as sessions hold it, in the lidar's counts: 0 for what is no number.
[[nodiscard]] std::uint16_t intensity_of(std::optional<double> counts);

/// Words with commas between.
[[nodiscard]] std::string listed(const std::vector<std::string>& words);

/// A duration in its two largest units: "32 s", "2 min 3 s", "1 h 2 min", "5 days 13 h". Below zero it is "0
/// s".
[[nodiscard]] std::string duration_text(double seconds);

}  // namespace rig
