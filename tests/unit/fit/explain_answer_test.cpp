// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>

#include "fit/explain/answer/chapters.hpp"

namespace explain_answer_test {

TEST_CASE("nothing missing, but held-out figures far beyond the noise: too few stops is said") {
  const fit::Bench bench;
  fit::explain::Reduced reduced;
  reduced.bench = bench;
  fit::explain::inference::Inferred inferred{
      .kinds = nullptr, .posterior = {}, .means = fit::explain::MeanResult(bench)};
  const auto notes = [&](double rms_mm, double coverage) {
    inferred.means.noise_floor_mm = 0.6;
    inferred.means.before.rms_mm = inferred.means.after.rms_mm = rms_mm;
    inferred.means.after.coverage = coverage;
    fit::explain::Explanation out;
    fit::explain::answer::report_doubts(reduced, inferred, out);
    return out.notes;
  };
  REQUIRE(notes(11.2, 0).size() == 1);
  CHECK_THAT(notes(11.2, 0).front(), Catch::Contains("Record more stage angles"));
  CHECK(notes(0.57, 0.95).empty());
}

TEST_CASE("where no experiment of the bench decides, the catalogue says what work would") {
  fit::explain::Explanation e;
  CHECK(fit::explain::what_separates(e).empty());
  e.undecided_between = {{"index-offset", "mount-yaw"}, {"unknown-physics", "nothing-missing"}};
  CHECK(fit::explain::what_separates(e) ==
        "to take the lidar off and mount it again by its housing (index-offset)");
}

}  // namespace explain_answer_test
