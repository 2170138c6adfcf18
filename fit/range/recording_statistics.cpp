// SPDX-License-Identifier: MIT
#include "fit/range/recording_statistics.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "fit/numeric/median.hpp"

namespace fit {
namespace {

constexpr double sector_rad = 3 * rad_per_deg;
constexpr double range_step_mm = 250;
constexpr int fewest = 30;  ///< Samples of a sector or a step of range.
constexpr double smooth_share = 0.05, smooth_mm = 60, gap_share = 0.08, gap_mm = 120;
constexpr double no_echo_below_mm = 22, no_echo_above_mm = 65000;

bool echo(double r) { return r >= no_echo_below_mm && r < no_echo_above_mm; }

/// What one sector of beams of one capture collects.
struct Sector {
  std::vector<double> bend_mm, light, light_bend;
  std::vector<double> along;  ///< Bends of one beam place, scan after scan.
  long lost = 0, all = 0;
  double memory = 0;
  long pairs = 0;
};

struct Step {
  std::vector<double> bend_mm, light;
  long lost = 0, all = 0;
};

class Collector {
 public:
  explicit Collector(const StatisticsOptions& options) : options_(options) {}

  void capture(const Recording& recording, std::size_t index, RecordingStatistics& out) {
    sectors_.clear();
    before_.clear();
    const CaptureInfo& info = recording.captures()[index];
    std::int64_t first = 0, last = 0;
    bool any = false;
    if (options_.half != 0)
      recording.for_each_scan(index, [&](const ScanView& scan) {
        if (!any) first = scan.seq;
        any = true;
        last = scan.seq;
      });
    recording.for_each_scan(index, [&](const ScanView& scan) {
      if (options_.half != 0 && (scan.seq > (first + last) / 2) != (options_.half == 2)) return;
      ++out.scans;
      out.samples += static_cast<long>(scan.range_mm.size());
      add_scan(scan, info, recording.bench());
    });
    for (auto& [number, sector] : sectors_) finish(sector);
  }

  void write(RecordingStatistics& out) {
    const auto add = [&](const char* name, const char* unit, const char* what, std::vector<double>& v) {
      out.statistics.push_back({name, unit, what, std::move(v)});
    };
    add("range noise", "mm", "standard deviation of a sample, from neighbouring beams; one value a sector",
        noise_);
    add("share of large deviations", "%",
        "samples beyond three standard deviations (normal: 0.27); one value a sector", tails_);
    add("memory of the noise", "",
        "correlation of a beam's deviation with that of the scan before; one value a sector", memory_);
    add("intensity", "counts", "median; one value a sector", light_);
    add("intensity noise", "%", "relative standard deviation of a sample; one value a sector", light_noise_);
    add("lost echoes", "%", "samples without echo; one value a sector", lost_);
    add("place of samples at edges", "",
        "0: on the near surface, 1: on the far one; one value for a beam between two that see different "
        "surfaces",
        place_);
    RangeProfile noise{"range noise", "mm", {}, {}, {}}, light{"intensity", "counts", {}, {}, {}},
        lost{"lost echoes", "%", {}, {}, {}};
    for (auto& [number, step] : steps_) {
      if (step.bend_mm.size() < fewest) continue;
      const double at = (number + 0.5) * range_step_mm, n = static_cast<double>(step.bend_mm.size());
      const double sigma = spread(step.bend_mm);
      noise.range_mm.push_back(at);
      noise.value.push_back(sigma);
      noise.u.push_back(sigma * 1.2 / std::sqrt(n));
      const double share = static_cast<double>(step.lost) / static_cast<double>(std::max(1L, step.all));
      lost.range_mm.push_back(at);
      lost.value.push_back(100 * share);
      lost.u.push_back(100 * std::sqrt(share * (1 - share) / static_cast<double>(std::max(1L, step.all))));
      if (step.light.size() < fewest) continue;
      light.range_mm.push_back(at);
      light.value.push_back(median_or_nan(step.light));
      light.u.push_back(1.25 * spread_about(step.light, light.value.back()) /
                        std::sqrt(static_cast<double>(step.light.size())));
    }
    out.profiles = {noise, light, lost};
  }

