// SPDX-License-Identifier: MIT
#include "fit/explain/reduce.hpp"

#include <algorithm>
#include <cmath>

#include "fit/empirical.hpp"
#include "fit/explain/seen_edges.hpp"
#include "fit/median.hpp"

namespace fit::explain {
namespace {

constexpr int sectors_per_scan = 8;
constexpr double steady_within_k = 0.2;  // a thermometer that shows no more than that shows nothing
constexpr int scans_per_group = 200;     // a longer capture is split in time
constexpr int turning_beams = 3;         // beams taken together where every scan has its own stage angle
constexpr double edge_margin_rad = 1.3 * rad_per_deg;   // half a footprint and doubt about the yaw
constexpr double brink_margin_rad = 0.8 * rad_per_deg;  // where nothing lies behind the edge: only the yaw
constexpr double edge_window_rad = 2.5 * rad_per_deg;
constexpr double grazing_rad = 78 * rad_per_deg;
constexpr double no_echo_above_mm = 65000, no_echo_below_mm = 22;

constexpr std::size_t strays_at_most = 5000;

constexpr float not_looked = -1;  // no beam of that scan fell there

/// Scans side by side: one column for each beam, or, where scans have their own geometry, for each interval
/// of the beam angle as wide as the beams' spacing.
struct Samples {
  int scans = 0, beams = 0;
  std::vector<float> range, intensity;   ///< Scan after scan.
  std::vector<float> aside_rad;          ///< From the column's middle; empty when all beams lie there.
  std::vector<std::uint16_t> raw;        ///< Ranges as they came.
  std::vector<double> beam_rad, beam_s;  ///< Of the columns.
  std::vector<double> since_start_s;
  std::vector<std::int64_t> seq, turn;
  [[nodiscard]] std::size_t index(int scan, int beam) const {
    return static_cast<std::size_t>(scan) * static_cast<std::size_t>(beams) + static_cast<std::size_t>(beam);
  }
  [[nodiscard]] double at(int scan, int beam) const { return range[index(scan, beam)]; }
};

bool is_echo(double range) { return range >= no_echo_below_mm && range < no_echo_above_mm; }

/// Counts the mirror's turns between scans by the lidar's clock, which goes on between captures.
class TurnCounter {
 public:
  explicit TurnCounter(double scan_hz) : stated_ms_(scan_hz > 0 ? 1000 / scan_hz : 0) {}

  std::int64_t at(std::int64_t device_ms) {
    // A clock that stands or jumps back tells nothing.
    const std::int64_t since = last_ms_ ? device_ms - *last_ms_ : 0;
    std::int64_t turns = last_ms_ ? 1 : 0;
    if (since > 0 && stated_ms_ > 0) {
      turns = std::max<std::int64_t>(1, std::llround(static_cast<double>(since) / period_ms()));
      counted_ms_ += since;
      counted_ += turns;
    }
    last_ms_ = device_ms;
    return turn_ += turns;
  }

 private:
  /// The motor's own period, once a few seconds tell it better than what the bench states.
  [[nodiscard]] double period_ms() const {
    constexpr std::int64_t tells_ms = 2000;
    return counted_ms_ > tells_ms ? static_cast<double>(counted_ms_) / static_cast<double>(counted_)
                                  : stated_ms_;
  }

  double stated_ms_;
  std::optional<std::int64_t> last_ms_;
  std::int64_t turn_ = 0, counted_ms_ = 0, counted_ = 0;
};

/// Products of every beam's deviation in one scan with those in the scans before, by bands of lags.
class LagProducts {
 public:
  explicit LagProducts(std::size_t beams) : sums_{std::vector<double>(beams, 0.0)}, before_(beams, 0.0) {}

  /// `deviation` of every beam in the next scan; 0 where there is none.
  void add(const std::vector<double>& deviation, Group& group) {
    const int scan = static_cast<int>(sums_.size()) - 1;  // scans before this one
    std::vector<double> sum = sums_.back();
    for (std::size_t beam = 0; beam < sum.size(); ++beam) {
      const double d = deviation[beam], product = d * before_[beam];
      group.lagged[0] += d * d;
      group.lagged_squares += product * product;
      sum[beam] += d;
    }
    for (std::size_t band = 1; band < lag_bands.size() && lag_bands[band].first <= scan; ++band) {
      const std::vector<double>&to = sums_[static_cast<std::size_t>(scan - lag_bands[band].first + 1)],
            &from = sums_[static_cast<std::size_t>(std::max(0, scan - lag_bands[band].last))];
      double products = 0;
      for (std::size_t beam = 0; beam < sum.size(); ++beam)
        products += deviation[beam] * (to[beam] - from[beam]);
      group.lagged[band] += products;
    }
    sums_.push_back(std::move(sum));
    before_ = deviation;
  }

