// SPDX-License-Identifier: MIT
#include "fit/range/range_calibration.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "fit/numeric/number_format.hpp"
#include "fit/range/extra_scatter.hpp"
#include "fit/range/joint_range.hpp"

namespace fit {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

std::vector<CurvePoint> curve(const std::vector<RangePoint>& points, bool RangePoint::*which,
                              double RangePoint::*x, double scatter) {
  std::vector<CurvePoint> out;
  for (const RangePoint& p : points)
    if (p.*which) out.push_back({p.*x, p.error_mm(), std::hypot(p.u_mm, scatter)});
  return out;
}

/// Scatter of the points themselves; where too few show it, what the bench says of the placement.
double scatter_of(const std::vector<CurvePoint>& points, double placement_u_mm) {
  return std::ssize(points) < fewest_that_scatter ? placement_u_mm : extra_scatter(points);
}

/// The distance experiment with one surface: where several stood at one distance, those of the strongest
/// echo (within 3 %). The others' errors differ for their echo's sake, which is no scatter.
std::vector<CurvePoint> of_one_surface(const std::vector<RangePoint>& points) {
  constexpr double one_place_mm = 2, one_surface = 1.03;
  std::vector<CurvePoint> out;
  for (const RangePoint& p : points) {
    if (!p.for_distance) continue;
    const bool weaker = std::ranges::any_of(points, [&](const RangePoint& other) {
      return other.for_distance && std::abs(other.true_mm - p.true_mm) < one_place_mm &&
             other.intensity > one_surface * p.intensity;
    });
    if (!weaker) out.push_back({p.true_mm, p.error_mm(), p.u_mm});
  }
  return out;
}

const FamilyFit* chosen(const std::vector<FamilyFit>& table, const std::string& wanted) {
  if (wanted.empty()) return best_of(table);
  for (const FamilyFit& fit : table)
    if (fit.family == wanted && fit.usable && !fit.spline) return &fit;
  return nullptr;
}

/// A correction with one term, its curve as it is.
Correction single(const FamilyFit& fit, CorrectionTerm::Argument argument) {
  Correction c;
  CorrectionTerm term;
  term.argument = argument;
  term.family = fit.family, term.coefficients = fit.coefficients;
  term.from = fit.from, term.to = fit.to;
  (argument == CorrectionTerm::Argument::intensity ? c.intensity : c.range) = term;
  c.factor = MatrixXd::Zero(fit.factor.rows() + 1, fit.factor.cols());
  c.factor.bottomRows(fit.factor.rows()) = fit.factor;
  return c;
}

/// A1's curve first; A2's errors less that curve, whose uncertainty goes with them; then A2's curve.
Correction sequential_of(const FamilyFit& intensity, const std::vector<RangePoint>& points, double scatter,
                         const std::string& wanted, std::vector<FamilyFit>& table) {
  std::vector<CurvePoint> rest;
  for (const RangePoint& p : points) {
    if (!p.for_distance) continue;
    const double counts = std::clamp(p.intensity, intensity.from, intensity.to), error = intensity(counts);
    rest.push_back({p.measured_mm - error, p.error_mm() - error,
                    std::sqrt(p.u_mm * p.u_mm + scatter * scatter + std::pow(intensity.u(counts), 2))});
  }
  table = compare_families(rest);
  Correction out = single(intensity, CorrectionTerm::Argument::intensity);
  const FamilyFit* distance = chosen(table, wanted);
  if (!distance) return out;
  const Correction second = single(*distance, CorrectionTerm::Argument::range);
  out.range = second.range;
  const Index a = out.factor.rows(), ac = out.factor.cols(), b = distance->factor.rows(),
              bc = distance->factor.cols();
  MatrixXd factor = MatrixXd::Zero(a + b, ac + bc);
  factor.topLeftCorner(a, ac) = out.factor;
  factor.bottomRightCorner(b, bc) = distance->factor;
  out.factor = factor;
  return out;
}

void state_identifiability(RangeCalibration& out, const std::vector<RangePoint>& points) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const RangePoint& p : points)
    if (p.for_intensity) low = std::min(low, p.intensity), high = std::max(high, p.intensity);
  double from = std::numeric_limits<double>::infinity(), to = 0;
  int outside = 0;
  for (const RangePoint& p : points) {
    if (!p.for_distance || (p.intensity >= low && p.intensity <= high)) continue;
    ++outside;
    from = std::min(from, p.true_mm), to = std::max(to, p.true_mm);
  }
  if (outside > 0)
    out.identifiability.push_back(
        formatted("at %.0f distances between %.0f and ", outside, from) + formatted("%.0f mm", to) +
        formatted(" the echo's intensity lay outside the %.0f to %.0f counts that "
                  "changed surfaces covered: there only the "
                  "sum of intensity and distance error is known, for this surface. Add "
                  "surfaces of that intensity at the "
                  "reference distance.",
                  low, high));
  if (out.correlation > 0.999)
    out.identifiability.push_back(formatted(
        "intensity and distance changed together (canonical correlation %.5f): how the error is split "
        "between "
        "them is hardly known, only their sum",
        out.correlation));
}