 private:
  /// Standard deviation of a sample from deviations of beams from the line through their neighbours.
  static double spread(const std::vector<double>& bends) {
    std::vector<double> sizes;
    for (const double b : bends) sizes.push_back(std::abs(b));
    // Whole millimetres make the plain median coarse: the mean of those within reach is finer.
    const double rough = std::max(0.3, 1.4826 * median_or_nan(sizes));
    double sum = 0, count = 0;
    for (const double s : sizes)
      if (s < 3 * rough) {
        sum += s * s;
        count += 1;
      }
    return count > 0 ? std::sqrt(sum / count / 0.973 / 1.5) : 0;
  }
  static double spread_about(const std::vector<double>& v, double middle) {
    std::vector<double> sizes;
    for (const double x : v) sizes.push_back(std::abs(x - middle));
    return 1.4826 * median_or_nan(sizes);
  }

  void add_scan(const ScanView& scan, const CaptureInfo& info, const Bench& bench) {
    const auto beams = scan.range_mm.size();
    const auto angle = [&](std::size_t k) {
      return scan.geometry
                 ? wrap_angle(scan.geometry->first_rad + static_cast<double>(k) * scan.geometry->step_rad)
                 : bench.lidar.beam_angle(info.step_of(static_cast<int>(k)));
    };
    const auto range = [&](std::size_t k) { return static_cast<double>(scan.range_mm[k]); };
    std::map<int, double> now;
    for (std::size_t k = 0; k < beams; ++k) {
      const double at = angle(k), r = range(k);
      const bool counts = at >= options_.from_rad && at <= options_.to_rad;
      if (k >= 2 && k + 2 < beams) edge(range(k - 2), range(k - 1), r, range(k + 1), range(k + 2));
      if (!counts || k == 0 || k + 1 >= beams) continue;
      const int number = static_cast<int>(std::floor(at / sector_rad));
      Sector& sector = sectors_[number];
      const double left = range(k - 1), right = range(k + 1);
      if (!echo(left) || !echo(right)) {
        ++sector.all;
        sector.lost += !echo(r);
        continue;
      }
      const double middle = (left + right) / 2;
      ++sector.all;
      Step& step = steps_[static_cast<int>(middle / range_step_mm)];
      ++step.all;
      if (!echo(r)) {
        ++sector.lost;
        ++step.lost;
        continue;
      }
      if (std::abs(left - right) > std::max(smooth_mm, smooth_share * middle))
        continue;  // an edge, or a slant
      const double bend = r - middle;
      sector.bend_mm.push_back(bend);
      if (std::abs(bend) < std::max(smooth_mm, smooth_share * middle)) step.bend_mm.push_back(bend);
      if (k % 3 == 1) now[static_cast<int>(std::lround(at / (0.5 * rad_per_deg)))] = bend;
      if (scan.intensity.size() == beams) {
        const double light = scan.intensity[k];
        sector.light.push_back(light);
        step.light.push_back(light);
        if (light > 0)
          sector.light_bend.push_back((light - (scan.intensity[k - 1] + scan.intensity[k + 1]) / 2.0) /
                                      light);
      }
    }
    for (const auto& [place, bend] : now) {
      const auto then = before_.find(place);
      if (then == before_.end()) continue;
      Sector& sector = sectors_[static_cast<int>(std::floor(place * 0.5 * rad_per_deg / sector_rad))];
      sector.memory += bend * then->second;
      sector.along.push_back(bend);
      ++sector.pairs;
    }
    before_ = std::move(now);
  }

