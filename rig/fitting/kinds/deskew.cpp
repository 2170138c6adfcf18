// SPDX-License-Identifier: MIT
#include <nlohmann/json.hpp>

#include "rig/fitting/deskewing.hpp"
#include "rig/fitting/fitting.hpp"

namespace rig::fittings {
namespace {

/// Motion distortion of a turning lidar, and what is left of it once corrected (source B).
class Deskew : public Fitting {
 public:
  std::string kind() const override { return "deskew"; }
  std::string describes() const override {
    return "motion distortion, before and after its correction, against the scene at rest";
  }
  std::vector<std::string> values() const override {
    return {"thickness_raw_mm",  "thickness_odometry_mm", "thickness_rigid_mm",   "thickness_fused_mm",
            "time_offset_ms",    "shape_at_rest_mm",      "shape_turning_mm",     "shape_by_stage_mm",
            "shape_fused_mm",    "reference_before_mm",   "reference_by_path_mm", "reference_fused_mm",
            "reference_gain_mm", "reference_at_rest_mm"};
  }
  bool accepts_clusters() const override { return true; }
  std::vector<FitOption> options() const override {
    return {
        {.name = "scans_per_capture",
         .type = FitOption::Type::integer,
         .min = 1,
         .max = 100000,
         .otherwise = 40.0,
         .about = "number of scans of each capture that are used, from its first"},
        {.name = "offset_ms",
         .unit = "ms",
         .min = -10000,
         .max = 10000,
         .about = "path time minus scan time; without it, estimated from the scans"},
        {.name = "reference",
         .type = FitOption::Type::text,
         .about = "session of the scene at rest, or pose X_MM,Y_MM,HEADING_DEG at which the carrier stood"}};
  }

  nlohmann::json run(const std::vector<FitSource>& sources, const FitOptions& options) const override {
    DeskewOptions wanted;
    wanted.scans_per_capture = options.integer("scans_per_capture");
    wanted.offset_ms = options.maybe_number("offset_ms");
    if (const std::string reference = options.text("reference"); !reference.empty())
      wanted.reference = std::make_shared<const DeskewReference>(reference);
    const auto recording = sources.front().session->recording();
    return Deskewing(wanted, *recording, sources.front().path).document();
  }
};

}  // namespace

std::unique_ptr<Fitting> make_deskew() { return std::make_unique<Deskew>(); }

}  // namespace rig::fittings
