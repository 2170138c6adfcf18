// SPDX-License-Identifier: MIT
#include "rig/fitting/deskew_reference.hpp"

#include <cmath>
#include <filesystem>
#include <sstream>

#include "fit/numeric/angle.hpp"
#include "rig/errors.hpp"

namespace rig {
namespace {

/// Nothing unless the text is three numbers with commas between them.
std::optional<fit::Pose2> pose_in(const std::string& text) {
  std::istringstream in(text);
  fit::Pose2 pose;
  double heading_deg = 0;
  char first = 0, second = 0;
  if (!(in >> pose.x_mm >> first >> pose.y_mm >> second >> heading_deg) || first != ',' || second != ',' ||
      !(in >> std::ws).eof())
    return std::nullopt;
  pose.heading_rad = heading_deg * fit::rad_per_deg;
  return pose;
}

}  // namespace

DeskewReference::DeskewReference(const std::string& text) : text_(text), pose_(pose_in(text)) {
  if (pose_) return;
  if (!std::filesystem::exists(text) || !is_session_file(text))
    throw UsageError("the reference '" + text +
                     "' is neither a session file nor a pose; give the session of the same scene at rest, or "
                     "where the carrier stood still as X_MM,Y_MM,HEADING_DEG, such as 0,0,90");
  session_ = std::make_unique<SessionStore>(text, SessionStore::Mode::read);
  recording_ = session_->recording();
}

}  // namespace rig