 private:
  std::vector<std::vector<double>> sums_;  ///< Of all deviations before scan 0, 1, ...
  std::vector<double> before_;
};

/// Reads one capture's scans into blocks and reduces each.
class Reducer {
 public:
  Reducer(const Recording& recording, Reduced& out, bool keep_samples)
      : recording_(recording),
        out_(out),
        nuisance_(recording.bench()),
        keep_samples_(keep_samples),
        turns_(recording.bench().lidar.scan_hz) {}

  void capture(std::size_t index) {
    index_ = index;
    info_ = &out_.captures[index];
    turning_ = std::abs(info_->stage_rate_rad_s) > 1e-9;
    spacing_rad_ = 0;
    columns_ = {};
    Samples block;
    recording_.for_each_scan(index, [&](const ScanView& scan) {
      if (block.scans == 0) block = empty_block(scan);
      if (!(scan.geometry ? add_by_angle(scan, block) : add_by_step(scan, block))) return;
      block.since_start_s.push_back(
          std::max(0.0, static_cast<double>(scan.host_us - info_->started_us) * 1e-6));
      block.seq.push_back(scan.seq);
      block.turn.push_back(turns_.at(scan.device_ms));
      ++block.scans;
      if (turning_ || block.scans == scans_per_group) {
        reduce_block(block);
        block.scans = 0;
      }
    });
    if (block.scans > 0) reduce_block(block);
  }

 private:
  /// Columns for scans like this one.
  Samples empty_block(const ScanView& scan) {
    if (!columns_.beam_rad.empty()) return columns_;
    const LidarGeometry& lidar = out_.bench.lidar;
    if (!scan.geometry) {
      columns_.beams = info_->beams();
      for (int k = 0; k < columns_.beams; ++k) {
        columns_.beam_rad.push_back(lidar.beam_angle(info_->first_step + k * info_->cluster));
        columns_.beam_s.push_back(lidar.beam_time_s(info_->first_step + k * info_->cluster));
      }
      return columns_;
    }
    columns_.beams =
        std::clamp(static_cast<int>(std::lround(2 * pi / std::abs(scan.geometry->step_rad))), 1, 20000);
    spacing_rad_ = 2 * pi / columns_.beams;
    const double turn_s = turn_time(scan);
    for (int k = 0; k < columns_.beams; ++k) {
      columns_.beam_rad.push_back((k + 0.5) * spacing_rad_ - pi);
      const double since_first =
          std::fmod(columns_.beam_rad.back() - scan.geometry->first_rad + 4 * pi, 2 * pi);
      columns_.beam_s.push_back(since_first / (2 * pi) * turn_s);
    }
    return columns_;
  }

  [[nodiscard]] double turn_time(const ScanView& scan) const {
    const double swept = std::abs(scan.geometry->step_rad) * static_cast<double>(scan.range_mm.size());
    if (scan.geometry->scan_s && *scan.geometry->scan_s > 0 && swept > 0)
      return *scan.geometry->scan_s * 2 * pi / swept;
    return 1 / out_.bench.lidar.scan_hz;
  }

  bool add_by_step(const ScanView& scan, Samples& block) const {
    const int beams = block.beams;
    if (beams <= 0 || spacing_rad_ > 0 || static_cast<int>(scan.range_mm.size()) < beams) return false;
    block.range.insert(block.range.end(), scan.range_mm.begin(), scan.range_mm.begin() + beams);
    block.raw.insert(block.raw.end(), scan.range_mm.begin(), scan.range_mm.begin() + beams);
    if (static_cast<int>(scan.intensity.size()) >= beams)
      block.intensity.insert(block.intensity.end(), scan.intensity.begin(), scan.intensity.begin() + beams);
    return true;
  }

  /// Every beam goes to the column that its own angle falls into; of two in one, the nearer to the middle.
  bool add_by_angle(const ScanView& scan, Samples& block) const {
    if (block.beams <= 0 || !(spacing_rad_ > 0)) return false;
    const std::size_t first = block.range.size(), more = static_cast<std::size_t>(block.beams);
    block.range.resize(first + more, not_looked);
    block.aside_rad.resize(first + more, static_cast<float>(pi));
    const bool lit = scan.intensity.size() == scan.range_mm.size() && !scan.intensity.empty();
    if (lit) block.intensity.resize(first + more, 0.0F);
    for (std::size_t k = 0; k < scan.range_mm.size(); ++k) {
      const double angle =
          wrap_angle(scan.geometry->first_rad + static_cast<double>(k) * scan.geometry->step_rad);
      const auto column = static_cast<std::size_t>(
          std::clamp(static_cast<int>((angle + pi) / spacing_rad_), 0, block.beams - 1));
      const auto aside = static_cast<float>(angle - block.beam_rad[column]);
      block.raw.push_back(scan.range_mm[k]);
      if (std::abs(aside) >= std::abs(block.aside_rad[first + column])) continue;
      block.aside_rad[first + column] = aside;
      block.range[first + column] = scan.range_mm[k];
      if (lit) block.intensity[first + column] = scan.intensity[k];
    }
    return true;
  }

