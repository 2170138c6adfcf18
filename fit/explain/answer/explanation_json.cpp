// SPDX-License-Identifier: MIT
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "fit/explain/explanation.hpp"

namespace fit::explain {

using nlohmann::json;

namespace {

json number(double v) { return std::isfinite(v) ? json(v) : json(nullptr); }

json found_json(const Found& found, const Explanation& e) {
  json parameters = json::object();
  for (const auto& [name, estimate] : found.parameters)
    parameters[name] = {{"value", number(estimate.value)}, {"u", number(estimate.u)}};
  if (!found.target.empty()) parameters["target"] = found.target;
  json held_out{{"log_likelihood_gain", number(found.log_likelihood_gain)},
                {"rms_before_mm", number((found.gain_is_expected ? e.after : e.before).rms_mm)},
                {"rms_after_mm", number(e.after.rms_mm)}};
  if (found.gain_is_expected) held_out["log_likelihood_gain_is"] = "expected";
  return {{"mechanism", found.mechanism->id}, {"probability", found.probability},
          {"parameters", parameters},         {"says", found.says},
          {"evidence", found.evidence},       {"held_out", held_out}};
}

json figures_json(const PredictedFigures& f) {
  return {{"rms_mm", number(f.rms_mm)},
          {"rms_of_means_mm", number(f.rms_of_means_mm)},
          {"log_likelihood", number(f.log_likelihood)},
          {"coverage_95", number(f.coverage_95)}};
}

json prediction_json(const Prediction& p) {
  json cells = json::object();
  for (const PredictedCell& c : p.shown) {
    cells["beam_deg"].push_back(c.beam_deg);
    cells["incidence_deg"].push_back(c.incidence_deg);
    cells["range_mm"].push_back(c.range_mm);
    cells["mean_before_mm"].push_back(c.mean_mm);
    cells["mean_after_mm"].push_back(c.mean_after_mm);
    cells["sd_mm"].push_back(c.sd_mm);
    cells["sd_before_mm"].push_back(c.sd_before_mm);
    cells["sd_after_mm"].push_back(c.sd_after_mm);
  }
  return {{"session", p.session},
          {"samples", p.samples},
          {"before", figures_json(p.before)},
          {"after", figures_json(p.after)},
          {"log_likelihood_gain", {{"value", number(p.gain)}, {"u", number(p.u_gain)}}},
          {"notes", p.notes},
          {"cells", cells}};
}

}  // namespace

json to_json(const Explanation& e) {
  json located = json::array(), mechanisms = json::array(), curves = json::array();
  for (const Located& l : e.located)
    located.push_back({{"coordinate", name_of(l.coordinate)},
                       {"from", number(l.from)},
                       {"to", number(l.to)},
                       {"observable", name_of(l.observable)},
                       {"p_value", number(l.p_value)}});
  for (const Found& found : e.mechanisms) mechanisms.push_back(found_json(found, e));
  for (const Curve& c : e.curves) {
    curves.push_back({{"coordinate", name_of(c.coordinate)},
                      {"at", c.at},
                      {"before_mm", c.before_mm},
                      {"after_mm", c.after_mm},
                      {"u_mm", c.sigma_mm}});
    if (!c.target.empty()) curves.back()["target"] = c.target;
  }
  const double cells = std::max(1.0, e.after.cells);
  json out{{"schema", "explanation/1"},
           {"verdict", e.verdict},
           {"located", located},
           {"mechanisms", mechanisms},
           {"undecided_between", e.undecided_between},
           {"next_experiment", nullptr},
           {"fit",
            {{"rms_before_mm", number(e.before.rms_mm)},
             {"rms_after_mm", number(e.after.rms_mm)},
             {"noise_floor_mm", number(e.noise_floor_mm)},
             {"held_out_log_likelihood_before", number(e.before.log_likelihood / cells)},
             {"held_out_log_likelihood_after", number(e.after.log_likelihood / cells)},
             {"held_out_log_likelihood_gain", number(e.after.log_likelihood - e.before.log_likelihood)},
             {"coverage_95_before", number(e.before.coverage)},
             {"coverage_95_after", number(e.after.coverage)}}},
           {"cells", e.cells},
           {"samples", e.samples},
           {"cells_left_out", e.left_out},
           {"notes", e.notes},
           {"curves", curves},
           {"bench", json::parse(to_json_text(e.bench))}};
  for (const SpreadCurve& c : e.spread_curves)
    out["spread_curves"].push_back({{"shows", c.shows},
                                    {"unit", c.unit},
                                    {"along", c.along},
                                    {"observable", name_of(c.observable)},
                                    {"coordinate", name_of(c.coordinate)},
                                    {"at", c.at},
                                    {"recorded", c.recorded},
                                    {"u", c.sigma},
                                    {"before", c.before},
                                    {"after", c.after}});
  if (e.unknown)
    out["unknown"] = {{"coordinate", name_of(e.unknown->coordinate)},
                      {"observable", name_of(e.unknown->observable)},
                      {"describes", e.unknown->describes},
                      {"from", number(e.unknown->from)},
                      {"to", number(e.unknown->to)}};
  if (e.unknown_is_bench_error) out["unknown"]["bench_error"] = true;
  for (const EmpiricalFunction& f : e.correction) out["empirical_correction"].push_back(as_entry(f));
  for (const Prediction& p : e.predictions) out["prediction"].push_back(prediction_json(p));
  return out;
}

std::string what_separates(const Explanation& explanation) {
  std::set<std::string> ids;
  for (const auto& set : explanation.undecided_between) ids.insert(set.begin(), set.end());
  std::string text;
  for (const std::string& id : ids)
    if (const Mechanism* m = find_mechanism(id); m && !m->separate.empty())
      text += (text.empty() ? "" : "; ") + ("to " + m->separate) + " (" + id + ")";
  return text;
}

std::string listed(const std::vector<std::string>& names, const std::string& last) {
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i)
    text += (i == 0 ? "" : i + 1 < names.size() ? ", " : " " + last + " ") + names[i];
  return text;
}

