// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <span>
#include <string>
#include <vector>

#include "rig/archive/history.hpp"

namespace rig {

/// A session whose results are not those of the lidar that it names.
struct StrangeSession {
  const SessionRecord* session = nullptr;
  std::string looks_like;     ///< The lidar whose results they are; empty: none's, or several lidars' alike.
  std::size_t also_like = 0;  ///< How many lidars they fit besides.
  double distance = 0;        ///< Chi-squared from the results of the lidar that it names.
  double distance_to_other = 0;  ///< From those of `looks_like`.
  std::size_t quantities = 0;    ///< Degrees of freedom of both.
  double p_value = 1;            ///< Of so large a distance by chance.
};

/// Compares the results of every session with those of its lidar's other sessions (their line where they
/// drift beyond doubt, else their median), and of every other lidar of the same model: each quantity that
/// repeats better than lidars differ, in units of the archive's repeatability. A session is strange if it is
/// not its own lidar's with an error of one in a thousand over all of them, and is reported with the lidar
/// whose results it has.
[[nodiscard]] std::vector<StrangeSession> strange_sessions(
    std::span<const SessionRecord> archive, std::span<const QuantityHistory> histories,
    const std::map<std::string, Repeatability>& repeat);

}  // namespace rig
