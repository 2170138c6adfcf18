// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "lidar/scan.hpp"

namespace rig {

/// What to stream; a class with a constructor because it is passed to coroutines.
struct LidarStream {
  LidarStream() {}
  int first_step = 0, last_step = 1080, cluster = 1;
  int skip = 0;  ///< Scans left out between two that are sent.
  bool intensity = true;
};

/// The runner's narrow view of a lidar; the real one is a lidar::Client, tests bring their own.
class LidarSource {
 public:
  template <class T>
  using awaitable = boost::asio::awaitable<T>;

  virtual ~LidarSource() = default;
  /// Connects, or connects anew after a loss; stops whatever the device was streaming. Returns its identity
  /// (VV, PP, II as JSON). Throws LidarAbsent when nothing answers, another DeviceError for what does.
  virtual awaitable<nlohmann::json> connect() = 0;
  /// Compares the device's clock with the host's anew, between two streams, so that the next scans are dated
  /// as well as after connecting: in the meantime both crystals went their own way, milliseconds in a few
  /// minutes. A device that cannot compare is dated as before. Throws DeviceError when the lidar is lost.
  virtual awaitable<void> synchronise() = 0;
  /// Throws UsageError for steps that the lidar does not have, DeviceError when it is lost or refuses.
  virtual awaitable<void> start(LidarStream stream) = 0;
  /// The next scan with good checksums; has a deadline of its own. Throws DeviceError or a system error when
  /// the lidar is lost.
  virtual awaitable<lidar::Scan> next() = 0;
  /// Takes back a scan that is done with: its memory may serve for one of the next.
  virtual void reuse(lidar::Scan /*scan*/) {}
  virtual awaitable<void> stop() = 0;
  /// Scans so far that are missing between two that came, by the device's stamps. This is the one count of
  /// them: of a capture, a run or a check it is the difference.
  [[nodiscard]] virtual std::uint64_t lost() const = 0;
  /// Answers thrown away so far because of a wrong checksum or shape.
  [[nodiscard]] virtual std::uint64_t rejected() const = 0;
  /// What came so far, across reconnections: {"scans", "lost", "damaged", "repeated", "stale",
  /// "reconnections", "attempts_in_vain"}; null where nobody counts.
  [[nodiscard]] virtual nlohmann::json statistics() const { return nullptr; }
  /// False once the device was found to measure distances alone.
  [[nodiscard]] virtual bool sends_intensities() const { return true; }
  /// HOST:PORT, for messages; empty where there is none.
  [[nodiscard]] virtual std::string address() const { return ""; }
  /// Times the device's clock was found to have started again; from there on its stamps are of a new time
  /// base, which goes on by the host's clock.
  [[nodiscard]] virtual int clock_restarts() const { return 0; }
  /// True when the device's clock does not run with the host's: a simulation faster than real time. Its own
  /// clock is then the session's.
  [[nodiscard]] virtual bool own_time() const = 0;
};

}  // namespace rig
