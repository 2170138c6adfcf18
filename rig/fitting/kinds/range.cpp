// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "fit/numeric/angle.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/fitting/one_lidar.hpp"
#include "rig/fitting/range_source.hpp"
#include "rig/fitting/range_tables.hpp"
#include "rig/fitting/result_document.hpp"
#include "rig/fitting/uncertainty_budget.hpp"
#include "rig/session/lidar_identity.hpp"
#include "rig/session/session_dates.hpp"

namespace rig::fittings {
namespace {

using namespace range_parts;
using fit::Correction;
using fit::FamilyFit;
using nlohmann::json;

/// Points of one way of selecting samples.
std::vector<fit::RangePoint> points_of(const RangeSource& source, bool robust) {
  std::vector<fit::RangePoint> out;
  for (const RangeCapture& capture : source.captures)
    out.push_back(capture.point(robust ? capture.robust : capture.paper));
  return out;
}

std::string counts_in_words(double counts) { return fit::format_fixed(counts, 0) + " counts"; }

/// The captures whose errors stand in front: all of a few, of many some that lie evenly from the nearest to
/// the farthest.
std::vector<RangeCapture> spread_over_distance(std::vector<RangeCapture> captures) {
  constexpr std::size_t all_of = 12, of_many = 9;
  if (captures.size() <= all_of) return captures;
  std::ranges::stable_sort(captures, {}, &RangeCapture::true_mm);
  std::vector<RangeCapture> out;
  for (std::size_t i = 0; i < of_many; ++i)
    out.push_back(captures[i * (captures.size() - 1) / (of_many - 1)]);
  return out;
}

class Range : public Fitting {
 public:
  std::string kind() const override { return "range"; }
  std::string describes() const override {
    return "range error against echo strength and distance, and the correction that follows";
  }
  std::vector<std::string> values() const override {
    return {"error_at_*_mm", "rms_error_before_mm",  "rms_error_after_mm",  "held_out_error_mm",
            "largest_u_mm",  "scatter_intensity_mm", "scatter_distance_mm", "zero_mm"};
  }
  std::vector<FitOption> options() const override {
    std::vector<std::string> families;
    for (const fit::Family& family : fit::all_families())
      if (!family.honest_reference) families.push_back(family.id);
    return {
        {.name = "selection",
         .type = FitOption::Type::choice,
         .choices = {"robust", "paper"},
         .otherwise = "robust",
         .about = "samples that the correction is made from; paper: those of the most frequent intensity"},
        {.name = "intensity",
         .type = FitOption::Type::choice,
         .choices = families,
         .about = "family of the intensity curve; without it, the one that predicts best"},
        {.name = "distance",
         .type = FitOption::Type::choice,
         .choices = families,
         .about = "family of the distance curve; without it, the one that predicts best"},
        {.name = "reference_intensity",
         .unit = "counts",
         .min = 1,
         .max = 65535,
         .about =
             "where the intensity error counts as 0; without it, the largest at the reference distance"}};
  }

  json run(const std::vector<FitSource>& sources, const FitOptions& options) const override {
    const std::string selection = options.text("selection");
    demand_one_lidar(sources, "range calibration");
    const RangeSource source = read_ranges(sources);
    fit::RangeOptions how;
    how.intensity_family = options.text("intensity"), how.distance_family = options.text("distance");
    how.reference_intensity = options.maybe_number("reference_intensity").value_or(0);
    for (const RangeCapture& c : source.captures) {
      how.placement_u_mm = std::max(how.placement_u_mm, c.u_placement_mm);
      how.common_u_mm = std::max(how.common_u_mm, c.u_common_mm());
    }
    auto points = points_of(source, selection == "robust");
    fit::RangeCalibration calibration = fit::calibrate_range(points, how);
    fit::sort_into_experiments(points);
    json out = new_result("range", method(selection == "robust"));
    out["tables"].push_back(captures_table(source));
    add_values(out, source, points, calibration, selection == "robust");
    if (!calibration.intensity_table.empty() || !calibration.distance_table.empty())
      out["tables"].push_back(paper_table(calibration, selection == "robust"));
    if (!calibration.intensity_table.empty())
      add_families(out["tables"], calibration.intensity_table, "Experiment A1, error against intensity");
    if (!calibration.distance_table.empty())
      add_families(out["tables"], calibration.distance_table, "Experiment A2, error against distance");
    if (calibration.joint) add_correction(out, sources, source, points, calibration, how, selection);
    if (!calibration.joint) out["plots"].push_back(points_plot(points, nullptr, false));
    out["tables"].push_back(robust_table(source));
    out["tables"].push_back(selection_table(source));
    note_correction(out, sources);
    for (const std::string& note : source.notes) out["notes"].push_back(note);
    for (const std::string& contradiction : source.contradictions)
      out["contradictions"].push_back(contradiction);
    for (const std::string& note : calibration.notes) out["notes"].push_back(note);
    if (!calibration.why_not.empty()) out["undetermined"].push_back("no correction: " + calibration.why_not);
    for (const std::string& sentence : calibration.identifiability) out["undetermined"].push_back(sentence);
    return out;
  }

