// SPDX-License-Identifier: MIT
#include "rig/investigate/investigation.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iterator>
#include <set>

#include "fit/explain/experiment/forecast.hpp"
#include "fit/explain/experiment/next_experiment.hpp"
#include "fit/mechanism.hpp"
#include "rig/errors.hpp"
#include "rig/investigate/dossier_document.hpp"
#include "rig/investigate/one_clock.hpp"
#include "rig/investigate/prediction_file.hpp"
#include "rig/investigate/text_file.hpp"
#include "rig/output_place.hpp"
#include "rig/report/dossier_page.hpp"
#include "rig/report/explain_procedure.hpp"
#include "rig/report/pdf.hpp"
#include "rig/runner/runner.hpp"
#include "rig/session/session_file.hpp"
#include "rig/session/session_store.hpp"
#include "rig/session/sha256.hpp"
#include "rig/whole_file.hpp"

namespace rig::investigate {
namespace {

namespace fs = std::filesystem;
using fit::explain::Explanation;
using nlohmann::json;

constexpr const char* state_file = "investigation.json";
constexpr const char* prediction_file = "prediction.json";
constexpr const char* twin_file = "twin.bench.json";
constexpr int most_rounds = 10, most_refuted = 2;
constexpr double last_session_min = 8;  // kept back for the predicted session

std::string text_of(const json& document) {
  return document.dump(1, ' ', false, json::error_handler_t::replace) + "\n";
}

/// Whether an investigation gives one of its files that name.
bool is_own_file(const std::string& name) {
  for (const char* one :
       {state_file, prediction_file, twin_file, "bench.json", "dossier.json", "dossier.html", "dossier.pdf"})
    if (name == one) return true;
  const auto dash = name.find('-'), dot = name.find('.');
  if (dash == std::string::npos || dot == std::string::npos || dot <= dash + 1) return false;
  const std::string kind = name.substr(0, dash), ending = name.substr(dot);
  return (kind == "round" || kind == "last") && (ending == ".yaml" || ending == ".explanation.json") &&
         name.find_first_not_of("0123456789", dash + 1) == dot;
}

/// Removes what a killed program left half-written. Whatever else lies in the folder is not ours.
void remove_parts(const std::string& folder) {
  std::error_code ignored;
  std::vector<fs::path> parts;
  for (const auto& each : fs::directory_iterator(folder, ignored)) {
    const std::string name = each.path().filename().string();
    const std::string page = ".html";  // What a PDF was being printed from (rig/report/pdf.cpp).
    if (is_own_file(whole_of_part(name)) ||
        (name.ends_with(page) && is_own_file(whole_of_part(name.substr(0, name.size() - page.size())))))
      parts.push_back(each.path());
  }
  for (const fs::path& part : parts) fs::remove(part, ignored);
}

std::string in_words(const Cost& cost) {
  return fit::rounded(cost.total(), 2) + " min" +
         (cost.hand > 0 ? ", of which an operator's " + fit::rounded(cost.hand, 2) : "");
}

Conclusions conclusions_of(const Explanation& found) {
  Conclusions conclusions;
  using Verdict = Conclusions::Verdict;
  conclusions.verdict = found.verdict == fit::explain::nothing_missing   ? Verdict::nothing_missing
                        : found.verdict == fit::explain::unknown_physics ? Verdict::unknown_physics
                        : found.verdict == "explained"                   ? Verdict::explained
                                                                         : Verdict::undecided;
  for (const auto& mechanism : found.mechanisms)
    conclusions.least_probability = std::min(conclusions.least_probability, mechanism.probability);
  return conclusions;
}

/// Whether two explanations name the same, or both nothing but physics outside the catalogue.
bool same(const Explanation& one, const Explanation& other) {
  const auto names = [](const Explanation& e) {
    std::set<std::string> ids;
    for (const auto& found : e.mechanisms) ids.insert(found.mechanism->id);
    return ids;
  };
  return one.verdict == other.verdict && one.undecided_between.empty() && names(one) == names(other);
}

/// The bench file with targets and mount known ten times as well.
fit::Bench known_better(fit::Bench bench) {
  constexpr double times = 10;
  for (fit::Target& target : bench.targets) target.u_mm /= times, target.u_rad /= times;
  fit::Mount& mount = bench.lidar.mount;
  for (fit::Estimate* e : {&mount.x_mm, &mount.y_mm, &mount.yaw_rad}) e->u /= times;
  return bench;
}

}  // namespace

/// Sessions opened, on one clock.
struct Investigation::Evidence {
  std::vector<std::unique_ptr<SessionStore>> stores;
  std::vector<std::unique_ptr<fit::Recording>> recordings;

