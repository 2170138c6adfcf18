// SPDX-License-Identifier: MIT
#include "rig/session/lidar_identity.hpp"

#include <algorithm>
#include <cctype>
#include <nlohmann/json.hpp>

namespace rig {
namespace {

using nlohmann::json;

std::string text_at(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}

/// VV, PP and II may stand in groups ({"VV": {...}}) or together, depending on who recorded the session.
std::string answer(const json& lidar, const char* key) {
  if (const std::string text = text_at(lidar, key); !text.empty()) return text;
  for (const auto& [name, group] : lidar.items())
    if (group.is_object())
      if (const std::string text = text_at(group, key); !text.empty()) return text;
  return "";
}

std::string first_answer(const json& lidar, const char* key, const char* otherwise) {
  const std::string text = answer(lidar, key);
  return text.empty() ? text_at(lidar, otherwise) : text;
}

/// Letters and digits only, without the maker in brackets: "UST-10LX(Hokuyo Automatic Co.,Ltd.)" and
/// "ust 10lx" are one model.
std::string plain(const std::string& name) {
  std::string out;
  for (const char c : name.substr(0, name.find('(')))
    if (std::isalnum(static_cast<unsigned char>(c)))
      out += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return out;
}

}  // namespace

LidarIdentity lidar_of(const SessionStore& session) {
  return lidar_in(json::parse(session.get("lidar").value_or("{}"), nullptr, false));
}

LidarIdentity lidar_in(const json& lidar) {
  if (!lidar.is_object()) return {};
  LidarIdentity out;
  out.product = answer(lidar, "PROD");
  out.model = first_answer(lidar, "MODL", "model");
  out.serial = first_answer(lidar, "SERI", "serial");
  out.firmware = first_answer(lidar, "FIRM", "firmware");
  for (const std::string& name : {out.product, out.model, text_at(lidar, "model")})
    if (!name.empty() && std::ranges::find(out.models, name) == out.models.end()) out.models.push_back(name);
  return out;
}

bool is_model(const std::string& model, const LidarIdentity& recorded) {
  return std::ranges::any_of(recorded.models,
                             [&](const std::string& name) { return plain(name) == plain(model); });
}

LidarMatch match_lidar(const std::string& model, const std::string& serial, const LidarIdentity& recorded) {
  const bool models_known = !model.empty() && !recorded.models.empty();
  if (models_known && !is_model(model, recorded))
    return {true, "the correction is for a lidar of the model " + model + ", the session is of a " +
                      recorded.models.front()};
  if (!serial.empty() && !recorded.serial.empty()) {
    if (serial == recorded.serial) return {};
    return {true, "the correction is for the lidar " + serial + ", the session is of " + recorded.serial};
  }
  const std::string who = serial.empty() && recorded.serial.empty() ? "neither the correction nor the session"
                          : serial.empty()                          ? "the correction does not"
                                                                    : "the session does not";
  return {false, who + (serial.empty() && recorded.serial.empty() ? " says" : " say") +
                     " which lidar it is of (no serial number" +
                     (models_known ? "" : ", no model on both sides") +
                     "): make sure that it is the same one"};
}

}  // namespace rig