 private:
  /// What a correction leaves is no error of the lidar, and nothing to correct robots by.
  static void note_correction(json& out, const std::vector<FitSource>& sources) {
    for (const FitSource& source : sources) {
      if (!source.session->get("correction")) continue;
      out["notes"].push_back(
          "The ranges of " + source.path +
          " were corrected by `rig apply`: these errors are what the correction leaves, not "
          "the lidar's, and no correction is made from them.");
      if (out.contains("data")) out["data"].erase("correction");
      out["use"] = json::array();
    }
  }

  static std::string method(bool robust) {
    return "Range calibration after Zhao et al., experiments A1 and A2: error of the beam square on a flat "
           "target at known distances. " +
           std::string(robust ? "Huber's mean of all samples is used; the paper's, of the samples of the "
                                "most frequent intensity without abnormal values and impulse noise, is given "
                                "for comparison in the tables that name it. "
                              : "Abnormal values and impulse noise are removed and the samples of the most "
                                "frequent intensity averaged; Huber's mean of all samples is given for "
                                "comparison. ") +
           "Families of curves are fitted by separable least squares from many starts and sorted by their "
           "error at blocks of points that were held out. Intensity and distance errors are then fitted "
           "together.";
  }

  static void add_values(json& out, const RangeSource& source, const std::vector<fit::RangePoint>& points,
                         const fit::RangeCalibration& calibration, bool robust) {
    std::set<long> named;
    for (const RangeCapture& c : spread_over_distance(source.captures)) {
      const fit::SelectedMean& selected = robust ? c.robust : c.paper;
      const fit::RangePoint p = c.point(selected);
      if (!named.insert(std::lround(p.true_mm)).second) continue;
      UncertaintyBudget budget("error_at_" + fit::format_fixed(p.true_mm, 0) + "_mm",
                               "Range error at " + fit::format_fixed(p.true_mm, 0) + " mm" +
                                   (p.intensity > 0 ? ", " + counts_in_words(p.intensity) : "") +
                                   ", from one capture",
                               "mm");
      budget.add({.source = "mean of the samples",
                  .kind = 'A',
                  .distribution = "normal",
                  .u = std::sqrt(std::max(0.0, p.u_mm * p.u_mm - selected.u_drift_mm * selected.u_drift_mm)),
                  .freedom = std::max(1.0, selected.effective - 1)});
      if (selected.u_drift_mm > 0)
        budget.add(
            {.source = "drift within the capture", .distribution = "rectangular", .u = selected.u_drift_mm});
      budget.add({.source = "placement of the target (bench file)",
                  .distribution = "normal",
                  .u = c.u_placement_mm});
      budget.add({.source = "lidar's place on the stage (bench file's mount)",
                  .distribution = "normal",
                  .u = c.u_mount_mm});
      budget.publish(out, p.error_mm());
    }
    out["values"].push_back(plain_value("rms_error_before_mm", "RMS range error of the captures, uncorrected",
                                        calibration.rms_before_mm, "mm"));
    if (calibration.joint) {
      out["values"].push_back(plain_value("rms_error_after_mm", "RMS range error of the captures, corrected",
                                          calibration.rms_after_mm, "mm"));
      out["values"].push_back(plain_value("held_out_error_mm",
                                          "RMS range error, each capture predicted from the others",
                                          calibration.held_out_mm, "mm"));
      double worst = 0;
      for (const fit::RangePoint& p : points)
        worst = std::max(worst, calibration.joint->u(p.measured_mm, p.intensity));
      out["values"].push_back(plain_value(
          "largest_u_mm", "Largest standard uncertainty of the correction at a measured point", worst, "mm"));
    }
    const auto scatter = [&](long captures, double u, const std::string& experiment) {
      if (captures > 0)
        out["values"].push_back(plain_value(
            "scatter_" + experiment + "_mm",
            "Scatter between captures, " + experiment +
                (captures < fit::fewest_that_scatter ? ", as the bench file states the placement" : ""),
            u, "mm"));
    };
    scatter(calibration.points_intensity, calibration.scatter_intensity_mm, "intensity");
    scatter(calibration.points_distance, calibration.scatter_distance_mm, "distance");
    double placement = 0, mount = 0;
    for (const RangeCapture& c : source.captures)
      placement = std::max(placement, c.u_placement_mm), mount = std::max(mount, c.u_mount_mm);
    if (mount > placement)
      out["notes"].push_back(
          "Where the lidar sits on the stage is known to U = " + fit::formatted("%.2g", 2 * mount) +
          " mm (k = 2) only, and every range error contains that: calibrate it first "
          "(procedure rotation-centre) and write it into the bench file's mount.");
  }

