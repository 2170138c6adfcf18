// SPDX-License-Identifier: MIT
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "fit/numeric/angle.hpp"
#include "fit/numeric/number_format.hpp"
#include "fit/range/range_calibration.hpp"
#include "fit/range/validation_measures.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/correction_source.hpp"
#include "rig/fitting/flat_surface.hpp"
#include "rig/fitting/one_lidar.hpp"
#include "rig/fitting/result_document.hpp"
#include "rig/session/lidar_identity.hpp"

namespace rig::fittings {
namespace {

using Eigen::Vector2d;
using nlohmann::json;

/// Per cent by which `after` is less than `before`. Their uncertainties are taken as independent, which they
/// are not: it is at most so uncertain.
fit::Estimate improvement(const fit::Estimate& before, const fit::Estimate& after) {
  const double ratio = after.value / before.value;
  return {100 * (1 - ratio), 100 * ratio * std::hypot(after.u / after.value, before.u / before.value)};
}

/// Half of a 95 % interval is 2.262 standard uncertainties (nine degrees of freedom of its jackknife).
double u_of_interval(double low, double high) { return (high - low) / 2 / 2.262; }

/// The lidar on the stage for which the axis is at `centre` in the lidar's frame.
fit::Mount mount_about(const Vector2d& centre, const fit::Estimate& yaw) {
  const Vector2d at = Eigen::Rotation2Dd(yaw.value) * -centre;
  return {{at.x()}, {at.y()}, yaw};
}

std::string percent(double part, double whole) {
  char text[32];
  std::snprintf(text, sizeof text, "%.0f %%", 100 * part / whole);
  return text;
}

std::string interval_text(const fit::Validity::Interval& interval, const char* unit) {
  char text[80];
  std::snprintf(text, sizeof text, "%.4g to %.4g %s", interval.from, interval.to, unit);
  return text;
}

class Validation : public Fitting {
 public:
  std::string kind() const override { return "validation"; }
  std::string describes() const override {
    return "a range correction judged on flat samples and on a scene seen from two stage angles";
  }
  std::vector<std::string> values() const override {
    return {"spread_20_before_mm", "spread_20_after_mm", "spread_20_improvement_percent",
            "spread_5_before_mm",  "spread_5_after_mm",  "spread_5_improvement_percent",
            "scene_before_mm",     "scene_after_mm",     "scene_improvement_percent"};
  }
  std::vector<FitOption> options() const override {
    using Type = FitOption::Type;
    return {{.name = "correction",
             .type = Type::text,
             .about = "correction file or session; without it, the session's own range calibration"},
            {.name = "target",
             .type = Type::text,
             .about = "the flat target; without it, what each capture is about"},
            {.name = "centre",
             .type = Type::text,
             .about = "session whose rotation centre is used; without it, the session's own, else the mount"},
            {.name = "centre_x_mm",
             .unit = "mm",
             .about = "rotation centre in the lidar's frame, x; takes precedence over the others"},
            {.name = "centre_y_mm", .unit = "mm", .about = "the same, y"}};
  }

  std::string doubt_about(const FitOptions& options) const override {
    if (!options.text("correction").empty()) return "";
    return "no correction is given (option correction). The session's own range calibration is judged if it "
           "has one; else no correction is, and an improvement says nothing.";
  }

  void check_files(const FitOptions& options) const override {
    try {
      if (const std::string file = options.text("correction"); !file.empty()) (void)load_correction(file);
      if (const std::string file = options.text("centre"); !file.empty())
        (void)load_centre(file, SessionStore(file, SessionStore::Mode::read));
    } catch (const MeasurementError& error) {
      throw UsageError(error.what());
    }
  }

