// SPDX-License-Identifier: MIT
// The one-pass receiver against the long way, on every kernel that the processor has: the same scans, the
// same numbers.
#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <memory>

#include "lidar/frame_reader.hpp"
#include "lidar/reply.hpp"
#include "lidar/scan_receiver.hpp"

namespace {

constexpr int least_mm = 20, most_mm = 30000;

bool same(const lidar::RawScan& raw, const lidar::Scan& scan) {
  if (raw.range_mm.size() != scan.range_mm.size() || raw.intensity.size() != scan.intensity.size())
    return false;
  for (std::size_t i = 0; i < raw.range_mm.size(); ++i)
    if (scan.range_mm[i] != (raw.range_mm[i] < least_mm || raw.range_mm[i] > most_mm ? 0 : raw.range_mm[i]))
      return false;
  for (std::size_t i = 0; i < raw.intensity.size(); ++i)
    if (scan.intensity[i] != std::min(raw.intensity[i], 65535u)) return false;
  return true;
}

}  // namespace

// The first byte chooses the format and the number of steps; the rest is what follows the echo of that
// command.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  lidar::ScanCommand command;
  command.format = data[0] % 2 == 0 ? lidar::ScanFormat::distance_intensity : lidar::ScanFormat::distance3;
  command.last_step = data[0] / 2;
  const std::string echo = build_line(lidar::Request(command, "r1"));
  const std::string text = echo + "\n" + std::string(reinterpret_cast<const char*>(data + 1), size - 1);
  // Exactly as long as it is, so that a read beyond it is seen.
  const auto bytes = std::make_unique<char[]>(text.size());
  std::memcpy(bytes.get(), text.data(), text.size());

  lidar::FrameReader reader;
  reader.feed(text);
  const auto frame = reader.next();
  const bool ours = frame && frame->has_value() && (*frame)->echo == echo && (*frame)->status == "99";
  const auto raw = ours ? lidar::decode_scan((*frame)->body, command)
                        : tl::expected<lidar::RawScan, lidar::DataError>(
                              tl::unexpected<lidar::DataError>(lidar::DataError::wrong_count));
  for (const auto kernel : {lidar::Kernel::portable, lidar::Kernel::avx2, lidar::Kernel::avx512}) {
    if (!available(kernel)) continue;
    const lidar::ScanReceiver receiver(command, "r1", least_mm, most_mm, kernel);
    lidar::Scan scan;
    const auto stamp = receiver.take({bytes.get(), text.size()}, scan);
    // Stamps of 11 characters are left to the long way.
    const bool short_stamp = raw && (*frame)->body.find('\n') == 5;
    if (stamp.has_value() != short_stamp) std::abort();
    if (stamp && (*stamp != raw->stamp || !same(*raw, scan))) std::abort();
  }
  return 0;
}
