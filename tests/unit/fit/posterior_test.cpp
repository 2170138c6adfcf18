// SPDX-License-Identifier: MIT
#include "fit/explain/inference/posterior.hpp"

#include <catch2/catch.hpp>
#include <cmath>

namespace posterior_test {

using namespace fit::explain;
using namespace fit::explain::inference;

model::Kind kind(const char* id) {
  model::Kind k;
  k.mechanism = fit::not_owned(*fit::find_mechanism(id));
  return k;
}

/// Fitted hypotheses, each a list of kinds, by their log odds to nothing.
Explored explored(const std::vector<std::pair<std::vector<const model::Kind*>, double>>& all) {
  Explored e;
  for (const auto& [kinds, log_odds] : all) {
    inference::Hypothesis h;
    for (const model::Kind* k : kinds) {
      h.terms.emplace_back();
      h.terms.back().kind = k;
    }
    h.log_evidence = log_odds;
    if (h.log_evidence > e.best.hypothesis.log_evidence) e.best.hypothesis = h;
    e.visited[kinds] = h;
  }
  return e;
}

TEST_CASE("that nothing is missing needs a probability as high as a name does") {
  const model::Kind walk = kind("range-walk"), scale = kind("range-scale");
  const auto set_of = [&](double log_odds_of_walk) {
    const Posterior p = posterior_of(explored({{{}, 0}, {{&walk}, log_odds_of_walk}, {{&scale}, -4}}));
    CHECK(p.named.empty());
    std::vector<std::pair<const model::Kind*, double>> members;
    for (const Undecided& set : p.undecided)
      for (const Named& member : set.members) members.emplace_back(member.term.kind, member.probability);
    return members;
  };
  CHECK(set_of(-4).empty());  // one in twenty-eight each
  const auto open = set_of(-0.5);
  REQUIRE(open.size() == 2);
  CHECK(open[0].first == nullptr);
  CHECK(open[1].first == &walk);
  CHECK(std::abs(open[0].second - 1 / (1 + std::exp(-0.5) + std::exp(-4))) < 1e-9);
  // As a hair more for the mechanism has it, the other way round.
  const auto other = set_of(0.1);
  REQUIRE(other.size() == 2);
  CHECK(other[0].first == &walk);
  CHECK(other[1].first == nullptr);
}

}  // namespace posterior_test
