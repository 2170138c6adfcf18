// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "fit/bench/bench.hpp"
#include "lidar/request.hpp"
#include "sim/engine.hpp"
#include "sim/ust_clock.hpp"
#include "sim/ust_habits.hpp"

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

  /// Scans are to be sent.
  [[nodiscard]] bool streaming() const { return stream_ && !stream_->stalled; }
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

  // What goes wrong with it; `FaultInjector::catalogue()` says what is meant.

  UstClock& clock() { return clock_; }
  void set_habit(UstHabit habit, bool on) { habits_[static_cast<std::size_t>(habit)] = on; }
  /// The stream stalls; the laser stays on, and the device believes that it measures.
  void stall();
  void switch_laser_off();
  /// The stream gives way to this status, and goes on with "98" so much later.
  void check_itself(double now_s, double seconds, const std::string& status);
  /// The next stream is of distances alone, whatever is asked for.
  void forget_intensities_once() { forgets_intensities_ = true; }
  enum class Heeds { all, quit_or_reset, reset };
  /// Hears nothing else, until it hears that.
  void heed_only(Heeds what) { heeds_ = what; }
  void ignore_quits(int count) { quits_ignored_ = count; }
  /// So many scans follow the next QT's acknowledgement.
  void send_after_quit(int scans) { scans_after_quit_ = scans; }
  /// In it, all is refused but RB and questions who it is.
  void set_error_state(bool on);
  void refuse_time_adjustment(bool refuse) { refuses_time_ = refuse; }
  /// Another device at the same address, by its serial number.
  void change_serial(const std::string& serial) { identity_.serial = serial; }
  [[nodiscard]] const std::string& serial() const { return identity_.serial; }

  /// Scans that were produced, for logs.
  [[nodiscard]] std::uint64_t scans_made() const { return scans_made_; }
  /// When the answer to this line, which comes now, is ready: a scan that is asked for must have been
  /// finished.
  [[nodiscard]] double answers_at_s(std::string_view line, double now_s) const;

 private:
  /// A message that stands in for scans.
  struct Notice {
    double due_s;
    std::string status;
  };
  struct Stream {
    lidar::Request request;
    int remaining = 0;  ///< Scans still to send; 0 with `endless`.
    bool endless = false;
    std::int64_t next_index = 0;  ///< Turn of the mirror since power-on.
    int closing = 0;              ///< Scans still to come although it was told to stop; 0: it was not.
    bool stalled = false;
    std::vector<Notice> notices;
  };

  static constexpr std::int64_t no_scan = -1;

  [[nodiscard]] bool has(UstHabit habit) const { return habits_[static_cast<std::size_t>(habit)]; }
  [[nodiscard]] bool hears(const lidar::Request& request);
  [[nodiscard]] std::string quit(std::string_view echo);
  void switch_laser_on(double now_s);
  /// When that turn's last step has been measured.
  [[nodiscard]] double finished_s(std::int64_t index) const;
  /// The latest turn that is finished and was begun with the laser on; or the first to be so.
  [[nodiscard]] std::int64_t latest_scan(double now_s) const;
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
  UstClock clock_;
  std::array<bool, ust_habits.size()> habits_{};
  bool laser_on_ = false, adjusting_time_ = false, reboot_requested_ = false;
  bool forgets_intensities_ = false, in_error_ = false, refuses_time_ = false;
  Heeds heeds_ = Heeds::all;
  int quits_ignored_ = 0, scans_after_quit_ = 0;
  double scan_end_s_ = 0, first_restart_s_ = -1;
  double laser_on_s_ = 0;                  ///< When it was switched on.
  std::int64_t measured_index_ = no_scan;  ///< The turn that range_ and intensity_ are of.
  std::uint64_t scans_made_ = 0;
  std::optional<Stream> stream_;
};

}  // namespace sim
