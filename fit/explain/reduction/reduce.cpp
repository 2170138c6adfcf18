// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/reduce.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <span>
#include <utility>

#include "fit/bench/empirical.hpp"
#include "fit/bench/radiometer.hpp"
#include "fit/explain/reduction/broken_scans.hpp"
#include "fit/explain/reduction/occluders.hpp"
#include "fit/explain/reduction/placing.hpp"
#include "fit/explain/reduction/samples.hpp"
#include "fit/explain/reduction/temperature.hpp"
#include "fit/explain/reduction/whole_scans.hpp"
#include "fit/numeric/median.hpp"

namespace fit::explain {

std::size_t Reduced::usable_cells() const {
  return static_cast<std::size_t>(std::ranges::count_if(cells, &Cell::usable));
}

double Reduced::typical_sigma_mm() const {
  std::vector<double> sigmas;
  for (const Group& group : groups) sigmas.push_back(group.sigma_mm);
  return median_of(sigmas);
}

Scene Reduced::scene_of(const Group& group, const Nuisance& nuisance) const {
  return {bench, nuisance, capture_of(group), absent[static_cast<std::size_t>(group.capture)]};
}

namespace {

using namespace reduction;

constexpr int scans_per_group = 200;  // a longer capture is split in time
constexpr int turning_beams = 3;      // beams taken together where every scan has its own stage angle

/// One more recording, before any of its scans is read.
void begin(const Recording& recording, const Standing& standing, Reduced& out) {
  constexpr std::size_t strays_at_most = 5000;
  if (out.captures.empty()) {
    out.bench = recording.bench();
    out.same_as = standing.same_as;
    for (std::size_t t = out.same_as.size(); t < out.bench.targets.size(); ++t)
      out.same_as.push_back(static_cast<int>(t));
    out.shown.assign(1 << 16, 0);
  }
  std::ranges::copy(recording.captures(), std::back_inserter(out.captures));
  std::ranges::copy(standing.absent, std::back_inserter(out.absent));
  out.absent.resize(out.captures.size());
  out.most_strays = out.strays_mm.size() + strays_at_most;
  const double before_c = out.reference_temperature_c;
  out.reference_temperature_c = reference_temperature(out.captures).value_or(0);
  for (Cell& cell : out.cells) cell.at.temperature_k += before_c - out.reference_temperature_c;
}

/// Since power-on; since the session began where nobody knows.
double began_s(const CaptureInfo& capture) {
  return capture.since_power_on_s.value_or(static_cast<double>(capture.started_us) * 1e-6);
}

/// By how much a recording is taken later than it says, so that none overlaps another: each may count from
/// zero.
double later_than_stated_s(const std::vector<CaptureInfo>& captures, const std::vector<Group>& before) {
  constexpr double pause_s = 60;
  if (before.empty() || captures.empty()) return 0;
  const auto [first, last] = std::ranges::minmax(captures, {}, began_s);
  const auto [earliest, latest] = std::ranges::minmax(before, {}, &Group::clock_s);
  if (began_s(first) > latest.clock_s || began_s(last) < earliest.clock_s - pause_s) return 0;
  return latest.clock_s + pause_s - began_s(first);
}

/// Reads one capture's scans into blocks and reduces each.
class Reducer {
 public:
  Reducer(const Recording& recording, const Standing& standing, Reduced& out, bool keep_samples)
      : recording_(recording),
        standing_(standing),
        out_(out),
        first_capture_(out.captures.size() - recording.captures().size()),
        as_stated_(recording.bench()),
        keep_samples_(keep_samples),
        turns_(recording.bench().lidar.scan_hz),
        later_s_(later_than_stated_s(recording.captures(), out.groups)) {
    out_.later_s.push_back(later_s_);
  }

  void capture(std::size_t index) {
    const std::size_t capture = first_capture_ + index;
    const CaptureInfo& info = out_.captures[capture];
    const int most_scans = is_turning(info) ? 1 : scans_per_group;
    Samples columns;  // of the capture, without scans
    Samples block;
    again_.next_capture();
    recording_.for_each_scan(index, [&](const ScanView& scan) {
      if (again_.is_again(scan)) {
        ++out_.repeated;
        return;
      }
      if (scan.geometry && !through_rad_) through_rad_ = scan.geometry->first_rad;
      if (columns.beam_rad.empty())
        columns = columns_for(scan, info, out_.bench.lidar, through_rad_.value_or(0));
      if (block.scans == 0) block = columns;
      if (!block.add(scan, info, turns_)) return;
      if (block.scans < most_scans) return;
      reduce_block(block, capture);
      block.scans = 0;
    });
    if (block.scans > 0) reduce_block(block, capture);
  }

