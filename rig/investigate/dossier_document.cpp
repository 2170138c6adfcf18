// SPDX-License-Identifier: MIT
#include "rig/investigate/dossier_document.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "fit/explain/explanation.hpp"
#include "fit/mechanism.hpp"
#include "rig/json_fields.hpp"

namespace rig::investigate {
namespace {

using nlohmann::json;

std::string in_words(const std::string& id) {
  return id == fit::explain::unknown_physics ? "something outside the catalogue" : id;
}

/// Every answer with its probability. Members of a set are equally probable: the sessions do not tell them
/// apart.
json suspects_of(const json& explanation) {
  json list = json::array();
  for (const json& found : explanation.at("mechanisms"))
    list.push_back(
        {{"name", found.at("mechanism")}, {"probability", found.at("probability")}, {"set", false}});
  for (const json& set : explanation.at("undecided_between"))
    for (const json& member : set)
      list.push_back({{"name", in_words(member.get<std::string>())},
                      {"probability", 1.0 / static_cast<double>(set.size())},
                      {"set", true}});
  if (explanation.contains("unknown"))
    list.push_back({{"name", is_bench_error(explanation) ? "another scene than the bench file's"
                                                         : in_words(fit::explain::unknown_physics)},
                    {"probability", 1.0},
                    {"set", false}});
  if (explanation.at("verdict") == fit::explain::nothing_missing)
    list.push_back({{"name", "nothing missing"}, {"probability", 1.0}, {"set", false}});
  return list;
}

json session_json(const Session& s) {
  return {{"name", s.name},
          {"title", s.title},
          {"why", s.why},
          {"stage_and_scans_min", s.cost.stage_and_scans},
          {"hand_min", s.cost.hand},
          {"needs_operator", s.needs_operator},
          {"recorded", s.recorded},
          {"without_data", s.without_data},
          {"failed", s.failed}};
}

/// The newest explanation; null before the first.
json newest(const State& state) {
  for (auto round = state.rounds.rbegin(); round != state.rounds.rend(); ++round)
    if (!round->explanation.is_null()) return round->explanation;
  return nullptr;
}

bool is_confirmed(const State& state) {
  return state.comparison.is_object() && state.comparison.value("confirmed", false);
}

/// Predictions that failed before one came true belong to what that one is worth: every further try is
/// another chance to be confirmed by luck.
std::string tries_in_words(const State& state) {
  if (state.refuted == 0) return "";
  return state.refuted == 1 ? " This was the second prediction; the first did not come true."
                            : " This was the third prediction; the two before did not come true.";
}

/// What the recording of the predicted session allows to say.
std::string claim_of(const State& state, const json& explanation) {
  if (!state.ending) return "The investigation is in progress.";
  if (state.comparison.is_null())
    return "Nothing is claimed before a new recording has been predicted and compared.";
  if (!is_confirmed(state))
    return "Nothing is claimed: the prediction that was written down was not confirmed. What follows is "
           "what the sessions suggest.";
  switch (state.ending->end) {
    case End::named: {
      std::vector<std::string> names;
      for (const json& found : explanation.at("mechanisms")) names.push_back(found.at("mechanism"));
      return "The physics that the bench file leaves out is " + fit::explain::listed(names) +
             ". A new recording was predicted with it, and confirms it." + tries_in_words(state);
    }
    case End::nothing_missing:
      return "Nothing is missing: a new recording is as the bench file predicts, to within its noise." +
             tries_in_words(state);
    case End::unknown_physics:
      if (is_bench_error(explanation))
        return "The bench file and the recordings do not agree: " +
               explanation["unknown"].value("describes", std::string()) + ".";
      return "Physics is missing that no mechanism of the catalogue produces. Described as a table, it "
             "predicted a new recording." +
             tries_in_words(state);
    case End::undecidable:
    case End::budget_spent:
      return std::string(may_be_nothing(explanation)
                             ? "The sessions do not determine whether physics is missing, nor which. "
                             : "Physics is missing, and the sessions do not determine which of several "
                               "causes it is. ") +
             "Only the best fitting answer was tried on a new recording, which it predicted; others may "
             "predict it too." +
             tries_in_words(state);
  }
  return "";
}

/// What remains open.
json open_of(const State& state, const json& explanation) {
  json list = json::array();
  if (explanation.is_object())
    for (const json& set : explanation.at("undecided_between")) {
      std::vector<std::string> names;
      for (const json& member : set) names.push_back(in_words(member.get<std::string>()));
      list.push_back("Which of these it is: " + fit::explain::listed(names, "or") + ".");
    }
  if (state.ending && !state.ending->needs.empty())
    list.push_back("To decide it would need " + state.ending->needs + ".");
  if (state.ending)
    for (const std::string& title : state.ending->not_examined)
      list.push_back("What this would show, which was not examined: " + title + ".");
  if (state.comparison.is_object() && !is_confirmed(state))
    list.push_back("Why the predicted recording came out differently.");
  for (const Round& round : state.rounds)
    if (!round.session.failed.empty())
      list.push_back("The session " + round.session.name +
                     (round.session.without_data ? " measured nothing: " : " ended early: ") +
                     round.session.failed);
  return list;
}

}  // namespace

json without_pictures(const json& explanation) {
  json kept = explanation;
  for (const char* key : {"curves", "spread_curves", "bench", "empirical_correction", "prediction"})
    kept.erase(key);
  kept["suspects"] = suspects_of(explanation);
  return kept;
}

std::string conclusions_in_words(const json& explanation) {
  std::vector<std::string> words;
  for (const json& s : explanation.at("suspects"))
    words.push_back(s.at("name").get<std::string>() + " " +
                    fit::rounded(100 * s.at("probability").get<double>(), 3) + " %");
  return words.empty() ? explanation.at("verdict").get<std::string>() : fit::explain::listed(words);
}

json dossier_document(const State& state, const fit::Bench& bench) {
  const json explanation = newest(state);
  json rounds = json::array();
  for (const Round& round : state.rounds) {
    json considered = json::array();
    for (const Possible& p : round.considered)
      considered.push_back({{"title", p.title},
                            {"information", p.information},
                            {"minutes", p.minutes},
                            {"needs_operator", p.needs_operator},
                            {"done", p.done}});
    rounds.push_back({{"session", session_json(round.session)},
                      {"considered", considered},
                      {"explanation", round.explanation},
                      {"comparison", round.comparison}});
  }
  json out = {{"schema", "dossier/2"},
              {"software", std::string("rig ") + RIG_VERSION},
              {"lidar", bench.lidar.model + (bench.lidar.serial.empty() ? "" : " " + bench.lidar.serial)},
              {"bench_sha256", state.bench_sha256},
              {"unattended", state.unattended},
              {"budget_min", state.budget_min},
              {"minutes", state.minutes_spent()},
              {"hand_minutes", state.hand_minutes()},
              {"rounds", rounds},
              {"claim", claim_of(state, explanation)},
              {"confirmed", is_confirmed(state)},
              {"found", explanation},
              {"open", open_of(state, explanation)},
              {"twin", "twin.bench.json"}};
  if (state.ending)
    out["end"] = {
        {"end", name_of(state.ending->end)}, {"why", state.ending->why}, {"needs", state.ending->needs}};
  if (state.last)
    out["last"] = {{"session", session_json(*state.last)},
                   {"prediction", "prediction.json"},
                   {"sha256", state.prediction_sha256},
                   {"comparison", state.comparison}};
  return out;
}

json for_live_page(const json& dossier) {
  json rounds = json::array();
  for (const json& round : dossier.at("rounds")) {
    const json& session = round.at("session");
    rounds.push_back(
        {{"title", session.at("title")},
         {"why", session.at("why")},
         {"minutes", session.at("stage_and_scans_min").get<double>() + session.at("hand_min").get<double>()},
         {"recorded", session.at("recorded")},
         {"suspects",
          round.at("explanation").is_object() ? round["explanation"].at("suspects") : json::array()}});
  }
  json out = {{"rounds", rounds},
              {"claim", dossier.at("claim")},
              {"minutes", dossier.at("minutes")},
              {"budget_min", dossier.at("budget_min")}};
  if (dossier.contains("last"))
    out["prediction"] = {{"sha256", dossier["last"].at("sha256")},
                         {"confirmed", dossier["last"].at("comparison").is_object()
                                           ? dossier["last"]["comparison"].at("confirmed")
                                           : json(nullptr)}};
  return out;
}

}  // namespace rig::investigate
