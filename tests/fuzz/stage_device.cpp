// SPDX-License-Identifier: MIT
// The simulated stages under any bytes, cut anywhere, while time passes and faults happen. The first byte
// chooses the language; of the others, those from 0xf0 on are events, the rest goes to the device.
#include "sim/stage_device.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>

namespace {

void expect_sound(const std::string& answer) {
  if (answer.size() > 1'000'000 || (!answer.empty() && answer.back() != '\n')) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  static const std::array<std::string, 4> languages{"zaber", "shot", "gsc", "falcon"};
  sim::StageDeviceOptions options;
  options.language = languages[data[0] % languages.size()];
  options.physics = sim::usual_stage_physics(options.language);
  options.axes = 1 + data[0] / 128;
  const auto device = sim::make_stage_device(options);
  double now_s = 0;
  std::string piece;
  const auto hand_over = [&] {
    expect_sound(device->receive(piece, now_s));
    expect_sound(device->poll(now_s));
    piece.clear();
  };
  for (std::size_t i = 1; i < size; ++i) {
    if (data[i] < 0xf0) {
      piece += static_cast<char>(data[i]);
      continue;
    }
    hand_over();
    const int event = data[i] - 0xf0;
    if (event < 7)
      device->inject(static_cast<sim::StageFault>(event), now_s);
    else
      now_s += std::pow(10.0, event - 12);
    const sim::StageMoment truth = device->mechanics().truth(now_s);
    if (!std::isfinite(truth.angle_rad) || !std::isfinite(truth.rate_rad_s)) std::abort();
    if (!std::isfinite(device->mechanics().position_units(now_s))) std::abort();
  }
  hand_over();
  return 0;
}
