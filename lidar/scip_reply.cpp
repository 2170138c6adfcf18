// SPDX-License-Identifier: MIT
#include "lidar/scip_reply.hpp"

#include <algorithm>
#include <cctype>

#include "lidar/scip_text.hpp"

namespace lidar::scip {
namespace {

bool is_number(std::string_view status) {
  return status.size() == 2 && std::isdigit(static_cast<unsigned char>(status[0])) &&
         std::isdigit(static_cast<unsigned char>(status[1]));
}

std::string_view without_percent(std::string_view command) {
  return command.starts_with('%') ? command.substr(1) : command;
}

bool has_intensity(std::string_view command) {
  command = without_percent(command);
  return command == "GE" || command == "ME" || command == "HE" || command == "NE" || command == "GG" ||
         command == "MG";
}

bool has_further_echoes(std::string_view command) {
  return command == "HD" || command == "HE" || command == "ND" || command == "NE";
}

int letters_per_value(std::string_view command) { return command == "GS" || command == "MS" ? 2 : 3; }

/// A line of input and output words precedes the stamp in these.
bool has_io_line(std::string_view command) {
  return command == "MF" || command == "GF" || command == "MG" || command == "GG";
}

tl::expected<Stamp, ScanError> decode_stamp(std::string_view line) {
  if (line.size() != 4 && line.size() != 11) return tl::unexpected(ScanError::no_stamp);
  return Stamp{decode(line), line.size() == 11};
}

/// Reads one value from letters that may straddle lines, without joining the lines.
class Letters {
 public:
  explicit Letters(std::span<const std::string_view> lines) : lines_(lines) { settle(); }
  [[nodiscard]] bool ended() const { return line_ >= lines_.size(); }
  [[nodiscard]] char here() const { return lines_[line_][at_]; }
  void skip() {
    ++at_;
    settle();
  }
  bool take(int letters, std::uint32_t& value) {
    value = 0;
    if (!ended() && at_ + static_cast<std::size_t>(letters) <= lines_[line_].size()) {
      const char* c = lines_[line_].data() + at_;
      for (int i = 0; i < letters; ++i) value = value << 6 | static_cast<std::uint32_t>(c[i] - 0x30);
      at_ += static_cast<std::size_t>(letters);
      settle();
      return true;
    }
    for (int i = 0; i < letters; ++i) {
      if (ended()) return false;
      value = value << 6 | static_cast<std::uint32_t>(here() - 0x30);
      skip();
    }
    return true;
  }

