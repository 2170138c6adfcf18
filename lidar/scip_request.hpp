// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>

namespace lidar::scip {

/// A command with its parameters, as a host writes it and a device reads it.
struct Request {
  std::string command;  ///< "VV", "ME", "%ST" ...
  /// Scan commands only. -1: the command does not have it.
  int first_step = -1, last_step = -1, cluster = -1, skip = -1, count = -1;
  std::string parameters;  ///< What follows other commands: "1" of TM1, "115200" of SS.
  std::string tag;         ///< After ';', at most 16 characters.

  [[nodiscard]] std::string text() const;  ///< Without the line end.
  [[nodiscard]] bool streams() const;      ///< MD MS ME ND NE and their kin: one request, many scans.
  [[nodiscard]] bool scans() const;        ///< Any command that answers with measurements.
};

/// A request for measurements. `count` 0: until stopped.
[[nodiscard]] Request scan_request(const std::string& command, int first_step, int last_step, int cluster,
                                   int skip = -1, int count = -1, const std::string& tag = "");

/// Reads one line (without its end). The error is the status a UST-10LX answers with: 0C too short, 0D too
/// long, 0E not defined, 0G string too long, 0H bad characters in the string, 01..07 not a number (scip.md, 3
/// and 4).
[[nodiscard]] tl::expected<Request, std::string> parse_request(std::string_view line);

}  // namespace lidar::scip
