// SPDX-License-Identifier: MIT
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "fit/angle.hpp"
#include "fit/range_calibration.hpp"
#include "fit/selection.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/correction_source.hpp"
#include "rig/fitting/fitting.hpp"
#include "rig/fitting/result_document.hpp"

namespace rig::fittings {
namespace {

using Eigen::Vector2d;
using nlohmann::json;

json column(const char* name, const char* unit) { return {{"name", name}, {"unit", unit}}; }

/// One beam of a capture: mean range and intensity over all scans.
struct Beam {
  double direction_rad, range_mm, intensity;
};

struct Surface {
  std::string label;
  double stage_rad = 0;
  Vector2d normal = Vector2d::UnitY();  ///< Of the target, in the lidar's frame, by the bench.
  std::vector<Beam> beams;
};

Vector2d point_of(const Beam& beam, double range_mm) {
  return {range_mm * std::cos(beam.direction_rad), range_mm * std::sin(beam.direction_rad)};
}

/// Beams that meet the target, by the bench's geometry and by what they saw.
std::optional<Surface> surface_of(const fit::Recording& recording, std::size_t index,
                                  const std::string& wanted) {
  const fit::CaptureInfo& capture = recording.captures()[index];
  const fit::Bench& bench = recording.bench();
  const std::string name = wanted.empty() ? capture.target.value_or("") : wanted;
  const fit::Target* target = bench.target(name);
  if (!target || fit::is_turning(capture) || (capture.target && *capture.target != name)) return std::nullopt;
  const fit::Mount& mount = bench.lidar.mount;
  const double stage = capture.stage_readback_rad.value_or(capture.stage_rad);
  const Vector2d origin = Eigen::Rotation2Dd(stage) * Vector2d(mount.x_mm.value, mount.y_mm.value);
  const Eigen::Rotation2Dd to_lidar(-stage - mount.yaw_rad.value);
  const Vector2d shift = target->outward_normal() * capture.target_shift_mm;
  const Vector2d from = to_lidar * (target->from_mm + shift - origin),
                 to = to_lidar * (target->to_mm + shift - origin);
  Surface out;
  out.label = capture.step.empty() ? std::to_string(capture.id) : capture.step;
  out.stage_rad = stage;
  out.normal = to_lidar * target->outward_normal();
  const double distance = out.normal.dot(from);
  std::map<int, std::vector<fit::Sample>> samples;
  recording.for_each_scan(index, [&](const fit::ScanView& scan) {
    if (scan.geometry) return;
    for (std::size_t k = 0; k < scan.range_mm.size(); ++k) {
      const int step = capture.first_step + static_cast<int>(k) * capture.cluster;
      const double direction = bench.lidar.beam_angle(step + (capture.cluster - 1) / 2.0);
      const Vector2d ray(std::cos(direction), std::sin(direction));
      const double facing = ray.dot(out.normal);
      if (facing < 0.1) continue;
      const Vector2d at = ray * (distance / facing), along = to - from;
      const double place = (at - from).dot(along) / along.squaredNorm();
      if (place < 0.03 || place > 0.97) continue;
      samples[step].push_back(
          {scan.range_mm[k], k < scan.intensity.size() ? scan.intensity[k] : std::uint16_t{0}});
    }
  });
  for (const auto& [step, of_step] : samples) {
    const fit::SelectedMean mean = fit::select_robust(of_step);
    const double direction = bench.lidar.beam_angle(step + (capture.cluster - 1) / 2.0);
    if (mean.kept < 1 ||
        std::abs(point_of({direction, 0, 0}, mean.mean_mm).dot(out.normal) - distance) > 0.1 * distance + 60)
      continue;
    out.beams.push_back({direction, mean.mean_mm, mean.intensity});
  }
  return out.beams.empty() ? std::nullopt : std::optional(out);
}

std::vector<Vector2d> points_of(const Surface& surface, const fit::Correction* correction) {
  // The ordinate of the paper lies across the surface.
  const Eigen::Rotation2Dd upright(fit::pi / 2 - std::atan2(surface.normal.y(), surface.normal.x()));
  std::vector<Vector2d> out;
  for (const Beam& beam : surface.beams)
    out.push_back(upright * point_of(beam, correction
                                               ? correction->apply(beam.range_mm, beam.intensity).range_mm
                                               : beam.range_mm));
  return out;
}

double improvement(double before, double after) { return 100 * (1 - after / before); }

class Validation : public Fitting {
 public:
  std::string kind() const override { return "validation"; }
  std::string describes() const override {
    return "a range correction judged on flat samples and on a scene seen from two stage angles";
  }
  std::vector<FitOption> options() const override {
    using Type = FitOption::Type;
    return {{.name = "correction",
             .type = Type::text,
             .about = "correction file or session; without it, the session's own range calibration"},
            {.name = "target",
             .type = Type::text,
             .about = "the flat target; without it, what each capture is about"},
            {.name = "centre_x_mm",
             .unit = "mm",
             .about = "rotation centre in the lidar's frame, x; without it, the session's, else the mount's"},
            {.name = "centre_y_mm", .unit = "mm", .about = "the same, y"}};
  }