  /// Ranges are brought to the middle of their column, by how the range changes along the target there.
  static void centre(Samples& block, const Scene& scene, double stage_rad) {
    if (block.aside_rad.empty()) return;
    for (int beam = 0; beam < block.beams; ++beam) {
      const double middle = block.beam_rad[static_cast<std::size_t>(beam)];
      const Sight at = scene.look(stage_rad, middle);
      if (at.target < 0) continue;
      for (int scan = 0; scan < block.scans; ++scan) {
        const std::size_t i = block.index(scan, beam);
        if (!is_echo(block.range[i])) continue;
        const Sight own = scene.look(stage_rad, middle + block.aside_rad[i]);
        if (own.target == at.target) block.range[i] += static_cast<float>(at.range_mm - own.range_mm);
      }
    }
  }

  void reduce_block(Samples& block) {
    Group group;
    group.capture = static_cast<int>(index_);
    group.scans = block.scans;
    const double middle_s = (block.since_start_s.front() + block.since_start_s.back()) / 2;
    group.stage_rad = info_->stage_rad + (turning_ ? info_->stage_rate_rad_s * middle_s : 0);
    group.time_s = info_->since_power_on_s.value_or(static_cast<double>(info_->started_us) * 1e-6) + middle_s;
    group.first_cell = out_.cells.size();
    const Scene scene(out_.bench, nuisance_, *info_, out_.absent[index_]);
    centre(block, scene, group.stage_rad);
    group.sigma_mm = typical_spread(block);
    const auto edges = scene.edges(group.stage_rad);
    const int stride = turning_ ? turning_beams : 1;
    index_of_beam_.assign(static_cast<std::size_t>(block.beams), -1);
    for (int beam = 0; beam + stride <= block.beams; beam += stride) {
      Cell cell = place(scene, edges, group, block, beam, stride);
      if (cell.sight.target < 0) continue;
      summarise(block, beam, stride, group, scene, cell);
      index_of_beam_[static_cast<std::size_t>(beam)] = static_cast<int>(out_.cells.size());
      cell.group = static_cast<int>(out_.groups.size());
      if (!cell.smooth) ++out_.left_out;
      out_.cells.push_back(cell);
    }
    group.last_cell = out_.cells.size();
    if (!turning_ && block.scans > 2) look_at_scans(block, group);
    count_remainders(block);
    out_.groups.push_back(group);
  }

  Cell place(const Scene& scene, const std::vector<Edge>& edges, const Group& group, const Samples& block,
             int beam, int stride) const {
    Cell cell;
    const auto first = static_cast<std::size_t>(beam), last = first + static_cast<std::size_t>(stride) - 1;
    cell.beam_rad = (block.beam_rad[first] + block.beam_rad[last]) / 2;
    cell.sight = scene.look(group.stage_rad, cell.beam_rad);
    if (cell.sight.target < 0) return cell;
    Circumstances& c = cell.at;
    scene.describe(cell.sight, group.stage_rad, edges, c);
    c.target = out_.same_as[static_cast<std::size_t>(cell.sight.target)];
    c.beam_rad = cell.beam_rad;
    c.stage_rad = group.stage_rad;
    c.time_s = group.time_s;
    c.temperature_k = info_->temperature_c ? *info_->temperature_c - out_.first_temperature_c
                                           : std::numeric_limits<double>::quiet_NaN();
    c.beam_time_s = (block.beam_s[first] + block.beam_s[last]) / 2;
    c.since_move_s = block.since_start_s.front() + c.beam_time_s;
    c.stage_rate_rad_s = info_->stage_rate_rad_s;
    c.approach = info_->approach;
    c.seq = static_cast<int>(block.seq.front());
    c.intensity = std::numeric_limits<double>::quiet_NaN();
    // Which wall a beam near a corner meets depends on where mount and walls really are.
    const Mount& mount = out_.bench.lidar.mount;
    const double sway = 3 * (mount.yaw_rad.u * cell.sight.range_mm + std::hypot(mount.x_mm.u, mount.y_mm.u));
    const bool near_corner =
        c.corner_mm < 8 + 0.003 * cell.sight.range_mm + sway / cell.sight.cos_incidence();
    const bool near_edge =
        std::abs(c.edge_rad) <= (c.gap_mm > 0 ? edge_margin_rad : brink_margin_rad) + spacing_rad_ / 2;
    const bool slanted = std::abs(cell.sight.incidence_rad) >= grazing_rad;
    cell.smooth = !near_edge && !near_corner && !slanted;
    cell.doubtful = !cell.smooth && !slanted && stride == 1;
    if (stride > 1) {
      const Sight left = scene.look(group.stage_rad, block.beam_rad[first]),
                  right = scene.look(group.stage_rad, block.beam_rad[last]);
      if (left.target != right.target) cell.smooth = false;
    }
    cell.nominal_mm = cell.sight.range_mm;
    const Edge* nearest = nullptr;
    const auto away = [&](const Edge& edge) {
      return std::abs(wrap_angle(cell.sight.bearing_rad - edge.bearing_rad));
    };
    for (const Edge& edge : edges)
      if (away(edge) < (nearest ? away(*nearest) : 1e9)) nearest = &edge;
    if (!nearest) return cell;
    cell.edge = nearest->id;
    if (!(std::abs(c.edge_rad) < edge_window_rad) || !(c.gap_mm > 0)) return cell;
    // Both surfaces may be slanted: each is taken where this beam would meet it.
    const int other = c.edge_rad > 0 ? behind(scene, *nearest, group) : nearest->id / 2;
    if (other >= 0 && other != cell.sight.target)
      cell.other_mm = scene.look_at(other, group.stage_rad, cell.beam_rad, {}).range_mm;
    return cell;
  }

