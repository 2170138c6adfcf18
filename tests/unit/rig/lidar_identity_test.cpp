// SPDX-License-Identifier: MIT
#include "rig/session/lidar_identity.hpp"

#include <catch2/catch.hpp>

#include "tests/support/test_folder.hpp"

namespace lidar_identity_test {
namespace {

using Catch::Matchers::Contains;

rig::LidarIdentity identity(const std::string& json) {
  const TestFolder folder;
  rig::SessionStore store(folder / "run.rig", rig::SessionStore::Mode::create);
  store.set("lidar", json);
  return rig::lidar_of(store);
}

}  // namespace

TEST_CASE("a session's lidar is found however its answers were recorded") {
  for (const char* json :
       {R"({"PROD": "SOKUIKI", "MODL": "UST-10LX", "SERI": "H1", "FIRM": "2.0"})",
        R"({"model": "UST-10LX", "serial": "H1", "firmware": "2.0", "VV": {"PROD": "SOKUIKI", "SERI": "H1",
            "FIRM": "2.0"}, "PP": {"MODL": "UST-10LX"}})"}) {
    const auto lidar = identity(json);
    CHECK(lidar.serial == "H1");
    CHECK(lidar.firmware == "2.0");
    CHECK(lidar.model == "UST-10LX");
    CHECK(lidar.product == "SOKUIKI");
  }
  CHECK(identity(R"({"serial": "H1", "model": "UTM-30LX"})").models == std::vector<std::string>{"UTM-30LX"});
  CHECK(identity("no JSON").serial.empty());
  CHECK(identity(R"({"SERI": 7})").serial.empty());
}

TEST_CASE("a correction belongs to one lidar, and what cannot be known is said") {
  const auto recorded = identity(R"({"PROD": "Hokuyo", "MODL": "UST-10LX", "SERI": "H1"})");
  const auto same = rig::match_lidar("UST-10LX", "H1", recorded);
  CHECK_FALSE(same.another);
  CHECK(same.says.empty());
  CHECK(rig::match_lidar("hokuyo", "H1", recorded).says.empty());  // Either of its names will do.
  CHECK(rig::match_lidar("UST-10LX(Hokuyo Automatic Co.,Ltd.)", "H1", recorded).says.empty());

  const auto other = rig::match_lidar("UST-10LX", "H2", recorded);
  CHECK(other.another);
  CHECK_THAT(other.says, Contains("H2") && Contains("H1"));

  const auto model = rig::match_lidar("UTM-30LX", "", recorded);
  CHECK(model.another);
  CHECK_THAT(model.says, Contains("UTM-30LX"));

  const auto unknown = rig::match_lidar("UST-10LX", "", recorded);
  CHECK_FALSE(unknown.another);
  CHECK_THAT(unknown.says, Contains("the correction does not say") && Contains("make sure"));
  CHECK_THAT(rig::match_lidar("UST-10LX", "H1", identity("{}")).says, Contains("the session does not say"));
  CHECK_THAT(rig::match_lidar("", "", identity("{}")).says,
             Contains("neither the correction nor the session"));
}

}  // namespace lidar_identity_test