/// Between points far apart a curve is less certain than at them: says where a capture would help.
void state_open_interval(RangeCalibration& out, const std::vector<FamilyFit>& table, const FamilyFit& chosen,
                         const std::vector<CurvePoint>& points, const char* what, const char* unit) {
  const auto open = most_open_interval(table, chosen, points);
  if (!open) return;
  out.identifiability.push_back(
      formatted("between %.0f and %.0f ", open->from, open->to) + unit + " no " + what +
      formatted(" was measured: there the correction is known to %.2g mm (k = 2, at %.0f ", 2 * open->u,
                open->at) +
      unit + formatted("), at the measured ones to %.2g mm. Measure there as well", 2 * open->u_at_points));
}

double rms_of(const std::vector<RangePoint>& points, const Correction* correction) {
  double sum = 0;
  for (const RangePoint& p : points)
    sum += std::pow(
        (correction ? correction->apply(p.measured_mm, p.intensity).range_mm : p.measured_mm) - p.true_mm, 2);
  return std::sqrt(sum / static_cast<double>(points.size()));
}

/// How far a sample may be from the mean that it belongs to: beyond lie 0.3 % of normal noise, and without
/// these the mean of the others moves by 0.4 % of a standard deviation.
constexpr double sample_sigmas = 3;

void set_ranges(Correction& c, const std::vector<RangePoint>& points) {
  const auto set_samples = [&](CorrectionTerm& term, double RangePoint::*x, double RangePoint::*sd) {
    term.sample_from = term.from, term.sample_to = term.to;
    for (const RangePoint& p : points) {
      term.sample_from = std::min(*term.sample_from, p.*x - sample_sigmas * p.*sd);
      term.sample_to = std::max(*term.sample_to, p.*x + sample_sigmas * p.*sd);
    }
  };
  const auto by = [&](auto key) {
    const auto [a, b] = std::ranges::minmax(points, {}, key);
    return std::pair(key(a), key(b));
  };
  if (c.intensity) {
    std::tie(c.intensity->from, c.intensity->to) = by([](const RangePoint& p) { return p.intensity; });
    set_samples(*c.intensity, &RangePoint::intensity, &RangePoint::sd_counts);
  }
  if (c.range) {
    const auto [low, high] = by([](const RangePoint& p) { return p.true_mm; });
    const auto [low_m, high_m] = by([](const RangePoint& p) { return p.measured_mm; });
    c.range->from = std::min(low, low_m), c.range->to = std::max(high, high_m);
    set_samples(*c.range, &RangePoint::true_mm, &RangePoint::sd_mm);
  }
}

}  // namespace

