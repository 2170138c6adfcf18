// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "sim/engine.hpp"

namespace sim {

/// The bench's operator as a TCP port: what a person would do at the bench, one JSON object a line, one
/// answer a line (docs/develop/simulator.md). Any number of clients.
///
///   {"place": {"target": "board", "shift_mm": 100, "reflectance": 0.2, "temperature_c": 30}}  -> {"ok":
///   true}
///   {"place": {"since_power_on_s": 0}}                                          -> {"ok": true}
///   {"fault": "stage stall"}                                                                  -> {"ok":
///   true}
///   {"get": "state"}                                                -> {"ok": true, "time_s": 12.3,
///   "stage_deg": 1.5, ...}
///
/// What cannot be done is answered {"ok": false, "error": "why"}.
class OperatorPort {
 public:
  struct Options {
    Options() {}
    std::string address = "127.0.0.1";
    std::uint16_t port = 0;            ///< 0: any free one.
    std::vector<std::string> targets;  ///< Names that may be placed.
  };
  struct Bench {
    std::function<void(const SceneState& scene)> place;
    /// The lidar was off until it was cold, and has been on again for so long.
    std::function<void(double since_s)> switch_on;
    std::function<void(const std::string& fault)> fault;  ///< Throws std::invalid_argument.
    std::function<nlohmann::json()> state;
  };

  /// Throws boost::system::system_error when the port is taken.
  OperatorPort(const boost::asio::any_io_executor& executor, const Options& options, Bench bench);
  ~OperatorPort();
  OperatorPort(const OperatorPort&) = delete;
  OperatorPort& operator=(const OperatorPort&) = delete;

  [[nodiscard]] std::uint16_t port() const;
  /// The answer to one line; what a client would get.
  [[nodiscard]] std::string answer(const std::string& line);

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace sim
