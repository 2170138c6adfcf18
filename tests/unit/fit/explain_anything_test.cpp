// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <random>
#include <stdexcept>

#include "../../support/finite.hpp"
#include "../../support/session_of_bytes.hpp"
#include "fit/explain/explanation.hpp"
#include "tests/support/rounds.hpp"

namespace explain_anything_test {

TEST_CASE("whatever a session holds is explained in figures, or refused", "[rounds]") {
  int explained = 0;
  for (unsigned seed = 1; seed <= rounds(200); ++seed) {
    std::mt19937 random(seed);
    std::vector<std::uint8_t> bytes(160);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
    INFO("seed " << seed);
    try {
      const SyntheticRecording recording = SessionOfBytes(bytes).recording();
      const fit::explain::Explanation e = fit::explain::explain({&recording}, {});
      CHECK(not_finite(to_json(e)) == "");
      ++explained;
    } catch (const std::invalid_argument&) {
    }
  }
  CHECK(explained > static_cast<int>(rounds(200)) / 10);
}

}  // namespace explain_anything_test
