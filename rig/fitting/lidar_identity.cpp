// SPDX-License-Identifier: MIT
#include "rig/fitting/lidar_identity.hpp"

#include <initializer_list>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"

namespace rig {
namespace {

using nlohmann::json;

/// VV's and PP's answers may stand side by side, or each in an object of its own.
std::string said(const json& lidar, std::initializer_list<const char*> keys) {
  if (!lidar.is_object()) return "";
  for (const char* key : keys)
    if (lidar.contains(key) && lidar.at(key).is_string()) return lidar.at(key).get<std::string>();
  for (const auto& part : lidar)
    if (part.is_object())
      if (std::string inside = said(part, keys); !inside.empty()) return inside;
  return "";
}

}  // namespace

LidarIdentity lidar_identity(const SessionStore& session) {
  const json lidar = json::parse(session.get("lidar").value_or("{}"), nullptr, false);
  return {said(lidar, {"PROD", "MODL", "model"}), said(lidar, {"SERI", "serial"}),
          said(lidar, {"FIRM", "firmware"})};
}

std::string lidar_in_words(const SessionStore& session) {
  const LidarIdentity lidar = lidar_identity(session);
  const std::string model = lidar.model.empty() ? session.recording()->bench().lidar.model : lidar.model;
  return model + (lidar.serial.empty() ? "" : " " + lidar.serial);
}

void demand_one_lidar(const std::vector<FitSource>& sources, const std::string& what) {
  const SessionStore& first = *sources.front().session;
  const LidarIdentity a = lidar_identity(first);
  for (const FitSource& source : sources) {
    const LidarIdentity b = lidar_identity(*source.session);
    const auto differ = [](const std::string& one, const std::string& other) {
      return !one.empty() && !other.empty() && one != other;
    };
    if (differ(a.model, b.model) || differ(a.serial, b.serial))
      throw UsageError("the " + what + " of " + sources.front().path + " and " + source.path +
                       " is not that of one thing: their lidars differ (" + lidar_in_words(first) + "; " +
                       lidar_in_words(*source.session) +
                       "). Fit each session by itself, and compare them with 'rig compare'.");
  }
}

}  // namespace rig
