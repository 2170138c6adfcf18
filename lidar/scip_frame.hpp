// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

namespace lidar::scip {

/// One message of the device: the request it answers, its status, and its data lines without their checksums.
/// The views live until the reader's next feed() or next().
struct Frame {
  std::string_view echo;
  std::string_view status;  ///< Two characters.
  std::vector<std::string_view> lines;

  /// The echoed command: "ME" of "ME0000108001000;7", "%ST" of "%ST".
  [[nodiscard]] std::string_view command() const;
  /// What follows ';' in the echo, which is how an answer is matched to its request.
  [[nodiscard]] std::string_view tag() const;
};

/// Why a message was dropped: what was seen, not what the code was doing.
enum class FrameError {
  too_long,        ///< No empty line within max_frame_bytes: not SCIP, or out of step.
  missing_status,  ///< The message ended after its first line, or its status is not two characters and a sum.
  bad_checksum,    ///< A line's last character does not match the sum of the others.
  bad_character,   ///< A data byte outside 0x30..0x6F, which the six-bit sum cannot always see.
};
[[nodiscard]] const char* to_string(FrameError error);

/// Cuts a byte stream into messages. Feed it whatever arrived, in any pieces.
///
///   reader.feed("QT\n00P\n\nVV");   // one message and the start of the next
///   auto frame = reader.next();      // QT; "VV" waits for more
///
/// Bytes not yet consumed survive a timed-out read. After an error the reader has dropped the offending
/// message and carries on with the one after it. Memory is bounded whatever the device sends.
class FrameReader {
 public:
  static constexpr std::size_t max_frame_bytes =
      64 * 1024;  ///< The largest legal one (HE, 3 echoes) is under 22 kB.

  void feed(std::string_view bytes);
  /// The next message; an empty optional when more bytes are needed.
  [[nodiscard]] tl::expected<std::optional<Frame>, FrameError> next();
  /// Forgets everything fed so far.
  void clear();
  [[nodiscard]] std::size_t buffered() const { return buffer_.size() - start_; }

 private:
  std::string buffer_;
  std::size_t start_ = 0;    ///< First byte not yet handed out.
  std::size_t scanned_ = 0;  ///< Up to here there is no end of message.
  bool skipping_ = false;    ///< After too_long: drop everything up to the next end of message.
};

}  // namespace lidar::scip
