// SPDX-License-Identifier: MIT
#include "rig/stage/stage_reply.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdio>

namespace rig {

namespace {

std::string two_digits(int number) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), "%02d", number);
  return text.data();
}

/// Sum of all bytes after the start character plus the checksum is 0 modulo 256.
std::string checksum(std::string_view text) {
  unsigned sum = 0;
  for (const char c : text) sum += static_cast<unsigned char>(c);
  std::array<char, 8> hex{};
  std::snprintf(hex.data(), hex.size(), "%02X", (256 - sum % 256) % 256);
  return hex.data();
}

bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// Sign, blanks, digits: exactly ten characters.
std::optional<double> position_of(std::string_view field) {
  const bool is_negative = field[0] == '-';
  if (!is_negative && field[0] != ' ' && field[0] != '+' && !is_digit(field[0])) return std::nullopt;
  std::size_t at = is_digit(field[0]) ? 0 : 1;
  while (at < field.size() && field[at] == ' ') ++at;
  if (at == field.size()) return std::nullopt;
  double value = 0;
  for (; at < field.size(); ++at) {
    if (!is_digit(field[at])) return std::nullopt;
    value = 10 * value + (field[at] - '0');
  }
  return is_negative ? -value : value;
}

std::optional<bool> flag_of(std::string_view field) {
  if (field == "0") return false;
  if (field == "1") return true;
  return std::nullopt;
}

}  // namespace

std::optional<long long> whole_number(std::string_view text) {
  long long number = 0;
  const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (failed != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return number;
}

std::vector<std::string> words_of(std::string_view text) {
  std::vector<std::string> words;
  for (std::size_t at = 0; (at = text.find_first_not_of(' ', at)) != std::string_view::npos;) {
    const std::size_t end = std::min(text.find(' ', at), text.size());
    words.emplace_back(text.substr(at, end - at));
    at = end;
  }
  return words;
}

std::string zaber_command(const std::string& words, int device, int axis, int id) {
  const std::string text =
      std::to_string(device) + " " + std::to_string(axis) + " " + two_digits(id) + " " + words;
  return "/" + text + ":" + checksum(text) + "\n";
}

std::optional<ZaberReply> zaber_reply(std::string_view line, int device, int axis, int id) {
  const std::size_t start = line.rfind('@');
  if (start == std::string_view::npos) return std::nullopt;
  line.remove_prefix(start + 1);
  // The protocol is printable ASCII: anything else was spoilt on the line, and is not for a terminal.
  if (std::ranges::any_of(line, [](char c) { return c < ' ' || c > '~'; })) return std::nullopt;
  if (line.size() >= 3 && line[line.size() - 3] == ':') {
    if (checksum(line.substr(0, line.size() - 3)) != line.substr(line.size() - 2)) return std::nullopt;
    line.remove_suffix(3);
  }
  const std::vector<std::string> words = words_of(line);
  if (words.size() < 7 || whole_number(words[0]) != device || whole_number(words[1]) != axis ||
      whole_number(words[2]) != id)
    return std::nullopt;
  if ((words[3] != "OK" && words[3] != "RJ") || (words[4] != "BUSY" && words[4] != "IDLE") ||
      words[5].size() != 2)
    return std::nullopt;
  ZaberReply reply;
  reply.accepted = words[3] == "OK";
  reply.busy = words[4] == "BUSY";
  reply.flag = words[5];
  for (std::size_t i = 6; i < words.size(); ++i) reply.data += (i > 6 ? " " : "") + words[i];
  return reply;
}

std::optional<ShotStatus> shot_status(std::string_view line, int axis) {
  constexpr std::size_t width = 11, letters = 5;  // "pppppppppp," and "K,K,R"
  if (line.size() < width + letters || (line.size() - letters) % width != 0) return std::nullopt;
  ShotStatus status;
  status.axes = static_cast<int>((line.size() - letters) / width);
  if (status.axes > 4 || axis < 1 || axis > status.axes) return std::nullopt;
  for (int i = 0; i < status.axes; ++i) {
    const std::string_view field = line.substr(static_cast<std::size_t>(i) * width, width);
    const auto position = position_of(field.substr(0, width - 1));
    if (!position || field.back() != ',') return std::nullopt;
    if (i + 1 == axis) status.position = *position;
  }
  const std::string_view tail = line.substr(line.size() - letters);
  if ((tail[0] != 'K' && tail[0] != 'X') || tail[1] != ',' || tail[3] != ',' ||
      (tail[4] != 'B' && tail[4] != 'R'))
    return std::nullopt;
  status.understood = tail[0] == 'K';
  status.busy = tail[4] == 'B';
  if (status.axes <= 2) {
    if (tail[2] != 'K' && tail[2] != 'L' && tail[2] != 'M' && tail[2] != 'W') return std::nullopt;
    status.at_limit = tail[2] == 'W' || tail[2] == (axis == 1 ? 'L' : 'M');
  } else {  // A hexadecimal digit with a bit an axis; K none, W all.
    const std::size_t bits = std::string_view("K123456789ABCDEW").find(tail[2]);
    if (bits == std::string_view::npos) return std::nullopt;
    status.at_limit = (bits >> (axis - 1) & 1U) != 0;
  }
  return status;
}

std::optional<bool> shot_acknowledgement(std::string_view line) {
  if (line == "OK") return true;
  if (line == "NG") return false;
  return std::nullopt;
}

std::optional<FalconStatus> falcon_status(std::string_view line) {
  constexpr std::string_view start = "FR_OK:";
  if (!line.starts_with(start)) return std::nullopt;
  std::vector<std::string_view> fields;
  for (std::size_t at = start.size();;) {
    const std::size_t end = std::min(line.find(':', at), line.size());
    fields.push_back(line.substr(at, end - at));
    if (end == line.size()) break;
    at = end + 1;
  }
  if (fields.size() != 6) return std::nullopt;
  const std::string_view deg = fields[1];
  if (deg.size() < 4 || deg.size() > 6 || deg[deg.size() - 3] != '.') return std::nullopt;
  FalconStatus status;
  for (const char c : deg) {
    if (c == '.') continue;
    if (!is_digit(c)) return std::nullopt;
    status.deg = status.deg * 10 + (c - '0');
  }
  status.deg /= 100;
  const auto moving = flag_of(fields[2]), limit = flag_of(fields[3]), derotates = flag_of(fields[4]),
             reversed = flag_of(fields[5]);
  if (status.deg > 360 || !moving || !limit || !derotates || !reversed) return std::nullopt;
  status.moving = *moving;
  status.at_limit = *limit;
  status.reversed = *reversed;
  return status;
}

}  // namespace rig
