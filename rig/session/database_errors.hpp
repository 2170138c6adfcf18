// SPDX-License-Identifier: MIT
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>

#include <string>

#include "rig/errors.hpp"

namespace rig {

/// The disk of a session is full or fails.
class SessionDiskError : public MeasurementError {
  using MeasurementError::MeasurementError;
};

/// Turns the database's words about the session file `path` into the operator's. Throws UsageError or
/// MeasurementError.
[[noreturn]] void rethrow_for_operator(const std::string& path, const SQLite::Exception& error);

/// Runs `work` on the session file `path`; what the database complains of is reported as above.
template <class F>
auto guarded(const std::string& path, F work) {
  try {
    return work();
  } catch (const SQLite::Exception& error) {
    rethrow_for_operator(path, error);
  }
}

}  // namespace rig
