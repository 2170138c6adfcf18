// SPDX-License-Identifier: MIT
#include <nlohmann/json.hpp>

#include "fit/numeric/angle.hpp"
#include "rig/export/exporter.hpp"
#include "rig/session/standing.hpp"
#include "rig/whole_file.hpp"

namespace rig::exporters {
namespace {

using nlohmann::json;

json parsed_or_text(const std::string& text) {
  json value = json::parse(text, nullptr, false);
  return value.is_discarded() ? json(text) : value;
}

template <class T>
json or_null(const std::optional<T>& value) {
  return value ? json(*value) : json(nullptr);
}

/// What was done and what came out of it, without the scans.
class Json : public Exporter {
 public:
  std::string format() const override { return "json"; }
  std::string describes() const override { return "circumstances, captures and results, without the scans"; }

  void write(const ExportSource& source, const std::string& output) const override {
    const SessionStore& session = *source.session;
    json out = {{"schema", "session-export/1"}, {"content_sha256", session.content_hash()}};
    for (const char* key : {"kind", "created_utc", "recorded_utc", "epoch_unix_us", "lidar_restarts",
                            "software", "lidar", "stage", "bench", "procedure_name", "procedure"})
      if (const auto value = session.get(key)) out[key] = parsed_or_text(*value);
    const Standing standing = standing_of(session);
    out["certified"] = standing.certifies(), out["simulated"] = standing.simulated;
    out["not_certified_because"] = standing.reasons;
    const auto recording = session.recording();
    out["captures"] = json::array();
    for (const fit::CaptureInfo& capture : recording->captures()) out["captures"].push_back(as_json(capture));
    out["results"] = json::object();
    for (const SessionStore::Result& result : session.latest_results())
      out["results"][result.kind] = parsed_or_text(result.json);
    write_text(output, out.dump(1) + "\n");
  }

 private:
  static json as_json(const fit::CaptureInfo& capture) {
    return {{"id", capture.id},
            {"step", capture.step},
            {"started_us", capture.started_us},
            {"stage_deg", capture.stage_rad * fit::deg_per_rad},
            {"approach", capture.approach},
            {"target", or_null(capture.target)},
            {"target_shift_mm", capture.target_shift_mm},
            {"reflectance", or_null(capture.reflectance)},
            {"temperature_c", or_null(capture.temperature_c)},
            {"since_power_on_s", or_null(capture.since_power_on_s)},
            {"stage_rate_deg_s", capture.stage_rate_rad_s * fit::deg_per_rad},
            {"first_step", capture.first_step},
            {"last_step", capture.last_step},
            {"cluster", capture.cluster}};
  }
};

}  // namespace

std::unique_ptr<Exporter> make_json() { return std::make_unique<Json>(); }

}  // namespace rig::exporters
