// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "fit/bench.hpp"
#include "lidar/request.hpp"
#include "sim/engine.hpp"

namespace sim {

/// Who the simulated lidar says it is, and how its clock runs.
struct UstIdentity {
  std::string model = "UST-10LX", serial = "H2600001", firmware = "2.23.0000";
  double clock_ppm =
      50;  ///< Fast by this much (a UST simulator's default, urg_stamped; real crystals stay within 100).
  double scan_period_s = 0.025;      ///< 2400 rpm; real motors are off by up to 0.2 % (25.05 ms seen).
  std::uint32_t clock_start_ms = 0;  ///< The timer at power-on, to start near the 24-bit wrap.
};

/// The UST-10LX as a state machine: requests in, answers and scans out. No socket, no clock: the caller says
/// what time it is. Behaviour from scip.md: statuses of the UST family, echo of the remaining count, clusters
/// as minimum of their steps, time adjustment that refuses measurements, reset that zeroes the timer.
class UstDevice {
 public:
  UstDevice(const fit::LidarGeometry& lidar, UstIdentity identity, std::shared_ptr<Engine> engine,
            std::function<StageMoment(double)> stage_at);

  /// The answer to one line (without its end) received at `now_s`. Empty when the device says nothing.
  [[nodiscard]] std::string handle(std::string_view line, double now_s);

  [[nodiscard]] bool streaming() const { return stream_.has_value(); }
  /// Streams, and leaves scans out between two that are sent.
  [[nodiscard]] bool skips_scans() const { return stream_ && stream_->request.scan.skip > 0; }
  /// When the next scan of the stream is ready to be sent, given that it is `now_s`: scans that nobody could
  /// take are passed over, as the motor does not wait.
  [[nodiscard]] double next_scan_ready_s(double now_s);
  /// Appends that scan's message; ends the stream after its last.
  void append_next_scan(std::string& out);
  /// The simulated time up to which the last appended scan has come.
  [[nodiscard]] double scan_end_s() const { return scan_end_s_; }

  /// The host went away: streaming stops, the laser goes off.
  void disconnected();
  /// Power-on or reboot at `now_s`.
  void reboot(double now_s);
  /// True once after the second RB: the connection is to be dropped.
  [[nodiscard]] bool take_reboot_request() { return std::exchange(reboot_requested_, false); }
  void shift_clock_ms(std::int64_t by) { clock_offset_ms_ += by; }
  /// The 24-bit timer will wrap in so many milliseconds.
  void wrap_clock_in_ms(double now_s, std::int64_t ms) {
    clock_offset_ms_ += 0x1000000 - ms - stamp_ms(now_s);
  }
  /// Some firmwares answer VV, PP and II with an error while they stream.
  void refuse_queries_while_streaming(bool refuse) { refuses_queries_ = refuse; }
  /// Scans that were produced, for logs.
  [[nodiscard]] std::uint64_t scans_made() const { return scans_made_; }

 private:
  struct Stream {
    lidar::Request request;
    int remaining = 0;  ///< Scans still to send; 0 with `endless`.
    bool endless = false;
    std::int64_t next_index = 0;  ///< Number of the next scan since power-on.
  };

  [[nodiscard]] std::uint32_t stamp_ms(double time_s) const;
  [[nodiscard]] std::string check_steps(const lidar::ScanCommand& scan) const;
  [[nodiscard]] std::string identify(std::string_view echo) const;
  [[nodiscard]] std::string parameters(std::string_view echo) const;
  [[nodiscard]] std::string state(std::string_view echo, double now_s) const;
  [[nodiscard]] std::string time_adjust(std::string_view echo, lidar::Command command, double now_s);
  [[nodiscard]] std::string single_scan(std::string_view echo, const lidar::Request& request, double now_s);
  [[nodiscard]] std::string start_stream(std::string_view echo, const lidar::Request& request, double now_s);
  [[nodiscard]] std::string reset(std::string_view echo, double now_s);
  [[nodiscard]] std::string restart(std::string_view echo, double now_s);
  void measure(const lidar::Request& request, std::int64_t scan_index, const std::string& echo,
               std::string_view status, std::string& out);

  fit::LidarGeometry lidar_;
  UstIdentity identity_;
  std::shared_ptr<Engine> engine_;
  std::function<StageMoment(double)> stage_at_;
  std::vector<std::uint32_t> range_, intensity_;            ///< Of all steps.
  std::vector<std::uint32_t> sent_range_, sent_intensity_;  ///< Of the clusters that were asked for.
  bool laser_on_ = false, adjusting_time_ = false, reboot_requested_ = false, refuses_queries_ = false;
  double timer_zero_s_ = 0, scan_end_s_ = 0, first_restart_s_ = -1;
  std::int64_t clock_offset_ms_ = 0;
  std::uint64_t scans_made_ = 0;
  std::optional<Stream> stream_;
};

}  // namespace sim