  json run(const std::vector<FitSource>& sources, const FitOptions& options) const override {
    const Centre centre = centre_for(sources, options);
    std::vector<FlatSurface> surfaces;
    for (const FitSource& source : sources) {
      const auto recording = source.session->recording();
      const fit::Mount& stated = recording->bench().lidar.mount;
      const fit::Mount mount = centre.measured ? mount_about(centre.at_mm, stated.yaw_rad) : stated;
      for (std::size_t i = 0; i < recording->captures().size(); ++i)
        if (auto surface = surface_of(*recording, i, options.text("target"), mount))
          surfaces.push_back(std::move(*surface));
    }
    if (surfaces.empty())
      throw MeasurementError(
          "no capture sees a flat target that the bench file knows: run the procedure range-validation, or "
          "name the target");
    const auto correction = correction_for(sources, options);
    json out = new_result(
        "validation",
        "Zhao et al., experiments A3 and A6. A3: standard deviation of the difference "
        "between each point's ordinate and "
        "that of the 20th (5th) point before it, on the mean over all scans; for comparison the same across "
        "the best plane, because a slanted surface alone makes the paper's figure large. Intervals: 95 %, "
        "jackknife over ten blocks. A6: "
        "mean distance of the points of one stage angle from the line through those of the "
        "other, in one frame.");
    if (!correction)
      out["notes"].push_back(
          "No correction was given (option correction=FILE): figures are of the uncorrected ranges only.");
    add_spreads(out, surfaces, correction ? &*correction : nullptr);
    out["notes"].push_back("The rotation centre is " + centre.source + "." +
                           doubt_about(centre, sources.front().session->recording()->bench().lidar.mount));
    add_scene(out, surfaces, correction ? &*correction : nullptr, centre.at_mm);
    if (out["values"].empty())
      throw MeasurementError(
          "there is nothing to validate: no capture sees a flat target with enough neighbouring beams for "
          "differences, and no two see it from stage angles 5 deg or more apart. Run the procedure "
          "range-validation");
    for (const FlatSurface& surface : surfaces)
      add_surface_plots(out, surface, correction ? &*correction : nullptr);
    if (correction) {
      warn_of_another_lidar(out, sources, *correction);
      warn_of_use_outside(out, surfaces, *correction);
    }
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

  /// Where the stage's axis is in the lidar's frame.
  struct Centre {
    Vector2d at_mm = Vector2d::Zero();
    bool measured = false;  ///< Else by the bench file's mount.
    std::string source;
  };

  static Centre centre_for(const std::vector<FitSource>& sources, const FitOptions& options) {
    Centre out = centre_of_mount(sources.front().session->recording()->bench().lidar.mount);
    for (const FitSource& source : sources)
      if (const auto found = centre_of(*source.session)) out = {*found, true, "that of " + source.path};
    if (const std::string file = options.text("centre"); !file.empty()) {
      const SessionStore session(file, SessionStore::Mode::read);
      out = {load_centre(file, session), true, "that of " + file};
    }
    const auto x = options.maybe_number("centre_x_mm"), y = options.maybe_number("centre_y_mm");
    if (x.has_value() != y.has_value())
      throw UsageError("the options 'centre_x_mm' and 'centre_y_mm' belong together; give both");
    if (x) out = {{*x, *y}, true, "that of the options centre_x_mm and centre_y_mm"};
    return out;
  }

  /// A centre of another bench moves the scenes apart that it should bring together.
  static std::string doubt_about(const Centre& centre, const fit::Mount& mount) {
    constexpr double hardly_mm = 1, beyond_chance = 4;
    const double off_mm = (centre.at_mm - centre_of_mount(mount).at_mm).norm(),
                 u_mm = std::hypot(mount.x_mm.u, mount.y_mm.u);
    if (!centre.measured || !(off_mm > hardly_mm + beyond_chance * u_mm)) return "";
    return " It lies " + fit::format_fixed(off_mm, 1) +
           " mm from where the bench file's mount has it: one of them is wrong, or the centre is of another "
           "bench.";
  }

  static Centre centre_of_mount(const fit::Mount& mount) {
    return {Eigen::Rotation2Dd(-mount.yaw_rad.value) * -Vector2d(mount.x_mm.value, mount.y_mm.value), false,
            "by the bench file's mount, as no session holds a measured one"};
  }

  static void add_spreads(json& out, const std::vector<FlatSurface>& surfaces,
                          const fit::Correction* correction) {
    json rows = json::array();
    for (const int lag : {20, 5}) {
      fit::Estimate before_all{0}, after_all{0};
      const auto add_to = [](fit::Estimate& all, const fit::DifferenceSpread& spread) {
        all.value += spread.plane_sd_mm;
        all.u = std::hypot(all.u, u_of_interval(spread.plane_low_mm, spread.plane_high_mm));
      };
      int count = 0;
      for (const FlatSurface& surface : surfaces) {
        const auto before = fit::difference_spread(surface_points(surface, nullptr), lag);
        if (!std::isfinite(before.sd_mm)) continue;
        const auto after = fit::difference_spread(surface_points(surface, correction), lag);
        rows.push_back({surface.label, lag, before.sd_mm, before.low_mm, before.high_mm, after.sd_mm,
                        after.low_mm, after.high_mm, improvement(before.sd_mm, after.sd_mm).value,
                        before.plane_sd_mm, after.plane_sd_mm, after.plane_low_mm, after.plane_high_mm,
                        improvement(before.plane_sd_mm, after.plane_sd_mm).value});
        add_to(before_all, before), add_to(after_all, after), ++count;
      }
      if (count == 0) continue;
      const std::string name = "spread_" + std::to_string(lag),
                        words = "Spread of the " + std::to_string(lag) + "th difference, plane removed";
      for (fit::Estimate* all : {&before_all, &after_all}) all->value /= count, all->u /= count;
      out["values"].push_back(result_value(name + "_before_mm", words + ", uncorrected", before_all, "mm"));
      out["budget"].push_back(
          budget_line(words + ", uncorrected: differs along the surface", "A", before_all.u, "mm"));
      if (!correction) continue;
      out["values"].push_back(result_value(name + "_after_mm", words + ", corrected", after_all, "mm"));
      out["budget"].push_back(
          budget_line(words + ", corrected: differs along the surface", "A", after_all.u, "mm"));
      out["values"].push_back(result_value(name + "_improvement_percent", words + ": improvement",
                                           improvement(before_all, after_all), "%"));
    }
    out["tables"].push_back(
        {{"title", "Experiment A3: spread of ordinate differences before and after correction"},
         {"columns",
          {"capture", "difference", column("before", "mm"), column("from", "mm"), column("to", "mm"),
           column("after", "mm"), column("from", "mm"), column("to", "mm"), column("improvement", "%"),
           column("plane removed, before", "mm"), column("after", "mm"), column("from", "mm"),
           column("to", "mm"), column("improvement", "%")}},
         {"rows", rows}});
  }

  static void add_scene(json& out, const std::vector<FlatSurface>& surfaces,
                        const fit::Correction* correction, const Vector2d& centre) {
    for (std::size_t i = surfaces.size() - 1; i > 0; --i) {
      const FlatSurface &a = surfaces[i - 1], &b = surfaces[i];
      if (std::abs(fit::wrap_angle(a.stage_rad - b.stage_rad)) < 5 * fit::rad_per_deg) continue;
      const auto placed = [&](const FlatSurface& surface, const fit::Correction* with,
                              const Vector2d& about) {
        std::vector<Vector2d> points;
        for (const MeanBeam& beam : surface.beams)
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
      const std::string corrected =
          correction ? "range and centre corrected" : "about the centre that was found";
      out["values"].push_back(
          result_value("scene_after_mm", "The same, " + corrected, {after.mean_mm, after.u_mm}, "mm"));
      out["values"].push_back(
          result_value("scene_improvement_percent", "Mean distance of the same scene: improvement",
                       improvement({before.mean_mm, before.u_mm}, {after.mean_mm, after.u_mm}), "%"));
      out["budget"].push_back(
          budget_line("same scene: distances differ from point to point", "A", after.u_mm, "mm"));
      add_scene_plot(out, "Experiment A6: one scene from two stage angles, uncorrected", a, b,
                     placed(a, nullptr, Vector2d::Zero()), placed(b, nullptr, Vector2d::Zero()));
      add_scene_plot(out, "Experiment A6: the same, " + corrected, a, b, placed(a, correction, centre),
                     placed(b, correction, centre));
      return;
    }
    out["undetermined"].push_back(
        "the scene from two stage angles (A6): all captures were taken at the same one");
  }

  static void add_scene_plot(json& out, const std::string& title, const FlatSurface& a, const FlatSurface& b,
                             const std::vector<Vector2d>& points_a, const std::vector<Vector2d>& points_b) {
    json plot = new_plot(title, "x (mm)", "y (mm)");
    const auto add = [&](const FlatSurface& surface, const std::vector<Vector2d>& points) {
      std::vector<double> x, y;
      for (const Vector2d& p : points) x.push_back(p.x()), y.push_back(p.y());
      char name[48];
      std::snprintf(name, sizeof name, "stage at %.2f deg", surface.stage_rad * fit::deg_per_rad);
      add_series(plot, name, "points", x, y);
    };
    add(a, points_a), add(b, points_b);
    out["plots"].push_back(std::move(plot));
  }

  /// The sample as seen from above, and the differences whose spread the table has.
  static void add_surface_plots(json& out, const FlatSurface& surface, const fit::Correction* correction) {
    json above = new_plot("Experiment A3: " + surface.label + ", seen from above", "along the surface (mm)",
                          "ordinate (mm)");
    json plots = json::array();
    for (const int lag : {20, 5})
      plots.push_back(new_plot("Experiment A3: " + surface.label + ", difference from the " +
                                   std::to_string(lag) + "th point before",
                               "number of the point", "difference of ordinates (mm)"));
    for (const bool after : {false, true}) {
      if (after && !correction) continue;
      const std::vector<Vector2d> points = surface_points(surface, after ? correction : nullptr);
      const char* const name = after ? "corrected" : "uncorrected";
      std::vector<double> x, y;
      for (const Vector2d& p : points) x.push_back(p.x()), y.push_back(p.y());
      add_series(above, name, "points", x, y);
      for (std::size_t which = 0; which < 2; ++which) {
        const std::size_t lag = which == 0 ? 20 : 5;
        std::vector<double> number, difference;
        for (std::size_t i = lag; i < points.size(); ++i)
          number.push_back(static_cast<double>(i + 1)),
              difference.push_back(points[i].y() - points[i - lag].y());
        if (!number.empty()) add_series(plots[which], name, "line", number, difference);
      }
    }
    out["plots"].push_back(std::move(above));
    for (json& plot : plots)
      if (!plot["series"].empty()) out["plots"].push_back(std::move(plot));
  }

  static void warn_of_another_lidar(json& out, const std::vector<FitSource>& sources,
                                    const fit::Correction& correction) {
    for (const FitSource& source : sources) {
      const LidarIdentity lidar = lidar_of(*source.session);
      const bool other_firmware = !lidar.firmware.empty() && !correction.lidar_firmware.empty() &&
                                  lidar.firmware != correction.lidar_firmware;
      if (match_lidar(correction.lidar_model, correction.lidar_serial, lidar).another)
        out["notes"].push_back("The correction belongs to another lidar (" + correction.lidar_model + " " +
                               correction.lidar_serial + ") than " + source.path + " (" +
                               lidar_in_words(*source.session) + "): these figures hold for neither.");
      else if (other_firmware)
        out["notes"].push_back("The correction was measured with firmware " + correction.lidar_firmware +
                               ", " + source.path + " with " + lidar.firmware + ".");
    }
  }

  /// Beams that the correction was not measured for, by each circumstance that it tells.
  static void warn_of_use_outside(json& out, const std::vector<FlatSurface>& surfaces,
                                  const fit::Correction& correction) {
    const fit::Validity& validity = correction.validity;
    long all = 0, by_range = 0, by_intensity = 0, by_beam = 0, by_temperature = 0;
    const auto outside = [](const std::optional<fit::Validity::Interval>& interval, double x) {
      return interval && !interval->holds(x);
    };
    for (const FlatSurface& surface : surfaces)
      for (const MeanBeam& beam : surface.beams) {
        const auto corrected = correction.apply(beam.range_mm, beam.intensity);
        ++all;
        by_range += corrected.range_outside || outside(validity.range_mm, corrected.range_mm);
        by_intensity += corrected.intensity_outside || outside(validity.intensity, beam.intensity);
        by_beam += outside(validity.beam_deg, beam.direction_rad * fit::deg_per_rad);
        by_temperature += surface.temperature_c && outside(validity.temperature_c, *surface.temperature_c);
      }
    const auto warn = [&](long count, const char* of_what,
                          const std::optional<fit::Validity::Interval>& interval, const char* unit) {
      if (count == 0) return;
      out["notes"].push_back(percent(static_cast<double>(count), static_cast<double>(all)) +
                             " of the beams lie outside the " + of_what +
                             " that the correction was measured over" +
                             (interval ? ", " + interval_text(*interval, unit) : "") + ".");
    };
    warn(by_range, "distances", validity.range_mm, "mm");
    warn(by_intensity, "intensities", validity.intensity, "counts");
    warn(by_beam, "beam directions", validity.beam_deg, "deg");
    warn(by_temperature, "temperatures", validity.temperature_c, "deg C");
    if (validity.temperature_c && std::ranges::none_of(surfaces, [](const FlatSurface& surface) {
          return surface.temperature_c.has_value();
        }))
      out["undetermined"].push_back(
          "whether the correction holds at this temperature: these captures do not say");
  }
};

}  // namespace

std::unique_ptr<Fitting> make_validation() { return std::make_unique<Validation>(); }

}  // namespace rig::fittings
