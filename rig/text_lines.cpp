// SPDX-License-Identifier: MIT
#include "rig/text_lines.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "fit/echo.hpp"

namespace rig {
namespace {

constexpr double first_distance_mm = 20;  // Lidars write codes below it.

}  // namespace

bool next_line(std::istream& in, std::string& line, bool& too_long, std::size_t longest) {
  line.clear();
  too_long = false;
  std::streambuf* buffer = in.rdbuf();
  for (int c = buffer->sbumpc();; c = buffer->sbumpc()) {
    if (c == std::char_traits<char>::eof()) {
      in.setstate(std::ios::eofbit);
      return !line.empty();
    }
    if (c == '\n') break;
    if (line.size() >= longest) {
      too_long = true;
      return false;
    }
    line.push_back(static_cast<char>(c));
  }
  if (!line.empty() && line.back() == '\r') line.pop_back();
  return true;
}

std::vector<std::string_view> split(std::string_view text, char separator) {
  std::vector<std::string_view> pieces;
  while (!text.empty()) {
    const std::size_t end = text.find(separator);
    pieces.push_back(text.substr(0, end));
    if (end == text.npos) break;
    text.remove_prefix(end + 1);
  }
  return pieces;
}

std::string_view trimmed(std::string_view text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '"'; };
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

std::optional<double> number_in(std::string_view text) {
  text = trimmed(text);
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || end != text.data() + text.size() || !std::isfinite(value))
    return std::nullopt;
  return value;
}

std::uint16_t range_of(std::optional<double> mm) {
  if (!mm || !(*mm >= first_distance_mm) || *mm > 1e6) return 0;
  const long whole = std::lround(*mm);
  return whole < fit::first_error_code_mm ? static_cast<std::uint16_t>(whole) : std::uint16_t{0};
}

std::uint16_t intensity_of(std::optional<double> counts) {
  if (!counts || !(*counts > 0)) return 0;
  return static_cast<std::uint16_t>(std::lround(std::min(*counts, 65535.0)));
}

std::string listed(const std::vector<std::string>& words) {
  std::string text;
  for (const auto& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

std::string duration_text(double seconds) {
  struct Unit {
    long seconds;
    const char *one, *many;
  };
  static constexpr std::array<Unit, 4> units{
      {{86400, " day", " days"}, {3600, " h", " h"}, {60, " min", " min"}, {1, " s", " s"}}};
  const long whole = std::lround(std::max(0.0, seconds));
  const auto in_units = [](long count, const Unit& unit) {
    return std::to_string(count) + (count == 1 ? unit.one : unit.many);
  };
  for (std::size_t i = 0; i + 1 < units.size(); ++i) {
    if (whole < units[i].seconds) continue;
    const long rest = whole % units[i].seconds / units[i + 1].seconds;
    return in_units(whole / units[i].seconds, units[i]) +
           (rest > 0 ? " " + in_units(rest, units[i + 1]) : "");
  }
  return in_units(whole, units.back());
}

}  // namespace rig
