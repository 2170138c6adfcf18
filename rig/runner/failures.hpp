// SPDX-License-Identifier: MIT
#pragma once
// What a failure of a run is, and what it says.

#include <exception>
#include <string>

namespace rig {

/// What an exception says to the operator.
std::string words_of(const std::exception_ptr& why);
/// The same with a full stop at its end: another sentence may follow.
std::string sentence(const std::exception_ptr& why);

/// The same failure with words more, if it is one after which the operator goes on.
std::exception_ptr with_more_words(const std::exception_ptr& why, const std::string& words);

/// Whether it is of that class or one derived from it.
template <typename Error>
bool is_a(const std::exception_ptr& why) {
  try {
    std::rethrow_exception(why);
  } catch (const Error&) {
    return true;
  } catch (...) {
    return false;
  }
}

bool is_stage_error(const std::exception_ptr& why);
bool is_stage_lost(const std::exception_ptr& why);
/// The lidar's driver gave up: no answer, a closed connection, an answer that makes no sense.
bool is_lidar_lost(const std::exception_ptr& why);

}  // namespace rig
