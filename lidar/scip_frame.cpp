// SPDX-License-Identifier: MIT
#include "lidar/scip_frame.hpp"

#include <algorithm>
#include <utility>

#include "lidar/scip_text.hpp"

namespace lidar::scip {
namespace {

/// VV, PP and II lines read "KEY:value;sum". The ';' is not summed (all real devices seen); some sum it all
/// the same, and one UTM-30LX firmware leaves a trailing "<-comment" out (gearbox mailing list, 2009).
bool info_line_sums(std::string_view line, char sum) {
  if (checksum(line) == sum) return true;
  if (line.empty() || line.back() != ';') return false;
  const std::string_view text = line.substr(0, line.size() - 1);
  return checksum(text) == sum || checksum(text.substr(0, text.find("<-"))) == sum;
}

bool is_info(std::string_view command) { return command == "VV" || command == "PP" || command == "II"; }

tl::expected<Frame, FrameError> parse(std::string_view message) {
  Frame frame;
  const std::size_t echo_end = message.find('\n');
  if (echo_end == std::string_view::npos) return tl::unexpected(FrameError::missing_status);
  frame.echo = message.substr(0, echo_end);
  if (!frame.echo.empty() && frame.echo.back() == '\r') frame.echo.remove_suffix(1);
  message.remove_prefix(echo_end + 1);
  const std::string_view status = message.substr(0, message.find('\n'));
  if (status.size() != 3) return tl::unexpected(FrameError::missing_status);
  if (checksum(status.substr(0, 2)) != status[2]) return tl::unexpected(FrameError::bad_checksum);
  frame.status = status.substr(0, 2);
  message.remove_prefix(std::min(message.size(), status.size() + 1));
  const bool info = is_info(frame.command());
  frame.lines.reserve(message.size() / (line_payload + 2) + 1);
  while (!message.empty()) {
    std::string_view line = message.substr(0, message.find('\n'));
    message.remove_prefix(std::min(message.size(), line.size() + 1));
    if (line.empty()) return tl::unexpected(FrameError::bad_checksum);
    const char sum = line.back();
    line.remove_suffix(1);
    if (info ? !info_line_sums(line, sum) : checksum(line) != sum)
      return tl::unexpected(FrameError::bad_checksum);
    // '&' marks a further echo of the same step (HD, HE, ND, NE).
    if (!info && !std::ranges::all_of(line, [](char c) { return is_data(c) || c == '&'; }))
      return tl::unexpected(FrameError::bad_character);
    frame.lines.push_back(line);
  }
  return frame;
}

}  // namespace

std::string_view Frame::command() const {
  const std::size_t length = !echo.empty() && (echo[0] == '%' || echo[0] == '$') ? 3 : 2;
  return echo.substr(0, length);
}

std::string_view Frame::tag() const {
  const std::size_t at = echo.find(';');
  return at == std::string_view::npos ? std::string_view{} : echo.substr(at + 1);
}

const char* to_string(FrameError error) {
  switch (error) {
    case FrameError::too_long:
      return "a message without end";
    case FrameError::missing_status:
      return "a message without status";
    case FrameError::bad_checksum:
      return "a wrong checksum";
    case FrameError::bad_character:
      return "a byte that is not SCIP data";
  }
  return "an unknown error";
}

void FrameReader::feed(std::string_view bytes) {
  if (start_ > 0 && start_ >= buffer_.size() / 2) {
    buffer_.erase(0, start_);
    scanned_ -= start_;
    start_ = 0;
  }
  buffer_ += bytes;
}

void FrameReader::clear() {
  buffer_.clear();
  start_ = scanned_ = 0;
  skipping_ = false;
}

tl::expected<std::optional<Frame>, FrameError> FrameReader::next() {
  while (true) {
    while (start_ < buffer_.size() && buffer_[start_] == '\n') ++start_;  // empty lines between messages
    scanned_ = std::max(scanned_, start_);
    const std::size_t end = buffer_.find("\n\n", scanned_ > start_ ? scanned_ - 1 : scanned_);
    if (end == std::string::npos) {
      scanned_ = buffer_.size();
      if (skipping_ || buffered() > max_frame_bytes) {
        const bool first = !skipping_;
        skipping_ = true;
        start_ = buffer_.empty() ? 0 : buffer_.size() - 1;  // the last byte may begin the end of message
        if (first) return tl::unexpected(FrameError::too_long);
      }
      return std::optional<Frame>{};
    }
    const std::string_view message(buffer_.data() + start_, end - start_);
    start_ = scanned_ = end + 2;
    if (std::exchange(skipping_, false)) continue;
    if (message.size() > max_frame_bytes) return tl::unexpected(FrameError::too_long);
    auto frame = parse(message);
    if (!frame) return tl::unexpected(frame.error());
    return std::optional<Frame>{std::move(*frame)};
  }
}

}  // namespace lidar::scip