void sort_into_experiments(std::vector<RangePoint>& points) {
  std::map<long, std::vector<std::size_t>> places;
  std::vector<std::size_t> order(points.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::sort(order, {}, [&](std::size_t i) { return points[i].true_mm; });
  long place = 0;
  for (std::size_t k = 0; k < order.size(); ++k) {
    if (k > 0 && points[order[k]].true_mm - points[order[k - 1]].true_mm > 2) ++place;
    places[place].push_back(order[k]);
  }
  const auto most = std::ranges::max_element(
      places, [](const auto& a, const auto& b) { return a.second.size() < b.second.size(); });
  if (most == places.end()) return;
  std::vector<double> counts;
  for (const std::size_t i : most->second) counts.push_back(points[i].intensity);
  std::ranges::sort(counts);
  int different = counts.empty() ? 0 : 1;
  double last = counts.empty() ? 0 : counts.front();
  for (const double c : counts)
    if (c > 1.03 * last) ++different, last = c;
  const bool has_intensity = different >= 4;
  if (has_intensity)
    for (const std::size_t i : most->second) points[i].for_intensity = true;
  if (places.size() < 3) return;
  for (auto& [key, members] : places)
    if (key != most->first || !has_intensity)
      for (const std::size_t i : members) points[i].for_distance = true;
  if (!has_intensity) return;
  // The surface that was carried along the rail also stood at the reference distance.
  const auto next = std::next(most) != places.end() ? std::next(most) : std::prev(most);
  const double carried = points[next->second.front()].intensity;
  const auto nearest = std::ranges::min_element(most->second, {}, [&](std::size_t i) {
    return std::abs(std::log(std::max(1.0, points[i].intensity) / std::max(1.0, carried)));
  });
  points[*nearest].for_distance = true;
}

namespace {

/// The families that both experiments chose, and where the correction's zero is referred to.
struct Chosen {
  const FamilyFit *intensity = nullptr, *distance = nullptr;
  double reference_mm = 0, reference_counts = 0;
};

/// Fits every family to either experiment.
Chosen fit_families(RangeCalibration& out, const std::vector<RangePoint>& points,
                    const RangeOptions& options) {
  Chosen families;
  families.reference_counts = options.reference_intensity;
  if (std::ranges::any_of(points, &RangePoint::for_intensity)) {
    out.intensity_table = compare_families(
        curve(points, &RangePoint::for_intensity, &RangePoint::intensity, out.scatter_intensity_mm));
    families.intensity = chosen(out.intensity_table, options.intensity_family);
    for (const RangePoint& p : points)
      if (p.for_intensity) {
        families.reference_mm = p.true_mm;
        if (options.reference_intensity <= 0)
          families.reference_counts = std::max(families.reference_counts, p.intensity);
      }
    if (families.intensity)
      out.sequential = sequential_of(*families.intensity, points, out.scatter_distance_mm,
                                     options.distance_family, out.distance_table);
  }
  if (std::ranges::none_of(points, &RangePoint::for_distance)) return families;
  if (!out.sequential)
    out.distance_table = compare_families(
        curve(points, &RangePoint::for_distance, &RangePoint::measured_mm, out.scatter_distance_mm));
  families.distance = chosen(out.distance_table, options.distance_family);
  return families;
}

/// The correction from both experiments at once, else from the one that there is; says what it leaves open.
void combine(RangeCalibration& out, const std::vector<RangePoint>& points, const Chosen& families) {
  if (families.intensity && families.distance) {
    const JointOptions about{out.scatter_intensity_mm, out.scatter_distance_mm, families.reference_mm,
                             families.reference_counts};
    const JointFit joint = fit_joint(points, *families.intensity, *families.distance, about);
    if (joint.ok) {
      out.joint = joint.correction;
      out.condition = joint.condition, out.correlation = joint.correlation, out.held_out_mm = joint.held_out;
    } else {
      out.notes.emplace_back(
          "there are too few points for both curves at once; the sequential method was used");
      out.joint = out.sequential;
    }
    state_identifiability(out, points);
  } else if (families.intensity) {
    out.joint = single(*families.intensity, CorrectionTerm::Argument::intensity);
    out.held_out_mm = families.intensity->held_out;
    out.identifiability.emplace_back(
        "the distance was not changed: an error that grows with distance is not in this correction");
  } else if (families.distance) {
    out.joint = single(*families.distance, CorrectionTerm::Argument::range);
    out.held_out_mm = families.distance->held_out;
    const bool no_intensity =
        std::ranges::all_of(points, [](const RangePoint& p) { return p.intensity <= 0; });
    out.identifiability.push_back(
        std::string(
            no_intensity
                ? "no intensity was recorded, and echoes weaken with distance: how much of the error "
                : "only one surface was measured, and its echo's intensity changes with distance: how "
                  "much of the error ") +
        "is due to distance and how much to intensity cannot be determined, and the curve holds for such a "
        "surface only. Measure several surfaces at one distance (procedure range-intensity) as well");
  } else {
    out.why_not =
        std::ranges::any_of(points, [](const RangePoint& p) { return p.for_intensity || p.for_distance; })
            ? "no family of curves could be fitted to these points"
            : "a range correction needs at least three distances, or four surfaces at one distance";
  }
}

}  // namespace

RangeCalibration calibrate_range(std::vector<RangePoint> points, const RangeOptions& options) {
  RangeCalibration out;
  sort_into_experiments(points);
  out.points_intensity = std::ranges::count(points, true, &RangePoint::for_intensity);
  out.points_distance = std::ranges::count(points, true, &RangePoint::for_distance);
  const auto by_intensity = [&](double scatter) {
    return curve(points, &RangePoint::for_intensity, &RangePoint::intensity, scatter);
  };
  out.scatter_intensity_mm = scatter_of(by_intensity(0), options.placement_u_mm);
  out.scatter_distance_mm = scatter_of(of_one_surface(points), options.placement_u_mm);
  out.rms_before_mm = points.empty() ? std::nan("") : rms_of(points, nullptr);
  const Chosen families = fit_families(out, points, options);
  combine(out, points, families);
  if (families.intensity)
    state_open_interval(out, out.intensity_table, *families.intensity, by_intensity(0), "surface", "counts");
  if (families.distance)
    state_open_interval(out, out.distance_table, *families.distance,
                        curve(points, &RangePoint::for_distance, &RangePoint::measured_mm, 0), "distance",
                        "mm");
  if (!families.intensity || !families.distance) out.sequential.reset();
  for (auto* correction : {&out.joint, &out.sequential}) {
    if (!*correction) continue;
    (*correction)->reference_mm = families.reference_mm;
    (*correction)->reference_intensity = families.reference_counts;
    (*correction)->common_u_mm = options.common_u_mm;
    set_ranges(**correction, points);
  }
  if (out.joint) out.rms_after_mm = rms_of(points, &*out.joint);
  return out;
}

}  // namespace fit
