// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <filesystem>

#include "fit/explain/explanation.hpp"
#include "rig/import/import_session.hpp"
#include "rig/session/session_store.hpp"
#include "tests/support/test_folder.hpp"

namespace explain_recordings_test {

TEST_CASE("three real recordings before a wall predict the fourth better than geometry and constant noise do",
          "[long]") {
  const std::filesystem::path real =
      std::filesystem::path(RIG_SOURCE_DIR) / ".." / "shared" / "real" / "lds02-wall";
  if (!std::filesystem::exists(real)) {
    WARN("skipped: the real recordings are not here (" << real.string() << ")");
    return;
  }
  const TestFolder place;
  const std::vector<std::string> names{"0.5m", "1m", "1.5m", "2m"};
  std::vector<std::unique_ptr<rig::SessionStore>> stores;
  std::vector<std::unique_ptr<fit::Recording>> recordings;
  for (const std::string& name : names) {
    rig::ImportRequest request;
    request.files = {(real / ("lidar_calibration_" + name)).string()};
    request.output = rig::check_output({place / (name + ".rig")});
    request.target_width_mm = 1200;
    rig::import_session(request);
    stores.push_back(
        std::make_unique<rig::SessionStore>(request.output.path(), rig::SessionStore::Mode::read));
    recordings.push_back(stores.back()->recording());
  }
  double gain_per_sample = 0;
  for (std::size_t left_out = 0; left_out < names.size(); ++left_out) {
    std::vector<const fit::Recording*> three;
    for (std::size_t i = 0; i < names.size(); ++i)
      if (i != left_out) three.push_back(recordings[i].get());
    const auto explanation = fit::explain::explain(three, {});
    INFO(names[left_out] << " left out: " << to_text(explanation));
    CHECK(explanation.verdict != "nothing-missing");
    const auto prediction = fit::explain::predict_recording(explanation.predictor, *recordings[left_out]);
    CHECK(prediction.samples > 5000);
    gain_per_sample += (prediction.after.log_likelihood - prediction.before.log_likelihood) / 4;
    // Predicted intervals must be neither too bold nor worthless, at a distance that was never seen.
    CHECK(prediction.after.coverage_95 > 0.85);
    CHECK(prediction.after.rms_mm < 1.02 * prediction.before.rms_mm);
  }
  CHECK(gain_per_sample > 0.05);
}

}  // namespace explain_recordings_test
