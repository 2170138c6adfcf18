// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <catch2/catch.hpp>
#include <memory>

#include "lidar/client.hpp"
#include "sim/scip_server.hpp"
#include "sim/simple_engine.hpp"
#include "sim/ust_device.hpp"

/// What tests of the lidar's driver share: a simulated lidar in a room, one board a metre ahead of it.
namespace lidar_bench {

inline fit::Bench room() {
  fit::Bench bench;
  fit::Target board;
  board.name = "board";
  board.from_mm = {1000, -500};
  board.to_mm = {1000, 500};
  bench.targets = {board};
  return bench;
}

inline sim::UstDevice device(const sim::UstIdentity& identity = {}) {
  return {fit::LidarGeometry{}, identity,
          std::make_shared<sim::SimpleEngine>(room(), sim::SimpleOptions{}, 1),
          [](double) { return sim::StageMoment{}; }};
}

/// Runs the coroutine to its end on `io`; whatever it throws is thrown here. Nothing may take a minute.
template <class Make, class AtEnd>
void run(boost::asio::io_context& io, Make make, AtEnd at_end) {
  std::exception_ptr why;
  bool ended = false;
  auto work = make();
  boost::asio::co_spawn(io, std::move(work), [&](std::exception_ptr failed) {
    why = failed;
    ended = true;
    at_end();
    io.stop();
  });
  io.run_for(std::chrono::seconds(60));
  if (why) std::rethrow_exception(why);
  REQUIRE(ended);
}

/// A simulated lidar on a free port and a client, all on one thread.
struct Bench {
  boost::asio::io_context io{1};
  sim::SimClock clock;
  sim::UstDevice device;
  sim::ScipServer server;

  explicit Bench(double speed = sim::SimClock::max_speed, const sim::UstIdentity& identity = {})
      : clock(speed),
        device(lidar_bench::device(identity)),
        server(io.get_executor(), sim::ScipServer::Options(), clock, device) {}

  template <class Make>
  void run(Make make) {
    lidar_bench::run(io, make, [this] { server.stop(); });
  }
  [[nodiscard]] lidar::Client client(lidar::Options options = {}) {
    return {io.get_executor(), "127.0.0.1", server.port(), options};
  }
};

inline lidar::LidarError::Kind kind_of_failure(const std::function<void()>& act,
                                               std::string* what = nullptr) {
  try {
    act();
  } catch (const lidar::LidarError& error) {
    if (what) *what = error.what();
    return error.kind();
  }
  FAIL("nothing was thrown");
  return lidar::LidarError::Kind::wrong_use;
}

}  // namespace lidar_bench