  json run(const std::vector<FitSource>& sources, const FitOptions& options) const override {
    std::vector<Surface> surfaces;
    std::optional<fit::Mount> mount;
    for (const FitSource& source : sources) {
      const auto recording = source.session->recording();
      mount = recording->bench().lidar.mount;
      for (std::size_t i = 0; i < recording->captures().size(); ++i)
        if (auto surface = surface_of(*recording, i, options.text("target")))
          surfaces.push_back(std::move(*surface));
    }
    if (surfaces.empty())
      throw MeasurementError(
          "no capture sees a flat target that the bench file knows: run the procedure range-validation, or "
          "name the target");
    const auto correction = correction_for(sources, options);
    json out = new_result("validation",
                          "Zhao et al., experiments A3 and A6. A3: standard deviation of the difference "
                          "between each point's ordinate and "
                          "that of the 20th (5th) point before it, on the mean over all scans; beside it the "
                          "same across the best plane, "
                          "because a slanted surface alone makes the paper's figure large. Intervals: 95 %, "
                          "jackknife over ten blocks. A6: "
                          "mean distance of the points of one stage angle from the line through those of the "
                          "other, in one frame.");
    if (!correction)
      out["notes"].push_back(
          "No correction was given (option correction=FILE): figures are of the uncorrected ranges only.");
    add_spreads(out, surfaces, correction ? &*correction : nullptr);
    add_scene(out, surfaces, correction ? &*correction : nullptr, centre_for(sources, options, *mount));
    add_plot(out, surfaces.front(), correction ? &*correction : nullptr);
    if (correction) count_outside(out, surfaces, *correction);
    return out;
  }

 private:
  static std::optional<fit::Correction> correction_for(const std::vector<FitSource>& sources,
                                                       const FitOptions& options) {
    const std::string file = options.text("correction");
    if (!file.empty()) return load_correction(file);
    for (const FitSource& source : sources)
      if (source.session->latest_result("range")) {
        try {
          return load_correction(source.path, *source.session);
        } catch (const MeasurementError&) {
        }
      }
    return std::nullopt;
  }

  static Vector2d centre_for(const std::vector<FitSource>& sources, const FitOptions& options,
                             const fit::Mount& mount) {
    const double c = std::cos(-mount.yaw_rad.value), s = std::sin(-mount.yaw_rad.value);
    Vector2d centre(-(c * mount.x_mm.value - s * mount.y_mm.value),
                    -(s * mount.x_mm.value + c * mount.y_mm.value));
    for (const FitSource& source : sources) {
      const auto result =
          json::parse(source.session->latest_result("centre").value_or("null"), nullptr, false);
      if (!result.is_object()) continue;
      for (const auto& value : result.value("values", json::array())) {
        if (value.value("name", "") == "centre_x_mm") centre.x() = value.at("value").get<double>();
        if (value.value("name", "") == "centre_y_mm") centre.y() = value.at("value").get<double>();
      }
    }
    return {options.maybe_number("centre_x_mm").value_or(centre.x()),
            options.maybe_number("centre_y_mm").value_or(centre.y())};
  }

