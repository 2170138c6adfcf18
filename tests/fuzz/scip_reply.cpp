// SPDX-License-Identifier: MIT
// What a lidar, or what answers in its place, sends to a host: frames, then every decoder on every frame.
#include <algorithm>
#include <cstdlib>

#include "lidar/frame_reader.hpp"
#include "lidar/identity.hpp"
#include "lidar/reply.hpp"
#include "lidar/status.hpp"

namespace {

void decode(const lidar::Frame& frame) {
  (void)lidar::decode_key_values(frame.body);
  (void)lidar::decode_text(frame.body);
  (void)lidar::decode_time(frame.body);
  (void)lidar::decode_time(frame.body, true);
  (void)lidar::decode_information_time(frame.body);
  (void)lidar::make_identity(frame.body, frame.body, frame.body);
  const auto request = lidar::parse_request(frame.echo);
  if (!request) return;
  (void)lidar::kind_of(frame.status, *request);
  (void)lidar::meaning_of(frame.status, *request);
  if (request->command != lidar::Command::scan) return;
  const auto scan = lidar::decode_scan(frame.body, request->scan);
  if (!scan) return;
  // Values cannot outnumber the bytes that carried them, whatever the echo claims.
  if (scan->range_mm.size() * 2 > frame.body.size()) std::abort();
  const std::size_t steps = request->scan.multi_echo ? scan->echoes.size() : scan->range_mm.size();
  if (steps != static_cast<std::size_t>(request->scan.values())) std::abort();
}

}  // namespace

// The first byte says in what pieces the rest arrives.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  constexpr std::size_t limit = 8192;
  const std::size_t piece = 1 + data[0] * 16;
  std::string_view rest(reinterpret_cast<const char*>(data + 1), size - 1);
  lidar::FrameReader reader(limit);
  while (!rest.empty()) {
    reader.feed(rest.substr(0, piece));
    rest.remove_prefix(std::min(piece, rest.size()));
    for (auto frame = reader.next(); !frame || frame->has_value(); frame = reader.next())
      if (frame) decode(**frame);
    if (reader.pending() > limit) std::abort();
  }
  return 0;
}
