// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <chrono>
#include <exception>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "fit/numeric/angle.hpp"
#include "rig/stage/stage_factory.hpp"
#include "sim/pty_port.hpp"
#include "sim/stage_device.hpp"

/// A simulated stage on a real pseudo-terminal, and the driver that talks to it: both on one thread.
struct StageRig {
  explicit StageRig(const std::string& language = "zaber", double speed = sim::SimClock::max_speed,
                    bool homed = false)
      : clock(speed) {
    device_options.language = language;
    device_options.physics = sim::usual_stage_physics(language);
    device_options.homed = homed;
    options.language = language;
    options.settle_s = 0;
    options.reply_s = 0.3;
  }

  void switch_on() {
    device = sim::make_stage_device(device_options);
    port = std::make_unique<sim::PtyPort>(io.get_executor(), *device, clock, port_options);
  }

  [[nodiscard]] std::string url() const {
    return "serial:" + (port_options.link.empty() ? port->path() : port_options.link);
  }

  /// Runs one coroutine to its end, the simulator serving meanwhile.
  template <class T>
  T run(boost::asio::awaitable<T> work) {
    std::exception_ptr failure;
    bool done = false;
    std::optional<T> result;
    boost::asio::co_spawn(io, std::move(work), [&](std::exception_ptr why, T value) {
      failure = why;
      if (!why) result = std::move(value);
      done = true;
    });
    pump(done);
    if (failure) std::rethrow_exception(failure);
    return std::move(*result);
  }
  void run(boost::asio::awaitable<void> work) {
    std::exception_ptr failure;
    bool done = false;
    boost::asio::co_spawn(io, std::move(work), [&](std::exception_ptr why) {
      failure = why;
      done = true;
    });
    pump(done);
    if (failure) std::rethrow_exception(failure);
  }

  /// Serves until `done`, for 20 s at most.
  void pump(const bool& done) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    io.restart();
    while (!done && std::chrono::steady_clock::now() < end) io.run_one_for(std::chrono::milliseconds(100));
    if (!done) throw std::runtime_error("the test waited in vain");
  }

  void open() {
    if (!device) switch_on();
    stage = run(rig::open_stage(io.get_executor(), url(), options));
  }

  [[nodiscard]] double true_deg() const {
    return device->mechanics().truth(clock.now_s()).angle_rad * fit::deg_per_rad;
  }

  boost::asio::io_context io{1};
  sim::SimClock clock;
  sim::StageDeviceOptions device_options;
  sim::PtyPort::Options port_options;
  rig::StageOptions options;
  std::unique_ptr<sim::StageDevice> device;
  std::unique_ptr<sim::PtyPort> port;
  std::unique_ptr<rig::Stage> stage;
};
