// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "fit/motion/pose2.hpp"
#include "rig/fitting/fitting.hpp"

namespace rig {

/// What deskewed scans are judged against: a recording of the same scene at rest, in the same frame, or the
/// stretch of the judged recording in which its carrier stood still about a pose.
class DeskewReference {
 public:
  /// `text`: a session file, or a pose "X_MM,Y_MM,HEADING_DEG" of the carrier. Throws UsageError when it is
  /// neither.
  explicit DeskewReference(const std::string& text);

  /// Null when a pose was given.
  [[nodiscard]] const fit::Recording* recording() const { return recording_.get(); }
  [[nodiscard]] const std::optional<fit::Pose2>& pose() const { return pose_; }
  /// As it was given.
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  std::string text_;
  std::unique_ptr<SessionStore> session_;
  std::unique_ptr<fit::Recording> recording_;
  std::optional<fit::Pose2> pose_;
};

}  // namespace rig