 private:
  void reduce_block(Samples& block, std::size_t capture) {
    Group group = group_of(block, capture);
    out_.scans += block.scans;
    out_.broken += do_not_look_at_gaps(block);
    const Scene scene = out_.scene_of(group, as_stated_);
    bring_to_middle(block, scene, group.stage_rad);
    if (const auto hidden = standing_.hidden.find(group.capture); hidden != standing_.hidden.end())
      for (const auto& [from_rad, to_rad] : hidden->second) block.do_not_look(from_rad, to_rad);
    group.sigma_mm = typical_spread(block, out_.bench);
    for (Occluder& one : occluders_in(block, scene, group.stage_rad, group.sigma_mm)) {
      one.capture = group.capture;
      out_.occluders.push_back(one);
    }
    const CaptureInfo& info = out_.captures[capture];
    const Setting setting{info, group, block, scene, scene.edges(group.stage_rad)};
    const bool turning = is_turning(info);
    const std::vector<int> cell_of_beam = add_cells(setting, turning ? turning_beams : 1);
    group.last_cell = out_.cells.size();
    if (!turning && block.scans > 2) summarise_scans(block, cell_of_beam, group, out_);
    count_shown(block);
    out_.groups.push_back(group);
  }

  /// The next one, when and from where it was taken.
  [[nodiscard]] Group group_of(const Samples& block, std::size_t capture) const {
    const CaptureInfo& info = out_.captures[capture];
    const double middle_s = (block.since_start_s.front() + block.since_start_s.back()) / 2;
    Group group;
    group.capture = static_cast<int>(capture);
    group.scans = block.scans;
    group.stage_rad = info.stage_rad + (is_turning(info) ? info.stage_rate_rad_s * middle_s : 0);
    group.time_s = began_s(info) + middle_s;
    group.clock_s = group.time_s + later_s_;
    group.first_cell = out_.cells.size();
    return group;
  }

  /// A cell for every beam, or for so many together, that meets something. Returns their indices by the first
  /// beam; -1 where there is none.
  std::vector<int> add_cells(const Setting& setting, int together) {
    const int columns = setting.samples.beams;
    std::vector<int> cell_of_beam(static_cast<std::size_t>(columns), -1);
    for (Beams beams{0, together}; beams.first + together <= columns; beams.first += together) {
      Cell cell = placed(out_, setting, beams);
      if (cell.sight.target < 0) continue;
      summarise(setting, beams, keep_samples_, cell, out_);
      cell_of_beam[static_cast<std::size_t>(beams.first)] = static_cast<int>(out_.cells.size());
      cell.group = static_cast<int>(out_.groups.size());
      if (!cell.usable) ++out_.left_out;
      out_.cells.push_back(cell);
    }
    return cell_of_beam;
  }

  /// Of ranges as they came: coarse steps show there.
  void count_shown(const Samples& block) {
    const std::size_t stride = std::max<std::size_t>(1, block.raw.size() / 2000);
    for (std::size_t i = 0; i < block.raw.size(); i += stride) {
      const std::uint16_t r = block.raw[i];
      if (is_echo(r)) ++out_.shown[r];
    }
  }

  const Recording& recording_;
  const Standing& standing_;
  Reduced& out_;
  std::size_t first_capture_;
  Nuisance as_stated_;
  bool keep_samples_;
  TurnCounter turns_;
  double later_s_;
  RepeatedScans again_;
  std::optional<double> through_rad_;  // a beam of the recording's first scan: the same columns throughout
};

/// Where a recording holds no intensities, what follows the echo is compared with the one that reflectance,
/// distance and incidence make.
void expect_echoes(Reduced& session, std::size_t first_cell) {
  const IntensityLaw law = law_of_bench(session.bench);
  for (Cell& cell : std::span(session.cells).subspan(first_cell))
    cell.at.intensity = law.counts(cell.at.reflectance, cell.sight.cos_incidence(), cell.sight.range_mm);
}

}  // namespace

void reduce_into(Reduced& reduced, const Recording& recording, const Progress& progress,
                 const Standing& standing, bool keep_samples) {
  const std::size_t first_cell = reduced.cells.size(), captures = recording.captures().size();
  const bool had_intensity = std::exchange(reduced.has_intensity, false);
  begin(recording, standing, reduced);
  Reducer reducer(recording, standing, reduced, keep_samples);
  for (std::size_t i = 0; i < captures; ++i) {
    reducer.capture(i);
    // A list that grows holds its cells twice meanwhile.
    if (i == 0) reduced.cells.reserve(first_cell + (reduced.cells.size() - first_cell) * captures * 17 / 16);
    if (progress && i % 8 == 0) progress(static_cast<double>(i) / static_cast<double>(captures), "reading");
  }
  if (!reduced.has_intensity) expect_echoes(reduced, first_cell);
  reduced.has_intensity |= had_intensity;
}

Reduced reduce(const Recording& recording, const Progress& progress, const Standing& standing,
               bool keep_samples) {
  Reduced out;
  reduce_into(out, recording, progress, standing, keep_samples);
  return out;
}

}  // namespace fit::explain
