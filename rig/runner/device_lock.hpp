// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace rig {

/// Keeps two runs of one computer from using the same device, whoever started them: a file a device under
/// /run/lock/rig (or `$RIG_LOCKS`), locked as long as this object lives, and by nobody once the program
/// ended, however it ended. A device is locked by its address before it is spoken to, and by its serial
/// number once that is known: the same device may be reached by two addresses.
class DeviceLocks {
 public:
  /// `holder`: who has them, for those who are refused ("session out.rig").
  explicit DeviceLocks(std::string holder);
  ~DeviceLocks();
  DeviceLocks(const DeviceLocks&) = delete;
  DeviceLocks& operator=(const DeviceLocks&) = delete;

  /// `kind`: "lidar" or "stage"; `identity`: an address or a serial number. Locking again what is locked here
  /// does nothing. Throws DeviceError naming the holder if another program has it. Where no lock can be made,
  /// nothing is locked.
  void lock(const std::string& kind, const std::string& identity);

  /// Locks a lidar by the serial number in its answers. Simulated ones, which all have the same, go by their
  /// addresses.
  void lock_lidar(const nlohmann::json& answers);
  /// Locks a stage by its serial number, if it has one.
  void lock_stage(const std::string& model, const std::string& serial);

 private:
  std::string holder_;
  std::map<std::string, int> held_;  ///< Descriptors by file name.
};

}  // namespace rig
