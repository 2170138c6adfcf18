// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Index pulse off the front: on one bench the same thing as the mount's yaw, told only by the yaw's prior.
Mechanism make_index_offset() {
  Mechanism m;
  m.id = "index-offset";
  m.cause = "the lidar's zero direction is not where the bench file says";
  m.coordinate = Coordinate::beam;
  m.geometric = true;
  m.formula_error = 0;
  m.parameters = {{.name = "offset_deg", .typical = 0.7}};
  m.act = [](const Circumstances&, std::span<const double> p) {
    return Effect{.beam_rad = p[0] * rad_per_deg};
  };
  m.looks_like = {mount_yaw};
  m.says = [](const Finding& f) {
    return "The lidar's zero direction is off by " + with_uncertainty(f.at("offset_deg"), "deg") +
           ", more than the bench file's uncertainty of the mount's yaw allows: either the index is off or "
           "the bench file is wrong.";
  };
  m.separate = "take the lidar off and mount it again by its housing";
  return m;
}

}  // namespace fit::mechanisms
