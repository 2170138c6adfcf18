// SPDX-License-Identifier: MIT
#include "lidar/request.hpp"

#include <algorithm>
#include <array>

namespace lidar {

namespace {

struct Plain {
  std::string_view word;
  Command command;
};
// Commands without parameters. Longer words first, so that a prefix decides.
constexpr std::array plain_commands{
    Plain{"SCIP2.0", Command::switch_scip2},
    Plain{"%ST", Command::state},
    Plain{"%SL", Command::sleep},
    Plain{"VV", Command::version},
    Plain{"PP", Command::parameters},
    Plain{"II", Command::information},
    Plain{"BM", Command::laser_on},
    Plain{"QT", Command::quit},
    Plain{"RS", Command::reset},
    Plain{"RT", Command::reset_keep_speed},
    Plain{"RB", Command::reboot},
};

struct WithDigits {
  std::string_view word;
  Command command;
  std::size_t digits;
};
constexpr std::array digit_commands{
    WithDigits{"$IP", Command::set_address, 36},  WithDigits{"CR", Command::motor_speed, 2},
    WithDigits{"HS", Command::sensitivity, 1},    WithDigits{"SS", Command::bit_rate, 6},
    WithDigits{"DB", Command::simulate_fault, 2},
};

struct ScanWord {
  std::string_view word;
  bool continuous, multi_echo;
  ScanFormat format;
};
constexpr std::array scan_words{
    ScanWord{"GS", false, false, ScanFormat::distance2},
    ScanWord{"GD", false, false, ScanFormat::distance3},
    ScanWord{"GE", false, false, ScanFormat::distance_intensity},
    ScanWord{"HD", false, true, ScanFormat::distance3},
    ScanWord{"HE", false, true, ScanFormat::distance_intensity},
    ScanWord{"MS", true, false, ScanFormat::distance2},
    ScanWord{"MD", true, false, ScanFormat::distance3},
    ScanWord{"ME", true, false, ScanFormat::distance_intensity},
    ScanWord{"ND", true, true, ScanFormat::distance3},
    ScanWord{"NE", true, true, ScanFormat::distance_intensity},
};

bool all_digits(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; });
}

/// The number in text[at, at + digits), or -1.
int number_at(std::string_view text, std::size_t at, std::size_t digits) {
  const std::string_view field = text.substr(at, digits);
  if (!all_digits(field)) return -1;
  int value = 0;
  for (const char c : field) value = 10 * value + (c - '0');
  return value;
}

void append_number(std::string& out, int value, int digits) {
  std::string text(static_cast<std::size_t>(digits), '0');
  for (auto digit = text.rbegin(); digit != text.rend(); ++digit, value /= 10) {
    *digit = static_cast<char>('0' + value % 10);
  }
  out += text;
}

using Parsed = tl::expected<Request, RequestError>;

Parsed fail(RequestError error) { return tl::unexpected<RequestError>(error); }

Parsed parse_scan(const ScanWord& word, std::string_view parameters, bool microseconds) {
  const std::size_t length = word.continuous ? 13 : 10;
  if (parameters.size() < length) return fail(RequestError::too_short);
  if (parameters.size() > length) return fail(RequestError::too_long);
  ScanCommand scan;
  scan.continuous = word.continuous;
  scan.multi_echo = word.multi_echo;
  scan.microseconds = microseconds;
  scan.format = word.format;
  if ((scan.first_step = number_at(parameters, 0, 4)) < 0) return fail(RequestError::first_not_a_number);
  if ((scan.last_step = number_at(parameters, 4, 4)) < 0) return fail(RequestError::last_not_a_number);
  if ((scan.cluster = number_at(parameters, 8, 2)) < 0) return fail(RequestError::cluster_not_a_number);
  if (word.continuous) {
    if ((scan.skip = number_at(parameters, 10, 1)) < 0) return fail(RequestError::skip_not_a_number);
    if ((scan.count = number_at(parameters, 11, 2)) < 0) return fail(RequestError::count_not_a_number);
  }
  if (scan.last_step < scan.first_step) return fail(RequestError::last_before_first);
  return Request(scan);
}

Parsed parse_time(std::string_view parameters, bool microseconds) {
  if (parameters.empty()) return fail(RequestError::too_short);
  if (parameters.size() > 1) return fail(RequestError::too_long);
  if (parameters[0] < '0' || parameters[0] > '2') return fail(RequestError::bad_argument);
  constexpr std::array commands{Command::time_enter, Command::time_read, Command::time_leave};
  Request request(commands[static_cast<std::size_t>(parameters[0] - '0')]);
  if (microseconds && request.command != Command::time_read) return fail(RequestError::undefined_command);
  request.microseconds = microseconds;
  return request;
}

