// SPDX-License-Identifier: MIT
// The layouts of docs/examples show what a run and a bag really offer.
#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>
#include <set>

#include "rig/live/foxglove_messages.hpp"
#include "tests/support/test_folder.hpp"

namespace foxglove_layouts_test {
namespace {

using nlohmann::json;

json layout_named(const std::string& name) {
  return json::parse(file_text(std::string(RIG_SOURCE_DIR "/docs/examples/") + name));
}

/// Every panel that the layout's tree places.
void placed_panels(const json& node, std::set<std::string>& into) {
  if (node.is_string()) {
    into.insert(node.get<std::string>());
    return;
  }
  placed_panels(node.at("first"), into);
  placed_panels(node.at("second"), into);
}

void check_panels(const json& layout) {
  std::set<std::string> placed, described;
  placed_panels(layout.at("layout"), placed);
  for (const auto& panel : layout.at("configById").items()) described.insert(panel.key());
  CHECK(placed == described);
}

/// Topics and the paths into their messages ("/beam.range_mm") that the panels show.
std::set<std::string> shown(const json& layout) {
  std::set<std::string> paths;
  for (const auto& panel : layout.at("configById")) {
    const json topics = panel.value("topics", json::object());
    for (const auto& topic : topics.items()) paths.insert(topic.key());
    for (const auto& path : panel.value("paths", json::array())) paths.insert(path.at("value"));
    for (const char* key : {"topicPath", "topicToRender"})
      if (panel.contains(key)) paths.insert(panel.at(key).get<std::string>());
  }
  return paths;
}

}  // namespace

TEST_CASE("the layout for a running bench shows topics and fields that the run serves") {
  const json layout = layout_named("foxglove-run.json");
  check_panels(layout);
  std::set<std::string> topics;
  for (const std::string& path : shown(layout)) {
    INFO(path);
    const std::string topic = path.substr(0, path.find('.'));
    const auto channel =
        std::ranges::find_if(rig::foxglove_channels(), [&](const auto& c) { return topic == c.topic; });
    REQUIRE(channel != rig::foxglove_channels().end());
    topics.insert(topic);
    if (const auto dot = path.find('.'); dot != path.npos)
      CHECK(channel->schema.at("properties").contains(path.substr(dot + 1)));
  }
  CHECK(topics == std::set<std::string>{"/scan", "/beam", "/stage", "/step", "/results", "/messages"});
}

TEST_CASE("the layout for bags shows topics that rig export writes") {
  const json layout = layout_named("foxglove-bag.json");
  check_panels(layout);
  const std::set<std::string> written{"/scan", "/points", "/odom", "/joint_states", "/tf"};
  for (const std::string& path : shown(layout)) {
    INFO(path);
    CHECK(written.contains(path.substr(0, path.find('.'))));
  }
}

}  // namespace foxglove_layouts_test