  static void add_spreads(json& out, const std::vector<Surface>& surfaces,
                          const fit::Correction* correction) {
    json rows = json::array();
    for (const int lag : {20, 5}) {
      double before_sum = 0, after_sum = 0;
      int count = 0;
      for (const Surface& surface : surfaces) {
        const auto before = fit::difference_spread(points_of(surface, nullptr), lag);
        if (!std::isfinite(before.sd_mm)) continue;
        const auto after = fit::difference_spread(points_of(surface, correction), lag);
        rows.push_back({surface.label, lag, before.sd_mm, before.low_mm, before.high_mm, after.sd_mm,
                        after.low_mm, after.high_mm, improvement(before.sd_mm, after.sd_mm),
                        before.plane_sd_mm, after.plane_sd_mm, after.plane_low_mm, after.plane_high_mm,
                        improvement(before.plane_sd_mm, after.plane_sd_mm)});
        before_sum += before.plane_sd_mm, after_sum += after.plane_sd_mm, ++count;
      }
      if (count == 0) continue;
      const std::string name = "spread_" + std::to_string(lag),
                        words = "Spread of the " + std::to_string(lag) + "th difference, plane removed";
      out["values"].push_back(
          plain_value(name + "_before_mm", words + ", uncorrected", before_sum / count, "mm"));
      if (!correction) continue;
      out["values"].push_back(
          plain_value(name + "_after_mm", words + ", corrected", after_sum / count, "mm"));
      out["values"].push_back(plain_value(name + "_improvement_percent", words + ": better by",
                                          improvement(before_sum, after_sum), "%"));
    }
    out["tables"].push_back(
        {{"title", "Experiment A3: spread of ordinate differences before and after correction"},
         {"columns",
          {"capture", "difference", column("before", "mm"), column("from", "mm"), column("to", "mm"),
           column("after", "mm"), column("from", "mm"), column("to", "mm"), column("better by", "%"),
           column("plane removed, before", "mm"), column("after", "mm"), column("from", "mm"),
           column("to", "mm"), column("better by", "%")}},
         {"rows", rows}});
  }

  static void add_scene(json& out, const std::vector<Surface>& surfaces, const fit::Correction* correction,
                        const Vector2d& centre) {
    for (std::size_t i = surfaces.size() - 1; i > 0; --i) {
      const Surface &a = surfaces[i - 1], &b = surfaces[i];
      if (std::abs(fit::wrap_angle(a.stage_rad - b.stage_rad)) < 5 * fit::rad_per_deg) continue;
      const auto placed = [&](const Surface& surface, const fit::Correction* with, const Vector2d& about) {
        std::vector<Vector2d> points;
        for (const Beam& beam : surface.beams)
          points.push_back(
              Eigen::Rotation2Dd(surface.stage_rad) *
              (point_of(beam, with ? with->apply(beam.range_mm, beam.intensity).range_mm : beam.range_mm) -
               about));
        return points;
      };
      const auto before =
          fit::scene_distance(placed(a, nullptr, Vector2d::Zero()), placed(b, nullptr, Vector2d::Zero()), 60);
      const auto after =
          fit::scene_distance(placed(a, correction, centre), placed(b, correction, centre), 60);
      out["values"].push_back(result_value("scene_before_mm", "Same scene from two stage angles, uncorrected",
                                           {before.mean_mm, before.u_mm}, "mm"));
      out["values"].push_back(result_value("scene_after_mm", "The same, range and centre corrected",
                                           {after.mean_mm, after.u_mm}, "mm"));
      out["values"].push_back(plain_value("scene_improvement_percent", "Better by",
                                          improvement(before.mean_mm, after.mean_mm), "%"));
      return;
    }
    out["undetermined"].push_back(
        "the scene from two stage angles (A6): all captures were taken at the same one");
  }

  static void add_plot(json& out, const Surface& surface, const fit::Correction* correction) {
    json plot = new_plot("The flat sample, seen from above", "along (mm)", "ordinate (mm)");
    for (const bool after : {false, true}) {
      if (after && !correction) continue;
      std::vector<double> x, y;
      for (const Vector2d& p : points_of(surface, after ? correction : nullptr))
        x.push_back(p.x()), y.push_back(p.y());
      add_series(plot, after ? "corrected" : "uncorrected", "points", x, y);
    }
    out["plots"].push_back(std::move(plot));
  }

  static void count_outside(json& out, const std::vector<Surface>& surfaces,
                            const fit::Correction& correction) {
    long outside = 0, all = 0;
    for (const Surface& surface : surfaces)
      for (const Beam& beam : surface.beams)
        ++all, outside += !correction.apply(beam.range_mm, beam.intensity).inside();
    if (outside == 0) return;
    char text[160];
    std::snprintf(text, sizeof text,
                  "%.0f %% of the beams lie outside the region that the correction was calibrated for.",
                  100.0 * static_cast<double>(outside) / static_cast<double>(all));
    out["notes"].push_back(text);
  }
};

}  // namespace

std::unique_ptr<Fitting> make_validation() { return std::make_unique<Validation>(); }

}  // namespace rig::fittings