  /// The target that begins where the edge's own ends.
  [[nodiscard]] int behind(const Scene& scene, const Edge& edge, const Group& group) const {
    constexpr double aside = 2e-4;
    return scene
        .look(group.stage_rad, edge.bearing_rad - edge.near_side * aside - group.stage_rad -
                                   out_.bench.lidar.mount.yaw_rad.value)
        .target;
  }

  /// Median over beams of each beam's own robust spread.
  [[nodiscard]] double typical_spread(const Samples& block) const {
    std::vector<double> spreads, values;
    for (int beam = 0; beam < block.beams; beam += std::max(1, block.beams / 200)) {
      double sum = 0;
      int count = 0;
      for (int scan = 1; scan < block.scans; ++scan) {
        const double a = block.at(scan, beam), b = block.at(scan - 1, beam);
        if (!is_echo(a) || !is_echo(b) || std::abs(a - b) > 400) continue;
        sum += std::abs(a - b);
        ++count;
      }
      if (count > 0) spreads.push_back(sum / count * 0.8862);
    }
    const double stated = stated_sigma(out_.bench);
    if (spreads.empty()) return stated;
    return std::max(0.3, median_of(spreads));
  }

  static double stated_sigma(const Bench& bench) {
    if (const KnownMechanism* noise = bench.knows("range-noise")) {
      const auto found = noise->parameters.find("sigma_mm");
      if (found != noise->parameters.end() && found->second.value > 0) return found->second.value;
    }
    return 10;
  }

  void summarise(const Samples& block, int beam, int stride, const Group& group, const Scene& scene,
                 Cell& cell) {
    values_.clear();
    double intensity = 0, intensity_squares = 0;
    int lit = 0, looked = 0;
    for (int scan = 0; scan < block.scans; ++scan) {
      for (int k = 0; k < stride; ++k) {
        const double range = block.at(scan, beam + k);
        if (range == not_looked) continue;
        ++looked;
        if (!is_echo(range)) {
          ++cell.lost;
          continue;
        }
        // Beams taken together are brought to their middle.
        const double own =
            stride == 1
                ? 0
                : scene.look(group.stage_rad, block.beam_rad[static_cast<std::size_t>(beam + k)]).range_mm -
                      cell.nominal_mm;
        values_.push_back(range - own);
        if (!block.intensity.empty()) {
          const double counts = block.intensity[block.index(scan, beam + k)];
          intensity += counts;
          intensity_squares += counts * counts;
          ++lit;
        }
      }
    }
    out_.samples += static_cast<long>(values_.size());
    if (lit > 0) {
      cell.at.intensity = intensity / lit;
      if (lit > 1)
        cell.intensity_sd =
            std::sqrt(std::max(0.0, (intensity_squares - intensity * intensity / lit) / (lit - 1)));
      out_.has_intensity = true;
    }
    if (values_.empty()) {
      cell.smooth = false;
      return;
    }
    const bool in_clear = cell.smooth;
    at_edge(cell, group);
    sorted_ = values_;
    // Around their own median: a cut around a prediction, which is off by as much as the mount is unknown,
    // lets noise decide on one side only, and shifts the means.
    const double middle = median_of(sorted_);
    for (double& v : sorted_) v = std::abs(v - middle);
    const double own = 1.4826 * median_of(sorted_);
    // A few samples say little about their own spread.
    const double least = values_.size() < 50 ? 25 : 4;
    const double reach =
        turning_ ? std::max(60.0, 10 * group.sigma_mm) : std::max({least, 6 * group.sigma_mm, 5 * own});
    double sum = 0, squares = 0;
    cell.first_kept = out_.kept.size();
    for (const double v : values_) {
      if (std::abs(v - middle) > reach) {
        ++cell.stray;
        if (std::abs(v - middle) > std::max({reach, 12 * group.sigma_mm, 60.0})) {
          ++cell.far;
          if (cell.smooth && out_.strays_mm.size() < strays_at_most) {
            out_.strays_mm.push_back(static_cast<float>(v));
            out_.strays_of_target.push_back(static_cast<float>(v / middle));
          }
        }
        continue;
      }
      sum += v - middle;
      squares += (v - middle) * (v - middle);
      ++cell.n;
      if (keep_samples_) out_.kept.push_back(static_cast<float>(v));
    }
    if (cell.n == 0) {
      cell.smooth = false;
      return;
    }
    cell.mean_mm = middle + sum / cell.n;
    if (cell.n > 1) cell.variance_mm2 = std::max(0.0, (squares - sum * sum / cell.n) / (cell.n - 1));
    if (turning_ && cell.stray > 0) cell.smooth = false;  // which of three is wrong nobody knows
    if (own > 1.6 * group.sigma_mm + 1 || cell.stray > 0 || cell.lost > 0 || cell.between > 0)
      cell.doubtful = false;
    if (own > 4 * group.sigma_mm + 20) cell.smooth = false;
    const bool astray = std::abs(cell.mean_mm - cell.nominal_mm) > astray_mm;
    if (astray || cell.n * 2 < looked - cell.lost) cell.smooth = false;
    out_.in_clear += in_clear;
    out_.astray += in_clear && astray;
  }

