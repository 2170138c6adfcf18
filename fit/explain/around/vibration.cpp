// SPDX-License-Identifier: MIT
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <complex>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "fit/explain/around/around.hpp"
#include "fit/explain/model/scans.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain {
namespace {

/// Scans of one capture: when, and by how many standard deviations of its noise each is off.
struct Block {
  std::vector<double> time_s, off;
};

/// The angles, or the ranges, of whole scans, block by block.
struct Series {
  std::vector<Block> blocks;
  double squares = 0, scans = 0;
  double unit = 0;                       ///< Mean noise of one: rad, or mm.
  double longest_s = 0, nyquist_hz = 0;  ///< Of the longest block, and of the densest.

  /// Of each part that.
  Series(const std::vector<model::ScanPart>& parts, bool of_angle, double model::ScanPart::*mm) {
    constexpr std::size_t fewest = 20, most = 20'000;
    std::map<int, Block> all;
    double units = 0;
    for (const model::ScanPart& part : parts) {
      if (part.of_angle != of_angle || static_cast<std::size_t>(part.scans) < fewest || scans >= most)
        continue;
      const double sigma = std::sqrt(part.variance_mm2);
      all[part.block].time_s.push_back(part.at.since_move_s);
      all[part.block].off.push_back(part.*mm / sigma);
      squares += std::pow(part.*mm / sigma, 2);
      units += of_angle ? sigma / part.sensitivity_mm : sigma;
      scans += 1;
    }
    unit = scans > 0 ? units / scans : 0;
    for (auto& [number, block] : all) {
      const double duration_s = block.time_s.back() - block.time_s.front();
      longest_s = std::max(longest_s, duration_s);
      if (duration_s > 0)
        nyquist_hz = std::max(nyquist_hz, static_cast<double>(block.off.size() - 1) / duration_s / 2);
      blocks.push_back(std::move(block));
    }
  }
};

struct Line {
  double hz = 0, share = 0;
};

/// The frequency between two that takes the largest share of a series' variance, by a wave with a phase of
/// its own in each block; none in a series that never moves. Phasors turn by one step after the other: no
/// sine is taken of every scan and frequency.
Line strongest(const Series& series, double from_hz, double to_hz, double step_hz) {
  using Eigen::ArrayXcd, Eigen::ArrayXd;
  if (!(series.squares > 0) || to_hz < from_hz) return {};
  ArrayXd power = ArrayXd::Zero(static_cast<Eigen::Index>((to_hz - from_hz) / step_hz) + 1);
  for (const Block& block : series.blocks) {
    const auto size = std::ssize(block.off);
    const ArrayXcd turns = std::complex<double>(0, 2 * pi) * ArrayXd::Map(block.time_s.data(), size),
                   by_step = (turns * step_hz).exp();
    ArrayXcd phasors = (turns * from_hz).exp() * ArrayXd::Map(block.off.data(), size);
    for (double& of_frequency : power) {
      of_frequency += 2 * std::norm(phasors.sum()) / static_cast<double>(size);
      phasors *= by_step;
    }
  }
  Eigen::Index best = 0;
  const double most = power.maxCoeff(&best);
  return {from_hz + static_cast<double>(best) * step_hz, most / series.squares};
}

}  // namespace

std::optional<double> vibration(const Reduced& reduced, std::vector<Unexplained>& unknown) {
  constexpr double least_share = 0.3,  // of what scans scatter by: else it is noise
      slowest = 3;                     // periods in a block
  const std::vector<model::ScanPart> parts = model::scan_parts(reduced, model::fewest_in_common, 1);
  std::optional<double> found;
  double most = 0;
  Unexplained u;
  for (const bool of_angle : {true, false}) {
    // What repeats from capture to capture, or with mirror faces, is no vibration; but it takes a part of
    // one.
    const Series rest(parts, of_angle, &model::ScanPart::rest_mm),
        series(parts, of_angle, &model::ScanPart::mm);
    if (rest.blocks.empty() || !(rest.longest_s > 0)) continue;
    const double resolved_hz = 1 / rest.longest_s,
                 seen_hz = strongest(rest, slowest * resolved_hz, rest.nyquist_hz, resolved_hz / 3).hz;
    const Line of_rest =
                   strongest(rest, seen_hz - resolved_hz / 3, seen_hz + resolved_hz / 3, resolved_hz / 30),
               line = strongest(series, seen_hz - resolved_hz, seen_hz + resolved_hz, resolved_hz / 100);
    // Noise has two degrees of freedom in every block, and the best of all frequencies was taken.
    const auto blocks = static_cast<double>(rest.blocks.size());
    const double tried = 3 * rest.nyquist_hz / resolved_hz, by_chance = 2 * blocks / rest.scans,
                 gain = -rest.scans / 2 * std::log(1 - std::min(0.99, of_rest.share)),
                 penalty = blocks + 4 * std::sqrt(blocks) + std::log(tried / numbers::forms_expected) +
                           std::log(numbers::named_at / (1 - numbers::named_at));
    if (of_rest.share < least_share + by_chance || gain < penalty || line.share < by_chance || gain < most)
      continue;
    most = gain;
    found = line.hz;
    const double amplitude =
        series.unit * std::sqrt(2 * (line.share - by_chance) * series.squares / series.scans);
    u.observable = Observable::range_mean;
    u.coordinate = Coordinate::time;
    u.gain = gain - penalty;
    const std::string at =
        rounded(line.hz, 4) +
        " Hz (or one that looks like it from scan to scan), with another phase in every capture";
    u.describes = of_angle ? "the stage's angle swings by " + rounded(amplitude * deg_per_rad, 2) +
                                 " deg at " + at + ": stage or mount vibrate"
                           : "ranges of whole scans swing by " + rounded(amplitude, 2) + " mm at " + at;
  }
  if (found) unknown.push_back(std::move(u));
  return found;
}

}  // namespace fit::explain
