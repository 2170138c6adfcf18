// SPDX-License-Identifier: MIT
#include "rig/investigate/decision.hpp"

#include <array>
#include <cmath>
#include <functional>
#include <stdexcept>
#include <utility>

#include "fit/mechanism.hpp"

namespace rig::investigate {
namespace {

constexpr std::array<std::pair<End, const char*>, 5> ends = {{{End::named, "named"},
                                                              {End::nothing_missing, "nothing-missing"},
                                                              {End::unknown_physics, "unknown-physics"},
                                                              {End::undecidable, "cannot-tell"},
                                                              {End::budget_spent, "budget-spent"}}};

constexpr double least_information = 0.05;  // nats; less is not worth a session

bool can_be_done(const Possible& p, const Means& means) {
  return !p.done && !(p.needs_operator && means.unattended) && p.minutes <= means.minutes_left;
}

double rate(const Possible& p) { return p.information / std::max(p.minutes, 0.1); }

/// The best of those that pass, by `better(one, other)`.
std::optional<std::size_t> best_of(const std::vector<Possible>& list,
                                   const std::function<bool(const Possible&)>& passes,
                                   const std::function<bool(const Possible&, const Possible&)>& better) {
  std::optional<std::size_t> best;
  for (std::size_t i = 0; i < list.size(); ++i)
    if (passes(list[i]) && (!best || better(list[i], list[*best]))) best = i;
  return best;
}

std::string minutes_text(double minutes) { return fit::rounded(minutes, minutes < 10 ? 2 : 3) + " min"; }

Decision next(Decision::From from, std::size_t index, std::string why) {
  Decision d;
  d.next = {from, index};
  d.why = std::move(why);
  return d;
}

Decision ending(End end, std::string why) {
  Decision d;
  d.end = end;
  d.why = std::move(why);
  return d;
}

std::optional<Decision> survey(const std::vector<Possible>& surveys, const Means& means, const char* why) {
  const auto quickest = best_of(
      surveys, [&](const Possible& p) { return can_be_done(p, means); },
      [](const Possible& one, const Possible& other) { return one.minutes < other.minutes; });
  if (!quickest) return {};
  return next(Decision::From::surveys, *quickest, why);
}

std::optional<Decision> most_informative(const std::vector<Possible>& experiments, const Means& means) {
  const auto most = best_of(
      experiments,
      [&](const Possible& p) { return can_be_done(p, means) && p.information >= least_information; },
      [](const Possible& one, const Possible& other) { return rate(one) > rate(other); });
  if (!most) return {};
  const Possible& p = experiments[*most];
  return next(Decision::From::experiments, *most,
              "Of what this bench can do, it gives the most information per minute: " +
                  fit::rounded(p.information, 2) + " nats expected about which suspect is the cause, in " +
                  minutes_text(p.minutes) + ".");
}

/// Why what would tell more is not done.
Decision stopped(const std::vector<Possible>& experiments, const Means& means) {
  const auto most = best_of(
      experiments, [](const Possible& p) { return !p.done && p.information >= least_information; },
      [](const Possible& one, const Possible& other) { return rate(one) > rate(other); });
  if (!most)
    return ending(End::undecidable, "No experiment that this bench can do distinguishes the suspects.");
  const Possible& p = experiments[*most];
  const bool hand = p.needs_operator && means.unattended, time = p.minutes > means.minutes_left;
  Decision d =
      ending(hand ? End::undecidable : End::budget_spent,
             hand ? "What would distinguish the suspects needs an operator, and this run is unattended."
                  : "What would distinguish the suspects takes longer than the time that is left.");
  d.needs = (hand ? std::string("an operator") + (time ? ", and " : ", for ") : std::string()) +
            minutes_text(p.minutes) + ": " + p.title;
  return d;
}

}  // namespace

const char* name_of(End end) {
  for (const auto& [each, name] : ends)
    if (each == end) return name;
  return "";
}

End end_named(const std::string& name) {
  for (const auto& [end, word] : ends)
    if (name == word) return end;
  throw std::invalid_argument("no investigation ends with '" + name + "'");
}

Decision decide(const Conclusions& conclusions, const std::vector<Possible>& experiments,
                const std::vector<Possible>& surveys, const Means& means) {
  using Verdict = Conclusions::Verdict;
  const bool in_doubt = conclusions.verdict == Verdict::undecided ||
                        conclusions.verdict == Verdict::unknown_physics ||
                        (conclusions.verdict == Verdict::explained && conclusions.least_probability < sure);
  if (means.rounds_left <= 0) {
    if (in_doubt && conclusions.verdict != Verdict::unknown_physics)
      return ending(End::budget_spent, "The largest number of sessions of one investigation was recorded.");
  } else {
    if (in_doubt)
      if (auto most = most_informative(experiments, means)) return *most;
    const char* why = in_doubt ? "No experiment distinguishes the suspects; this has not been examined yet."
                               : "Nothing is in doubt; this has not been examined yet.";
    if (auto more = survey(surveys, means, why)) return *more;
  }
  switch (conclusions.verdict) {
    case Verdict::nothing_missing:
      return ending(End::nothing_missing, "The bench file explains everything that was examined.");
    case Verdict::unknown_physics:
      return ending(End::unknown_physics, "No mechanism of the catalogue produces what was found.");
    case Verdict::explained:
      if (!in_doubt) return ending(End::named, "What was found has a name, and nothing else stands out.");
      break;
    case Verdict::undecided:
      break;
  }
  return stopped(experiments, means);
}

bool gains(const Outcome& outcome) { return outcome.gain > 2 * outcome.u_gain; }

Confirmation judge(const Outcome& o, bool claims) {
  // Where intervals of 95 % may lie that were stated honestly: 92 to 98 %; means are few and have much in
  // common.
  constexpr double least = 0.92, most = 0.98, least_of_means = 0.85, worst_ratio = 1.5;
  Confirmation c;
  c.confirmed = true;
  const auto demand = [&](bool held, const std::string& sentence) {
    c.confirmed = c.confirmed && held;
    c.reasons.push_back((held ? "Fulfilled: " : "Not fulfilled: ") + sentence);
  };
  const auto percent = [](double share) { return fit::rounded(100 * share, 3) + " %"; };
  demand(o.coverage_95 >= least && o.coverage_95 <= most,
         percent(o.coverage_95) +
             " of the samples lie in their predicted 95 % intervals (92 to 98 % is required).");
  demand(o.coverage_95_of_means >= least_of_means,
         percent(o.coverage_95_of_means) + " of the beams' means lie in theirs (85 % is required).");
  demand(o.rms_of_means_mm <= worst_ratio * o.expected_rms_of_means_mm,
         "the means are off by " + fit::rounded(o.rms_of_means_mm, 3) + " mm (rms), " +
             fit::rounded(o.expected_rms_of_means_mm, 3) + " mm were predicted (1.5 times that is allowed).");
  if (claims && !gains(o) && o.named_again)
    demand(o.gain > -2 * o.u_gain - 1,
           "an explanation of this recording alone names the same. It is of a kind that neither means nor "
           "variances show.");
  else if (claims)
    demand(gains(o), "what was found makes the recording e^" + fit::rounded(o.gain, 3) +
                         " times as likely (± " + fit::rounded(2 * o.u_gain, 2) +
                         " in the exponent, k = 2).");
  else
    c.reasons.emplace_back("No cause was named, so nothing was found to test.");
  return c;
}

}  // namespace rig::investigate