  void add_correction(json& out, const std::vector<FitSource>& sources, const RangeSource& source,
                      const std::vector<fit::RangePoint>& points, fit::RangeCalibration& calibration,
                      const fit::RangeOptions& how, const std::string& selection) const {
    Correction& correction = *calibration.joint;
    describe(correction, sources, source, calibration);
    note_what_is_not_stated(out, correction);
    const fit::RangePoint& middle = points[points.size() / 2];
    if (std::isfinite(correction.apply(middle.measured_mm, middle.intensity).range_mm))
      out["use"].push_back(how_to_use(correction, middle));
    if (correction.intensity && correction.range) {
      UncertaintyBudget budget("zero_mm",
                               "Range error at the reference condition (" +
                                   fit::format_fixed(correction.reference_mm, 0) + " mm, " +
                                   fit::format_fixed(correction.reference_intensity, 0) +
                                   " counts), from the curves through all captures",
                               "mm");
      budget.add(
          {.source = "fit of both curves", .kind = 'A', .distribution = "normal", .u = correction.zero_mm.u});
      budget.add({.source = "true distances, common to all (bench file)",
                  .distribution = "normal",
                  .u = correction.common_u_mm});
      budget.publish(out, correction.zero_mm.value);
    }
    flag_misplaced(out, source, points, correction, how);
    if (correction.intensity) out["plots"].push_back(points_plot(points, &correction, true));
    if (correction.range) out["plots"].push_back(points_plot(points, &correction, false));
    out["plots"].push_back(residual_plot(points, correction));
    out["tables"].push_back(coefficients_table(correction));
    if (calibration.sequential) {
      double largest = 0;
      out["tables"].push_back(methods_table(calibration, points, largest));
      out["notes"].push_back(
          "Fitted jointly and by the paper's sequential method, the correction differs by " +
          fit::format_fixed(largest, 2) + " mm at most at the measured points.");
    }
    compare_selections(out, source, correction, selection);
    out["data"] = {{"correction", json::parse(fit::to_json_text(correction))},
                   {"selection", selection},
                   {"condition_number", number_or_null(calibration.condition)},
                   {"intensity_distance_correlation", number_or_null(calibration.correlation)}};
    warn_of_the_reference(out, calibration);
    warn_of_no_fit(out, calibration);
  }

