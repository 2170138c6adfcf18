// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>

#include "rig/procedure/procedure_plan.hpp"
#include "rig/session/session_store.hpp"

namespace rig {

/// What is done of a procedure, part by part, as the session holds it: steps by their key, captures by
/// "STEP/...". What is recorded is never measured again.
class RunProgress {
 public:
  explicit RunProgress(SessionStore& session);

  [[nodiscard]] bool has(const std::string& part) const { return parts_.contains(part); }
  /// What was recorded of it; null if nothing was.
  [[nodiscard]] nlohmann::json of(const std::string& part) const;
  void record(const std::string& part, const nlohmann::json& what);
  /// The transaction in which it was recorded came to nothing.
  void withdraw(const std::string& part) { parts_.erase(part); }
  /// Forgets these steps in the session too; their captures stay there under another name.
  void forget(std::span<const PlannedStep> steps);
  /// The captures of an unfinished step that are whole.
  [[nodiscard]] long captures_begun(const PlannedStep& step) const;

 private:
  SessionStore& session_;
  std::map<std::string, std::string> parts_;
};

}  // namespace rig