  void edge(double a, double b, double r, double c, double d) {
    if (!echo(a) || !echo(b) || !echo(r) || !echo(c) || !echo(d)) return;
    const double near = std::min(b, c), far = std::max(b, c);
    if (far - near < std::max(gap_mm, gap_share * far)) return;
    const auto flat = [](double x, double y) { return std::abs(x - y) < std::max(30.0, 0.02 * x); };
    if (!flat(a, b) || !flat(c, d)) return;
    if (place_.size() < 200000) place_.push_back(std::clamp((r - near) / (far - near), -0.2, 1.2));
  }

  void finish(Sector& s) {
    if (s.all >= fewest) lost_.push_back(100.0 * static_cast<double>(s.lost) / static_cast<double>(s.all));
    if (s.bend_mm.size() < fewest) return;
    const double middle = median_or_nan(s.bend_mm);  // a curved wall bends every time alike
    for (double& b : s.bend_mm) b -= middle;
    const double sigma = spread(s.bend_mm);
    noise_.push_back(sigma);
    const double limit = 3 * std::sqrt(1.5) * std::max(sigma, 0.3);
    tails_.push_back(
        100.0 *
        static_cast<double>(std::ranges::count_if(s.bend_mm, [&](double b) { return std::abs(b) > limit; })) /
        static_cast<double>(s.bend_mm.size()));
    if (s.pairs >= fewest) {
      double squares = 0, sum = 0;
      for (const double b : s.along) {
        squares += b * b;
        sum += b;
      }
      const double n = static_cast<double>(s.pairs), mean = sum / n;
      const double variance = squares / n - mean * mean;
      if (variance > 1e-9) memory_.push_back(std::clamp((s.memory / n - mean * mean) / variance, -1.0, 1.0));
    }
    if (s.light.size() < fewest) return;
    light_.push_back(median_or_nan(s.light));
    double squares = 0;
    for (const double b : s.light_bend) squares += b * b;
    light_noise_.push_back(
        100 * std::sqrt(squares / 1.5 / static_cast<double>(std::max<std::size_t>(1, s.light_bend.size()))));
  }

  StatisticsOptions options_;
  std::map<int, Sector> sectors_;
  std::map<int, Step> steps_;
  std::map<int, double> before_;
  std::vector<double> noise_, tails_, memory_, light_, light_noise_, lost_, place_;
};

}  // namespace

RecordingStatistics recording_statistics(const std::vector<const Recording*>& recordings,
                                         const StatisticsOptions& options) {
  RecordingStatistics out;
  Collector collector(options);
  for (const Recording* recording : recordings)
    for (std::size_t i = 0; i < recording->captures().size(); ++i) collector.capture(*recording, i, out);
  collector.write(out);
  return out;
}

double distribution_distance(std::vector<double> a, std::vector<double> b) {
  if (a.empty() || b.empty()) return std::nan("");
  std::ranges::sort(a);
  std::ranges::sort(b);
  double worst = 0;
  std::size_t i = 0, k = 0;
  while (i < a.size() && k < b.size()) {
    const double x = std::min(a[i], b[k]);
    while (i < a.size() && a[i] <= x) ++i;
    while (k < b.size() && b[k] <= x) ++k;
    worst = std::max(worst, std::abs(static_cast<double>(i) / static_cast<double>(a.size()) -
                                     static_cast<double>(k) / static_cast<double>(b.size())));
  }
  return worst;
}

double distance_probability(double distance, std::size_t values, std::size_t other_values) {
  const double root = std::sqrt(static_cast<double>(values) * static_cast<double>(other_values) /
                                static_cast<double>(values + other_values));
  const double lambda = (root + 0.12 + 0.11 / root) * distance;
  if (lambda < 0.3) return 1;  // The series converges slowly; it is 1 to 5 digits.
  double sum = 0;
  for (int k = 1; k <= 100; ++k) sum += (k % 2 ? 2 : -2) * std::exp(-2 * k * k * lambda * lambda);
  return std::clamp(sum, 0.0, 1.0);
}

}  // namespace fit
