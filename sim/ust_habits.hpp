// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <string_view>

namespace sim {

/// What some firmwares do otherwise than the UST that is simulated. Each can be switched on and off while it
/// runs
/// (`lidar NAME on=1`); a driver must be right with all of them.
enum class UstHabit {
  refuse_queries,
  queries_stop_stream,
  slow_frame,
  comments,
  coded_time,
  reordered_parameters,
  more_parameters,
  silent_reboot,
  strict_time,
  quit_leaves_time,
  never_already,
  unwell,
  speed_in_words,
};

struct UstHabitName {
  UstHabit habit;
  std::string_view name, about;
};

/// In the order of the enumeration. Where it was seen stands behind what it is.
inline constexpr std::array ust_habits{
    UstHabitName{UstHabit::refuse_queries, "refuse-queries", "VV and II are refused while it streams"},
    UstHabitName{UstHabit::queries_stop_stream, "queries-stop-stream",
                 "VV, PP and II end its stream (urg_node #60)"},
    UstHabitName{UstHabit::slow_frame, "slow-frame",
                 "answers and scans leave on a 5 ms frame (urg_stamped #172)"},
    UstHabitName{UstHabit::comments, "comments",
                 "lines of II end in comments that their sums leave out (UTM-30LX)"},
    UstHabitName{UstHabit::coded_time, "coded-time",
                 "the time in II has 4 coded characters in place of 6 digits"},
    UstHabitName{UstHabit::reordered_parameters, "reordered-parameters",
                 "the lines of PP stand in another order"},
    UstHabitName{UstHabit::more_parameters, "more-parameters",
                 "PP has a line PROT (urg_stamped's simulator; hokuyoaist trips over it)"},
    UstHabitName{UstHabit::silent_reboot, "silent-reboot", "RB is not answered but obeyed (urg_stamped #71)"},
    UstHabitName{UstHabit::strict_time, "strict-time", "TM1 is refused outside time-adjust mode"},
    UstHabitName{UstHabit::quit_leaves_time, "quit-leaves-time",
                 "QT is accepted in time-adjust mode and leaves it (urg_stamped #115)"},
    UstHabitName{UstHabit::never_already, "never-already",
                 "TM0 and TM2 answer 00 although nothing changes (urg_stamped #115)"},
    UstHabitName{UstHabit::unwell, "unwell", "its STAT says that the window is dirty; it measures"},
    UstHabitName{UstHabit::speed_in_words, "speed-in-words",
                 "SCSP in II is Initial(2400[rpm]) and a comment, as older generations write it"},
};

}  // namespace sim
