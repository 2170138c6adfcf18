// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "sim/clock.hpp"
#include "sim/ust_device.hpp"

namespace sim {

/// Serves a simulated UST-10LX on TCP to one host at a time, as the device does: further connections wait
/// until the first has gone. Answers in order, streams at simulated time, drops scans that the host is too
/// slow to take (at maximum speed it waits for the host instead).
class ScipServer {
 public:
  struct Options {
    Options() = default;
    std::string address = "127.0.0.1";
    std::uint16_t port = 0;  ///< 0: any free one.
  };
  /// What a fault does to bytes on their way to the host: returns what is sent instead; may drop the
  /// connection.
  struct Fault {
    std::function<std::string(std::string bytes, bool& drop_connection)> to_host;
    std::function<std::string(std::string bytes)> to_device;
    /// At maximum speed answers leave by the thousand; when this says so, the next one leaves alone.
    std::function<bool()> is_due;
  };

  /// Throws boost::system::system_error when the port is taken.
  ScipServer(boost::asio::any_io_executor executor, const Options& options, SimClock& clock,
             UstDevice& device);
  ~ScipServer();
  ScipServer(const ScipServer&) = delete;
  ScipServer& operator=(const ScipServer&) = delete;

  [[nodiscard]] std::uint16_t port() const;
  [[nodiscard]] bool has_host() const;
  /// Hosts that were served so far.
  [[nodiscard]] std::uint64_t connections() const;
  void set_fault(Fault fault);
  /// Closes the present connection in good order.
  void drop_connection();
  /// Ends it with a reset, as a reboot does.
  void reset_connection();
  /// Never serves it again and never closes it: to the host it looks as if the cable were cut. Others may
  /// connect.
  void abandon_connection();
  /// Nothing leaves for so many real seconds; then everything does.
  void hold_output(double seconds);
  /// For so many real seconds bytes leave in pieces of this size, with pauses; the rest of a long batch
  /// whole.
  void split_output(std::size_t piece, double seconds);
  /// For so many real seconds no more than this many bytes leave in a second.
  void slow_output(double bytes_per_s, double seconds);
  /// Once what waits has left, the connection ends with a reset.
  void reset_after_output();
  /// The port is closed for so many real seconds.
  void refuse_connections(double seconds);
  /// For so many real seconds hosts may connect and are not served, as while the device starts.
  void serve_nobody(double seconds);
  /// The next host that leaves finds the device still streaming when it comes back.
  void keep_streaming_once();
  void stop();

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace sim
