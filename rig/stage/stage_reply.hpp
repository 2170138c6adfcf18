// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace rig {

// The lines that stages of the several languages answer, read without any I/O.

/// A Zaber ASCII reply: "@01 1 42 OK BUSY WR 0:7A".
struct ZaberReply {
  ZaberReply() {}
  bool accepted = false, busy = false;
  std::string flag;  ///< The highest warning, "--" if there is none.
  std::string data;
};

/// One command with its id and checksum, ready for the line.
std::string zaber_command(const std::string& words, int device, int axis, int id);
/// The reply to command `id` of this device and axis; nothing if the line is anything else or is damaged.
std::optional<ZaberReply> zaber_reply(std::string_view line, int device, int axis, int id);

std::optional<long long> whole_number(std::string_view text);
std::vector<std::string> words_of(std::string_view text);

/// What a Sigma-Koki controller answers to `Q:` about one of its axes.
struct ShotStatus {
  ShotStatus() {}
  double position = 0;      ///< Pulses.
  bool understood = false;  ///< The last command.
  bool at_limit = false;    ///< The axis was stopped by a limit switch.
  bool busy = false;
  int axes = 0;
};

/// "       400,         0,K,K,R": ten characters an axis (sign, blanks, digits), then three letters. Nothing
/// but the exact form is taken, because nothing else tells a damaged line: there is no checksum. `axis`
/// counts from 1.
std::optional<ShotStatus> shot_status(std::string_view line, int axis);

/// OK: true, NG: false.
std::optional<bool> shot_acknowledgement(std::string_view line);

/// What a Pegasus Falcon answers to `FA`: "FR_OK:72000:180.00:0:0:0:0".
struct FalconStatus {
  FalconStatus() {}
  double deg = 0;  ///< 0 to 360, two decimals.
  bool moving = false, at_limit = false, reversed = false;
};

std::optional<FalconStatus> falcon_status(std::string_view line);

}  // namespace rig
