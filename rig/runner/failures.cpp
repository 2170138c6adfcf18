// SPDX-License-Identifier: MIT
#include "rig/runner/failures.hpp"

#include "rig/errors.hpp"
#include "rig/runner/runner.hpp"
#include "rig/session/database_errors.hpp"
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

std::exception_ptr with_more_words(const std::exception_ptr& why, const std::string& words) {
  if (words.empty()) return why;
  const std::string text = sentence(why) + " " + words;
  if (is_a<RunStopped>(why)) return std::make_exception_ptr(RunStopped(text));
  if (is_a<StageLost>(why)) return std::make_exception_ptr(StageLost(text));
  if (is_a<StageError>(why)) return std::make_exception_ptr(StageError(text));
  if (is_a<DeviceError>(why)) return std::make_exception_ptr(DeviceError(text));
  if (is_a<SessionDiskError>(why)) return std::make_exception_ptr(SessionDiskError(text));
  if (is_a<MeasurementError>(why)) return std::make_exception_ptr(MeasurementError(text));
  if (is_a<UsageError>(why)) return std::make_exception_ptr(UsageError(text));
  return why;
}

bool is_stage_error(const std::exception_ptr& why) { return is_a<StageError>(why); }

bool is_stage_lost(const std::exception_ptr& why) { return is_a<StageLost>(why); }

bool is_lidar_lost(const std::exception_ptr& why) { return is_a<DeviceError>(why) && !is_a<StageError>(why); }

}  // namespace rig