  /// Says so where not one family with an equation fits.
  static void warn_of_no_fit(json& out, const fit::RangeCalibration& calibration) {
    for (const auto* table : {&calibration.intensity_table, &calibration.distance_table}) {
      const FamilyFit* best = fit::best_of(*table);
      if (!best || std::ranges::any_of(*table, [](const FamilyFit& fit) {
            return fit.usable && !fit.spline && !fit.ambiguous && !fit.lacks_fit();
          }))
        continue;
      out["undetermined"].push_back(
          "None of these families fits the error against " +
          std::string(table == &calibration.intensity_table ? "intensity" : "distance") +
          ": the residuals have structure that the points' scatter does not explain (fit p below 0.01 for "
          "all). The "
          "correction is the best of them, and its uncertainty is that of its own residuals. A target that "
          "steps "
          "back, or a wrong distance, leaves such structure too; rig explain looks for the physics behind "
          "it.");
    }
  }

  static constexpr double far_off = 6,
                          least_reported_mm = 1;  ///< Standard uncertainties, and mm beside them.

  /// A capture whose target stood elsewhere, and how far it lies from the curve.
  struct Misplaced {
    std::size_t capture = 0;
    double mm = 0;
  };

  static double off_mm(const Correction& curve, const fit::RangePoint& p) {
    return std::abs(curve.apply(p.measured_mm, p.intensity).range_mm - p.true_mm);
  }

  /// Those far from the curve by the scatter of all, which a few of them do not change.
  static std::vector<Misplaced> far_from_all(const RangeSource& source,
                                             const std::vector<fit::RangePoint>& points,
                                             const Correction& curve) {
    std::vector<double> sizes;
    for (const fit::RangePoint& p : points) sizes.push_back(off_mm(curve, p));
    std::vector<double> sorted = sizes;
    std::ranges::nth_element(sorted, sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2));
    const double spread = 1.4826 * sorted[sorted.size() / 2];
    std::vector<Misplaced> list;
    for (std::size_t i = 0; i < points.size(); ++i)
      if (sizes[i] >
          far_off * std::hypot(spread, points[i].u_mm, source.captures[i].u_placement_mm) + least_reported_mm)
        list.push_back({i, sizes[i]});
    return list;
  }

  /// The one farthest from the curve through the others, which it cannot bend to itself.
  static std::optional<Misplaced> far_from_others(const RangeSource& source,
                                                  const std::vector<fit::RangePoint>& points,
                                                  const fit::RangeOptions& how) {
    constexpr std::size_t most = 40;  // of more, one hardly bends the curve
    std::optional<Misplaced> farthest;
    double beyond = 1;
    for (std::size_t i = 0; points.size() <= most && i < points.size(); ++i) {
      const fit::RangePoint& p = points[i];
      std::vector<fit::RangePoint> others = points;
      others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
      const fit::RangeCalibration without = fit::calibrate_range(std::move(others), how);
      if (!without.joint || !without.joint->apply(p.measured_mm, p.intensity).inside()) continue;
      const double u_mm = std::hypot(std::max(without.scatter_intensity_mm, without.scatter_distance_mm),
                                     std::hypot(without.joint->u(p.measured_mm, p.intensity), p.u_mm,
                                                source.captures[i].u_placement_mm)),
                   mm = off_mm(*without.joint, p), by = mm / (far_off * u_mm + least_reported_mm);
      if (by <= beyond) continue;
      beyond = by;
      farthest = {i, mm};
    }
    return farthest;
  }

