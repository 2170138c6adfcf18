// SPDX-License-Identifier: MIT
#pragma once

#include <cstdio>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "rig/runner/runner.hpp"

namespace rig {

/// Shows a run as it goes. show() is called at every change, thousands of times a second: it must be cheap
/// when there is nothing new.
class RunView {
 public:
  virtual ~RunView() = default;
  virtual void show(const RunState& state) = 0;
};

/// One line that is drawn over and over (what it does, how far, time left), messages above it. When `out` is
/// not a terminal: warnings and errors only.
[[nodiscard]] std::unique_ptr<RunView> make_terminal_view(std::FILE* out, bool is_terminal);

/// One JSON object a line, for machines (docs/operate/run.md).
[[nodiscard]] std::unique_ptr<RunView> make_json_log(std::FILE* out);

/// The table at the end of a run: what was captured, what came out, which limits it meets.
[[nodiscard]] std::string summary_text(const RunState& state, const SessionStore& session, double seconds);

}  // namespace rig
