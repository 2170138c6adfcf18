// SPDX-License-Identifier: MIT
#include "rig/fitting/range_source.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

#include "fit/bench/placed_anew.hpp"
#include "fit/numeric/distributions.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/facing_target.hpp"
#include "rig/session/step_in_words.hpp"

namespace rig {
namespace {

/// Per scan the beam nearest to the normal; false when none is within one and a half steps of it.
struct SquareBeam {
  std::vector<fit::Sample> samples;
  double sum_rad = 0, sum_excess_mm = 0, sum_excess_per_rad = 0, step_rad = 0;
  long scans = 0;
};
SquareBeam square_beam(const fit::Recording& recording, std::size_t index, const FacingTarget& board,
                       double normal_rad) {
  const fit::CaptureInfo& capture = recording.captures()[index];
  SquareBeam out;
  recording.for_each_scan(index, [&](const fit::ScanView& scan) {
    ++out.scans;
    const fit::BeamAngles angles(recording.bench().lidar, capture, scan.geometry);
    const long last = static_cast<long>(scan.range_mm.size()) - 1;
    if (last < 0) return;
    // A full turn may begin or end just beside the normal: the beam may be the first, the last or neither.
    const double turns = 2 * fit::pi / std::abs(angles.step_rad());
    double place = fit::wrap_angle(normal_rad - angles.first_rad()) / angles.step_rad();
    if (place < 0) place += turns;
    const auto off_of = [&](long k) {
      return fit::wrap_angle(angles.at_rad(static_cast<std::size_t>(k)) - normal_rad);
    };
    long k = 0;
    for (const long candidate : {std::min(std::lround(place), last), last})
      if (std::abs(off_of(candidate)) < std::abs(off_of(k))) k = candidate;
    const double off = off_of(k);
    const double excess_mm = board.excess_mm(off);
    if (std::abs(off) > 1.5 * std::abs(angles.step_rad()) || !std::isfinite(excess_mm)) return;
    const auto at = static_cast<std::size_t>(k);
    out.samples.push_back(
        {scan.range_mm[at], at < scan.intensity.size() ? scan.intensity[at] : std::uint16_t{0}});
    out.sum_rad += normal_rad + off;
    out.step_rad = std::abs(angles.step_rad());
    out.sum_excess_mm += excess_mm, out.sum_excess_per_rad += board.excess_per_rad(off);
  });
  return out;
}

double sd_of_counts(const std::vector<fit::Sample>& samples) {
  double n = 0, sum = 0, squares = 0;
  for (const fit::Sample& sample : samples)
    if (sample.range_mm > 0) ++n, sum += sample.intensity, squares += std::pow(sample.intensity, 2);
  return n > 1 ? std::sqrt(std::max(0.0, (squares - sum * sum / n) / (n - 1))) : 0;
}

/// The target a capture is about; without a name, the nearest one that the capture's beams meet squarely.
const fit::Target* target_of(const fit::Bench& bench, const fit::CaptureInfo& capture) {
  if (capture.target) return bench.target(*capture.target);
  const fit::Target* nearest = nullptr;
  double least = 1e300;
  for (const fit::Target& target : bench.targets) {
    const FacingTarget board = facing_target(target, capture, bench.lidar.mount);
    if (board.meets(board.normal_rad) && board.distance_mm < least)
      least = board.distance_mm, nearest = &target;
  }
  return nearest;
}

/// The captures that were left out, by reason, in the order in which the reasons came up.
using LeftOut = std::vector<std::pair<std::string, std::vector<std::string>>>;

void leave_out(LeftOut& left_out, const std::string& capture, const std::string& reason) {
  for (auto& [known, captures] : left_out)
    if (known == reason) return captures.push_back(capture);
  left_out.emplace_back(reason, std::vector<std::string>{capture});
}

/// One line a reason: a search for edges has a hundred captures that see none squarely.
std::string in_words(const LeftOut::value_type& group) {
  const auto& [reason, captures] = group;
  if (captures.size() == 1) return captures.front() + " was left out: " + reason;
  return std::to_string(captures.size()) + " captures were left out, from " + captures.front() + " to " +
         captures.back() + ": " + reason;
}

std::optional<RangeCapture> read_capture(const fit::Recording& recording, std::size_t index,
                                         RangeSource& source, LeftOut& left_out) {
  const fit::CaptureInfo& capture = recording.captures()[index];
  const fit::Bench& bench = recording.bench();
  const std::string name = "capture " + std::to_string(capture.id) +
                           (capture.step.empty() ? "" : " (" + step_in_words(capture.step) + ")");
  if (fit::is_turning(capture)) return std::nullopt;
  const fit::Target* target = target_of(bench, capture);
  if (!target) {
    leave_out(left_out, name,
              "the bench file has no target " +
                  (capture.target ? "'" + *capture.target + "'" : "that its beams meet at right angles"));
    return std::nullopt;
  }
  const FacingTarget board = facing_target(*target, capture, bench.lidar.mount);
  const SeenNormal normal = seen_normal(recording, index, board);
  const SquareBeam beam = square_beam(recording, index, board, normal.rad);
  if (beam.samples.size() < 20) {
    leave_out(left_out, name, "fewer than 20 samples of the beam that is square on '" + target->name + "'");
    return std::nullopt;
  }
  RangeCapture out;
  out.label = capture.step.empty() ? std::to_string(capture.id) : step_in_words(capture.step);
  out.target = target->name;
  out.true_mm = board.distance_mm;
  out.normal_deg = normal.rad * fit::deg_per_rad, out.u_normal_deg = normal.u_rad * fit::deg_per_rad;
  out.normal_from_data = normal.from_data;
  const auto n = static_cast<double>(beam.samples.size());
  out.beam_deg = fit::wrap_angle(beam.sum_rad / n) * fit::deg_per_rad;
  out.oblique_mm = beam.sum_excess_mm / n;
  out.u_placement_mm = std::hypot(target->u_mm, target->round ? target->round->u_radius_mm : 0,
                                  beam.sum_excess_per_rad / n * normal.u_rad);
  out.u_mount_mm = board.u_mount_mm;
  out.placed_anew = fit::is_placed_anew(bench, target->name);
  out.temperature_c = capture.temperature_c;
  out.beam_step_deg = beam.step_rad * fit::deg_per_rad;
  out.reflectance = capture.reflectance ? capture.reflectance : target->reflectance;
  out.paper = fit::select_most_frequent(beam.samples);
  out.robust = fit::select_robust(beam.samples);
  out.sd_counts = sd_of_counts(beam.samples);
  out.scans = beam.scans;
  if (out.paper.kept < 1) {
    leave_out(left_out, name, "no valid sample");
    return std::nullopt;
  }
  if (!normal.said.empty())
    source.notes.push_back(name + ": '" + target->name +
                           "' is not one flat face as the bench file says: " + normal.said +
                           ". Only the face of the square beam was used; correct the target's ends");
  const double off = std::abs(fit::wrap_angle(normal.rad - board.normal_rad));
  if (normal.from_data && off > 4 * board.u_normal_rad)
    source.contradictions.push_back(
        name + ": '" + target->name + "' is turned by " + fit::format_fixed(off * fit::deg_per_rad, 1) +
        " deg from where the bench file says; correct its mount yaw or the target");
  if (std::abs(out.paper.mean_mm - out.true_mm) > 0.1 * out.true_mm + 60)
    source.contradictions.push_back(name + ": the beam sees " + fit::format_fixed(out.paper.mean_mm, 0) +
                                    " mm where the bench file puts '" + target->name + "' at " +
                                    fit::format_fixed(out.true_mm, 0) + " mm; check the true distance");
  return out;
}

/// The captures of one recording, and how a sentence names them.
struct OfRecording {
  std::size_t from, to;
  std::string prefix;  ///< The file, where several recordings are fitted.
};

/// Ranges that change within captures whose target stands still: a lidar that warms up, above all.
void doubt_drift(RangeSource& source, const std::vector<OfRecording>& recordings) {
  std::vector<fit::Trend> trends;
  std::string name;
  const RangeCapture* most = nullptr;
  const auto pull = [](const RangeCapture& c) {
    return std::abs(c.robust.trend.rise.value) / c.robust.trend.rise.u;
  };
  for (const OfRecording& recording : recordings)
    for (std::size_t i = recording.from; i < recording.to; ++i) {
      const RangeCapture& capture = source.captures[i];
      trends.push_back(capture.robust.trend);
      if (!capture.robust.trend.is_known() || (most && pull(capture) <= pull(*most))) continue;
      most = &capture, name = recording.prefix + capture.label;
    }
  if (!fit::drift_together(trends, fit::chance_of_drift)) return;
  const fit::Estimate& rise = most->robust.trend.rise;
  source.contradictions.push_back(
      "The ranges drift within the captures, most surely in " + name + ": by " +
      fit::format_value(rise.value, 2 * rise.u) + " mm, U = " + fit::format_value(2 * rise.u, 2 * rise.u) +
      " mm, from its first to its last sample. Steady captures without long memory show this in at most 1 of "
      "1,000 fits. The lidar was not warm, or "
      "targets moved. Let the lidar warm up, and measure again");
}

/// A surface that came back to its place in one session shows how far the lidar drifted meanwhile. Nothing
/// says that two captures show the same surface but its reflectance.
void doubt_returns(RangeSource& source, const OfRecording& recording) {
  const std::vector<RangeCapture>& all = source.captures;
  const auto is_return = [&](const RangeCapture& first, const RangeCapture& again) {
    return first.target == again.target && std::abs(first.true_mm - again.true_mm) < 0.01 &&
           first.reflectance && first.reflectance == again.reflectance &&
           first.temperature_c == again.temperature_c;
  };
  std::vector<std::pair<const RangeCapture*, const RangeCapture*>> returns;
  for (std::size_t j = recording.from; j < recording.to; ++j)
    for (std::size_t i = recording.from; i < j; ++i)
      if (is_return(all[i], all[j])) {
        returns.emplace_back(&all[i], &all[j]);
        break;
      }
  const double chance = fit::chance_of_drift / static_cast<double>(std::max<std::size_t>(1, returns.size()));
  for (const auto& [first, again] : returns) {
    const double by_mm = again->point(again->robust).error_mm() - first->point(first->robust).error_mm(),
                 u_mm = std::hypot(std::hypot(first->robust.u_mm, again->robust.u_mm),
                                   std::hypot(first->u_placement_mm, again->u_placement_mm));
    if (!(by_mm * by_mm > fit::chi_squared_quantile(1, 1 - chance) * u_mm * u_mm)) continue;
    source.contradictions.push_back(
        "Two captures of reflectance " + fit::format_value(*first->reflectance, 0) + " at " +
        fit::format_fixed(first->true_mm, 0) + " mm differ: " + recording.prefix + again->label + " reads " +
        fit::format_value(std::abs(by_mm), 2 * u_mm) + " mm " + (by_mm < 0 ? "nearer" : "farther") +
        " than " + first->label + ", U = " + fit::format_value(2 * u_mm, 2 * u_mm) +
        " mm. The lidar drifted between them, or they are not the same surface in the same place. Let the "
        "lidar warm up, and measure again");
  }
}

}  // namespace

RangeSource read_ranges(const std::vector<FitSource>& sources) {
  RangeSource out;
  LeftOut left_out;
  std::vector<OfRecording> recordings;
  for (const FitSource& source : sources) {
    const auto recording = source.session->recording();
    const std::size_t before = out.captures.size();
    for (std::size_t i = 0; i < recording->captures().size(); ++i)
      if (auto capture = read_capture(*recording, i, out, left_out))
        out.captures.push_back(std::move(*capture));
    recordings.push_back(
        {before, out.captures.size(),
         sources.size() > 1 ? std::filesystem::path(source.path).filename().string() + ", " : std::string()});
    doubt_returns(out, recordings.back());
  }
  for (const auto& group : left_out) out.notes.push_back(in_words(group));
  doubt_drift(out, recordings);
  if (!out.captures.empty()) return out;
  std::string why;
  for (const auto* all : {&out.notes, &out.contradictions})
    for (const std::string& note : *all) why += "\n  " + note;
  throw MeasurementError("no capture faces a target of known distance squarely" + why +
                         "\nThe bench file must hold the target, and captures of a range ladder its shift.");
}

}  // namespace rig
