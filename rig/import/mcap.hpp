// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <functional>
#include <iosfwd>
#include <span>
#include <string>
#include <vector>

namespace rig {

/// One message of an MCAP file, borrowed: valid only during the call that hands it over.
struct McapMessage {
  const std::string& topic;
  const std::string& type;  ///< Name of the channel's schema, e.g. "sensor_msgs/msg/LaserScan"; may be empty.
  const std::string& encoding;  ///< Of the message, e.g. "cdr".
  std::uint64_t log_time_ns;
  std::span<const std::uint8_t> data;
};

/// What was read, and what could not be. `notes` are sentences for the operator.
struct McapSummary {
  std::uint64_t messages = 0;  ///< Handed over.
  bool truncated = false;  ///< The file ends before its end mark: the recorder was killed or the copy is cut.
  bool stopped = false;    ///< The visitor had enough.
  std::uint64_t bad_chunks = 0;
  std::vector<std::string> notes;
};

/// Walks an MCAP file (mcap.dev/spec, version 0) from front to back, needing no index: chunks with no, lz4 or
/// zstd compression, their CRC-32 verified. A file that is cut gives every message that is whole; a chunk
/// that is damaged costs that chunk. Memory is bounded by the largest chunk, and a chunk that claims more
/// than 512 MiB is refused. `visit` returns false to stop early.
/// Throws UsageError when the stream is not MCAP.
McapSummary read_mcap(std::istream& in, const std::function<bool(const McapMessage&)>& visit);

[[nodiscard]] bool is_mcap(std::span<const std::uint8_t> first_bytes);

}  // namespace rig
