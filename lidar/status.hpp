// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>

#include "lidar/request.hpp"

namespace lidar {

/// What a two-character status means for what the host does next. "0A" to "0M" are refusals, although a
/// reader of decimal numbers would see a zero in them.
enum class StatusKind {
  done,               ///< The command was carried out.
  already,            ///< The sensor was in the asked state already: as good as done.
  scan_data,          ///< "99": the answer carries a scan of a continuous command.
  repeat_to_confirm,  ///< RB's first "01": the second request reboots.
  refused,            ///< The request or the sensor's present state does not allow it.
  checking,           ///< "21" to "49": scanning stopped to check a suspected fault; it may resume by itself.
  resumed,            ///< "98": the check passed, scanning goes on.
  hardware_fault,     ///< "50" to "97", BM's "01", and "0L": the sensor needs service or a reboot.
  unknown,
};

[[nodiscard]] StatusKind kind_of(std::string_view status, const Request& request);

/// What the sensor meant, in words: "start step is not a number". For messages to the operator.
[[nodiscard]] std::string meaning_of(std::string_view status, const Request& request);

}  // namespace lidar
