// SPDX-License-Identifier: MIT
#pragma once

#include <CLI/CLI.hpp>
#include <memory>

namespace rig {

/// One subcommand of `rig`. Each lives in its own file commands/NAME.cpp, which defines
/// `std::unique_ptr<rig::Command> rig::commands::make_NAME()`; the build finds it by its name.
class Command {
 public:
  virtual ~Command() = default;
  /// Adds the subcommand with its options to `root`. The object outlives the parsing.
  virtual CLI::App* declare(CLI::App& root) = 0;
  /// Does the work after parsing; returns the exit status (0) or throws UsageError (2), DeviceError (3) or
  /// any other exception (1).
  virtual int run() = 0;
};

}  // namespace rig