 private:
  void settle() {
    while (line_ < lines_.size() && at_ >= lines_[line_].size()) {
      ++line_;
      at_ = 0;
    }
  }
  std::span<const std::string_view> lines_;
  std::size_t line_ = 0, at_ = 0;
};

}  // namespace

bool succeeded(std::string_view command, std::string_view status) {
  if (!is_number(status)) return false;
  if (status == "00" || status == "99") return true;
  if (command == "BM" || command == "TM") return status == "02";  // already so
  if (command == "RB") return status == "01";                     // first of two
  return false;
}

std::string describe_status(std::string_view command, std::string_view status) {
  const auto say = [&](const char* words) { return std::string(status) + ": " + words; };
  if (status == "0A") return say("the sensor could not build its answer");
  if (status == "0B") return say("the sensor is short of buffers, or the command was repeated too soon");
  if (status == "0C") return say("the command is too short");
  if (status == "0D") return say("the command is too long");
  if (status == "0E") return say("the sensor does not know this command");
  if (status == "0F") return say("this sensor does not support the command");
  if (status == "0G") return say("the string after ';' is longer than 16 characters");
  if (status == "0H") return say("the string after ';' has characters that are not allowed");
  if (status == "0I") return say("the sensor is in firmware-update mode");
  if (status == "0L") return say("the sensor reports an internal fault; switch it off and on");
  if (status == "0M") return say("the sensor is not stable yet; wait and try again");
  if (!is_number(status)) return say("a status that the protocol does not define");
  const int number = (status[0] - '0') * 10 + (status[1] - '0');
  const bool scan =
      command.size() >= 2 && std::string_view("GMHN%").find(command[0]) != std::string_view::npos;
  if (number == 0) return say("done");
  if (number == 99) return say("measurement data");
  if (number == 98 && scan) return say("the sensor resumed after checking itself");
  if (scan && number >= 21 && number <= 49) return say("the sensor stopped to check a suspected fault");
  if (scan && number >= 50 && number <= 97)
    return say("hardware fault (laser or motor); switch the sensor off and on");
  if (number == 10)
    return say("not possible in the sensor's present state (laser off, or another mode is active)");
  if (scan && number >= 1 && number <= 3) return say("start step, end step or cluster is not a number");
  if (scan && number == 4) return say("the end step is beyond the sensor's last step");
  if (scan && number == 5) return say("the end step lies before the start step");
  if (scan && (number == 6 || number == 7)) return say("interval or count of scans is not a number");
  if (command == "BM" && number == 1) return say("the laser is faulty and stays off");
  if (command == "BM" && number == 2) return say("the laser was already on");
  if (command == "TM" && number == 2) return say("time adjustment was already on");
  if (command == "TM" && number >= 3) return say("time adjustment is not on");
  return say("refused");
}

std::map<std::string, std::string> decode_info(const Frame& frame) {
  std::map<std::string, std::string> out;
  for (std::string_view line : frame.lines) {
    if (!line.empty() && line.back() == ';') line.remove_suffix(1);
    const std::size_t colon = line.find(':');
    if (colon != std::string_view::npos) out.emplace(line.substr(0, colon), line.substr(colon + 1));
  }
  return out;
}

const char* to_string(ScanError error) {
  switch (error) {
    case ScanError::not_a_scan:
      return "no measurement in the message";
    case ScanError::no_stamp:
      return "no time stamp in the message";
    case ScanError::wrong_length:
      return "the message does not hold the number of values that was asked for";
  }
  return "an unknown error";
}

int value_count(const Request& request) {
  const int cluster = std::max(request.cluster, 1);
  return request.last_step < request.first_step ? 0 : (request.last_step - request.first_step) / cluster + 1;
}

tl::expected<void, ScanError> decode_scan(const Frame& frame, RawScan& into) {
  const auto request = parse_request(frame.echo);
  if (!request || !request->scans() || !succeeded(request->command, frame.status) || frame.lines.empty())
    return tl::unexpected(ScanError::not_a_scan);
  std::span<const std::string_view> lines(frame.lines);
  if (has_io_line(request->command)) lines = lines.subspan(1);
  if (lines.empty()) return tl::unexpected(ScanError::no_stamp);
  const auto stamp = decode_stamp(lines.front());
  if (!stamp) return tl::unexpected(stamp.error());
  into.stamp = *stamp;
  into.range.clear();
  into.intensity.clear();
  into.further.clear();
  const bool intensities = has_intensity(request->command), further = has_further_echoes(request->command);
  const int letters = letters_per_value(request->command);
  const auto expected = static_cast<std::size_t>(value_count(*request));
  into.range.reserve(expected);
  if (intensities) into.intensity.reserve(expected);
  Letters data(lines.subspan(1));
  while (!data.ended()) {
    const bool again = further && data.here() == '&';
    if (again) data.skip();
    std::uint32_t range = 0, intensity = 0;
    if (!data.take(letters, range) || (intensities && !data.take(letters, intensity)))
      return tl::unexpected(ScanError::wrong_length);
    if (again) {
      if (into.range.empty()) return tl::unexpected(ScanError::wrong_length);
      into.further.push_back({into.range.size() - 1, range, intensity});
      continue;
    }
    if (into.range.size() == expected) return tl::unexpected(ScanError::wrong_length);
    into.range.push_back(range);
    if (intensities) into.intensity.push_back(intensity);
  }
  if (into.range.size() != expected) return tl::unexpected(ScanError::wrong_length);
  return {};
}

tl::expected<Stamp, ScanError> decode_time(const Frame& frame) {
  if (frame.lines.empty()) return tl::unexpected(ScanError::no_stamp);
  return decode_stamp(frame.lines.front());
}

std::string status_reply(std::string_view echo, std::string_view status) {
  std::string out(echo);
  out += '\n';
  append_line(out, status);
  out += '\n';
  return out;
}

std::string info_reply(std::string_view echo, std::span<const std::pair<std::string, std::string>> lines) {
  std::string out(echo);
  out += '\n';
  append_line(out, "00");
  for (const auto& [key, value] : lines) {
    const std::string text = key + ":" + value;
    out += text + ";" + checksum(text) + "\n";
  }
  out += '\n';
  return out;
}

std::string line_reply(std::string_view echo, std::string_view status, std::string_view line) {
  std::string out(echo);
  out += '\n';
  append_line(out, status);
  append_line(out, line);
  out += '\n';
  return out;
}

void append_scan_reply(std::string& out, std::string_view echo, std::string_view status,
                       std::uint32_t stamp_ms, std::span<const std::uint32_t> range,
                       std::span<const std::uint32_t> intensity, int digits) {
  out += echo;
  out += '\n';
  append_line(out, status);
  append_line(out, encode(stamp_ms & 0xffffff, 4));
  char line[line_payload + 8];
  int used = 0;
  unsigned sum = 0;
  const auto put = [&](std::uint32_t value) {
    for (int shift = 6 * (digits - 1); shift >= 0; shift -= 6) {
      const char c = static_cast<char>((value >> shift & 0x3f) + 0x30);
      line[used++] = c;
      sum += static_cast<unsigned char>(c);
      if (used < line_payload) continue;
      line[used++] = static_cast<char>((sum & 0x3f) + 0x30);
      line[used++] = '\n';
      out.append(line, static_cast<std::size_t>(used));
      used = 0;
      sum = 0;
    }
  };
  for (std::size_t i = 0; i < range.size(); ++i) {
    put(range[i]);
    if (i < intensity.size()) put(intensity[i]);
  }
  if (used > 0) {
    line[used++] = static_cast<char>((sum & 0x3f) + 0x30);
    line[used++] = '\n';
    out.append(line, static_cast<std::size_t>(used));
  }
  out += '\n';
}

}  // namespace lidar::scip
