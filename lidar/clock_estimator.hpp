// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <vector>

#include "lidar/device_timer.hpp"
#include "lidar/exchange_round.hpp"
#include "lidar/least_lateness.hpp"
#include "lidar/offset_filter.hpp"
#include "lidar/scan_grid.hpp"

namespace lidar {

/// How the lidar's clock stands to the host's: host = host_us + (device - device_ms) * 1000 * (1 - drift_ppm
/// * 1e-6).
struct ClockEstimate {
  bool synchronised = false;  ///< From TM exchanges; else only from when scans arrived.
  bool follows_host =
      true;  ///< False when a device second is not a host second within 1 %: a simulator at full speed or a
             ///< broken clock. Scan times then follow the device's clock 1:1 from the anchor.
  double device_ms = 0;    ///< The anchor, device side (24-bit wraps undone).
  double host_us = 0;      ///< The anchor, host side.
  double offset_u_us = 0;  ///< Standard uncertainty of host_us.
  double scan_u_us = 0;    ///< Standard uncertainty of the last scan's host time.
  double drift_ppm = 0;    ///< How much faster than the host's the device's clock runs.
  double drift_u_ppm = 0;  ///< Standard uncertainty of drift_ppm.
  int exchanges = 0;       ///< TM exchanges used.
  int resets = 0;          ///< Times the device's timer was found to have started again.
};

/// Relates a lidar's millisecond timer to the host's clock, and each scan to the moment at which its step 0
/// was passed. Pure: the caller says when things happened.
///
/// An exchange of TM1 says: at some moment between sending and receiving, the timer stood in [stamp, stamp +
/// 1 ms). Each exchange bounds the offset from both sides; what all allow together is far narrower than 1 ms.
/// What they cannot tell is how the shortest round trip is shared between the two ways: a constant of which
/// the uncertainty contains its whole width. ScanGrid says when scans began on the lidar's clock;
/// OffsetFilter carries the offset on from the exchanges by the scans that were least late.
///
/// A UST hands a scan over when its timer next comes to a whole millisecond (urg_stamped README). Arrivals
/// then lie a whole number of milliseconds behind a tick of the timer plus the way to the host, so that each
/// says where the tick is. Where arrivals do not look like that, they are taken to come at some moment within
/// a millisecond of the scan's end. Some firmware answers and hands scans over every 5 ms only (urg_stamped
/// #172), or may count in steps of 5 ms: both are seen from the exchanges' stamps, which then all have the
/// same rest, and what is said above of 1 ms holds for 5.
class ClockEstimator {
 public:
  /// How scans leave the lidar.
  enum class Departure {
    on_tick,  ///< Of the timer: the UST family. Given up when arrivals contradict it.
    unknown,
  };
  /// A scan ends `scan_ms` after its step 0, and cannot arrive before.
  explicit ClockEstimator(double nominal_period_ms = 25, double scan_ms = 18.75,
                          Departure departure = Departure::on_tick);

  /// The stamp on the present time base (DeviceTimer); a timer that started again begins a new one.
  std::uint64_t unwrap(std::uint32_t stamp_ms, double host_us);
  /// The lidar is connected anew: nothing is under way, so that the next stamp says whether its timer ran on.
  void begin_connection() { timer_.begin_connection(); }

  /// One TM1: sent and received by the host's clock.
  void add_exchange(double sent_us, double received_us, std::uint64_t device_ms);
  /// When to send the next TM1, not before `earliest_us`, so that it tells most: so that the lidar reads its
  /// timer where the next millisecond is thought to begin. The first of a round come at any moment.
  [[nodiscard]] double best_time_to_send(double earliest_us) const;
  /// A new round of exchanges begins; earlier ones stay in the filter, not in the bounds.
  void begin_exchanges();
  /// The round is over: its bounds become one measurement.
  void end_exchanges();

  /// A stream starts: scans come another way, or with another size, than those before.
  void begin_stream();
  /// A scan that arrived; returns the host time of its step 0, microseconds.
  double add_scan(std::uint64_t device_ms, double arrival_us);
  /// Standard uncertainty of what add_scan returned last, microseconds. Of the lidar's own clock when that is
  /// followed.
  [[nodiscard]] double u_scan_us() const;

  [[nodiscard]] ClockEstimate estimate() const;
  /// False once the lidar's second is no second of the host's.
  [[nodiscard]] bool follows_host() const { return follows_host_; }

 private:
  struct Moment {
    double device_ms, host_us;
  };
  /// The scans of a while, and where in the timer's millisecond they began.
  struct While {
    double begun_ms = 0;
    std::vector<Lateness> of_starts;  ///< Behind the scan's start.
    std::vector<Lateness> of_stamps;  ///< Behind the stamp, a whole millisecond.
    std::uint32_t phases = 0;
    void begin();
  };
  [[nodiscard]] TimerRate rate() const { return {filter_.rate_ppm(), filter_.u_rate_ppm()}; }
  void learn_steps(ExchangeRound::Answering how);
  [[nodiscard]] double behind_frame_ms(std::uint64_t device_ms) const;
  void start_again();
  void follow_device(Moment from);
  void judge_rate(Moment arrival);
  void note_lateness(const ScanGrid::Start& start, std::uint64_t stamp_ms, double arrival_us);
  void close_while();
  void learn_usual_lateness();
  void measure_by_ticks();
  void measure_by_starts(LeastLateness least);
  void begin_anew(double device_ms, double beyond_us);
  void measure(const LeastLateness& least);
  void give_up_ticks();
  [[nodiscard]] LeastLateness least_behind_tick(std::vector<Lateness>& scans) const;
  [[nodiscard]] double to_host(double device_ms) const;

  double scan_ms_;
  DeviceTimer timer_;
  bool synchronised_ = false, follows_host_ = true;
  int exchanges_used_ = 0;
  ExchangeRound exchanges_;
  ScanGrid grid_;
  OffsetFilter filter_;
  double frame_ms_ = 1;  ///< Scans leave when the timer has come to multiples of this, plus the rest.
  int coarse_step_ms_ =
      1;  ///< The exchanges' stamps, and scans' for all that is known, are multiples of this ...
  std::uint64_t coarse_rest_ms_ = 0;  ///< ... plus this, since the timer's start.
  bool coarse_stamps_ = false;  ///< No scan's stamp has yet shown that the timer counts single milliseconds.
  double u_way_us_ = 0;         ///< Of the share of the round trip that each way has.
  bool offset_known_ = false, tick_unknown_ = true;
  double origin_us_ = 0;  ///< host = origin + 1000 device + the filter's offset: keeps its numbers small.
  While while_;
  Departure departure_;
  int whiles_closed_ = 0, late_whiles_ = 0, scattered_whiles_ = 0, lost_whiles_ = 0;
  int whiles_for_usual_ = 0;  ///< To come.
  double usual_late_us_ = 0;  ///< The least of the stream's first whiles, behind the scans' starts.
  bool rate_judged_from_ = false;
  Moment rate_from_{}, last_arrival_{};
  Moment anchor_{};  ///< When the lidar's own clock is followed.
  double last_start_ms_ = 0, u_start_us_ = 0;
};

}  // namespace lidar
