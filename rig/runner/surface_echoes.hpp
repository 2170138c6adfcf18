// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <string>
#include <vector>

namespace rig {

/// The echoes of surfaces that were put on targets: two of very different reflectance at one distance cannot
/// return the same.
class SurfaceEchoes {
 public:
  struct Surface {
    double distance_mm, reflectance, intensity;
  };

  /// What speaks against it, for the operator; empty and remembered if nothing does.
  std::string contradiction(const std::string& target, const Surface& here);

 private:
  std::map<std::string, std::vector<Surface>> known_;
};

}  // namespace rig