std::vector<std::string> suspects_in_words(std::vector<std::string> ids) {
  for (std::string& id : ids)
    if (id == unknown_physics)
      id = "something that no mechanism of the catalogue makes";
    else if (id == nothing_missing)
      id = "nothing missing";
  return ids;
}

std::string to_text(const Explanation& e) {
  std::string text;
  if (e.verdict == nothing_missing)
    text += "Nothing is missing: the simulation explains this recording to its noise.\n";
  for (const Found& found : e.mechanisms)
    text += found.mechanism->id + " (probability " + rounded(found.probability, 3) + "): " + found.says +
            "\n    " + found.evidence + "\n";
  for (const auto& set : e.undecided_between)
    text +=
        "Undecided between " + listed(suspects_in_words(set)) + ": the recording does not tell them apart.\n";
  if (e.unknown)
    text += (e.unknown_is_bench_error ? "Bench file and recording do not agree: " : "Unknown physics: ") +
            e.unknown->describes + ".\n";
  text += "Held-out means: rms " + rounded(e.before.rms_mm, 3) + " mm before, " + rounded(e.after.rms_mm, 3) +
          " mm after, noise floor " + rounded(e.noise_floor_mm, 3) + " mm; 95 % intervals hold " +
          rounded(100 * e.before.coverage, 3) + " % before, " + rounded(100 * e.after.coverage, 3) +
          " % after.\n";
  if (const double gain = e.after.log_likelihood - e.before.log_likelihood;
      gain >= 1 && e.verdict != nothing_missing)
    text += "All that is named raises the log-likelihood of held-out data by " + rounded(gain, 3) + ".\n";
  for (const Prediction& p : e.predictions)
    text += "Predicted, not fitted: " + p.session + ": samples rms " + rounded(p.before.rms_mm, 3) +
            " mm before, " + rounded(p.after.rms_mm, 3) + " mm after; means rms " +
            rounded(p.before.rms_of_means_mm, 3) + " mm before, " + rounded(p.after.rms_of_means_mm, 3) +
            " mm after; log-likelihood of a sample " + rounded(p.before.log_likelihood, 4) + " before, " +
            rounded(p.after.log_likelihood, 4) + " after; 95 % intervals hold " +
            rounded(100 * p.before.coverage_95, 3) + " % before, " + rounded(100 * p.after.coverage_95, 3) +
            " % after.\n";
  for (const Prediction& p : e.predictions)
    for (const std::string& note : p.notes) text += "Note on " + p.session + ": " + note + "\n";
  for (const std::string& note : e.notes) text += "Note: " + note + "\n";
  return text;
}

}  // namespace fit::explain
