// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "lidar/request.hpp"
#include "lidar/scan.hpp"
#include "lidar/scan_kernels.hpp"

namespace lidar {

/// Takes the scans of one continuous stream off its bytes in one pass: they all have the same length and the
/// same echo but for the number of scans that remain, so nothing needs to be searched for. Every check is
/// made that FrameReader and decode_scan make together; what does not pass, or is no such scan, is left to
/// them.
class ScanReceiver {
 public:
  ScanReceiver() = default;
  /// For the stream that was asked for with this command and string (without ';'). Ranges below and above
  /// these become 0.
  ScanReceiver(const ScanCommand& command, const std::string& text, int min_range_mm, int max_range_mm,
               Kernel kernel = fastest_kernel());

  /// Whether scans of this command can be taken here: MD and ME with stamps of milliseconds.
  [[nodiscard]] static bool can_take(const ScanCommand& command);
  /// Length of each message, its empty line included.
  [[nodiscard]] std::size_t message_bytes() const { return message_bytes_; }
  /// The stamp of the scan that `bytes` begin with, its values written to `scan`; nothing when they do not
  /// begin with a whole and good one.
  [[nodiscard]] std::optional<std::uint32_t> take(std::string_view bytes, Scan& scan) const;

 private:
  std::string echo_begin_, echo_end_;  ///< Around the two digits that change.
  LineShape shape_;
  Kernel kernel_ = Kernel::portable;
  std::size_t message_bytes_ = 0;
};

/// The largest range that can be told from "no echo" in 16 bits, or the lidar's own limit.
[[nodiscard]] std::uint16_t largest_range_mm(int max_range_mm);

}  // namespace lidar
