// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <functional>
#include <memory>
#include <string>

#include "sim/clock.hpp"
#include "sim/stage_device.hpp"

namespace sim {

/// A simulated stage on a pseudo-terminal, with a symbolic link to it at a path of the caller's choice. Runs
/// on one thread: call it only from its executor.
class PtyPort {
 public:
  enum class Direction { to_device, to_client };
  /// What becomes of bytes on their way: change them, drop them (empty), or hold them back.
  struct Passage {
    Passage(std::string bytes_, double delay_s_ = 0) : bytes(std::move(bytes_)), delay_s(delay_s_) {}
    std::string bytes;
    double delay_s = 0;  ///< Real seconds.
    bool split = false;  ///< The second half comes after a pause (towards the client only).
  };
  /// Called for each piece that arrives and for each line that leaves.
  using LineFault = std::function<Passage(Direction direction, const std::string& bytes)>;

  struct Options {
    Options() {}
    std::string link;          ///< Where the symbolic link is made; empty: none.
    bool strict_baud = false;  ///< Garble everything while the client's baud rate is not the device's.
  };

  /// Opens the pseudo-terminal, makes the link (replacing a stale link, never a file) and starts serving. The
  /// device and the clock must outlive it. Throws std::system_error with the path in its words.
  PtyPort(const boost::asio::any_io_executor& executor, StageDevice& device, SimClock& clock,
          const Options& options = Options());
  ~PtyPort();
  PtyPort(const PtyPort&) = delete;
  PtyPort& operator=(const PtyPort&) = delete;

  /// The terminal's own name, e.g. /dev/pts/7; empty while unplugged.
  [[nodiscard]] const std::string& path() const;
  void set_line_fault(LineFault fault);
  /// The cable comes out: the client sees end of file or an I/O error, the link is gone.
  void unplug();
  /// The cable is back in, as another terminal; the link points there.
  void replug();

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace sim
