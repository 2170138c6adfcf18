// SPDX-License-Identifier: MIT
#include "rig/runner/run_progress.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

namespace rig {

RunProgress::RunProgress(SessionStore& session) : session_(session), parts_(session.progress()) {}

nlohmann::json RunProgress::of(const std::string& part) const {
  const auto found = parts_.find(part);
  if (found == parts_.end()) return nullptr;
  return nlohmann::json::parse(found->second, nullptr, false);
}

void RunProgress::record(const std::string& part, const nlohmann::json& what) {
  session_.set_progress(part, what.dump());
  parts_[part] = what.dump();
}

void RunProgress::forget(std::span<const PlannedStep> steps) {
  std::vector<std::string> forgotten;
  std::vector<std::int64_t> captures;
  for (const PlannedStep& step : steps)
    for (const auto& [part, text] : parts_)
      if (part == step.key || part.starts_with(step.key + "/")) {
        forgotten.push_back(part);
        const auto what = nlohmann::json::parse(text, nullptr, false);
        if (what.is_object() && what.contains("capture"))
          captures.push_back(what["capture"].get<std::int64_t>());
      }
  session_.forget_progress(forgotten, captures);
  for (const auto& part : forgotten) parts_.erase(part);
}

long RunProgress::captures_begun(const PlannedStep& step) const {
  const auto whole = std::ranges::count_if(parts_, [&](const auto& part) {
    return part.first.starts_with(step.key + "/") && !part.first.ends_with("/short") &&
           part.second.find("\"capture\"") != std::string::npos;
  });
  return std::min<long>(whole, step.captures);  // A search may have taken more than it was planned with.
}

}  // namespace rig
