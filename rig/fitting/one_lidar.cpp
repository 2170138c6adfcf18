// SPDX-License-Identifier: MIT
#include "rig/fitting/one_lidar.hpp"

#include "rig/errors.hpp"
#include "rig/session/lidar_identity.hpp"

namespace rig {

std::string lidar_in_words(const SessionStore& session) {
  const LidarIdentity lidar = lidar_of(session);
  const std::string model = lidar.models.empty() ? session.recording()->bench().lidar.model : lidar.name();
  return model + (lidar.serial.empty() ? "" : " " + lidar.serial);
}

void demand_one_lidar(const std::vector<FitSource>& sources, const std::string& what) {
  const SessionStore& first = *sources.front().session;
  const LidarIdentity lidar = lidar_of(first);
  for (const FitSource& source : sources)
    if (match_lidar(lidar.name(), lidar.serial, lidar_of(*source.session)).another)
      throw UsageError("the " + what + " of " + sources.front().path + " and " + source.path +
                       " cannot be fitted together: their lidars differ (" + lidar_in_words(first) + "; " +
                       lidar_in_words(*source.session) +
                       "). Fit each session by itself, and compare them with 'rig compare'.");
}

}  // namespace rig
