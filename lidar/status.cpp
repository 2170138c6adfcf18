// SPDX-License-Identifier: MIT
#include "lidar/status.hpp"

#include <algorithm>
#include <array>

namespace lidar {

namespace {

struct Meaning {
  std::string_view status;
  StatusKind kind;
  std::string_view words;
};

// Of any command. Where generations differ (S20 page 23 against the UST's), the UST's meaning is given.
constexpr std::array generic{
    Meaning{"00", StatusKind::done, "done"},
    Meaning{"0A", StatusKind::refused, "the sensor could not build an answer"},
    Meaning{"0B", StatusKind::refused, "the sensor's buffer is short, or the command was repeated"},
    Meaning{"0C", StatusKind::refused, "the command is too short"},
    Meaning{"0D", StatusKind::refused, "the command is too long"},
    Meaning{"0E", StatusKind::refused, "the command is not defined"},
    Meaning{"0F", StatusKind::refused, "the command is not supported by this sensor"},
    Meaning{"0G", StatusKind::refused, "the string after ';' is longer than 16 characters"},
    Meaning{"0H", StatusKind::refused,
            "the string after ';' has a letter that is not allowed, or the command is too short"},
    Meaning{"0I", StatusKind::refused, "the sensor is in firmware-update mode"},
    Meaning{"0L", StatusKind::hardware_fault, "the sensor is in an error state"},
    Meaning{"0M", StatusKind::hardware_fault, "the sensor is unstable"},
    Meaning{"10", StatusKind::refused,
            "not allowed in the sensor's present state (laser off, or busy with another mode)"},
};

constexpr std::array laser_on{
    Meaning{"01", StatusKind::hardware_fault, "the laser cannot be switched on: it is faulty"},
    Meaning{"02", StatusKind::already, "the laser was on already"},
};

constexpr std::array time_mode{
    Meaning{"01", StatusKind::refused, "the digit after TM is not 0, 1 or 2"},
    Meaning{"02", StatusKind::already, "time-adjust mode was on already"},
    Meaning{"03", StatusKind::already, "time-adjust mode was off already"},
    Meaning{"04", StatusKind::refused, "time-adjust mode is off"},
};

constexpr std::array scan{
    Meaning{"01", StatusKind::refused, "the start step is not a number"},
    Meaning{"02", StatusKind::refused, "the end step is not a number"},
    Meaning{"03", StatusKind::refused, "the cluster count is not a number"},
    Meaning{"04", StatusKind::refused, "the end step is out of the sensor's range"},
    Meaning{"05", StatusKind::refused, "the end step is below the start step"},
    Meaning{"06", StatusKind::refused, "the number of skipped scans is not a number"},
    Meaning{"07", StatusKind::refused, "the number of scans is not a number"},
    Meaning{"0M", StatusKind::checking, "scanning stopped while the sensor is unstable"},
};

constexpr std::array reboot{
    Meaning{"01", StatusKind::repeat_to_confirm, "the sensor waits for the second RB"},
};

constexpr std::array setting{
    Meaning{"01", StatusKind::refused, "the value is out of range"},
    Meaning{"02", StatusKind::already, "the setting had this value already"},
    Meaning{"03", StatusKind::already, "the setting had this value already"},
    Meaning{"04", StatusKind::refused, "this sensor does not have the setting"},
};

bool is_number(std::string_view status) {
  return status.size() == 2 &&
         std::all_of(status.begin(), status.end(), [](char c) { return c >= '0' && c <= '9'; });
}

Meaning scan_fault(std::string_view status) {
  const int number = 10 * (status[0] - '0') + (status[1] - '0');
  if (number == 99) return {status, StatusKind::scan_data, "scan data"};
  if (number == 98) return {status, StatusKind::resumed, "scanning resumed after the sensor checked itself"};
  if (number >= 50) return {status, StatusKind::hardware_fault, "hardware fault of laser or motor"};
  if (number >= 21)
    return {status, StatusKind::checking, "scanning stopped while the sensor checks a suspected fault"};
  return {status, StatusKind::unknown, "a status this program does not know"};
}

template <std::size_t size>
const Meaning* find(const std::array<Meaning, size>& table, std::string_view status) {
  const auto found =
      std::find_if(table.begin(), table.end(), [&](const Meaning& m) { return m.status == status; });
  return found == table.end() ? nullptr : &*found;
}

const Meaning* find_special(std::string_view status, const Request& request) {
  switch (request.command) {
    case Command::laser_on:
      return find(laser_on, status);
    case Command::time_enter:
    case Command::time_read:
    case Command::time_leave:
      return find(time_mode, status);
    case Command::scan:
      return find(scan, status);
    case Command::reboot:
      return find(reboot, status);
    case Command::motor_speed:
    case Command::sensitivity:
    case Command::bit_rate:
      return find(setting, status);
    default:
      return nullptr;
  }
}

Meaning look_up(std::string_view status, const Request& request) {
  if (const Meaning* special = find_special(status, request)) return *special;
  if (const Meaning* known = find(generic, status)) return *known;
  if (request.command == Command::scan && is_number(status)) return scan_fault(status);
  return {status, StatusKind::unknown, "a status this program does not know"};
}

}  // namespace

StatusKind kind_of(std::string_view status, const Request& request) { return look_up(status, request).kind; }

std::string meaning_of(std::string_view status, const Request& request) {
  return std::string(look_up(status, request).words);
}

}  // namespace lidar