  /// Near an edge: where between the two surfaces the samples lie.
  void at_edge(Cell& cell, const Group& group) const {
    if (!(cell.other_mm > 0)) return;
    const bool on_near = cell.at.edge_rad > 0;
    const double near = on_near ? cell.nominal_mm : cell.other_mm,
                 gap = (on_near ? cell.other_mm : cell.nominal_mm) - near;
    if (gap < 12 * group.sigma_mm + 30) return;
    const double margin = (6 * group.sigma_mm + 15) / gap;
    double sum = 0;
    for (const double v : values_) {
      const double place = (v - near) / gap;
      sum += std::clamp(place, 0.0, 1.0);
      if (place > margin && place < 1 - margin) ++cell.between;
    }
    cell.far_share = sum / static_cast<double>(values_.size());
  }

  /// What all beams of a scan have in common, and how noise remembers the scans before.
  void look_at_scans(const Samples& block, Group& group) {
    const int width = std::max(1, (block.beams + sectors_per_scan - 1) / sectors_per_scan);
    LagProducts products(static_cast<std::size_t>(block.beams));
    std::vector<double> now(static_cast<std::size_t>(block.beams));
    std::vector<char> good(static_cast<std::size_t>(block.beams));
    for (int scan = 0; scan < block.scans; ++scan) {
      std::ranges::fill(now, 0.0);
      std::ranges::fill(good, 0);
      double sum = 0, weight = 0, lever = 0, square = 0, moment = 0;
      const std::size_t first_sector = out_.sectors.size();
      for (int beam = 0; beam < block.beams; ++beam) {
        const int index = index_of_beam_[static_cast<std::size_t>(beam)];
        if (index < 0) continue;
        const Cell& cell = out_.cells[static_cast<std::size_t>(index)];
        const double range = block.at(scan, beam);
        if (!cell.smooth || cell.stray > 0 || !is_echo(range)) continue;
        const double d = range - cell.mean_mm, v = cell.sight.stage_lever();
        const int number = beam / width;
        if (out_.sectors.size() == first_sector || out_.sectors.back().number != number) {
          Sector sector;
          sector.group = static_cast<int>(out_.groups.size());
          sector.seq = static_cast<int>(block.seq[static_cast<std::size_t>(scan)]);
          sector.turn = block.turn[static_cast<std::size_t>(scan)];
          sector.number = number;
          sector.since_move_s = block.since_start_s[static_cast<std::size_t>(scan)] +
                                block.beam_s[static_cast<std::size_t>(
                                    std::min(block.beams - 1, static_cast<int>((number + 0.5) * width)))];
          sector.approach = info_->approach;
          out_.sectors.push_back(sector);
        }
        Sector& sector = out_.sectors.back();
        // Where enough samples tell, a noisy beam counts less: else its noise looks like the whole scan's.
        const double q =
            block.scans < weighted_from_scans
                ? 1
                : std::clamp(group.sigma_mm * group.sigma_mm / std::max(1.0 / 12, cell.variance_mm2), 0.01,
                             4.0);
        sector.w += q;
        sector.wv += q * v;
        sector.wvv += q * v * v;
        sector.wd += q * d;
        sector.wdv += q * d * v;
        weight += q;
        sum += q * d;
        lever += q * v;
        square += q * v * v;
        moment += q * d * v;
        now[static_cast<std::size_t>(beam)] = d;
        good[static_cast<std::size_t>(beam)] = 1;
      }
      // Common range and common angle of the scan are taken off before the memory of single beams is judged.
      const double det = weight * square - lever * lever;
      double common = weight > 3 ? sum / weight : 0, angle = 0;
      if (weight > 8 && det > 1e-6 * weight * square) {
        angle = (weight * moment - lever * sum) / det;
        common = (sum - angle * lever) / weight;
      }
      for (std::size_t beam = 0; beam < now.size(); ++beam) {
        if (!good[beam]) continue;
        const Cell& cell = out_.cells[static_cast<std::size_t>(index_of_beam_[beam])];
        now[beam] -= common + angle * cell.sight.stage_lever();
        if (scan > 0) ++group.pairs;
      }
      products.add(now, group);
    }
    for (std::size_t i = group.first_cell; i < group.last_cell; ++i)
      if (out_.cells[i].smooth && out_.cells[i].stray == 0) ++group.cells;
  }

