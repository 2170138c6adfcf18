// SPDX-License-Identifier: MIT
#include "rig/fitting/range_tables.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "fit/numeric/number_format.hpp"
#include "rig/fitting/result_document.hpp"

namespace rig::range_parts {

using fit::Correction;
using fit::FamilyFit;
using nlohmann::json;

namespace {

/// For tables that people read: so many significant digits.
json digits(double value, int count = 3) {
  if (!std::isfinite(value) || value == 0) return number_or_null(value);
  const double unit = std::pow(10.0, std::floor(std::log10(std::abs(value))) - count + 1);
  return std::round(value / unit) * unit;
}

/// Hundredths of a millimetre.
json hundredths(double mm) { return number_or_null(std::round(mm * 100) / 100); }

/// A coefficient's standard uncertainty, or why it has none.
json u_of_coefficient(double u, bool is_determined, const Eigen::MatrixXd& factor) {
  // Directions that the points do not determine at all are columns of zeros: no u is to be had from the rest.
  const bool is_complete = (factor.colwise().norm().array() > 0).all();
  if (is_determined && is_complete) return number_or_null(u);
  return is_complete && u == 0 ? "cancels" : "not determined";
}

/// Every family's equation with its coefficients: whoever prefers another than the best finds it here.
json family_coefficients(const std::vector<FamilyFit>& fits, const std::string& title) {
  json rows = json::array();
  for (const FamilyFit& fit : fits) {
    if (!fit.usable || fit.spline) continue;
    const auto is_determined = fit::determined_coefficients(*fit::find_family(fit.family), fit.coefficients,
                                                            fit.factor, fit.from, fit.to);
    for (std::size_t i = 0; i < fit.coefficients.size(); ++i)
      rows.push_back({i == 0 ? fit.title + ": " + fit.equation : "", fit.names[i],
                      fit::format_exactly(fit.coefficients[i]),
                      u_of_coefficient(fit.coefficient(i).u, is_determined[i], fit.factor)});
  }
  return {{"title", title + ": coefficients of every family, all digits (not determined: the others make up "
                            "for a change of it)"},
          {"columns", {"family", "coefficient", "value", "u"}},
          {"rows", rows}};
}

struct Curve {
  std::vector<double> x, y, expanded;
};

/// One term over its argument with its k = 2 band, the other terms left out.
Curve drawn(const Correction& c, bool over_intensity) {
  Correction only = c;
  (over_intensity ? only.range : only.intensity).reset();
  const auto names = c.parameter_names();
  std::vector<Eigen::Index> rows = {0};
  for (std::size_t i = 1; i < names.size(); ++i)
    if (names[i].starts_with(over_intensity ? "intensity." : "range."))
      rows.push_back(static_cast<Eigen::Index>(i));
  only.factor.resize(static_cast<Eigen::Index>(rows.size()), c.factor.cols());
  for (std::size_t i = 0; i < rows.size(); ++i)
    only.factor.row(static_cast<Eigen::Index>(i)) = c.factor.row(rows[i]);
  only.common_u_mm = 0;
  const fit::CorrectionTerm& term = over_intensity ? *c.intensity : *c.range;
  Curve out;
  for (int i = 0; i <= 120; ++i) {
    const double x = term.from + (term.to - term.from) * i / 120;
    const double measured = over_intensity ? only.reference_mm : x + only.zero_mm.value;
    const double y = only.zero_mm.value + term.value(x), u = only.u(measured, x);
    out.x.push_back(x), out.y.push_back(y), out.expanded.push_back(2 * u);
  }
  return out;
}

void add_curve(json& plot, const Curve& curve, const char* name) {
  add_series(plot, "k = 2", "band", curve.x, curve.y, curve.expanded);
  add_series(plot, name, "line", curve.x, curve.y);
}

}  // namespace

json captures_table(const RangeSource& source) {
  json rows = json::array();
  for (const RangeCapture& c : source.captures) {
    const fit::RangePoint point = c.point(c.paper);
    rows.push_back({c.label, hundredths(point.true_mm), hundredths(point.measured_mm),
                    hundredths(point.error_mm()), digits(point.u_mm),
                    digits(2 * std::hypot(point.u_mm, c.u_true_mm())), c.paper.intensity, c.paper.kept});
  }
  return {{"title",
           "Range error of each capture: beam square on the target, mean of the most frequent intensity"},
          {"columns",
           {"capture", column("true", "mm"), column("mean", "mm"), column("error", "mm"),
            column("u(mean)", "mm"), column("U(error)", "mm"), "counts", "samples"}},
          {"rows", rows}};
}

json robust_table(const RangeSource& source) {
  json rows = json::array();
  for (const RangeCapture& c : source.captures)
    rows.push_back({c.label, hundredths(c.true_mm), hundredths(c.beam_deg),
                    c.normal_from_data ? "data" : "bench file",
                    hundredths(c.robust.mean_mm - c.oblique_mm - c.true_mm), digits(c.robust.u_mm),
                    hundredths(c.robust.trend.rise.value), hundredths(2 * c.robust.trend.rise.u),
                    digits(c.robust.intensity, 5)});
  return {
      {"title",
       "The beam, and the robust alternative: Huber's mean of all samples (drift: from the first to the last "
       "sample)"},
      {"columns",
       {"capture", column("true", "mm"), column("beam", "deg"), "normal from", column("error", "mm"),
        column("u(mean)", "mm"), column("drift", "mm"), column("U(drift)", "mm"), "mean counts"}},
      {"rows", rows}};
}

json selection_table(const RangeSource& source) {
  json rows = json::array();
  for (const RangeCapture& c : source.captures)
    rows.push_back({c.label, c.paper.samples, c.paper.rejected.no_echo, c.paper.rejected.abnormal,
                    c.paper.rejected.impulse, c.paper.rejected.other_intensity, c.paper.kept, c.robust.kept,
                    digits(c.paper.sd_mm), digits(c.robust.effective, 4)});
  return {{"title", "Selection of samples, each rejected one counted under its first reason"},
          {"columns",
           {"capture", "samples", "no echo", "abnormal", "impulse", "other", "kept", "robust",
            column("sd", "mm"), "worth"}},
          {"rows", rows}};
}

json paper_table(const fit::RangeCalibration& calibration, bool robust) {
  const std::vector<std::string> families = {"exponential-2", "fourier-2", "polynomial-3", "power-2",
                                             "rational-33"};
  json columns = {"experiment"}, rows = json::array();
  for (const std::string& family : families) columns.push_back(fit::find_family(family)->title);
  const auto add = [&](const std::vector<FamilyFit>& fits, const std::string& experiment) {
    if (std::ranges::none_of(fits, &FamilyFit::usable)) return;  // another experiment's session
    json rmse = {experiment + ": RMSE (mm)"}, r2 = {experiment + ": R2"};
    for (const std::string& family : families) {
      const auto fit = std::ranges::find(fits, family, &FamilyFit::family);
      const bool is_there = fit != fits.end() && fit->usable;
      rmse.push_back(is_there ? json(fit::format_fixed(fit->rmse, 3)) : json(nullptr));
      r2.push_back(is_there ? json(fit::format_fixed(fit->r2, 4)) : json(nullptr));
    }
    rows.push_back(rmse);
    rows.push_back(r2);
  };
  add(calibration.intensity_table, "A1 intensity");
  add(calibration.distance_table, "A2 distance");
  return {{"title", std::string("Five families of curves (Zhao et al.), ") +
                        (robust ? "from Huber's means of all samples (the paper's: --option selection=paper)"
                                : "from the means of the most frequent intensity")},
          {"columns", columns},
          {"rows", rows}};
}

void add_families(json& tables, const std::vector<FamilyFit>& fits, const std::string& title) {
  json rows = json::array(), words = json::array();
  for (const FamilyFit& fit : fits) {
    if (!fit.usable) words.push_back({fit.title, fit.message});
    for (const std::string& remark : fit.remarks) words.push_back({fit.title, remark});
    if (!fit.usable) continue;
    rows.push_back({fit.title, digits(fit.held_out), digits(fit.r2, 5), digits(fit.rmse, 4),
                    digits(fit.fit_p, 2), digits(fit.parameters), digits(fit.aicc, 4), digits(fit.bic, 4),
                    fit.spline ? json(nullptr) : digits(fit.condition, 2),
                    fit.spline ? json(nullptr) : digits(fit.printed_mm, 2)});
  }
  tables.push_back(
      {{"title",
        title +
            ": families by their error at held-out points (condition: of the coefficients; "
            "4 digits: error of the curve when they are printed so; fit p: how often the right "
            "family leaves such residuals; below 0.01 a family does not fit; empty: too few points to "
            "tell, which takes " +
            std::to_string(fit::fewest_for_fit_p) + ")"},
       {"columns",
        {"family", column("held out", "mm"), "R2", column("RMSE", "mm"), "fit p", "coeff.", "AICc", "BIC",
         "condition", column("4 digits", "mm")}},
       {"rows", rows}});
  if (!words.empty())
    tables.push_back({{"title", title + ": what must be known about these families"},
                      {"columns", {"family", "remark"}},
                      {"rows", words}});
  if (json coefficients = family_coefficients(fits, title); !coefficients["rows"].empty())
    tables.push_back(std::move(coefficients));
}

json coefficients_table(const Correction& c) {
  json rows = json::array();
  const auto names = c.parameter_names();
  std::vector<double> values = {c.zero_mm.value};
  std::vector<bool> is_determined = {true};
  for (const auto* term : {&c.intensity, &c.range}) {
    if (!*term) continue;
    const auto& own = (*term)->coefficients;
    const auto rows_before = static_cast<Eigen::Index>(values.size());
    values.insert(values.end(), own.begin(), own.end());
    const auto own_determined =
        fit::determined_coefficients(*fit::find_family((*term)->family), own,
                                     c.factor.middleRows(rows_before, static_cast<Eigen::Index>(own.size())),
                                     (*term)->from, (*term)->to, (*term)->zero_at);
    is_determined.insert(is_determined.end(), own_determined.begin(), own_determined.end());
  }
  for (std::size_t i = 0; i < names.size(); ++i) {
    rows.push_back(
        {names[i], fit::format_exactly(values[i]),
         u_of_coefficient(c.factor.row(static_cast<Eigen::Index>(i)).norm(), is_determined[i], c.factor)});
  }
  std::string equation = "error = zero";
  if (c.intensity) equation += " + f_I(I): " + fit::find_family(c.intensity->family)->equation;
  if (c.range) equation += " + f_L(r): " + fit::find_family(c.range->family)->equation;
  return {{"title",
           "Coefficients of the correction, all digits (not determined: the others make up for a change of "
           "it; cancels: "
           "each curve counts from its value at the reference). " +
               equation},
          {"columns", {"coefficient", "value", "u"}},
          {"rows", rows}};
}

json methods_table(const fit::RangeCalibration& calibration, const std::vector<fit::RangePoint>& points,
                   double& largest) {
  json rows = json::array();
  largest = 0;
  for (const fit::RangePoint& p : points) {
    const double joint = calibration.joint->apply(p.measured_mm, p.intensity).error_mm;
    const double sequential = calibration.sequential->apply(p.measured_mm, p.intensity).error_mm;
    largest = std::max(largest, std::abs(joint - sequential));
    rows.push_back({p.true_mm, p.intensity, p.error_mm(), joint,
                    calibration.joint->u(p.measured_mm, p.intensity), sequential, joint - sequential});
  }
  return {{"title", "Joint fit and the paper's sequential method"},
          {"columns",
           {column("true", "mm"), "counts", column("measured", "mm"), column("joint fit", "mm"),
            column("u", "mm"), column("sequential", "mm"), column("difference", "mm")}},
          {"rows", rows}};
}

json points_plot(const std::vector<fit::RangePoint>& points, const Correction* correction,
                 bool over_intensity) {
  std::string title = over_intensity ? "Range error against intensity" : "Range error against distance";
  if (correction && correction->intensity && correction->range)
    title += over_intensity ? ", less the part that distance has in it"
                            : ", less the part that intensity has in it";
  json plot = new_plot(title, over_intensity ? "intensity (counts)" : "range (mm)", "error (mm)");
  std::vector<double> x, y, u;
  for (const fit::RangePoint& p : points) {
    if (!(over_intensity ? p.for_intensity : p.for_distance) && correction) continue;
    // The other term's share is taken off, so that points and curve belong together.
    double other = 0;
    if (correction && over_intensity && correction->range)
      other = correction->range->value(std::clamp(p.true_mm, correction->range->from, correction->range->to));
    if (correction && !over_intensity && correction->intensity)
      other = correction->intensity->value(
          std::clamp(p.intensity, correction->intensity->from, correction->intensity->to));
    x.push_back(over_intensity ? p.intensity : p.true_mm);
    y.push_back(p.error_mm() - other);
    u.push_back(2 * p.u_mm);
  }
  add_series(plot, "measured, k = 2", "errorbars", x, y, u);
  if (correction) add_curve(plot, drawn(*correction, over_intensity), "correction");
  return plot;
}

}  // namespace rig::range_parts