  /// Captures far from the curve: their targets stood elsewhere. Where none can be named, as in a few, which
  /// bend the curve to themselves, it is told of all of them.
  static void flag_misplaced(json& out, const RangeSource& source, const std::vector<fit::RangePoint>& points,
                             const Correction& correction, const fit::RangeOptions& how) {
    std::vector<Misplaced> misplaced;
    if (std::ssize(points) >= fit::fewest_that_scatter) {
      misplaced = far_from_all(source, points, correction);
      if (misplaced.empty())
        if (const auto one = far_from_others(source, points, how)) misplaced.push_back(*one);
    }
    for (const Misplaced& one : misplaced)
      out["contradictions"].push_back(source.captures[one.capture].label + " lies " +
                                      fit::format_fixed(one.mm, 1) +
                                      " mm from the curve through the others: its target stood elsewhere");
    if (!misplaced.empty()) return;
    double squares = 0, stated_mm = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      squares += std::pow(off_mm(correction, points[i]), 2);
      stated_mm = std::max(stated_mm, std::hypot(points[i].u_mm, source.captures[i].u_placement_mm));
    }
    const double rms_mm = std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, points.size())));
    if (rms_mm > far_off * stated_mm + least_reported_mm)
      out["contradictions"].push_back(
          "the captures lie " + fit::format_fixed(rms_mm, 1) +
          " mm (RMS) from the best curve through them, though the bench file knows their distances to u "
          "= " +
          fit::format_value(stated_mm, stated_mm) +
          " mm: a target stood elsewhere than stated, or the error follows no such curve. Measure the "
          "distances again, and add some");
  }

  static std::string how_to_use(const Correction& correction, const fit::RangePoint& point) {
    const double measured_mm = std::round(point.measured_mm), counts = std::round(point.intensity);
    return "The error is positive where the lidar measures too far, and is subtracted: corrected = "
           "measured - error. Example: " +
           fit::format_fixed(measured_mm, 0) + " mm measured" +
           (counts > 0 ? " with " + counts_in_words(counts) : "") + " become " +
           fit::format_fixed(correction.apply(measured_mm, counts).range_mm, 2) +
           " mm, U = " + fit::format_fixed(2 * correction.u(measured_mm, counts), 2) +
           " mm (k = 2, of the correction; a single range has its own noise in addition). `rig export` "
           "writes "
           "it for robots: as a C or C++ header, a table, or ROS 2 parameters.";
  }

  /// Where the smoother without an equation predicts much better, no family follows the data.
  static void warn_of_the_reference(json& out, const fit::RangeCalibration& calibration) {
    for (const auto* table : {&calibration.intensity_table, &calibration.distance_table}) {
      const auto spline =
          std::ranges::find_if(*table, [](const FamilyFit& fit) { return fit.usable && fit.spline; });
      const FamilyFit* best = fit::best_of(*table);
      if (spline == table->end() || !best || spline->held_out > 0.7 * best->held_out) continue;
      out["notes"].push_back("No family follows the error against " +
                             std::string(table == &calibration.intensity_table ? "intensity" : "distance") +
                             " well: a smooth curve without an equation predicts held-out points to " +
                             fit::format_fixed(spline->held_out, 2) + " mm, the best family (" + best->title +
                             ") to " + fit::format_fixed(best->held_out, 2) +
                             " mm. rig explain looks for the physics behind it.");
    }
  }

  static void compare_selections(json& out, const RangeSource& source, const Correction& correction,
                                 const std::string& selection) {
    double sum = 0, largest = 0;
    for (const RangeCapture& c : source.captures) {
      const double corrected_a = correction.apply(c.point(c.paper).measured_mm, c.paper.intensity).range_mm;
      const double corrected_b = correction.apply(c.point(c.robust).measured_mm, c.robust.intensity).range_mm;
      sum += std::pow(corrected_a - corrected_b, 2);
      largest = std::max(largest, std::abs(corrected_a - corrected_b));
    }
    // Both from the same captures: over all of them, their mean difference is what one way adds to the other,
    // and a drift is in both.
    double mean = 0, u2 = 0;
    const auto captures = static_cast<double>(source.captures.size());
    for (const RangeCapture& c : source.captures) {
      mean += (correction.apply(c.point(c.paper).measured_mm, c.paper.intensity).range_mm -
               correction.apply(c.point(c.robust).measured_mm, c.robust.intensity).range_mm) /
              captures;
      for (const fit::SelectedMean* of : {&c.paper, &c.robust})
        u2 += std::max(0.0, of->u_mm * of->u_mm - of->u_drift_mm * of->u_drift_mm) / (captures * captures);
    }
    compare_methods(
        out, "Corrected range against its mean over the captures",
        {"from all samples", {0, std::sqrt(u2 / 2)}},
        {"from the samples of the most frequent intensity", {mean, std::hypot(std::sqrt(u2 / 2), 0.1)}},
        "mm");
    out["notes"].push_back(
        "The correction is made from the " +
        std::string(selection == "robust" ? "robust means of all samples"
                                          : "means of the most frequent intensity") +
        "; corrected, the two ways of selecting samples differ by " +
        fit::format_fixed(std::sqrt(sum / static_cast<double>(source.captures.size())), 2) + " mm RMS and " +
        fit::format_fixed(largest, 2) + " mm at most.");
  }

  static json residual_plot(const std::vector<fit::RangePoint>& points, const Correction& correction) {
    // Over what was varied: at one distance only the echo's strength.
    const auto [nearest, farthest] = std::ranges::minmax(points, {}, &fit::RangePoint::true_mm);
    const bool one_distance = farthest.true_mm - nearest.true_mm < 0.02 * farthest.true_mm;
    json plot = new_plot("Error left after the correction",
                         one_distance ? "intensity (counts)" : "range (mm)", "error (mm)");
    std::vector<double> x, y, u;
    for (const fit::RangePoint& p : points) {
      x.push_back(one_distance ? p.intensity : p.true_mm), u.push_back(2 * p.u_mm);
      y.push_back(correction.apply(p.measured_mm, p.intensity).range_mm - p.true_mm);
    }
    add_series(plot, "corrected, k = 2 of the mean", "errorbars", x, y, u);
    return plot;
  }

  static fit::Validity validity_of(const RangeSource& source) {
    fit::Validity out;
    const auto include = [](std::optional<fit::Validity::Interval>& interval, double from, double to) {
      if (!interval) interval = fit::Validity::Interval{from, to};
      interval->include(from), interval->include(to);
    };
    for (const RangeCapture& c : source.captures) {
      include(out.range_mm, c.true_mm, c.true_mm);
      include(out.intensity, c.paper.intensity, c.paper.intensity);
      include(out.beam_deg, c.beam_deg - c.beam_step_deg / 2, c.beam_deg + c.beam_step_deg / 2);
      if (c.temperature_c) include(out.temperature_c, *c.temperature_c, *c.temperature_c);
    }
    return out;
  }

  /// By distance, which echoes were seen there; nothing where the lidar sent no intensities.
  static std::vector<Correction::Measured> measured_by(const RangeSource& source) {
    constexpr double one_place_mm = 2;
    std::vector<Correction::Measured> out;
    for (const RangeCapture& c : source.captures) {
      if (c.robust.intensity <= 0) return {};
      out.push_back({c.true_mm, c.robust.intensity, c.robust.intensity});
    }
    std::ranges::sort(out, {}, &Correction::Measured::range_mm);
    std::vector<Correction::Measured> joined;
    for (const Correction::Measured& m : out) {
      if (joined.empty() || m.range_mm - joined.back().range_mm > one_place_mm) joined.push_back(m);
      joined.back().from = std::min(joined.back().from, m.from);
      joined.back().to = std::max(joined.back().to, m.to);
    }
    return joined;
  }

  /// What a user of the correction must know that the sessions do not say.
  static void note_what_is_not_stated(json& out, const Correction& correction) {
    const auto say = [&](bool missing, const char* what) {
      if (missing) out["undetermined"].push_back(what);
    };
    say(correction.lidar_serial.empty(),
        "which lidar the correction belongs to: the session has no serial number");
    say(!correction.validity.temperature_c,
        "at which temperature the correction holds: no capture has one (prompt with place: {temperature_c})");
  }

  static void describe(Correction& correction, const std::vector<FitSource>& sources,
                       const RangeSource& source, const fit::RangeCalibration& calibration) {
    const SessionStore& session = *sources.front().session;
    const LidarIdentity lidar = lidar_of(session);
    correction.lidar_model = lidar.name(), correction.lidar_serial = lidar.serial;
    correction.lidar_firmware = lidar.firmware;
    correction.validity = validity_of(source);
    correction.measured = measured_by(source);
    correction.created_utc = dates_of(session).measured_utc;
    correction.software = "rig " RIG_VERSION;
    for (const FitSource& file : sources) {
      correction.session_sha256.push_back(file.session->content_hash());
      const std::string procedure =
          file.session->get("procedure_name").value_or(file.session->get("kind").value_or(""));
      if (procedure.size() < 100)
        correction.procedure += (correction.procedure.empty() ? "" : ", ") + procedure;
    }
    for (const std::string& sentence : calibration.identifiability) correction.notes.push_back(sentence);
  }
};

}  // namespace

std::unique_ptr<Fitting> make_range() { return std::make_unique<Range>(); }

}  // namespace rig::fittings
