// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "rig/investigate/cost.hpp"
#include "rig/investigate/decision.hpp"

namespace rig::investigate {

/// One session of an investigation. Its files carry its name: NAME.yaml, NAME.rig, NAME.explanation.json.
struct Session {
  std::string name, title, why;
  Cost cost;
  bool needs_operator = false;
  bool recorded = false;
  bool without_data = false;  ///< Nothing could be measured: there is no NAME.rig, and it took no time.
  std::string failed;         ///< Why it ended before its end; what it captured counts.
};

/// A session and what all sessions up to it say together.
struct Round {
  Session session;
  std::vector<Possible> considered;  ///< Beside what was chosen, with what they promised.
  nlohmann::json explanation;  ///< `explanation/1` without its curves and its bench; null: not yet explained.
  nlohmann::json comparison;   ///< Of a session whose prediction did not come true; else null.
};

/// Where an investigation stands: all that `--resume` needs beside the sessions (`investigation/2`).
struct State {
  std::string bench_sha256;
  double budget_min = 0;
  bool unattended = false;
  std::optional<double> on_for_min;  ///< The lidar had been on for so long when it began.
  std::vector<Round> rounds;

  struct Ending {
    End end = End::undecidable;
    std::string why, needs;
    std::vector<std::string> not_examined;  ///< Titles of looks that nobody took.
  };
  std::optional<Ending> ending;
  std::optional<Session> last;    ///< The predicted session.
  std::string prediction_sha256;  ///< Of prediction.json, before `last` was recorded.
  nlohmann::json comparison;      ///< How it came out; null: not yet compared.
  int refuted = 0;                ///< Predictions that did not come true; their sessions became rounds.

  [[nodiscard]] double minutes_spent() const;
  [[nodiscard]] double hand_minutes() const;
};

[[nodiscard]] nlohmann::json to_json(const State& state);
/// Throws UsageError, naming `file`, where it is no such document.
[[nodiscard]] State state_of(const std::string& text, const std::string& file);

}  // namespace rig::investigate
