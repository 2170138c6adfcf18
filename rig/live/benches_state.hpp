// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

namespace rig {

/// What the sessions of a folder tell of the benches that write them: which run, which wait for a person and
/// for what, which were killed. Nothing is changed by looking; finished sessions are read once.
class BenchesState {
 public:
  explicit BenchesState(std::string folder) : folder_(std::move(folder)) {}

  /// `benches/1` (docs/operate/laboratory.md), at the time `now_unix_s`: who is needed first. Throws
  /// UsageError: no such folder.
  [[nodiscard]] nlohmann::json observe(std::int64_t now_unix_s);

 private:
  struct Ended {
    std::filesystem::file_time_type modified;
    nlohmann::json says;
  };
  [[nodiscard]] nlohmann::json ended_session(const std::filesystem::path& file);

  std::string folder_;
  std::map<std::string, Ended> ended_;
};

}  // namespace rig