  [[nodiscard]] std::vector<const fit::Recording*> list() const {
    std::vector<const fit::Recording*> all;
    for (const auto& recording : recordings) all.push_back(recording.get());
    return all;
  }
  [[nodiscard]] std::vector<fit::CaptureInfo> captures() const {
    std::vector<fit::CaptureInfo> all;
    for (const auto& recording : recordings)
      all.insert(all.end(), recording->captures().begin(), recording->captures().end());
    return all;
  }
};

Investigation::Investigation(const fit::Bench& bench, Options options, Actions actions)
    : bench_(bench),
      bench_text_(fit::to_json_text(bench)),
      limits_(stage_limits(bench)),
      options_(std::move(options)),
      actions_(std::move(actions)) {
  const std::string state = file(state_file);
  if (has_data(state)) {
    if (!options_.resume)
      throw UsageError(options_.folder +
                       " holds an investigation already. Continue it with --resume, or name another folder.");
    state_ = state_of(text_of_file(state), state);
    if (state_.bench_sha256 != sha256_of(bench_text_))
      throw UsageError("the bench file differs from the one that the investigation in " + options_.folder +
                       " was begun with. Give that one, or begin a new investigation in another folder.");
    remove_parts(options_.folder);
    return;
  }
  std::error_code failed;
  fs::create_directories(options_.folder, failed);
  if (!fs::is_directory(options_.folder))
    throw UsageError("cannot make the folder " + options_.folder + " (" + failed.message() +
                     "). Name another one.");
  state_.bench_sha256 = sha256_of(bench_text_);
  state_.budget_min = options_.budget_min;
  state_.unattended = options_.unattended;
  state_.on_for_min = options_.on_for_min;
}

json Investigation::run() {
  if (state_.rounds.empty()) begin();
  while (true) {
    if (!state_.ending) {
      record(state_.rounds.back().session);
      explain_and_decide();
    } else if (!state_.last) {
      predict();
    } else if (!state_.last->recorded) {
      record(*state_.last);
    } else if (state_.comparison.is_null()) {
      compare();
    } else {
      break;
    }
    publish();
  }
  const json document = dossier();
  write_dossier(document);
  return document;
}

std::string Investigation::file(const std::string& name) const {
  return (fs::path(options_.folder) / name).string();
}

void Investigation::save() { write_file_atomically(file(state_file), text_of(to_json(state_))); }

void Investigation::publish() {
  if (actions_.show) actions_.show(dossier());
}

double Investigation::minutes_left() const {
  return state_.budget_min - state_.minutes_spent() - last_session_min;
}

void Investigation::begin() {
  Round first;
  first.session.name = "round-1";
  if (options_.procedure.empty()) {
    const SessionPlan plan = first_plan(bench_, limits_, !state_.unattended);
    write_file_atomically(file("round-1.yaml"), procedure_text("round-1", plan, bench_));
    first.session.title = plan.title;
    first.session.why = plan.about;
  } else {
    const Procedure given = read_procedure(find_procedure(options_.procedure));
    write_file_atomically(file("round-1.yaml"), given.text);
    first.session.title = given.title;
    first.session.why = "The procedure that was given.";
  }
  const Procedure procedure = procedure_of(first.session);
  const auto planned = unroll(procedure, bench_);
  first.session.cost = cost_of(planned, procedure.variables);
  first.session.needs_operator = needs_operator(planned);
  if (first.session.needs_operator && state_.unattended)
    throw UsageError(options_.procedure +
                     " needs an operator, and --unattended excludes one. Leave one out.");
  if (first.session.cost.total() > state_.budget_min)
    throw UsageError("the first session alone takes " + in_words(first.session.cost) +
                     ", more than the --budget-min of " + fit::rounded(state_.budget_min, 3) +
                     ". Allow more, give a shorter procedure" +
                     (first.session.cost.hand > 0 ? ", or leave the operator out (--unattended)." : "."));
  write_file_atomically(file("bench.json"), bench_text_ + "\n");
  state_.rounds.push_back(std::move(first));
  save();
}

Procedure Investigation::procedure_of(const Session& session) const {
  return read_procedure(file(session.name + ".yaml"));
}

void Investigation::record(Session& session) {
  if (session.recorded) return;
  const std::string path = file(session.name + ".rig");
  actions_.say(session.name + ": " + session.title + " (" + in_words(session.cost) + ")");
  publish();
  try {
    actions_.record(procedure_of(session), path, has_data(path));
  } catch (const RunStopped&) {
    throw;
  } catch (const DeviceError&) {
    throw;
  } catch (const std::exception& error) {
    // What was asked for could not be done here, or a limit of a procedure that was given is not met.
    if (!has_data(path) && state_.rounds.size() == 1 && !state_.last) throw;
    session.failed = error.what();
    actions_.say("note: " + session.name + " ended early: " + session.failed);
  }
  session.recorded = true;
  session.without_data = !has_data(path);
  if (session.without_data) session.cost = {};
  save();
}

std::unique_ptr<Investigation::Evidence> Investigation::evidence(const fit::Bench& bench,
                                                                 bool with_last) const {
  auto all = std::make_unique<Evidence>();
  std::vector<std::string> names;
  for (const Round& round : state_.rounds)
    if (round.session.recorded) names.push_back(round.session.name);
  if (with_last && state_.last) names.push_back(state_.last->name);
  for (const std::string& name : names)
    if (const std::string path = file(name + ".rig"); has_data(path))
      all->stores.push_back(std::make_unique<SessionStore>(path, SessionStore::Mode::read));
  const auto on_for_s = state_.on_for_min ? std::optional(60 * *state_.on_for_min) : std::nullopt;
  all->recordings = on_one_clock(all->stores, bench, on_for_s);
  return all;
}

void Investigation::explain_and_decide() {
  const auto all = evidence(bench_, false);
  Round& round = state_.rounds.back();
  const bool something_new = has_data(file(round.session.name + ".rig"));
  if (!found_ || something_new) found_ = actions_.explain(all->list());
  const json explanation = fit::explain::to_json(*found_);
  write_file_atomically(file(round.session.name + ".explanation.json"), text_of(explanation));
  write_file_atomically(file(twin_file), text_of(explanation.at("bench")));
  round.explanation = without_pictures(explanation);
  actions_.say(round.session.name + ": " + conclusions_in_words(round.explanation));
  const std::vector<Candidate> experiments = separating(*all, *found_);
  const std::vector<SessionPlan> unasked = surveys(bench_, limits_, all->captures());
  const std::vector<Candidate> survey = candidates(unasked, std::vector<double>(unasked.size(), 0));
  const auto possible = [](const std::vector<Candidate>& list) {
    std::vector<Possible> out;
    for (const Candidate& c : list) out.push_back(c.possible);
    return out;
  };
  const Means means{minutes_left(), state_.unattended, most_rounds - static_cast<int>(state_.rounds.size())};
  const Decision decision = decide(conclusions_of(*found_), possible(experiments), possible(survey), means);
  if (decision.next) {
    const auto& from = decision.next->from == Decision::From::experiments ? experiments : survey;
    plan(from[decision.next->index], decision.why, from);
    return;
  }
  std::string needs = decision.needs;
  if (needs.empty() && decision.end == End::undecidable) needs = would_need(*found_);
  state_.ending = {decision.end, decision.why, needs, {}};
  for (const Candidate& c : survey)
    if (!c.possible.done) state_.ending->not_examined.push_back(c.possible.title);
  actions_.say(std::string("end: ") + name_of(decision.end) + ". " + decision.why +
               (needs.empty() ? "" : " It would need " + needs + "."));
  save();
}

std::vector<Investigation::Candidate> Investigation::candidates(
    const std::vector<SessionPlan>& plans, const std::vector<double>& information) const {
  std::vector<Candidate> list;
  for (std::size_t i = 0; i < plans.size(); ++i) {
    try {
      const Procedure procedure =
          parse_procedure(procedure_text("candidate", plans[i], bench_), plans[i].title);
      const auto planned = unroll(procedure, bench_);
      Candidate c{plans[i],
                  {plans[i].title, information[i], 0, needs_operator(planned), false},
                  cost_of(planned, procedure.variables)};
      c.possible.minutes = c.cost.total();
      c.possible.done = std::ranges::any_of(
          state_.rounds, [&](const Round& round) { return round.session.title == plans[i].title; });
      list.push_back(std::move(c));
    } catch (
        const ProcedureError&) {  // The bench forbids it: soft limits, beams that the lidar does not have.
    }
  }
  return list;
}

std::vector<Investigation::Candidate> Investigation::separating(const Evidence& all,
                                                                const Explanation& found) const {
  std::vector<SessionPlan> plans;
  std::vector<double> information;
  for (const fit::explain::Experiment& e :
       fit::explain::telling_experiments(all.list(), found, travel_of(limits_))) {
    const bool many = e.scans > 100 || (e.scans == 100 && !e.by_hand);  // ten times as many as at first
    plans.push_back({e.title + (many ? ", with many scans" : ""), promise_of(e), {e}, ""});
    information.push_back(e.information);
  }
  return candidates(plans, information);
}

std::string Investigation::would_need(const Explanation& found) const {
  const auto all = evidence(known_better(bench_), false);
  const auto list = fit::explain::telling_experiments(all->list(), found, travel_of(limits_));
  const auto best = std::ranges::max_element(list, {}, &fit::explain::Experiment::information);
  if (best == list.end()) return what_separates(found);
  return "with mount and targets measured ten times better than the bench file states: " + best->title;
}

void Investigation::plan(const Candidate& candidate, const std::string& why,
                         const std::vector<Candidate>& considered) {
  Round next;
  next.session.name = "round-" + std::to_string(state_.rounds.size() + 1);
  next.session.title = candidate.plan.title;
  next.session.why = why + " " + candidate.plan.about;
  next.session.cost = candidate.cost;
  next.session.needs_operator = candidate.possible.needs_operator;
  for (const Candidate& c : considered) next.considered.push_back(c.possible);
  write_file_atomically(file(next.session.name + ".yaml"),
                        procedure_text(next.session.name, candidate.plan, bench_));
  actions_.say("next: " + next.session.title + ". " + next.session.why);
  state_.rounds.push_back(std::move(next));
  save();
}

void Investigation::predict() {
  const auto all = evidence(bench_, false);
  if (!found_) found_ = actions_.explain(all->list());
  const std::vector<fit::CaptureInfo> so_far = all->captures();
  Session last;
  last.name = "last-" + std::to_string(state_.refuted + 1);
  SessionPlan plan;
  for (const bool with_hand : {true, false}) {
    if (with_hand && state_.unattended) continue;
    plan = fresh_plan(bench_, limits_, with_hand, so_far);
    const Procedure procedure = parse_procedure(procedure_text(last.name, plan, bench_), last.name);
    const auto planned = unroll(procedure, bench_);
    last.cost = cost_of(planned, procedure.variables);
    last.needs_operator = needs_operator(planned);
    if (!with_hand || last.cost.total() <= minutes_left() + last_session_min) break;
  }
  last.title = plan.title;
  last.why = plan.about;
  const std::vector<fit::CaptureInfo> planned = after(so_far, plan.captures());
  const fit::explain::Forecast forecast = fit::explain::forecast(found_->bench, planned, all->list());
  const std::string text = text_of(prediction_document(*found_, planned, forecast, last.title));
  write_file_atomically(file(last.name + ".yaml"), procedure_text(last.name, plan, bench_));
  write_file_atomically(file(prediction_file), text);
  state_.prediction_sha256 = sha256_of(text);
  actions_.say("prediction of " + last.name + " written before it is recorded: " + file(prediction_file) +
               ", SHA-256 " + state_.prediction_sha256);
  state_.last = std::move(last);
  save();
}

void Investigation::compare() {
  const std::string text = text_of_file(file(prediction_file));
  if (sha256_of(text) != state_.prediction_sha256)
    throw UsageError(
        file(prediction_file) +
        " was changed after the session that it predicts was recorded: nothing can be concluded from "
        "it. Restore it, or begin a new investigation.");
  const auto before = evidence(bench_, false);
  if (!found_) found_ = actions_.explain(before->list());
  const auto all = evidence(bench_, true);
  Outcome outcome;
  json comparison = {{"session", state_.last->name}};
  try {
    if (!has_data(file(state_.last->name + ".rig")))
      throw std::invalid_argument("it was not recorded: " + state_.last->failed);
    const WrittenPrediction written = read_prediction(text, file(prediction_file));
    const auto score = fit::explain::score(written.forecast, written.twin, *all->recordings.back());
    const auto prediction = fit::explain::predict_recording(found_->predictor, *all->recordings.back());
    outcome = {score.samples,
               score.coverage_95,
               score.coverage_95_of_means,
               score.rms_of_means_mm,
               score.expected_rms_of_means_mm,
               prediction.gain,
               prediction.u_gain,
               false};
    // A set of suspects names none of them: which one the twin has says nothing.
    const bool claims = !found_->mechanisms.empty() || (found_->unknown && !found_->unknown_is_bench_error);
    if (claims && !gains(outcome))
      outcome.named_again = same(*found_, actions_.explain({all->recordings.back().get()}));
    const Confirmation judged = judge(outcome, claims);
    comparison.update(comparison_document(score, prediction, judged));
  } catch (const std::invalid_argument& error) {
    comparison["confirmed"] = false;
    comparison["reasons"] = {std::string("It could not be compared: ") + error.what()};
  }
  std::string summary =
      comparison["confirmed"] == true ? "The prediction was confirmed." : "The prediction was not confirmed.";
  for (const json& reason : comparison["reasons"]) summary += " " + reason.get<std::string>();
  actions_.say(summary);
  const bool again = comparison["confirmed"] == false && state_.refuted < most_refuted &&
                     has_data(file(state_.last->name + ".rig")) && minutes_left() > last_session_min &&
                     static_cast<int>(state_.rounds.size()) < most_rounds;
  if (again) {
    // It showed something new: it counts among what is to be explained.
    Round joined;
    joined.session = *state_.last;
    joined.session.why =
        "What it showed differs from the prediction: it is explained together with all others.";
    joined.comparison = std::move(comparison);
    state_.rounds.push_back(std::move(joined));
    state_.last.reset();
    state_.ending.reset();
    state_.prediction_sha256.clear();
    found_.reset();
    ++state_.refuted;
  } else {
    state_.comparison = std::move(comparison);
  }
  save();
}

json Investigation::dossier() const { return dossier_document(state_, bench_); }

void Investigation::write_dossier(const json& document) {
  write_file_atomically(file("dossier.json"), text_of(document));
  const std::string page = dossier_page(document);
  write_file_atomically(file("dossier.html"), page);
  try {
    write_pdf(page, file("dossier.pdf"));
  } catch (const std::exception& error) {
    actions_.say(std::string("note: no dossier.pdf (") + error.what() + ")");
  }
}

}  // namespace rig::investigate