  void count_remainders(const Samples& block) {
    const std::size_t stride = std::max<std::size_t>(1, block.raw.size() / 2000);
    for (std::size_t i = 0; i < block.raw.size(); i += stride) {
      const std::uint16_t r = block.raw[i];
      if (!is_echo(r)) continue;
      for (std::size_t q = 2; q <= 24; ++q) ++out_.remainder[q * 25 + r % q];
    }
  }

  const Recording& recording_;
  Reduced& out_;
  Nuisance nuisance_;
  bool keep_samples_;
  TurnCounter turns_;
  std::size_t index_ = 0;
  const CaptureInfo* info_ = nullptr;
  Samples columns_;         ///< Of the capture, without scans.
  double spacing_rad_ = 0;  ///< Of the columns, where scans have their own geometry.
  bool turning_ = false;
  std::vector<double> values_, sorted_;
  std::vector<int> index_of_beam_;
};

}  // namespace

Reduced reduce(const Recording& recording, const Progress& progress, const Standing& standing,
               bool keep_samples) {
  Reduced out;
  out.bench = recording.bench();
  out.empirical = empirical_mechanisms(out.bench);
  out.captures = recording.captures();
  out.absent = standing.absent;
  out.absent.resize(out.captures.size());
  out.same_as = standing.same_as;
  for (std::size_t t = out.same_as.size(); t < out.bench.targets.size(); ++t)
    out.same_as.push_back(static_cast<int>(t));
  out.remainder.assign(25 * 25, 0);
  for (const CaptureInfo& capture : out.captures) {
    if (!capture.temperature_c) continue;
    out.first_temperature_c = *capture.temperature_c;
    break;
  }
  for (const CaptureInfo& capture : out.captures)
    if (capture.temperature_c && std::abs(*capture.temperature_c - out.first_temperature_c) > steady_within_k)
      out.has_temperature = true;
  Reducer reducer(recording, out, keep_samples);
  for (std::size_t i = 0; i < out.captures.size(); ++i) {
    reducer.capture(i);
    if (progress && i % 8 == 0)
      progress(static_cast<double>(i) / static_cast<double>(out.captures.size()), "reading");
  }
  return out;
}

Nuisance displaced(const Reduced& reduced, Nuisance nuisance, const std::vector<Active>& at_work) {
  for (const Active& active : at_work) {
    if (!active.mechanism->displaces || active.target < 0) continue;
    const Displacement moved = active.mechanism->displaces(active.values);
    for (std::size_t i = 0; i < reduced.bench.targets.size(); ++i) {
      if (reduced.same_as[i] != active.target) continue;
      nuisance.offset_mm[i] += moved.offset_mm;
      nuisance.turn_rad[i] += moved.turn_rad;
    }
  }
  return nuisance;
}

namespace {

/// Of the mechanisms at work and of what has no name.
Effect effect_there(const Reduced& reduced, const std::vector<Active>& at_work, const Circumstances& at) {
  Effect effect = effect_of(at_work, at);
  for (const Mechanism& unnamed : reduced.empirical) effect += unnamed.act(at, {});
  return effect;
}

}  // namespace

void predict(Reduced& reduced, const Nuisance& fitted, const std::vector<Active>& at_work,
             bool may_leave_out) {
  const Nuisance nuisance = displaced(reduced, fitted, at_work);
  for (const Group& group : reduced.groups) {
    const CaptureInfo& info = reduced.captures[static_cast<std::size_t>(group.capture)];
    const Scene scene(reduced.bench, nuisance, info, reduced.absent[static_cast<std::size_t>(group.capture)]);
    for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
      Cell& cell = reduced.cells[i];
      if (!cell.smooth) continue;
      const Effect effect = effect_there(reduced, at_work, cell.at);
      const Sight sight = may_leave_out
                              ? scene.look(group.stage_rad, cell.beam_rad, effect)
                              : scene.look_at(cell.sight.target, group.stage_rad, cell.beam_rad, effect);
      if (sight.target != cell.sight.target) {
        if (!may_leave_out) continue;
        cell.smooth = false;
        ++reduced.left_out;
        continue;
      }
      cell.sight = sight;
      cell.at.range_mm = sight.range_mm;
      cell.at.incidence_rad = sight.incidence_rad;
      cell.at.cos_incidence = sight.cos_incidence();
      cell.at.bearing_rad = sight.bearing_rad;
      cell.at.along_mm = sight.along_mm;
      cell.at.along_sign = sight.along_sign;
      cell.at.corner_mm = scene.to_corner_mm(sight);
      // Once more: mount and walls may have moved since the circumstances before.
      cell.nominal_mm = sight.range_mm + effect_there(reduced, at_work, cell.at).range_mm;
    }
  }
}

