// SPDX-License-Identifier: MIT
#include "lidar/frame_reader.hpp"

#include <algorithm>
#include <cstring>

#include "lidar/encoding.hpp"
#include "lidar/scan_kernels.hpp"

namespace lidar {

std::span<char> FrameReader::prepare(std::size_t bytes) {
  if (buffer_.size() - end_ < bytes && begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    scanned_ -= begin_;
    begin_ = 0;
  }
  if (buffer_.size() - end_ < bytes) buffer_.resize(end_ + bytes);
  last_ = {};
  return {buffer_.data() + end_, buffer_.size() - end_};
}

void FrameReader::commit(std::size_t bytes) { end_ += std::min(bytes, buffer_.size() - end_); }

void FrameReader::feed(std::string_view bytes) {
  if (bytes.empty()) return;
  const std::span<char> room = prepare(bytes.size());
  std::memcpy(room.data(), bytes.data(), bytes.size());
  commit(bytes.size());
}

void FrameReader::consume(std::size_t bytes) {
  begin_ += std::min(bytes, end_ - begin_);
  scanned_ = std::max(scanned_, begin_);
  last_ = {};
}

void FrameReader::clear() {
  begin_ = scanned_ = end_ = 0;
  skipping_ = false;
  last_ = {};
}

tl::expected<std::optional<Frame>, FrameError> FrameReader::next() {
  for (;;) {
    // An empty line between frames says nothing; sensors send one after a bare LF of ours at most.
    while (begin_ < end_ && !skipping_ && buffer_[begin_] == '\n') ++begin_;
    scanned_ = std::max(scanned_, begin_);
    const char* const data = buffer_.data();
    const std::size_t empty_line = scanned_ + find_empty_line({data + scanned_, end_ - scanned_});
    const bool ended = empty_line < end_;
    const std::string_view bytes(data + begin_, empty_line - begin_);
    const bool was_skipping = skipping_;
    if (ended) {
      begin_ = scanned_ = empty_line + 2;
      skipping_ = false;
    } else {
      // The last byte may be the first LF of an empty line.
      scanned_ = end_ > begin_ ? end_ - 1 : end_;
      if (was_skipping || bytes.size() > max_frame_bytes_) {
        begin_ = scanned_;
        skipping_ = true;
      }
    }
    if (was_skipping && ended) continue;
    if (!was_skipping && bytes.size() > max_frame_bytes_) {
      last_ = bytes.substr(0, max_frame_bytes_);
      return tl::unexpected<FrameError>(FrameError::too_long);
    }
    if (!ended) break;
    last_ = bytes;
    const tl::expected<Frame, FrameError> frame = parse_frame(bytes);
    if (!frame) return tl::unexpected<FrameError>(frame.error());
    return *frame;
  }
  return std::nullopt;
}

tl::expected<Frame, FrameError> parse_frame(std::string_view bytes) {
  const std::size_t echo_end = bytes.find('\n');
  if (echo_end == std::string_view::npos) return tl::unexpected<FrameError>(FrameError::missing_status);
  const std::string_view rest = bytes.substr(echo_end + 1);
  const std::size_t status_end = rest.find('\n');
  const std::string_view line = rest.substr(0, status_end);
  if (line.size() != 3 || checksum(line.substr(0, 2)) != line[2]) {
    return tl::unexpected<FrameError>(FrameError::bad_status_line);
  }
  Frame frame{bytes.substr(0, echo_end), line.substr(0, 2), {}};
  if (status_end != std::string_view::npos) {
    frame.body = rest.substr(status_end + 1);
  }
  return frame;
}

std::string_view to_string(FrameError error) {
  switch (error) {
    case FrameError::too_long:
      return "no end of the answer within the limit";
    case FrameError::missing_status:
      return "an answer without a status line";
    case FrameError::bad_status_line:
      return "an answer whose status line is wrong";
  }
  return "?";
}

}  // namespace lidar
