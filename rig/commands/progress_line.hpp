// SPDX-License-Identifier: MIT
#pragma once

#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <mutex>
#include <string>
#include <thread>

#include "fit/explain/explanation.hpp"

namespace rig::commands {

/// One line on a terminal while an explanation is computed: what it does, and for how long so far. Nobody
/// knows how long hypotheses take, so no time left is told. It counts on while nothing is reported, by a
/// thread; silent when nobody watches.
class ProgressLine {
 public:
  ProgressLine() {
    if (isatty(STDERR_FILENO) != 0) shows_ = std::thread([this] { show(); });
  }
  ~ProgressLine() {
    if (!shows_.joinable()) return;
    {
      const std::lock_guard lock(mutex_);
      over_ = true;
    }
    changed_.notify_one();
    shows_.join();
    std::fprintf(stderr, "\r%60s\r", "");
  }
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  /// fit::explain::Progress
  void operator()(double share, const std::string& what) {
    const std::lock_guard lock(mutex_);
    what_ = what;
    if (share != fit::explain::unknown_share)
      what_ += ", " + std::to_string(static_cast<int>(100 * share)) + " %";
  }

 private:
  void show() {
    const auto start = std::chrono::steady_clock::now();
    std::unique_lock lock(mutex_);
    while (!changed_.wait_for(lock, std::chrono::milliseconds(250), [this] { return over_; })) {
      const double spent = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      std::fprintf(stderr, "\r%-42s %4.0f s so far ", what_.c_str(), spent);
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::string what_ = "reading";
  bool over_ = false;
  std::thread shows_;
};

}  // namespace rig::commands