int reassign(Reduced& reduced, const Nuisance& fitted, const std::vector<Active>& at_work,
             double footprint_rad, bool may_leave_out) {
  const Nuisance nuisance = displaced(reduced, fitted, at_work);
  const Mount& mount = reduced.bench.lidar.mount;
  const double edge_margin = std::max(0.6 * rad_per_deg, 3.5 * footprint_rad);
  constexpr double doubt_left = 0.15;  // of the priors' sway
  int changed = 0;
  const std::map<int, SeenEdge> seen = seen_edges(reduced, fitted, at_work);
  for (const Group& group : reduced.groups) {
    const CaptureInfo& info = reduced.captures[static_cast<std::size_t>(group.capture)];
    const Scene scene(reduced.bench, nuisance, info, reduced.absent[static_cast<std::size_t>(group.capture)]);
    const auto edges = scene.edges(group.stage_rad);
    // Bright surfaces seem wider than they are: an edge is where the recording shows it.
    const auto from_edge = [&](int edge, const Circumstances& at) {
      const auto found = seen.find(edge);
      const bool known = found != seen.end() && found->second.settled;
      return std::min(std::abs(at.edge_rad),
                      std::abs(at.edge_rad - (known ? found->second.shift_deg * rad_per_deg : 0)));
    };
    const auto is_clear = [&](const Sight& sight, int edge, const Circumstances& at) {
      const double sway =
          3 * doubt_left * (mount.yaw_rad.u * sight.range_mm + std::hypot(mount.x_mm.u, mount.y_mm.u));
      return at.corner_mm >= 8 + 0.003 * sight.range_mm + sway / sight.cos_incidence() &&
             from_edge(edge, at) >= edge_margin + doubt_left * 3 * mount.yaw_rad.u;
    };
    for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
      Cell& cell = reduced.cells[i];
      if (!cell.doubtful && !(cell.smooth && may_leave_out)) continue;
      const Effect effect = effect_there(reduced, at_work, cell.at);
      const Sight sight = scene.look(group.stage_rad, cell.beam_rad, effect);
      Circumstances at = cell.at;
      at.corner_mm = at.edge_rad = std::numeric_limits<double>::infinity();
      at.gap_mm = at.pull_mm = 0;
      if (sight.target >= 0) scene.describe(sight, group.stage_rad, edges, at);
      at.target = sight.target < 0 ? -1 : reduced.same_as[static_cast<std::size_t>(sight.target)];
      if (cell.smooth) {
        // By geometry alone: how far a mean is off must not decide whether it counts.
        if (sight.target == cell.sight.target && at.corner_mm >= 8 + 0.003 * sight.range_mm) continue;
        cell.smooth = false;
        cell.doubtful = true;
        ++reduced.left_out;
        ++changed;
        continue;
      }
      if (sight.target < 0 || !is_clear(sight, cell.edge, at)) continue;
      const double nominal = sight.range_mm + effect.range_mm;
      if (std::abs(cell.mean_mm - nominal) > 60 + 5 * group.sigma_mm) continue;
      cell.sight = sight;
      cell.at = at;
      cell.nominal_mm = nominal;
      cell.smooth = true;
      cell.doubtful = false;
      --reduced.left_out;
      ++changed;
    }
  }
  return changed;
}

namespace {

/// One cell in place of several: their weighted deviation at the place of the middle one.
Cell middle_of(const std::vector<const Cell*>& run) {
  Cell cell = *run[run.size() / 2];
  double weight = 0, off = 0;
  cell.n = 0;
  for (const Cell* one : run) {
    const double w = one->n / one->pooled_mm2;
    weight += w;
    off += w * (one->mean_mm - one->nominal_mm);
    cell.n += one->n;
  }
  cell.mean_mm = cell.nominal_mm + off / weight;
  cell.pooled_mm2 = cell.n / weight;
  return cell;
}

}  // namespace

