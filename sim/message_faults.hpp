// SPDX-License-Identifier: MIT
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "sim/random.hpp"

namespace sim {

/// What firmware, or the way to the host, can make of one message of a lidar (its empty line included).
struct MessageFault {
  enum class Of { any, scan, parameters };  ///< Which message it waits for.
  struct Context {
    double amount;         ///< The fault's parameter.
    std::string previous;  ///< The latest answer before that was no scan; may be empty.
    Random& random;
  };

  std::string_view name, about;
  Of of = Of::any;
  std::string_view parameter;  ///< Its name; empty: it has none.
  double usual = 0;            ///< Its value unless one is given.
  void (*change)(std::string& message, const Context& context);
};

/// All there are. Messages that are not formed as expected are left as they are.
[[nodiscard]] std::span<const MessageFault> message_faults();

/// Whether the fault waits for such a message.
[[nodiscard]] bool concerns(MessageFault::Of of, std::string_view message);

}  // namespace sim
