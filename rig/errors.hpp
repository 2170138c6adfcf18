// SPDX-License-Identifier: MIT
#pragma once

#include <stdexcept>

namespace rig {

// What `rig` could not do, by exit status. what() is written for the operator: what happened, what the rig
// did, what to do next.

/// Wrong usage or an unreadable file: exit status 2.
class UsageError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A device failed or was lost: exit status 3.
class DeviceError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// No lidar is at the address. One that was switched on just now soon will be.
class LidarAbsent : public DeviceError {
  using DeviceError::DeviceError;
};

/// The measurement or the fit failed, with its reason: exit status 1.
class MeasurementError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The stage refused, failed or was lost.
class StageError : public DeviceError {
  using DeviceError::DeviceError;
};

/// Another program has the stage's port open.
class StageBusy : public StageError {
  using StageError::StageError;
};

/// The link to the stage is gone (unplugged, switched off, silent): Stage::reopen() may bring it back.
class StageLost : public StageError {
  using StageError::StageError;
};

}  // namespace rig
