// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

namespace lidar {

/// One answer of the sensor: the repeated request, the two status characters (their sum is verified) and the
/// lines of data, each with its sum (not verified yet), parted by LF. Borrowed from the reader: valid until
/// its next prepare, feed or clear.
struct Frame {
  std::string_view echo;
  std::string_view status;
  std::string_view body;
};

enum class FrameError {
  too_long,         ///< No empty line within the limit: the stream is not SCIP or is out of step.
  missing_status,   ///< The frame ended after its first line.
  bad_status_line,  ///< The second line is not two characters and their sum.
};

/// Cuts a sensor's byte stream into frames. Feed it whatever arrived, in any pieces.
///
///   reader.feed("QT\n00P\n\nVV");   // one frame and the start of the next
///   auto frame = reader.next();      // QT; "VV" waits for more
///
/// Bytes not yet consumed survive a timed-out read. After an error the reader drops the offending frame and
/// carries on with the one after it. It never holds more than max_frame_bytes and what one prepare or feed
/// added.
class FrameReader {
 public:
  /// The largest legal answer, three echoes with intensity on 1081 steps, is below 24 kB.
  static constexpr std::size_t default_max_frame_bytes = 64 * 1024;

  explicit FrameReader(std::size_t max_frame_bytes = default_max_frame_bytes)
      : max_frame_bytes_(max_frame_bytes) {}

  /// Room for at least `bytes` more bytes, to read into; then commit() as many as were read.
  [[nodiscard]] std::span<char> prepare(std::size_t bytes);
  void commit(std::size_t bytes);
  void feed(std::string_view bytes);

  /// The next frame; an empty optional when more bytes are needed.
  [[nodiscard]] tl::expected<std::optional<Frame>, FrameError> next();

  /// Every byte of the frame or error that next() gave last, without the empty line. Borrowed like the frame.
  [[nodiscard]] std::string_view last_bytes() const { return last_; }

  /// What waits, from the beginning of a frame on; nothing inside one that was too long. For who knows the
  /// frame well enough to take it whole: consume() what was taken.
  [[nodiscard]] std::string_view waiting() const {
    return skipping_ ? std::string_view() : std::string_view(buffer_.data() + begin_, end_ - begin_);
  }
  void consume(std::size_t bytes);

  /// Bytes that wait for their frame's end.
  [[nodiscard]] std::size_t pending() const { return end_ - begin_; }
  void clear();

 private:
  std::size_t max_frame_bytes_;
  std::vector<char> buffer_;
  std::size_t begin_ = 0;    // First byte not consumed.
  std::size_t scanned_ = 0;  // No empty line begins before this one.
  std::size_t end_ = 0;      // One past the last byte read.
  bool skipping_ = false;    // Inside a frame that was too long.
  std::string_view last_;
};

/// Takes one frame's bytes apart (without its empty line): what next() does, for a frame found inside
/// another's wreck.
[[nodiscard]] tl::expected<Frame, FrameError> parse_frame(std::string_view bytes);

/// What happened, in words.
[[nodiscard]] std::string_view to_string(FrameError error);

}  // namespace lidar
