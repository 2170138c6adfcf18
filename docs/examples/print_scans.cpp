// SPDX-License-Identifier: MIT
// Prints scans of a lidar with this computer's times: print_scans HOST [PORT [HOW_MANY]].
// docs/develop/lidar.md, "The driver".
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/this_coro.hpp>
#include <cstdio>
#include <cstdlib>

#include "lidar/client.hpp"

boost::asio::awaitable<void> print_scans(std::string host, std::uint16_t port, int count) {
  lidar::Client lidar(co_await boost::asio::this_coro::executor, host, port);
  const lidar::Identity who = co_await lidar.connect();
  co_await lidar.synchronise();
  lidar::StreamRequest all(who.min_step, who.max_step);
  co_await lidar.start(all);
  for (int i = 0; i < count; ++i) {
    const lidar::Scan scan = co_await lidar.next();
    const auto front = static_cast<std::size_t>(who.front_step - scan.first_step);
    std::printf("%.6f s (+- %.0f us), lidar's clock %llu ms, %zu beams, ahead %u mm\n",
                static_cast<double>(scan.host_us) / 1e6, 2 * lidar.clock().scan_u_us,
                static_cast<unsigned long long>(scan.device_ms), scan.range_mm.size(),
                unsigned{scan.range_mm[front]});
  }
  co_await lidar.stop();
}

int main(int count, char** words) {
  const char* host = count > 1 ? words[1] : "192.168.0.10";
  const auto port = static_cast<std::uint16_t>(count > 2 ? std::atoi(words[2]) : 10940);
  boost::asio::io_context io(1);
  int status = 0;
  boost::asio::co_spawn(io, print_scans(host, port, count > 3 ? std::atoi(words[3]) : 40),
                        [&](std::exception_ptr why) {
                          try {
                            if (why) std::rethrow_exception(why);
                          } catch (const std::exception& error) {
                            std::fprintf(stderr, "%s\n", error.what());
                            status = 3;
                          }
                        });
  io.run();
  return status;
}
