// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>

#include "fit/explain/answer/chapters.hpp"

TEST_CASE("nothing missing, but held-out figures far beyond the noise: too few stops is said") {
  const fit::Bench bench;
  fit::explain::Reduced reduced;
  reduced.bench = bench;
  fit::explain::Findings findings{std::move(reduced), fit::explain::SpreadResult(),
                                  fit::explain::MeanResult(bench), std::nullopt};
  const auto notes = [&findings](double rms_mm, double coverage) {
    findings.means.noise_floor_mm = 0.6;
    findings.means.after.rms_mm = rms_mm, findings.means.after.coverage = coverage;
    fit::explain::Explanation out;
    fit::explain::answer::tell_doubts(findings, out);
    return out.notes;
  };
  REQUIRE(notes(11.2, 0).size() == 1);
  CHECK_THAT(notes(11.2, 0).front(), Catch::Contains("Record more stage angles"));
  CHECK(notes(0.57, 0.95).empty());
}

TEST_CASE(
    "beside noise that is not decided, or by a law that may be wrong, no other name of noise is certain") {
  using fit::explain::Suspect;
  const auto suspect = [](const char* id) {
    Suspect s;
    s.mechanism = fit::find_mechanism(id);
    for (const fit::Parameter& p : s.mechanism->parameters) s.parameters[p.name] = {1, 0.1};
    s.gain = 20, s.evidence = 15;
    return s;
  };
  const fit::Bench bench;
  fit::explain::Reduced reduced;
  reduced.bench = bench;
  fit::explain::Findings findings{std::move(reduced), fit::explain::SpreadResult(),
                                  fit::explain::MeanResult(bench), std::nullopt};
  findings.spread.accepted = {suspect("angle-jitter"), suspect("range-noise"), suspect("correlated-noise")};
  const auto told = [&findings] {
    fit::explain::Explanation out;
    fit::explain::answer::tell_spread(findings, out);
    std::map<std::string, double> probability;
    for (const auto& found : out.mechanisms) probability[found.mechanism->id] = found.probability;
    return probability;
  };
  const auto alone = told();
  CHECK(alone.at("angle-jitter") > 0.99);
  findings.spread.undecided = {{suspect("intensity-noise"), suspect("dropout")}};
  const auto beside = told();
  CHECK(beside.at("angle-jitter") < 0.9);
  CHECK(beside.at("range-noise") == alone.at("range-noise"));
  CHECK(beside.at("correlated-noise") == alone.at("correlated-noise"));
  // A law of noise may be wrong by more than a small one beside it explains.
  findings.spread.undecided.clear();
  findings.spread.accepted = {suspect("angle-jitter"), suspect("sunlight")};
  findings.spread.accepted.front().gain = 300;
  CHECK(told().at("sunlight") > 0.99);
  findings.spread.accepted.front().gain = 3000;
  CHECK(told().at("sunlight") < 0.9);
  CHECK(told().at("angle-jitter") > 0.99);
}
