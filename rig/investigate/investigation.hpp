// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "fit/explain/explanation.hpp"
#include "rig/investigate/session_plan.hpp"
#include "rig/investigate/state.hpp"
#include "rig/procedure/procedure.hpp"

namespace rig::investigate {

struct Options {
  std::string folder;     ///< For everything that is written.
  std::string procedure;  ///< The first session's; empty: a short look from several angles.
  double budget_min = 480;
  bool unattended = false;  ///< No experiment that needs an operator is done.
  bool resume = false;
  std::optional<double> on_for_min;  ///< How long the lidar has been on; not given: it does not matter.
};

/// What an investigation has others do.
struct Actions {
  /// Runs a procedure into a session file; `resumed`: the file holds an earlier part. Throws as Runner does.
  std::function<void(const Procedure& procedure, const std::string& session, bool resumed)> record;
  std::function<fit::explain::Explanation(const std::vector<const fit::Recording*>& recordings)> explain;
  std::function<void(const std::string& line)> say;
  std::function<void(const nlohmann::json& dossier)> show;  ///< After every step; for whoever watches.
};

/// Rounds of recording, explaining everything together and choosing the next experiment, until there is an
/// end; then a session whose outcome is written down before it is recorded, and the dossier.
///
/// Every file appears whole or not at all, and `investigation.json`, which says how far it is, last: whatever
/// kills the program, `resume` goes on where it was, and no session is recorded twice.
class Investigation {
 public:
  /// Throws UsageError when the folder holds another investigation, or none that could be resumed.
  Investigation(const fit::Bench& bench, Options options, Actions actions);

  /// As it was begun.
  [[nodiscard]] bool unattended() const { return state_.unattended; }

  /// To the end. Returns the dossier (`dossier/2`, docs/operate/investigate.md). Throws what recording
  /// throws; what was recorded stays, and a resumed investigation goes on with it.
  nlohmann::json run();

 private:
  struct Evidence;
  struct Candidate {
    SessionPlan plan;
    Possible possible;
    Cost cost;
  };

  [[nodiscard]] std::string file(const std::string& name) const;
  void save();
  void publish();
  void begin();
  [[nodiscard]] Procedure procedure_of(const Session& session) const;
  void record(Session& session);
  [[nodiscard]] std::unique_ptr<Evidence> evidence(const fit::Bench& bench, bool with_last) const;
  void explain_and_decide();
  [[nodiscard]] std::vector<Candidate> candidates(const std::vector<SessionPlan>& plans,
                                                  const std::vector<double>& information) const;
  [[nodiscard]] std::vector<Candidate> separating(const Evidence& evidence,
                                                  const fit::explain::Explanation& found) const;
  [[nodiscard]] std::string would_need(const fit::explain::Explanation& found) const;
  [[nodiscard]] double minutes_left() const;
  void plan(const Candidate& candidate, const std::string& why, const std::vector<Candidate>& considered);
  void predict();
  void compare();
  [[nodiscard]] nlohmann::json dossier() const;
  void write_dossier(const nlohmann::json& document);

  fit::Bench bench_;
  std::string bench_text_;
  StageLimits limits_;
  Options options_;
  Actions actions_;
  State state_;
  std::optional<fit::explain::Explanation> found_;  ///< Of all rounds, as long as none was recorded since.
};

}  // namespace rig::investigate
