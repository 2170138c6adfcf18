// SPDX-License-Identifier: MIT
#pragma once

#include <string>

namespace rig {

/// A capture's `step` for people who read a certificate: "capture 3.2[distance_mm=500]" is "step 3.2, 500
/// mm", "find-edge 3.1[beam_deg=92]" is "find-edge, step 3.1, beam 92 deg". What no procedure named stays as
/// it is.
[[nodiscard]] std::string step_in_words(const std::string& step);

/// A step's number in its procedure's file ("4.1"), of its key, which names the turns of its loops as well.
[[nodiscard]] inline std::string number_of_step(const std::string& key) {
  return key.substr(0, key.find('['));
}

}  // namespace rig