Reduced merged(const Reduced& reduced, std::size_t rows) {
  const auto smooth = static_cast<std::size_t>(std::ranges::count_if(reduced.cells, &Cell::smooth));
  const std::size_t together = std::max<std::size_t>(1, (smooth + rows - 1) / rows);
  Reduced out;
  out.bench = reduced.bench;
  out.captures = reduced.captures;
  out.absent = reduced.absent;
  out.same_as = reduced.same_as;
  out.first_temperature_c = reduced.first_temperature_c;
  out.has_intensity = reduced.has_intensity;
  out.has_temperature = reduced.has_temperature;
  out.empirical = reduced.empirical;
  std::vector<const Cell*> run;
  for (Group group : reduced.groups) {
    const std::size_t first = out.cells.size();
    const auto close = [&] {
      if (!run.empty()) out.cells.push_back(middle_of(run));
      run.clear();
    };
    for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
      const Cell& cell = reduced.cells[i];
      if (!cell.smooth) continue;
      if (!run.empty() && (run.size() == together || run.back()->sight.target != cell.sight.target)) close();
      run.push_back(&cell);
    }
    close();
    group.first_cell = first;
    group.last_cell = out.cells.size();
    out.groups.push_back(group);
  }
  return out;
}

namespace {

bool has_thermometer(const Reduced& reduced) {
  return std::ranges::any_of(reduced.captures,
                             [](const CaptureInfo& c) { return c.temperature_c.has_value(); });
}

}  // namespace

void append(Reduced& reduced, const Reduced& other) {
  // Temperatures count from the first that anybody read.
  const bool mine = has_thermometer(reduced), theirs = has_thermometer(other);
  if (!mine && theirs) reduced.first_temperature_c = other.first_temperature_c;
  const double warmer_k = mine && theirs ? other.first_temperature_c - reduced.first_temperature_c : 0;
  const auto captures = static_cast<int>(reduced.captures.size()),
             groups = static_cast<int>(reduced.groups.size());
  const std::size_t cells = reduced.cells.size();
  reduced.captures.insert(reduced.captures.end(), other.captures.begin(), other.captures.end());
  reduced.absent.insert(reduced.absent.end(), other.absent.begin(), other.absent.end());
  for (Group group : other.groups) {
    group.capture += captures;
    group.first_cell += cells;
    group.last_cell += cells;
    reduced.groups.push_back(group);
  }
  for (Cell cell : other.cells) {
    cell.group += groups;
    cell.at.temperature_k += warmer_k;
    reduced.cells.push_back(cell);
  }
  for (Sector sector : other.sectors) {
    sector.group += groups;
    reduced.sectors.push_back(sector);
  }
  for (std::size_t i = 0; i < reduced.remainder.size(); ++i) reduced.remainder[i] += other.remainder[i];
  reduced.strays_mm.insert(reduced.strays_mm.end(), other.strays_mm.begin(), other.strays_mm.end());
  reduced.strays_of_target.insert(reduced.strays_of_target.end(), other.strays_of_target.begin(),
                                  other.strays_of_target.end());
  reduced.samples += other.samples;
  reduced.has_intensity = reduced.has_intensity || other.has_intensity;
  reduced.has_temperature =
      reduced.has_temperature || other.has_temperature || std::abs(warmer_k) > steady_within_k;
  reduced.left_out += other.left_out;
  reduced.in_clear += other.in_clear;
  reduced.astray += other.astray;
}

double value_of(Coordinate coordinate, const Cell& cell, const Group& group) {
  switch (coordinate) {
    case Coordinate::beam:
      return cell.beam_rad * deg_per_rad;
    case Coordinate::stage:
      return group.stage_rad * deg_per_rad;
    case Coordinate::range:
      return cell.at.range_mm;
    case Coordinate::intensity:
      return cell.at.intensity;
    case Coordinate::incidence:
      return cell.at.incidence_rad * deg_per_rad;
    case Coordinate::edge_distance:
      return cell.at.edge_rad * deg_per_rad;
    case Coordinate::time:
      return group.time_s;
    case Coordinate::temperature:
      return cell.at.temperature_k;
    case Coordinate::approach:
      return cell.at.approach;
    case Coordinate::stage_rate:
      return cell.at.stage_rate_rad_s * deg_per_rad;
    case Coordinate::range_rate:
      return cell.sight.beam_lever();
    case Coordinate::scan_seq:
      return cell.at.seq;
    case Coordinate::target:
      return cell.at.target;
  }
  return 0;
}

}  // namespace fit::explain
