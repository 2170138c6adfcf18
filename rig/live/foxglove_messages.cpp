// SPDX-License-Identifier: MIT
#include "rig/live/foxglove_messages.hpp"

#include <algorithm>
#include <cmath>

#include "fit/motion/pose2.hpp"
#include "fit/numeric/angle.hpp"
#include "rig/json_fields.hpp"

namespace rig {
namespace {

using nlohmann::json;

enum Topic : std::size_t {
  scan_topic,
  tf_topic,
  log_topic,
  beam_topic,
  stage_topic,
  step_topic,
  results_topic
};

json object_of(const json& properties) { return {{"type", "object"}, {"properties", properties}}; }
json of_type(const char* type) { return {{"type", type}}; }
json list_of_type(const char* type) { return {{"type", "array"}, {"items", of_type(type)}}; }

const json moment_schema = object_of({{"sec", of_type("integer")}, {"nsec", of_type("integer")}});
const json vector_schema =
    object_of({{"x", of_type("number")}, {"y", of_type("number")}, {"z", of_type("number")}});
const json quaternion_schema = object_of(
    {{"x", of_type("number")}, {"y", of_type("number")}, {"z", of_type("number")}, {"w", of_type("number")}});

std::vector<FoxgloveChannel> make_channels() {
  const json number = of_type("number"), text = of_type("string"), whole = of_type("integer");
  return {
      {"/scan", "foxglove.LaserScan",
       object_of({{"timestamp", moment_schema},
                  {"frame_id", text},
                  {"pose", object_of({{"position", vector_schema}, {"orientation", quaternion_schema}})},
                  {"start_angle", number},
                  {"end_angle", number},
                  {"ranges", list_of_type("number")},
                  {"intensities", list_of_type("number")}})},
      {"/tf", "foxglove.FrameTransform",
       object_of({{"timestamp", moment_schema},
                  {"parent_frame_id", text},
                  {"child_frame_id", text},
                  {"translation", vector_schema},
                  {"rotation", quaternion_schema}})},
      {"/messages", "foxglove.Log",
       object_of({{"timestamp", moment_schema},
                  {"level", whole},
                  {"message", text},
                  {"name", text},
                  {"file", text},
                  {"line", whole}}),
       true},
      {"/beam", "rig.Beam", object_of({{"timestamp", moment_schema}, {"step", whole}, {"range_mm", number}})},
      {"/stage", "rig.Stage", object_of({{"timestamp", moment_schema}, {"angle_deg", number}})},
      {"/step", "rig.Step",
       object_of({{"timestamp", moment_schema},
                  {"phase", text},
                  {"n", whole},
                  {"of", whole},
                  {"text", text},
                  {"done", number},
                  {"total", number},
                  {"left_s", number},
                  {"overall", number},
                  {"prompt", text}})},
      {"/results", "rig.Results",
       object_of({{"timestamp", moment_schema},
                  {"results",
                   {{"type", "array"},
                    {"items", object_of({{"name", text}, {"text", text}, {"verdict", text}})}}}})}};
}

json moment(std::int64_t time_ns) {
  return {{"sec", time_ns / 1'000'000'000}, {"nsec", time_ns % 1'000'000'000}};
}

json rotation(double yaw_rad) {
  return {{"x", 0.0}, {"y", 0.0}, {"z", std::sin(yaw_rad / 2)}, {"w", std::cos(yaw_rad / 2)}};
}

json position(double x_mm, double y_mm) { return {{"x", x_mm / 1000}, {"y", y_mm / 1000}, {"z", 0.0}}; }

json scan_message(const json& scan, const json& time) {
  json ranges = json::array();
  for (const json& mm : list_of(scan, "range_mm"))
    ranges.push_back(mm.is_number() ? mm.get<double>() / 1000 : 0.0);
  const double first = number_of(scan, "first_deg", 0) * fit::rad_per_deg,
               step = number_of(scan, "step_deg", 0) * fit::rad_per_deg;
  const double last = first + step * (static_cast<double>(std::max<std::size_t>(1, ranges.size())) - 1);
  return {{"timestamp", time},
          {"frame_id", "laser"},
          {"pose", {{"position", position(0, 0)}, {"orientation", rotation(0)}}},
          {"start_angle", first},
          {"end_angle", last},
          {"ranges", std::move(ranges)},
          {"intensities", list_of(scan, "intensity")}};
}

json tf_message(double stage_deg, const fit::Mount& lidar, const json& time) {
  const fit::Pose2 turned{0, 0, stage_deg * fit::rad_per_deg};
  const fit::Pose2 at = turned * fit::Pose2{lidar.x_mm.value, lidar.y_mm.value, lidar.yaw_rad.value};
  return {{"timestamp", time},
          {"parent_frame_id", "bench"},
          {"child_frame_id", "laser"},
          {"translation", position(at.x_mm, at.y_mm)},
          {"rotation", rotation(at.heading_rad)}};
}

json step_message(const json& state, const json& time) {
  const json none = json::object();
  const json &step = state.contains("step") ? state["step"] : none,
             &progress = state.contains("progress") ? state["progress"] : none,
             &prompt = state.contains("prompt") ? state["prompt"] : none;
  return {{"timestamp", time},
          {"phase", text_of(state, "phase")},
          {"n", number_of(step, "n", 0)},
          {"of", number_of(step, "of", 0)},
          {"text", text_of(step, "text")},
          {"done", number_of(progress, "done", 0)},
          {"total", number_of(progress, "total", 0)},
          {"left_s", number_of(progress, "left_s", 0)},
          {"overall", number_of(progress, "overall", 0)},
          {"prompt", text_of(prompt, "title")}};
}

int log_level(const std::string& level) {
  constexpr int info = 2, warning = 3, error = 4;  // foxglove.Log's numbers
  return level == "error" ? error : level == "warning" ? warning : info;
}

}  // namespace

const std::vector<FoxgloveChannel>& foxglove_channels() {
  static const std::vector<FoxgloveChannel> channels = make_channels();
  return channels;
}

std::vector<FoxgloveMessage> foxglove_messages(const json& state, std::int64_t time_ns,
                                               const fit::Mount& lidar, std::uint64_t logged) {
  const json time = moment(time_ns);
  std::vector<FoxgloveMessage> out;
  out.push_back({step_topic, step_message(state, time)});
  if (const double stage_deg = number_of(state, "stage_deg"); std::isfinite(stage_deg)) {
    out.push_back({stage_topic, {{"timestamp", time}, {"angle_deg", stage_deg}}});
    out.push_back({tf_topic, tf_message(stage_deg, lidar, time)});
  }
  if (state.contains("scan")) out.push_back({scan_topic, scan_message(state["scan"], time)});
  if (state.contains("beam"))
    if (const json ranges = list_of(state["beam"], "range_mm"); !ranges.empty())
      out.push_back({beam_topic,
                     {{"timestamp", time},
                      {"step", number_of(state["beam"], "step", 0)},
                      {"range_mm", ranges.back()}}});
  if (state.contains("results"))
    out.push_back({results_topic, {{"timestamp", time}, {"results", state["results"]}}});
  const json messages = list_of(state, "messages");
  const auto total =
      static_cast<std::uint64_t>(number_of(state, "messages_total", static_cast<double>(messages.size())));
  const std::uint64_t fresh = std::min<std::uint64_t>(messages.size(), total > logged ? total - logged : 0);
  for (std::size_t i = messages.size() - fresh; i < messages.size(); ++i)
    out.push_back({log_topic,
                   {{"timestamp", time},
                    {"level", log_level(text_of(messages[i], "level"))},
                    {"message", text_of(messages[i], "text")},
                    {"name", "rig"},
                    {"file", ""},
                    {"line", 0}}});
  return out;
}

}  // namespace rig
