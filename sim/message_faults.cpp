// SPDX-License-Identifier: MIT
#include "sim/message_faults.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "lidar/encoding.hpp"
#include "lidar/request.hpp"
#include "lidar/response.hpp"

namespace sim {

namespace {

using Context = MessageFault::Context;

constexpr std::string_view scan_status = "\n99b\n";
constexpr std::size_t block = 64, stamp_characters = 4;

std::size_t some(double uniform, std::size_t count) {
  return static_cast<std::size_t>(uniform * static_cast<double>(count));
}

std::size_t whole(double amount) { return static_cast<std::size_t>(std::clamp(amount, 0.0, 1e6)); }

/// A message taken apart: echo, status, and its lines of data without their sums.
struct Parts {
  std::string head;  ///< Echo and status lines.
  std::vector<std::string> lines;
};

/// Takes a message with its empty line apart; no lines when it has no data.
Parts parts_of(const std::string& message) {
  Parts parts;
  const std::size_t echo_end = message.find('\n'), head_end = message.find('\n', echo_end + 1);
  if (echo_end == std::string::npos || head_end == std::string::npos) return parts;
  parts.head = message.substr(0, head_end + 1);
  for (std::size_t at = head_end + 1, end = 0; at < message.size() && message[at] != '\n'; at = end + 1) {
    end = message.find('\n', at);
    if (end == std::string::npos) break;
    parts.lines.push_back(message.substr(at, end - at - 1));
  }
  return parts;
}

std::string joined(const Parts& parts) {
  std::string message = parts.head;
  for (const std::string& line : parts.lines) lidar::append_checked_line(message, line);
  return message + "\n";
}

// --- of any answer ---

void repeat_previous(std::string& message, const Context& context) { message.insert(0, context.previous); }

void alter_echo(std::string& message, const Context& context) {
  const std::size_t at = some(context.random.uniform(), std::max<std::size_t>(message.find('\n'), 1));
  if (at < message.size()) message[at] = message[at] == 'Z' ? 'A' : 'Z';
}

void alter_status(std::string& message, const Context& context) {
  constexpr std::string_view letters = "ABCDEFGHILM";
  const std::size_t at = message.find('\n') + 1;
  if (at == 0 || at + 3 > message.size()) return;
  const std::size_t which = some(context.random.uniform(), 99 + letters.size());
  std::string status = which < 99 ? std::to_string(which + 1) : std::string("0") + letters[which - 99];
  if (status.size() < 2) status.insert(0, "0");
  message.replace(at, 3, status + lidar::checksum(status));
}

// --- of scans ---

void insert_answer(std::string& message, const Context&) {
  const std::string answer = lidar::build_text_response("II", "00", "LASR:ON");
  message.insert(message.size() / 2, answer);
}

void repeat(std::string& message, const Context& context) {
  const std::string once = message;
  for (std::size_t i = 0; i < std::min<std::size_t>(whole(context.amount), 100); ++i) message += once;
}

/// The values that remain are sent in good order, each line with its right sum.
void drop_values(std::string& message, const Context& context) {
  Parts parts = parts_of(message);
  if (parts.lines.size() < 2) return;
  const std::size_t characters = message[1] == 'E' ? 6 : 3;
  std::string payload;
  for (std::size_t i = 1; i < parts.lines.size(); ++i) payload += parts.lines[i];
  payload.resize(payload.size() - std::min(payload.size(), characters * whole(context.amount)));
  parts.lines.resize(1);
  for (std::size_t at = 0; at < payload.size(); at += block) parts.lines.push_back(payload.substr(at, block));
  message = joined(parts);
}

/// One character is missing, and the line's sum is right for what is left.
void shorten_line(std::string& message, const Context& context) {
  Parts parts = parts_of(message);
  if (parts.lines.size() < 2) return;
  std::string& line = parts.lines[1 + some(context.random.uniform(), parts.lines.size() - 1)];
  if (line.size() < 2) return;
  line.erase(some(context.random.uniform(), line.size()), 1);
  message = joined(parts);
}

void change_count(std::string& message, const Context& context) {
  const auto asked = lidar::parse_request(message.substr(0, message.find('\n')));
  if (!asked || asked->command != lidar::Command::scan) return;
  lidar::Request other = *asked;
  other.scan.count = (asked->scan.count + 1 + static_cast<int>(some(context.random.uniform(), 98))) % 100;
  message.replace(0, message.find('\n'), lidar::build_line(other));
}

void set_stamp_back(std::string& message, const Context& context) {
  Parts parts = parts_of(message);
  if (parts.lines.empty()) return;
  const auto stamp = lidar::decode_value(parts.lines[0]);
  if (!stamp || parts.lines[0].size() != stamp_characters) return;
  parts.lines[0].clear();
  const auto by = static_cast<std::uint64_t>(std::llround(context.amount));
  lidar::append_value(parts.lines[0], (*stamp - by) & 0xFFFFFF, stamp_characters);
  message = joined(parts);
}

// --- of the answer to PP ---

void drop_line(std::string& message, const Context& context) {
  const Parts parts = parts_of(message);
  std::size_t at = parts.head.size();
  const std::size_t line = whole(context.amount);
  if (line < 1 || line > parts.lines.size()) return;
  for (std::size_t i = 1; i < line; ++i) at = message.find('\n', at) + 1;
  const std::size_t end = message.find('\n', at);
  message.erase(at, end + 1 - at);
}

constexpr std::array faults{
    MessageFault{"previous-first", "the answer before comes once more, ahead of the next one",
                 MessageFault::Of::any, "", 0, repeat_previous},
    MessageFault{"echo", "the next answer repeats another request than was sent", MessageFault::Of::any, "",
                 0, alter_echo},
    MessageFault{"other-status", "the next answer has another status, any that there is",
                 MessageFault::Of::any, "", 0, alter_status},
    MessageFault{"insert", "an answer that nobody asked for stands inside the next scan (urg_stamped #135)",
                 MessageFault::Of::scan, "", 0, insert_answer},
    MessageFault{"repeat-scan", "the next scan is sent again", MessageFault::Of::scan, "times", 1, repeat},
    MessageFault{"short-scan", "the next scan lacks its last values; its sums are right",
                 MessageFault::Of::scan, "values", 1, drop_values},
    MessageFault{"short-line", "a line of the next scan lacks a character; its sum is right",
                 MessageFault::Of::scan, "", 0, shorten_line},
    MessageFault{"count", "the next scan gives a wrong number of scans that remain", MessageFault::Of::scan,
                 "", 0, change_count},
    MessageFault{"old-stamp", "the next scan's stamp is too early (urg_stamped #64)", MessageFault::Of::scan,
                 "ms", 100, set_stamp_back},
    MessageFault{"missing-parameter", "a line is missing in the next answer to PP",
                 MessageFault::Of::parameters, "line", 6, drop_line},
};

}  // namespace

std::span<const MessageFault> message_faults() { return faults; }

bool concerns(MessageFault::Of of, std::string_view message) {
  if (of == MessageFault::Of::scan) return message.find(scan_status) != std::string_view::npos;
  if (of == MessageFault::Of::parameters) return message.starts_with("PP");
  return true;
}

}  // namespace sim
