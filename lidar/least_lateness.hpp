// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

namespace lidar {

/// How late a scan came, behind whatever it is counted from.
struct Lateness {
  double us, device_ms, u_start_ms;
};

/// The least lateness possible, as some scans show it.
struct LeastLateness {
  double us, u_us;
  double device_ms;  ///< Of the scan that shows it.
  double excess_us;  ///< How much later scans were in the mean.
};

/// Smaller than this no uncertainty of a lateness is, microseconds.
constexpr double least_u_lateness_us = 4;

/// Where the densest quarter begins, once those before it that stand close together are taken in: what stands
/// alone in front is a delay that was folded over. Delays are taken to be exponential beyond the least, so
/// that the least is late by about as much as its neighbours stand apart.
///
/// A busy host holds scans up for spells: what they say is as uncertain as their thirds in time differ.
/// `scans`, one at least, are sorted anew.
[[nodiscard]] LeastLateness least_of(std::vector<Lateness>& scans);

}  // namespace lidar
