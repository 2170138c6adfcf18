// SPDX-License-Identifier: MIT
#include "rig/investigate/dossier_document.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "fit/explain/explanation.hpp"
#include "fit/mechanism.hpp"

namespace rig::investigate {
namespace {

using nlohmann::json;

std::string in_words(const std::string& id) {
  return id == fit::explain::unknown_physics ? "something outside the catalogue" : id;
}

/// Every answer with its probability. Members of a set are equally probable: the sessions do not tell them apart.
json suspects_of(const json& explanation) {
  json list = json::array();
  for (const json& found : explanation.at("mechanisms"))
    list.push_back({{"name", found.at("mechanism")}, {"probability", found.at("probability")}, {"set", false}});
  for (const json& set : explanation.at("undecided_between"))
    for (const json& member : set)
      list.push_back({{"name", in_words(member.get<std::string>())},
                      {"probability", 1.0 / static_cast<double>(set.size())},
                      {"set", true}});
  if (explanation.contains("unknown"))
    list.push_back({{"name", in_words(fit::explain::unknown_physics)}, {"probability", 1.0}, {"set", false}});
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
          {"needs_hand", s.needs_hand},
          {"recorded", s.recorded},
          {"failed", s.failed}};
}

/// The newest explanation; null before the first.
json newest(const State& state) {
  for (auto round = state.rounds.rbegin(); round != state.rounds.rend(); ++round)
    if (!round->told.is_null()) return round->told;
  return nullptr;
}

bool is_confirmed(const State& state) {
  return state.comparison.is_object() && state.comparison.value("confirmed", false);
}

/// Predictions that failed before one came true belong to what that one is worth: every further try is another
/// chance to be confirmed by luck.
std::string tries_in_words(const State& state) {
  if (state.refuted == 0) return "";
  return state.refuted == 1 ? " This was the second prediction; the first did not come true."
                            : " This was the third prediction; the two before did not come true.";
}

/// What the recording of the foretold session allows to say.
std::string claim_of(const State& state, const json& told) {
  if (!state.ending) return "The investigation goes on.";
  if (state.comparison.is_null()) return "Nothing is claimed before a new recording was foretold and compared.";
  if (!is_confirmed(state))
    return "Nothing is claimed: the recording that was foretold did not come out as written down. What follows is "
           "what the sessions suggest.";
  switch (state.ending->end) {
    case End::named: {
      std::vector<std::string> names;
      for (const json& found : told.at("mechanisms")) names.push_back(found.at("mechanism"));
      return "The physics that the bench file leaves out is " + fit::explain::listed(names) +
             ". A new recording came out as it was foretold with it." + tries_in_words(state);
    }
    case End::nothing_missing:
      return "Nothing is missing: a new recording came out as the bench file foretells, to its noise." + tries_in_words(state);
    case End::unknown_physics:
      return "Physics is missing that no mechanism of the catalogue makes. Described as a table it foretold a new "
             "recording." + tries_in_words(state);
    case End::cannot_tell:
    case End::budget_spent:
      return "Physics is missing, and the sessions do not tell which of several causes it is. Only the one that "
             "fits best was tried on a new recording, which came out as foretold; so may others." + tries_in_words(state);
  }
  return "";
}

/// What remains open.
json open_of(const State& state, const json& told) {
  json list = json::array();
  if (told.is_object())
    for (const json& set : told.at("undecided_between")) {
      std::vector<std::string> names;
      for (const json& member : set) names.push_back(in_words(member.get<std::string>()));
      list.push_back("Which it is of " + fit::explain::listed(names, "or") + ".");
    }
  if (state.ending && !state.ending->needs.empty()) list.push_back("To decide it would need " + state.ending->needs + ".");
  if (state.ending)
    for (const std::string& title : state.ending->not_looked_along)
      list.push_back("What this would show, which nobody looked along: " + title + ".");
  if (state.comparison.is_object() && !is_confirmed(state))
    list.push_back("Why the foretold recording came out otherwise.");
  for (const Round& round : state.rounds)
    if (!round.session.failed.empty())
      list.push_back("The session " + round.session.name + " ended before its time: " + round.session.failed);
  return list;
}

}  // namespace

json without_pictures(const json& explanation) {
  json told = explanation;
  for (const char* key : {"curves", "spread_curves", "intensity_curves", "bench", "empirical_correction", "prediction"})
    told.erase(key);
  told["suspects"] = suspects_of(explanation);
  return told;
}

std::string conclusions_in_words(const json& told) {
  std::vector<std::string> words;
  for (const json& s : told.at("suspects"))
    words.push_back(s.at("name").get<std::string>() + " " + fit::rounded(100 * s.at("probability").get<double>(), 3) +
                    " %");
  return words.empty() ? told.at("verdict").get<std::string>() : fit::explain::listed(words);
}

json dossier_document(const State& state, const fit::Bench& bench) {
  const json told = newest(state);
  json rounds = json::array();
  for (const Round& round : state.rounds) {
    json considered = json::array();
    for (const Possible& p : round.considered)
      considered.push_back({{"title", p.title},
                            {"information", p.information},
                            {"minutes", p.minutes},
                            {"needs_hand", p.needs_hand},
                            {"done", p.done}});
    rounds.push_back({{"session", session_json(round.session)},
                      {"considered", considered},
                      {"told", round.told},
                      {"comparison", round.comparison}});
  }
  json out = {{"schema", "dossier/1"},
              {"software", std::string("rig ") + RIG_VERSION},
              {"lidar", bench.lidar.model + (bench.lidar.serial.empty() ? "" : " " + bench.lidar.serial)},
              {"bench_sha256", state.bench_sha256},
              {"unattended", state.unattended},
              {"budget_min", state.budget_min},
              {"minutes", state.minutes_spent()},
              {"hand_minutes", state.hand_minutes()},
              {"rounds", rounds},
              {"claim", claim_of(state, told)},
              {"confirmed", is_confirmed(state)},
              {"found", told},
              {"open", open_of(state, told)},
              {"twin", "twin.bench.json"}};
  if (state.ending)
    out["end"] = {{"end", name_of(state.ending->end)}, {"why", state.ending->why}, {"needs", state.ending->needs}};
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
    rounds.push_back({{"title", session.at("title")},
                      {"why", session.at("why")},
                      {"minutes", session.at("stage_and_scans_min").get<double>() + session.at("hand_min").get<double>()},
                      {"recorded", session.at("recorded")},
                      {"suspects", round.at("told").is_object() ? round["told"].at("suspects") : json::array()}});
  }
  json out = {{"rounds", rounds}, {"claim", dossier.at("claim")}, {"minutes", dossier.at("minutes")}, {"budget_min", dossier.at("budget_min")}};
  if (dossier.contains("last"))
    out["prediction"] = {{"sha256", dossier["last"].at("sha256")},
                         {"confirmed", dossier["last"].at("comparison").is_object() ? dossier["last"]["comparison"].at("confirmed") : json(nullptr)}};
  return out;
}

}  // namespace rig::investigate
