// SPDX-License-Identifier: MIT
#include "rig/session/standing.hpp"

#include <algorithm>
#include <cctype>
#include <nlohmann/json.hpp>

#include "rig/json_fields.hpp"
#include "rig/session/lidar_identity.hpp"
#include "rig/session/session_dates.hpp"

namespace rig {
namespace {

using nlohmann::json;

json object_in(const std::optional<std::string>& text) {
  json value = json::parse(text.value_or("{}"), nullptr, false, true);
  return value.is_object() ? value : json::object();
}

/// What ISO/IEC 17025, 7.8.2.1 wants to know and only people can tell.
std::string not_stated(const SessionStore& session) {
  const json stated = object_in(session.get("bench")).value("certificate", json::object());
  std::string out;
  for (const auto& [key, words] : {std::pair{"laboratory", "laboratory"},
                                   {"address", "its address"},
                                   {"customer", "customer"},
                                   {"traceability", "traceability of the references"},
                                   {"authorised_by", "who authorises it"}})
    if (text_of(stated, key).empty()) out += (out.empty() ? "" : ", ") + std::string(words);
  return out;
}

/// Values that are not known.
void judge_values(const json& result, std::vector<std::string>& reasons) {
  for (const json& value : list_of(result, "values"))
    if (value.is_object() && value.contains("U") &&
        (value["U"].is_null() || !value.contains("value") || value["value"].is_null()))
      reasons.push_back("'" + text_of(value, "label", text_of(value, "name")) +
                        "' has no finite value or uncertainty.");
}

/// Dates of the certificate that the measurement contradicts.
void judge_dates(const SessionStore& session, std::vector<std::string>& reasons) {
  const std::string measured = date_in(dates_of(session).measured_utc);
  if (measured.empty()) return;
  const json stated = object_in(session.get("bench")).value("certificate", json::object());
  for (const json& item : list_of(stated, "equipment"))
    if (const std::string due = date_in(text_of(item, "due")); !due.empty() && due < measured)
      reasons.push_back("The calibration of '" + text_of(item, "name", "equipment") + "' was due on " + due +
                        ", before the measurement on " + measured + ".");
  if (const std::string received = date_in(text_of(stated, "received")); received > measured)
    reasons.push_back("The bench file states that the item was received on " + received +
                      ", after it was measured on " + measured + ".");
}

}  // namespace

std::vector<std::string> doubts_of(const json& result) {
  std::vector<std::string> reasons;
  for (const json& contradiction : list_of(result, "contradictions"))
    if (contradiction.is_string()) reasons.push_back(contradiction.get<std::string>());
  for (const json& comparison : list_of(result, "comparisons"))
    if (comparison.is_object() && comparison.contains("far_apart") && comparison["far_apart"] == true)
      reasons.push_back("Two methods do not agree. " + text_of(comparison, "says") + ".");
  return reasons;
}

bool says_simulated(const std::string& answers) {
  std::string lower = answers;
  std::ranges::transform(lower, lower.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return lower.find("simulat") != std::string::npos;
}

std::string unfinished(const SessionStore& session) {
  const std::string ended = session.get("ended").value_or("");
  if (ended == "done" || ended == ended_but_for_reports) return "";
  if (!ended.empty()) return ended;
  const auto steps = session.get("steps");
  if (!steps && !session.get("ended")) return "";  // No procedure made it.
  std::string words = "it was killed, or still runs";
  if (const json plan = json::parse(steps.value_or(""), nullptr, false); plan.is_array() && !plan.empty()) {
    const auto progress = session.progress();
    const auto done = std::ranges::count_if(
        plan, [&](const json& step) { return progress.contains(text_of(step, "key")); });
    words += "; " + std::to_string(done) + " of " + std::to_string(plan.size()) + " steps are done";
  }
  return words;
}

Standing standing_of(const SessionStore& session) {
  Standing out;
  out.simulated =
      says_simulated(session.get("lidar").value_or("")) || says_simulated(session.get("stage").value_or(""));
  if (out.simulated) out.reasons.emplace_back("The devices were simulated: no lidar was calibrated.");
  if (lidar_of(session).serial.empty())
    out.reasons.emplace_back("The lidar is not identified: the session has no serial number.");
  if (const std::string missing = not_stated(session); !missing.empty())
    out.reasons.push_back("The bench file does not state: " + missing + ".");
  if (session.get("correction"))
    out.reasons.emplace_back(
        "The ranges were corrected by rig apply: what is reported is what the correction leaves, not the "
        "lidar's error.");
  judge_dates(session, out.reasons);
  if (const std::string how = unfinished(session); !how.empty())
    out.reasons.push_back("The procedure ended before its last step: " + how);
  for (const SessionStore::Result& result : session.latest_results()) {
    const json document = object_in(result.json);
    if (result.kind == "explanation") {
      if (text_of(document, "verdict") == "unknown-physics")
        out.reasons.emplace_back(
            "The recording shows an effect that neither the values nor their uncertainties contain.");
    } else if (result.kind != "limits") {
      judge_values(document, out.reasons);
      std::ranges::move(doubts_of(document), std::back_inserter(out.reasons));
    }
  }
  return out;
}

}  // namespace rig
