// SPDX-License-Identifier: MIT
#include "rig/runner/time_left.hpp"

#include <algorithm>
#include <catch2/catch.hpp>

namespace time_left_test {
namespace {

using Running = rig::TimeLeft::Running;

/// A plan of steps, each a kind with its planned seconds.
struct Plan {
  explicit Plan(const std::vector<std::pair<std::string, double>>& wanted) : written(wanted.size()) {
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const auto& kinds = rig::step_kinds();
      written[i].kind = std::ranges::find_if(kinds, [&](const auto& kind) {
                          return kind->name() == wanted[i].first;
                        })->get();
      rig::PlannedStep step;
      step.step = &written[i];
      step.seconds = wanted[i].second;
      steps.push_back(step);
    }
  }
  std::vector<rig::Step> written;
  std::vector<rig::PlannedStep> steps;
};

Running at(std::size_t step, double from, double done, double passed_s) {
  Running now;
  now.step = step, now.from = from, now.done = done, now.passed_s = passed_s;
  return now;
}

}  // namespace

TEST_CASE("prompts that are answered at once do not make captures look quicker") {
  const Plan plan({{"prompt", 30}, {"capture", 100}, {"prompt", 30}, {"capture", 100}});
  rig::TimeLeft left(plan.steps);
  CHECK(left.left_s(at(0, 0, 0, 0)) == Approx(260));
  left.over(at(0, 0, 0, 1));
  CHECK(left.left_s(at(1, 0, 0, 0)) == Approx(201));
  left.over(at(1, 0, 1, 100));
  CHECK(left.left_s(at(2, 0, 0, 0.4)) == Approx(100.6));
  CHECK(left.left_s(at(2, 0, 0, 500)) == Approx(100));  // A person at lunch.
  left.over(at(2, 0, 0, 500));
  CHECK(left.left_s(at(3, 0, 0.5, 50)) == Approx(50));
}

TEST_CASE("captures that take twice as long as planned will do so again") {
  const Plan plan({{"capture", 100}, {"capture", 100}, {"move", 2}});
  rig::TimeLeft left(plan.steps);
  CHECK(left.left_s(at(0, 0, 0.5, 100)) == Approx(100 + 200 + 2));
  left.over(at(0, 0, 1, 200));
  CHECK(left.left_s(at(1, 0, 0, 0)) == Approx(200 + 4));  // The move as the devices have gone.
  CHECK(left.share(at(1, 0, 0.5, 100)) == Approx(150.0 / 202));
}

TEST_CASE("what an earlier run had done is no experience, and is not ahead") {
  const Plan plan({{"sweep", 100}, {"sweep", 100}});
  rig::TimeLeft left(plan.steps);
  left.over(0);
  CHECK(left.left_s(at(1, 0.5, 0, 0)) == Approx(50));
  CHECK(left.left_s(at(1, 0.5, 0.75, 50)) == Approx(50));
  left.again(0);
  CHECK(left.left_s(at(1, 0.5, 0.75, 50)) == Approx(50 + 200));
}

TEST_CASE("durations are reported in their two largest units") {
  CHECK(rig::duration_text(0) == "0 s");
  CHECK(rig::duration_text(-3) == "0 s");
  CHECK(rig::duration_text(59.4) == "59 s");
  CHECK(rig::duration_text(60) == "1 min");
  CHECK(rig::duration_text(123) == "2 min 3 s");
  CHECK(rig::duration_text(3600 + 125) == "1 h 2 min");
  CHECK(rig::duration_text(86400 + 3600) == "1 day 1 h");
  CHECK(rig::duration_text(8014.3 * 60) == "5 days 13 h");
}

}  // namespace time_left_test
