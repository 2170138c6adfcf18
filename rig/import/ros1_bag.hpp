// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <functional>
#include <iosfwd>
#include <span>
#include <string>
#include <vector>

namespace rig {

/// One message of a ROS 1 bag, borrowed: valid only during the call that hands it over.
struct Ros1Message {
  const std::string& topic;
  const std::string& type;  ///< "sensor_msgs/LaserScan"
  std::int64_t log_time_ns;
  std::span<const std::uint8_t> data;  ///< In ROS 1's own serialisation (Packing::ros1).
};

/// What was read, and what could not be. `notes` are sentences for the operator.
struct Ros1Summary {
  std::uint64_t messages = 0;  ///< Handed over.
  bool truncated = false;      ///< The file ends within a record.
  bool stopped = false;        ///< The visitor had enough.
  std::uint64_t bad_chunks = 0;
  std::vector<std::string> notes;
};

/// Walks a bag of format 2.0 (wiki.ros.org/Bags/Format/2.0) from front to back, needing no index, so that a
/// bag whose recorder was killed (*.bag.active) is read too: chunks with no, bz2 or lz4 compression. A file
/// that is cut gives every message that is whole; a chunk that is damaged costs what lies behind the damage
/// in that chunk. Memory is bounded by the largest chunk, and one that claims more than 512 MiB is refused.
/// `visit` returns false to stop early. Throws UsageError when the stream is no such bag.
Ros1Summary read_ros1_bag(std::istream& in, const std::function<bool(const Ros1Message&)>& visit);

/// Whether it begins as a bag of ROS 1, of whatever version.
[[nodiscard]] bool is_ros1_bag(std::span<const std::uint8_t> first_bytes);

}  // namespace rig
