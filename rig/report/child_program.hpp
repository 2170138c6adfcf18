// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <string>
#include <vector>

namespace rig {

/// How another program ended that was run to its end.
struct ChildResult {
  enum class End {
    done,     ///< With exit status 0.
    failed,   ///< With another, or by a signal, or it said more than anybody wants.
    missing,  ///< There is no such program.
    hung,     ///< It was not done in time and was killed, with all that it had started.
  };
  End end = End::failed;
  std::string output;  ///< What it wrote to standard output; its standard error goes nowhere.
};

/// Runs a program, found along PATH, until it ends or `longest` has passed; then its whole process group is
/// killed. It does not outlive this program. It gets no input, and SOURCE_DATE_EPOCH (unless set), so that it
/// gives the same bytes every time.
[[nodiscard]] ChildResult run_child(const std::vector<std::string>& arguments,
                                    std::chrono::milliseconds longest);

/// "gnuplot did not finish within 30 s and was stopped": for messages.
[[nodiscard]] std::string hung_in_words(const std::string& program, std::chrono::milliseconds longest);

}  // namespace rig
