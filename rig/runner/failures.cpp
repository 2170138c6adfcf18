// SPDX-License-Identifier: MIT
#include "rig/runner/failures.hpp"

#include "rig/errors.hpp"
#include "rig/stage/stage.hpp"

namespace rig {

std::string words_of(const std::exception_ptr& why) {
  try {
    std::rethrow_exception(why);
  } catch (const std::exception& error) {
    return error.what();
  } catch (...) {
    return "unknown error";
  }
}

std::string sentence(const std::exception_ptr& why) {
  std::string words = words_of(why);
  if (!words.empty() && std::string(".!?").find(words.back()) == std::string::npos) words += '.';
  return words;
}

bool is_stage_error(const std::exception_ptr& why) { return is_a<StageError>(why); }

bool is_stage_lost(const std::exception_ptr& why) { return is_a<StageLost>(why); }

bool is_lidar_lost(const std::exception_ptr& why) { return is_a<DeviceError>(why) && !is_a<StageError>(why); }

}  // namespace rig
