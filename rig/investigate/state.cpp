// SPDX-License-Identifier: MIT
#include "rig/investigate/state.hpp"

#include "rig/errors.hpp"

namespace rig::investigate {
namespace {

using nlohmann::json;

constexpr const char* schema = "investigation/2";

json json_of(const Session& s) {
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

Session session_in(const json& j) {
  Session s;
  s.name = j.at("name");
  s.title = j.at("title");
  s.why = j.at("why");
  s.cost = {j.at("stage_and_scans_min"), j.at("hand_min")};
  s.needs_operator = j.at("needs_operator");
  s.recorded = j.at("recorded");
  s.without_data = j.value("without_data", false);
  s.failed = j.at("failed");
  return s;
}

json json_of(const Possible& p) {
  return {{"title", p.title},
          {"information", p.information},
          {"minutes", p.minutes},
          {"needs_operator", p.needs_operator},
          {"done", p.done}};
}

Possible possible_in(const json& j) {
  Possible p;
  p.title = j.at("title");
  p.information = j.at("information");
  p.minutes = j.at("minutes");
  p.needs_operator = j.at("needs_operator");
  p.done = j.at("done");
  return p;
}

}  // namespace

double State::minutes_spent() const {
  double sum = last ? last->cost.total() : 0;
  for (const Round& round : rounds) sum += round.session.cost.total();
  return sum;
}

double State::hand_minutes() const {
  double sum = last ? last->cost.hand : 0;
  for (const Round& round : rounds) sum += round.session.cost.hand;
  return sum;
}

json to_json(const State& s) {
  json rounds = json::array();
  for (const Round& round : s.rounds) {
    json considered = json::array();
    for (const Possible& p : round.considered) considered.push_back(json_of(p));
    rounds.push_back({{"session", json_of(round.session)},
                      {"considered", considered},
                      {"explanation", round.explanation},
                      {"comparison", round.comparison}});
  }
  json out = {{"schema", schema},           {"bench_sha256", s.bench_sha256},
              {"budget_min", s.budget_min}, {"unattended", s.unattended},
              {"rounds", rounds},           {"prediction_sha256", s.prediction_sha256},
              {"comparison", s.comparison}, {"refuted", s.refuted}};
  if (s.on_for_min) out["on_for_min"] = *s.on_for_min;
  if (s.ending)
    out["ending"] = {{"end", name_of(s.ending->end)},
                     {"why", s.ending->why},
                     {"needs", s.ending->needs},
                     {"not_examined", s.ending->not_examined}};
  if (s.last) out["last"] = json_of(*s.last);
  return out;
}

State state_of(const std::string& text, const std::string& file) {
  try {
    const json j = json::parse(text);
    if (j.at("schema") != schema)
      throw UsageError(
          file + " is of the version " + j.at("schema").dump() + ", and this program knows " + schema +
          ". Continue with the program that began it, or begin a new investigation in another folder.");
    State s;
    s.bench_sha256 = j.at("bench_sha256");
    s.budget_min = j.at("budget_min");
    s.unattended = j.at("unattended");
    s.prediction_sha256 = j.at("prediction_sha256");
    s.comparison = j.at("comparison");
    s.refuted = j.at("refuted");
    if (j.contains("on_for_min")) s.on_for_min = j["on_for_min"].get<double>();
    for (const json& each : j.at("rounds")) {
      Round round;
      round.session = session_in(each.at("session"));
      for (const json& p : each.at("considered")) round.considered.push_back(possible_in(p));
      round.explanation = each.at("explanation");
      round.comparison = each.at("comparison");
      s.rounds.push_back(std::move(round));
    }
    if (j.contains("ending"))
      s.ending = {end_named(j["ending"].at("end")), j["ending"].at("why"), j["ending"].at("needs"),
                  j["ending"].at("not_examined").get<std::vector<std::string>>()};
    if (j.contains("last")) s.last = session_in(j["last"]);
    return s;
  } catch (const json::exception& error) {
    throw UsageError(file + " is not the state of an investigation (" + error.what() +
                     "). Begin a new one in another folder.");
  } catch (const std::invalid_argument& error) {
    throw UsageError(file + ": " + error.what() + ". Begin a new investigation in another folder.");
  }
}

}  // namespace rig::investigate
