// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "rig/session/session_store.hpp"

namespace rig {

/// What a session knows of its lidar; empty: not known.
struct LidarIdentity {
  /// Every name the device has for its model: SCIP has two (PROD in its version, MODL in its parameters).
  std::vector<std::string> models;
  std::string product, model, serial, firmware;
  /// The name it goes by: the first of `models`; empty if it has none.
  [[nodiscard]] std::string name() const { return models.empty() ? "" : models.front(); }
};

/// From a device's answers one by one or in groups, or what an importer found of it.
[[nodiscard]] LidarIdentity lidar_in(const nlohmann::json& lidar);
/// From the key `lidar`: the device's answers one by one or in groups, or what an importer found.
[[nodiscard]] LidarIdentity lidar_of(const SessionStore& session);

/// Whether one of the device's names for its model is this one, whatever their spaces, capitals and maker.
[[nodiscard]] bool is_model(const std::string& model, const LidarIdentity& recorded);

/// Whether a calibration made for the lidar `model`, `serial` may be used with recordings of another.
struct LidarMatch {
  bool another = false;  ///< Certainly another lidar, or one of another model.
  std::string says;      ///< Why, or what is not known; empty: it is the same lidar.
};
[[nodiscard]] LidarMatch match_lidar(const std::string& model, const std::string& serial,
                                     const LidarIdentity& recorded);

}  // namespace rig