Parsed parse_command(std::string_view line) {
  for (const Plain& plain : plain_commands) {
    if (!line.starts_with(plain.word)) continue;
    if (line.size() > plain.word.size()) return fail(RequestError::too_long);
    return Request(plain.command);
  }
  for (const WithDigits& with : digit_commands) {
    if (!line.starts_with(with.word)) continue;
    Request request(with.command);
    request.argument = line.substr(with.word.size());
    if (request.argument.size() < with.digits) return fail(RequestError::too_short);
    if (request.argument.size() > with.digits) return fail(RequestError::too_long);
    if (!all_digits(request.argument)) return fail(RequestError::bad_argument);
    return request;
  }
  const bool microseconds = line.starts_with('%');
  if (microseconds) line.remove_prefix(1);
  if (line.starts_with("TM")) return parse_time(line.substr(2), microseconds);
  for (const ScanWord& word : scan_words) {
    if (!line.starts_with(word.word)) continue;
    const bool can_be_microseconds = word.word == "MD" || word.word == "ME";
    if (microseconds && !can_be_microseconds) break;
    return parse_scan(word, line.substr(2), microseconds);
  }
  return fail(RequestError::undefined_command);
}

std::string_view scan_word(const ScanCommand& scan) {
  for (const ScanWord& word : scan_words) {
    if (word.continuous == scan.continuous && word.multi_echo == scan.multi_echo &&
        word.format == scan.format) {
      return word.word;
    }
  }
  return "GD";  // Multi-echo with short distances does not exist.
}

std::string build_scan(const ScanCommand& scan) {
  std::string line = scan.microseconds ? "%" : "";
  line += scan_word(scan);
  append_number(line, scan.first_step, 4);
  append_number(line, scan.last_step, 4);
  append_number(line, scan.cluster, 2);
  if (scan.continuous) {
    append_number(line, scan.skip, 1);
    append_number(line, scan.count, 2);
  }
  return line;
}

std::string build_command(const Request& request) {
  switch (request.command) {
    case Command::scan:
      return build_scan(request.scan);
    case Command::time_enter:
      return "TM0";
    case Command::time_read:
      return request.microseconds ? "%TM1" : "TM1";
    case Command::time_leave:
      return "TM2";
    default:
      break;
  }
  for (const Plain& plain : plain_commands) {
    if (plain.command == request.command) return std::string(plain.word);
  }
  for (const WithDigits& with : digit_commands) {
    if (with.command == request.command) return std::string(with.word) + request.argument;
  }
  return {};
}

}  // namespace

std::string build_line(const Request& request) {
  std::string line = build_command(request);
  if (!request.text.empty()) line += ";" + request.text;
  return line;
}

std::string build_request(const Request& request) { return build_line(request) + '\n'; }

tl::expected<Request, RequestError> parse_request(std::string_view line) {
  const std::size_t semicolon = line.find(';');
  const std::string_view text = semicolon == std::string_view::npos ? "" : line.substr(semicolon + 1);
  Parsed request = parse_command(line.substr(0, semicolon));
  if (!request && request.error() == RequestError::undefined_command) return request;
  if (text.size() > 16) return fail(RequestError::string_too_long);
  const auto printable = [](char c) { return c >= 0x20 && c <= 0x7E; };
  if (!std::all_of(text.begin(), text.end(), printable)) return fail(RequestError::bad_string_character);
  if (request) request->text = text;
  return request;
}

std::string_view status_of(RequestError error) {
  switch (error) {
    case RequestError::undefined_command:
      return "0E";
    case RequestError::string_too_long:
      return "0G";
    case RequestError::bad_string_character:
      return "0H";
    case RequestError::too_short:
      return "0C";
    case RequestError::too_long:
      return "0D";
    case RequestError::bad_argument:
      return "01";
    case RequestError::first_not_a_number:
      return "01";
    case RequestError::last_not_a_number:
      return "02";
    case RequestError::cluster_not_a_number:
      return "03";
    case RequestError::skip_not_a_number:
      return "06";
    case RequestError::count_not_a_number:
      return "07";
    case RequestError::last_before_first:
      return "05";
  }
  return "0E";
}

void RequestReader::feed(std::string_view bytes) {
  buffer_.erase(0, begin_);
  begin_ = 0;
  buffer_ += bytes;
}

tl::expected<std::optional<std::string_view>, RequestReader::Error> RequestReader::next() {
  while (begin_ < buffer_.size()) {
    const std::size_t end = buffer_.find_first_of("\r\n", begin_);
    const bool ended = end != std::string::npos;
    const std::size_t length = (ended ? end : buffer_.size()) - begin_;
    const std::string_view line(buffer_.data() + begin_, length);
    const bool was_skipping = skipping_;
    if (ended) {
      begin_ = end + 1;
      skipping_ = false;
    } else if (length > max_line || skipping_) {
      begin_ = buffer_.size();
      skipping_ = true;
    }
    if (length > max_line && !was_skipping) return tl::unexpected<Error>(Error::too_long);
    if (!ended) break;
    if (!was_skipping && length > 0) return line;
  }
  return std::nullopt;
}

}  // namespace lidar
