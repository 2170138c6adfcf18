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
  std::vector<std::pair<std::string, std::string>> options() const override {
    return {{"scans_per_capture", "of every capture only the first so many are used; default 40"},
            {"offset_ms", "path time minus scan time; default: estimated from the scans"}};
  }

  nlohmann::json run(const std::vector<FitSource>& sources, const nlohmann::json& options) const override {
    DeskewOptions wanted;
    wanted.scans_per_capture = static_cast<int>(options.value("scans_per_capture", 40.0));
    if (options.contains("offset_ms")) wanted.offset_ms = options.at("offset_ms").get<double>();
    const auto recording = sources.front().session->recording();
    return Deskewing(wanted, *recording, sources.front().path).document();
  }
};

}  // namespace

std::unique_ptr<Fitting> make_deskew() { return std::make_unique<Deskew>(); }

}  // namespace rig::fittings
