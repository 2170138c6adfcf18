// SPDX-License-Identifier: MIT
// What a host sends to the simulated lidar: lines, requests, and the device's answer to each, which must be a
// frame.
#include <algorithm>
#include <cstdlib>

#include "lidar/frame_reader.hpp"
#include "sim/simple_engine.hpp"
#include "sim/ust_device.hpp"

namespace {

void answer(sim::UstDevice& device, std::string_view line, double now_s) {
  if (const auto request = lidar::parse_request(line)) {
    const auto again = lidar::parse_request(lidar::build_line(*request));
    if (!again || !(*again == *request)) std::abort();
  }
  const std::string reply = device.handle(line, now_s);
  lidar::FrameReader reader;
  reader.feed(reply);
  const auto frame = reader.next();
  // A line that begins with LF cannot be: the reader of requests ends it there.
  if (!reply.empty() && (!frame || !frame->has_value())) std::abort();
}

}  // namespace

// The first byte says in what pieces the rest arrives.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  fit::Bench bench;
  fit::LidarGeometry geometry;
  geometry.steps = 101;
  geometry.front_step = 50;
  sim::UstDevice device(geometry, sim::UstIdentity{},
                        std::make_shared<sim::SimpleEngine>(bench, sim::SimpleOptions{}, 1),
                        [](double) { return sim::StageMoment{}; });
  const std::size_t piece = 1 + data[0];
  std::string_view rest(reinterpret_cast<const char*>(data + 1), size - 1);
  lidar::RequestReader requests;
  double now_s = 0;
  std::string scans;
  while (!rest.empty()) {
    requests.feed(rest.substr(0, piece));
    rest.remove_prefix(std::min(piece, rest.size()));
    for (auto line = requests.next(); !line || line->has_value(); line = requests.next()) {
      now_s += 0.01;
      if (line) answer(device, **line, now_s);
    }
    if (!device.streaming()) continue;
    now_s = device.next_scan_ready_s(now_s);
    scans.clear();
    device.append_next_scan(scans);
    if (device.take_reboot_request()) device.reboot(now_s);
  }
  return 0;
}
