// SPDX-License-Identifier: MIT
#include "fit/explain/spread.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <tuple>

#include "fit/explain/odds.hpp"

namespace fit::explain {
namespace {

// Log Bayes factors. Of 60 recordings with nothing missing none came nearer than 1.5 to the first.
constexpr double accept_at = odds::against_any + odds::worth_a_first_name;
constexpr double accept_rare_at = 5.5;  // ... where single samples decide, whose odds are less certain
constexpr double told_apart_at = 3;

double price_of_size(double gain) { return 0.5 * std::log(1 + 2 * std::max(0.0, gain)) + 0.7; }

const Mechanism* mechanism(const char* id) { return find_mechanism(id); }

// ---- variance --------------------------------------------------------------------------------------------

/// Neighbouring cells of one target in one group.
struct Pool {
  double freedom = 0, variance = 0, beam_deg = 0, intensity = 0, lever2 = 0;
  int capture = 0;
};

std::vector<Pool> pools_of(const Reduced& reduced) {
  std::vector<Pool> pools;
  constexpr int beams = 8;
  for (const Group& group : reduced.groups) {
    if (group.scans < 3) continue;
    Pool pool;
    int count = 0, target = -1;
    const auto finish = [&] {
      if (count > 0 && pool.freedom > 0) {
        pool.variance /= pool.freedom;
        pool.beam_deg /= count;
        pool.intensity /= count;
        pool.lever2 /= count;
        pools.push_back(pool);
      }
      pool = Pool();
      count = 0;
    };
    for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
      const Cell& cell = reduced.cells[i];
      if (!cell.smooth || cell.n < 2) continue;
      if (count == beams || cell.at.target != target) finish();
      target = cell.at.target;
      pool.capture = group.capture;
      const double lever = cell.sight.beam_lever();
      pool.freedom += cell.n - 1;
      pool.variance += (cell.n - 1) * cell.variance_mm2;
      pool.beam_deg += cell.beam_rad * deg_per_rad;
      pool.intensity += cell.at.intensity;
      pool.lever2 += lever * lever;
      ++count;
    }
    finish();
  }
  return pools;
}

/// Sum of variances with non-negative sizes, fitted by the likelihood of the pools' sample variances.
class VarianceModel {
 public:
  VarianceModel(const std::vector<Pool>& pools, Estimate stated, double fixed, double discount)
      : pools_(pools), stated_(stated), fixed_(fixed), discount_(discount) {}

  struct Fit {
    Eigen::VectorXd value, sigma;  ///< First: the constant variance, then one for each column.
    double log_likelihood = 0;
  };
  /// `columns`: variance for size one of every term at every pool. `free`: the stated noise is no constraint.
  /// The first `places` columns are differences between places and may be negative.
  [[nodiscard]] Fit fit(const std::vector<std::vector<double>>& columns, bool free,
                        std::size_t places = 0) const {
    const auto k = static_cast<Eigen::Index>(columns.size()) + 1;
    const double s0 = stated_.value, prior_mean = s0 * s0;
    const double prior_sigma = std::max(0.02 * s0 * s0, 2 * s0 * stated_.u);
    double mean = 0, freedom = 0;
    for (const Pool& p : pools_) {
      mean += p.freedom * p.variance;
      freedom += p.freedom;
    }
    mean = freedom > 0 ? mean / freedom : prior_mean;
    Eigen::VectorXd x = Eigen::VectorXd::Zero(k);
    x[0] = std::max(0.05 * mean, mean - fixed_);
    for (Eigen::Index j = 1; j < k; ++j) {
      double scale = 0;
      for (const double c : columns[static_cast<std::size_t>(j - 1)]) scale += c;
      scale /= static_cast<double>(std::max<std::size_t>(1, pools_.size()));
      x[j] = scale > 0 ? 0.05 * mean / scale : 0;
    }
    Eigen::MatrixXd normal(k, k);
    Eigen::VectorXd row(k);
    for (int iteration = 0; iteration < 12; ++iteration) {
      Eigen::VectorXd rhs = Eigen::VectorXd::Zero(k);
      normal.setZero();
      for (std::size_t i = 0; i < pools_.size(); ++i) {
        row[0] = 1;
        for (Eigen::Index j = 1; j < k; ++j) row[j] = columns[static_cast<std::size_t>(j - 1)][i];
        const double v = std::max(1e-3, row.dot(x) + fixed_);
        const double w = discount_ * pools_[i].freedom / (2 * v * v);
        normal.noalias() += w * row * row.transpose();
        rhs.noalias() += w * (pools_[i].variance - fixed_) * row;
      }
      if (!free) {
        normal(0, 0) += 1 / (prior_sigma * prior_sigma);
        rhs[0] += prior_mean / (prior_sigma * prior_sigma);
      }
      for (Eigen::Index j = 0; j < k; ++j) normal(j, j) *= 1 + 1e-9;
      Eigen::VectorXd next = normal.ldlt().solve(rhs);
      if (!next.allFinite()) break;
      for (Eigen::Index j = 1; j < k; ++j)
        if (j > static_cast<Eigen::Index>(places)) next[j] = std::max(next[j], 0.0);
      next[0] = std::max(next[0], 1e-3 * mean);
      const bool settled = (next - x).norm() < 1e-6 * (1 + x.norm());
      x = next;
      if (settled) break;
    }
    Fit result;
    result.value = x;
    result.sigma = normal.inverse().diagonal().cwiseAbs().cwiseSqrt();
    result.log_likelihood = likelihood(columns, x);
    if (!free) result.log_likelihood -= 0.5 * std::pow((x[0] - prior_mean) / prior_sigma, 2);
    return result;
  }

  [[nodiscard]] const std::vector<Pool>& pools() const { return pools_; }

  /// What one more column gains in captures that it was not fitted to, each with its own constant noise. Not
  /// known with fewer than three; none, unless two confirm it and fewer deny it.
  [[nodiscard]] std::optional<double> unseen_gain(const std::vector<std::vector<double>>& columns,
                                                  const std::vector<double>& more, std::size_t places,
                                                  bool free) const {
    std::set<int> captures;
    for (const Pool& p : pools_) captures.insert(p.capture);
    if (captures.size() < 3) return {};
    const int blocks = static_cast<int>(std::min<std::size_t>(8, captures.size()));
    std::map<int, int> block;
    for (const int capture : captures) {
      const int next = static_cast<int>(block.size()) % blocks;
      block.emplace(capture, next);
    }
    double gain = 0;
    int confirmed = 0, denied = 0;
    for (int b = 0; b < blocks; ++b) {
      std::vector<Pool> others, own;
      std::vector<std::vector<double>> others_columns(columns.size() + 1), own_columns(columns.size() + 1);
      for (std::size_t i = 0; i < pools_.size(); ++i) {
        const bool is_own = block.at(pools_[i].capture) == b;
        (is_own ? own : others).push_back(pools_[i]);
        for (std::size_t j = 0; j <= columns.size(); ++j)
          (is_own ? own_columns : others_columns)[j].push_back(j < columns.size() ? columns[j][i] : more[i]);
      }
      const VarianceModel taught(others, stated_, fixed_, discount_), asked(own, stated_, fixed_, discount_);
      double change =
          asked.with_own_constant(own_columns, taught.fit(others_columns, free, places).value, places);
      others_columns.pop_back();
      own_columns.pop_back();
      change -= asked.with_own_constant(own_columns, taught.fit(others_columns, free, places).value, places);
      gain += change;
      if (std::abs(change) < 0.5) continue;  // has no say
      (change > 0 ? confirmed : denied) += 1;
    }
    return confirmed > 1 && confirmed > denied ? gain : std::min(gain, -1.0);
  }

 private:
  /// Best likelihood over the constant variance, all other sizes given.
  [[nodiscard]] double with_own_constant(const std::vector<std::vector<double>>& columns, Eigen::VectorXd x,
                                         std::size_t places) const {
    for (std::size_t j = 1; j <= places; ++j) x[static_cast<Eigen::Index>(j)] = 0;
    double best = -1e300, at = x[0];
    for (double step = 2, from = at; step > 1.01; step = std::sqrt(step), from = at)
      for (int k = -6; k <= 6; ++k) {
        x[0] = from * std::pow(step, k);
        const double l = likelihood(columns, x);
        if (l <= best) continue;
        best = l;
        at = x[0];
      }
    return best;
  }

  [[nodiscard]] double likelihood(const std::vector<std::vector<double>>& columns,
                                  const Eigen::VectorXd& x) const {
    double sum = 0;
    for (std::size_t i = 0; i < pools_.size(); ++i) {
      double v = x[0] + fixed_;
      for (std::size_t j = 0; j < columns.size(); ++j)
        v += columns[j][i] * x[static_cast<Eigen::Index>(j) + 1];
      v = std::max(1e-3, v);
      sum -= discount_ * pools_[i].freedom / 2 * (std::log(v) + pools_[i].variance / v);
    }
    return sum;
  }

  const std::vector<Pool>& pools_;
  Estimate stated_;
  double fixed_, discount_;
};

/// Standard uncertainty of a size from that of its square.
Estimate root(double square, double sigma) {
  const double size = std::sqrt(std::max(0.0, square));
  return {size, size > 0 ? std::min(sigma / (2 * size), std::sqrt(sigma)) : std::sqrt(sigma)};
}

class VarianceSearch {
 public:
  VarianceSearch(const VarianceModel& model, bool has_intensity)
      : model_(model), has_intensity_(has_intensity) {}

  void run(SpreadResult& result, double jitter_rad2) {
    if (model_.pools().size() < 3) return;
    if (several_places) by_place();
    if (jitter_rad2 > 0) columns_.push_back(lever_column());
    for (int step = 0; step < 2; ++step) {
      std::vector<Suspect> suspects;
      base_ = model_.fit(columns_, free_, places_);
      if (has_intensity_ && !taken("intensity-noise", result)) suspects.push_back(intensity_noise());
      if (!taken("sunlight", result)) suspects.push_back(sunlight());
      if (!free_) suspects.push_back(range_noise());
      if (!taken("angle-jitter", result)) suspects.push_back(angle_jitter());
      std::ranges::sort(suspects, [](const auto& a, const auto& b) { return a.evidence > b.evidence; });
      // What does not help on captures that it has not seen is not believed.
      std::erase_if(suspects, [&](const Suspect& s) {
        if (s.evidence < accept_at || s.mechanism->id == "range-noise") return false;
        const auto gain = model_.unseen_gain(columns_, column_of(s), places_, free_);
        return gain && *gain < 0;
      });
      if (suspects.empty() || suspects.front().evidence < accept_at) break;
      std::vector<Suspect> set{suspects.front()};
      for (std::size_t i = 1; i < suspects.size(); ++i)
        if (suspects[i].evidence > suspects.front().evidence - told_apart_at) set.push_back(suspects[i]);
      if (set.size() > 1) {
        result.undecided.push_back(set);
        break;
      }
      if (suspects.size() > 1) set.front().ahead = suspects[0].evidence - suspects[1].evidence;
      accept(set.front(), result);
    }
    base_ = model_.fit(columns_, free_, places_);
    result.sigma_mm = std::sqrt(base_.value[0]);
    if (jitter_rad2 > 0) whole_jitter(result);
    for (std::size_t c = 0; places_ > 0 && c <= places_; ++c)
      result.sigma_by_capture_mm.push_back(std::sqrt(
          std::max(1e-3, base_.value[0] + (c > 0 ? base_.value[static_cast<Eigen::Index>(c)] : 0))));
  }

 private:
  /// Beams may scatter on their own beside what a scan has in common: the spread of samples shows both.
  void whole_jitter(SpreadResult& result) const {
    const auto at = static_cast<Eigen::Index>(places_) + 1;
    const double degree2 = deg_per_rad * deg_per_rad;
    const Estimate whole = root(base_.value[at] * degree2, base_.sigma[at] * degree2);
    for (Suspect& s : result.accepted) {
      if (s.mechanism->id != "angle-jitter") continue;
      Estimate& common = s.parameters.at("sigma_deg");
      if (whole.value > 1.2 * common.value && whole.value > common.value + 3 * std::hypot(whole.u, common.u))
        common = whole;
    }
  }

  /// A constant noise for every place, if the places differ. Whatever depends on slant or light is then
  /// judged within places.
  void by_place() {
    int captures = 0;
    for (const Pool& p : model_.pools()) captures = std::max(captures, p.capture + 1);
    if (captures < 2) return;
    // Beside a slope with the slant: else a place whose walls are seen at more of a slant is only noisier.
    std::vector<std::vector<double>> columns;
    for (int c = 1; c < captures; ++c) {
      columns.emplace_back();
      for (const Pool& p : model_.pools()) columns.back().push_back(p.capture == c);
    }
    auto slanted = columns;
    slanted.push_back(lever_column());
    const auto places = static_cast<std::size_t>(captures - 1);
    const double gain = model_.fit(slanted, free_, places).log_likelihood -
                        model_.fit({lever_column()}, free_).log_likelihood;
    const double each = gain / static_cast<double>(places);
    if (gain - price_of_size(each) * static_cast<double>(places) < accept_rare_at) return;
    columns_ = columns;
    places_ = places;
  }

  static bool taken(const char* id, const SpreadResult& result) {
    return std::ranges::any_of(result.accepted, [&](const Suspect& s) { return s.mechanism->id == id; });
  }

  void accept(const Suspect& suspect, SpreadResult& result) {
    if (suspect.mechanism->id == "range-noise")
      free_ = true;
    else
      columns_.push_back(column_of(suspect));
    result.accepted.push_back(suspect);
  }

  std::vector<double> column_of(const Suspect& suspect) const {
    const std::string& id = suspect.mechanism->id;
    const auto at = [&](const char* name) { return suspect.parameters.at(name).value; };
    if (id == "intensity-noise") return intensity_column(at("exponent"));
    if (id == "sunlight") return light_column(at("centre_deg"), at("width_deg"));
    return lever_column();
  }

  std::vector<double> intensity_column(double exponent) const {
    std::vector<double> column;
    for (const Pool& p : model_.pools())
      column.push_back(std::isfinite(p.intensity) ? std::pow(1000 / std::max(20.0, p.intensity), exponent)
                                                  : 0);
    return column;
  }
  std::vector<double> light_column(double centre, double width) const {
    std::vector<double> column;
    for (const Pool& p : model_.pools()) {
      const double away = wrap_angle((p.beam_deg - centre) * rad_per_deg) * deg_per_rad / width;
      column.push_back(std::exp(-away * away / 2));
    }
    return column;
  }
  std::vector<double> lever_column() const {
    std::vector<double> column;
    for (const Pool& p : model_.pools()) column.push_back(p.lever2);
    return column;
  }

  /// Log-likelihood gain of one more column.
  VarianceModel::Fit more(const std::vector<double>& column, double& gain) const {
    auto columns = columns_;
    columns.push_back(column);
    const auto fit = model_.fit(columns, free_, places_);
    gain = fit.log_likelihood - base_.log_likelihood;
    return fit;
  }

  Suspect intensity_noise() const {
    Suspect best;
    best.mechanism = mechanism("intensity-noise");
    for (const double exponent : {1.0, 1.5, 2.0, 2.5, 3.0, 4.0}) {
      double gain = 0;
      const auto fit = more(intensity_column(exponent), gain);
      if (gain <= best.gain) continue;
      best.gain = gain;
      const Eigen::Index last = fit.value.size() - 1;
      best.parameters = {{"sigma_mm_at_1000_counts", root(fit.value[last], fit.sigma[last])},
                         {"exponent", {exponent, 1 / std::sqrt(1 + gain)}}};
    }
    best.evidence = best.gain - price_of_size(best.gain) - odds::against_place(best.gain, 2);
    return best;
  }

  Suspect sunlight() const {
    Suspect best;
    best.mechanism = mechanism("sunlight");
    double low = 1e9, high = -1e9;
    for (const Pool& p : model_.pools()) {
      low = std::min(low, p.beam_deg);
      high = std::max(high, p.beam_deg);
    }
    const Parameter& bounds = best.mechanism->parameters[2];
    const auto gain_of = [&](double centre, double width) {
      const std::vector<double> column = light_column(centre, width);
      double gain = 0;
      if (*std::ranges::max_element(column) < 0.5) return gain;  // a size at a place that no beam saw
      (void)more(column, gain);
      return gain;
    };
    double centre = 0, width = 0;
    const auto take_if_better = [&](double c, double w) {
      if (w < bounds.lower || w > bounds.upper) return;
      const double gain = gain_of(c, w);
      if (gain <= best.gain) return;
      best.gain = gain;
      centre = c;
      width = w;
    };
    if (high - low > 20)
      for (const double w : {5.0, 9.0, 16.0, 28.0})
        for (double c = low; c <= high; c += 0.8 * w) take_if_better(c, w);
    if (best.gain > 2) {
      constexpr double finest = 0.02, hardly = 0.01;
      for (double share = 0.3; share > finest;) {
        const double before = best.gain, c = centre, w = width;
        for (const double other : {c - share * w, c + share * w}) take_if_better(other, w);
        for (const double other : {w / (1 + share), w * (1 + share)}) take_if_better(c, other);
        if (best.gain < before + hardly) share /= 2;
      }
    }
    if (best.gain > 0) {
      double gain = 0;
      const VarianceModel::Fit fit = more(light_column(centre, width), gain);
      best.parameters["sigma_mm"] = root(fit.value[fit.value.size() - 1], fit.sigma[fit.sigma.size() - 1]);
      // To where the log-likelihood has fallen by a half, on a parabola through places well aside.
      const double aside = 0.25 * width;
      const auto uncertainty = [&](double one, double other) {
        return aside / std::sqrt(2 * std::max(0.05, best.gain - (one + other) / 2));
      };
      const double centre_u = uncertainty(gain_of(centre - aside, width), gain_of(centre + aside, width));
      const double width_u = uncertainty(gain_of(centre, width - aside), gain_of(centre, width + aside));
      // A window's light has another profile than this one: its width at half height is 1.2 of this one's.
      constexpr double unknown_profile = 0.18;
      best.parameters["centre_deg"] = {centre, centre_u};
      best.parameters["width_deg"] = {width, std::hypot(width_u, unknown_profile * width)};
    }
    best.evidence = best.gain - price_of_size(best.gain) - odds::against_place(best.gain, (high - low) / 12) -
                    odds::against_place(best.gain, 2);
    return best;
  }

  Suspect range_noise() const {
    Suspect suspect;
    suspect.mechanism = mechanism("range-noise");
    const auto fit = model_.fit(columns_, true, places_);
    suspect.gain = fit.log_likelihood - base_.log_likelihood;
    const double extra = fit.value[0] - base_stated();
    suspect.parameters = {
        {"sigma_mm", root(std::max(0.0, extra), std::hypot(fit.sigma[0], stated_variance_u()))}};
    suspect.evidence = extra > 0 ? suspect.gain - 2 : -1;
    return suspect;
  }

  Suspect angle_jitter() const {
    Suspect suspect;
    suspect.mechanism = mechanism("angle-jitter");
    const auto fit = more(lever_column(), suspect.gain);
    const Eigen::Index last = fit.value.size() - 1;
    const double degree2 = deg_per_rad * deg_per_rad;
    const Estimate sigma = root(fit.value[last] * degree2, fit.sigma[last] * degree2);
    suspect.parameters = {{"sigma_deg", sigma}};
    suspect.evidence = suspect.gain - price_of_size(suspect.gain);
    // No mirror is so loose: something else scatters.
    if (sigma.value > suspect.mechanism->parameters.front().largest) suspect.evidence = -1;
    return suspect;
  }

  [[nodiscard]] double base_stated() const { return stated.value * stated.value; }
  [[nodiscard]] double stated_variance_u() const { return 2 * stated.value * stated.u; }

  const VarianceModel& model_;
  bool has_intensity_;
  bool free_ = false;
  std::size_t places_ = 0;  ///< The first so many columns are places.
  std::vector<std::vector<double>> columns_;
  VarianceModel::Fit base_;

 public:
  Estimate stated;
  bool several_places = false;
};

// ---- scans --------------------------------------------------------------------------------------

/// What one scan's cells say together of a common range and a common angle: information and score.
struct Scan {
  int group = 0, scans = 0;
  int capture = 0;
  double through_capture = 1;  ///< Share of its capture that has passed at its end.
  std::int64_t seq = 0;        ///< In its capture.
  std::int64_t counted = 0;    ///< In the recording.
  std::int64_t turn = 0;       ///< Of the mirror, by the lidar's clock.
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
  Eigen::Vector2d score = Eigen::Vector2d::Zero();
};

/// Of single samples about what their scan has in common, mm^2. The typical spread of a few samples, a
/// median, is a little too small, and a thousand scans would show that.
double own_variance(const Group& group) {
  const double typical = group.sigma_mm * group.sigma_mm + 1.0 / 12;
  const double news =
      static_cast<double>(group.pairs) * (1 - 2.0 / std::max<double>(3, static_cast<double>(group.cells)));
  if (group.scans >= weighted_from_scans || news < 200) return typical;
  return std::clamp(group.lagged[0] / news, 0.9 * typical, 1.2 * typical);
}

std::vector<Scan> scans_of(const Reduced& reduced) {
  std::vector<Scan> scans;
  for (const Sector& s : reduced.sectors) {
    const Group& group = reduced.groups[static_cast<std::size_t>(s.group)];
    if (scans.empty() || scans.back().group != s.group || scans.back().seq != s.seq) {
      Scan scan;
      scan.group = s.group;
      scan.seq = s.seq;
      scan.counted = static_cast<std::int64_t>(scans.size());
      scan.turn = s.turn;
      scan.scans = group.scans;
      scan.capture = group.capture;
      scans.push_back(scan);
    }
    const double precision = 1 / own_variance(group);
    Scan& scan = scans.back();
    Eigen::Matrix2d information;
    information << s.w, s.wv, s.wv, s.wvv;
    scan.information += precision * information;
    scan.score += precision * Eigen::Vector2d(s.wd, s.wdv);
  }
  std::map<int, std::int64_t> last;
  for (const Scan& s : scans) last[s.capture] = std::max(last[s.capture], s.seq);
  for (Scan& s : scans)
    s.through_capture = static_cast<double>(s.seq + 1) / static_cast<double>(last[s.capture] + 1);
  return scans;
}

/// How scans are counted: from 0 in every capture, through the recording, or with the mirror through the time
/// between captures as well.
using Numbering = std::int64_t Scan::*;
constexpr std::array<Numbering, 3> numberings{&Scan::seq, &Scan::counted, &Scan::turn};

// Standard sizes of patterns that are tried, and the log of what trying costs.
constexpr double least_pattern_mm = 0.01, most_pattern_mm = 5, price_of_pattern_size = 2;

/// What scans of every class, their number modulo the number of classes, have in common.
struct Classes {
  std::vector<double> score, information;

  Classes(const std::vector<Scan>& scans, Numbering number, std::size_t modulus)
      : score(modulus, 0.0), information(modulus, 0.0) {
    for (const Scan& s : scans) {
      const std::size_t at = static_cast<std::size_t>(s.*number) % modulus;
      score[at] += s.score[0];
      information[at] += s.information(0, 0);
    }
  }
  [[nodiscard]] double value(std::size_t at) const {
    return information[at] > 0 ? score[at] / information[at] : 0;
  }
  /// Log-likelihood that these values gain, and its evidence against a prior whose scale is searched.
  [[nodiscard]] std::pair<double, double> gain(double inflate) const {
    double sum = 0, best = -1e300;
    for (std::size_t c = 0; c < score.size(); ++c)
      if (information[c] > 0) sum += 0.5 * score[c] * score[c] / information[c] / inflate;
    for (double scale_mm = least_pattern_mm; scale_mm < most_pattern_mm; scale_mm *= 2)
      best = std::max(best, evidence_at(scale_mm, inflate));
    return {sum, best - price_of_pattern_size};
  }
  /// Squared scatter of scans within their classes, in units of their own noise; at least 1.
  [[nodiscard]] double scatter(const std::vector<Scan>& scans, Numbering number) const {
    double squares = 0;
    for (const Scan& s : scans) {
      if (s.information(0, 0) <= 0) continue;
      const double off =
          s.score[0] / s.information(0, 0) - value(static_cast<std::size_t>(s.*number) % score.size());
      squares += off * off * s.information(0, 0);
    }
    return std::max(1.0, squares / std::max(1.0, static_cast<double>(scans.size() - score.size())));
  }

 private:
  [[nodiscard]] double evidence_at(double scale_mm, double inflate) const {
    double evidence = 0;
    const auto modulus = static_cast<double>(score.size());
    for (std::size_t c = 0; c < score.size(); ++c) {
      if (information[c] <= 0) continue;
      const double known = information[c] / inflate * scale_mm * scale_mm;
      const double own = 0.5 * score[c] * score[c] / information[c] / inflate;
      evidence += own * known / (1 + known);
      // Deviations from a mean: one class says nothing that the others have not said.
      evidence -= 0.5 * std::log(1 + known) * (modulus - 1) / modulus;
    }
    return evidence;
  }
};

/// Faces do not drift: a pattern that grows or fades within a capture, or from the first capture to the last,
/// is something else.
bool grows_or_fades(const std::vector<Scan>& scans, Numbering number, const Classes& pattern,
                    double inflate) {
  const double last = std::max(1, scans.back().group);
  const auto significance = [&](const auto& place) {
    // The pattern with a slope beside the pattern itself, whose size is open.
    Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
    Eigen::Vector2d score = Eigen::Vector2d::Zero();
    for (const Scan& s : scans) {
      const double size = pattern.value(static_cast<std::size_t>(s.*number) % pattern.score.size());
      const Eigen::Vector2d x(size, size * place(s));
      information += s.information(0, 0) * x * x.transpose();
      score += s.score[0] * x;
    }
    const double own = information(1, 1) - information(0, 1) * information(0, 1) / information(0, 0);
    if (!(own > 1e-9 * information(1, 1)) || !(information(1, 1) > 0)) return 0.0;
    const double slope = score[1] - information(0, 1) / information(0, 0) * score[0];
    return 0.5 * slope * slope / own / inflate;
  };
  constexpr double beyond_chance = 6;
  return significance([](const Scan& s) {
           return (static_cast<double>(s.seq) - (s.scans - 1) / 2.0) / std::max(1, s.scans);
         }) > beyond_chance ||
         significance([last](const Scan& s) { return s.group / last - 0.5; }) > beyond_chance;
}

/// Squared scatter of scans with the same number in their captures, in units of their own noise, whatever
/// the pattern is; at least 1.
double scatter_of_numbers(const std::vector<Scan>& scans) {
  std::map<std::int64_t, std::vector<const Scan*>> by_number;
  for (const Scan& s : scans)
    if (s.information(0, 0) > 0) by_number[s.seq].push_back(&s);
  double excess = 0, count = 0;
  const bool few = by_number.size() * 2 > scans.size();
  for (const auto& [seq, list] : by_number) {
    if (list.size() < 2) continue;
    double mean = 0, weight = 0;
    for (const Scan* s : list) {
      mean += s->score[0];
      weight += s->information(0, 0);
    }
    mean /= weight;
    for (const Scan* s : list) {
      const double d = s->score[0] / s->information(0, 0) - mean;
      excess += d * d * s->information(0, 0);
      count += 1;
    }
    count -= 1;
  }
  return count > 10 ? std::max(1.0, excess / count) : few ? 1.5 : 1.0;
}

/// Amplitude and phase of the faces' first harmonic.
std::map<std::string, Estimate> faces_of(const Classes& pattern, double inflate) {
  const auto faces = static_cast<double>(pattern.score.size());
  double sine = 0, cosine = 0, information = 0;
  for (std::size_t i = 0; i < pattern.score.size(); ++i) {
    const double x = 2 * pi * static_cast<double>(i) / faces;
    sine += 2 * pattern.value(i) * std::sin(x) / faces;
    cosine += 2 * pattern.value(i) * std::cos(x) / faces;
    information += pattern.information[i];
  }
  const double u = std::sqrt(2 * inflate / information);
  double amplitude = std::hypot(sine, cosine), phase = std::atan2(cosine, sine) * deg_per_rad,
         phase_u = u / std::max(u, amplitude) * deg_per_rad;
  if (faces == 2) {
    amplitude = std::abs(pattern.value(0) - pattern.value(1)) / 2;
    phase = pattern.value(0) > pattern.value(1) ? 90 : -90;
    phase_u = 0;
  }
  return {{"amplitude_mm", {amplitude, u}}, {"phase_deg", {phase, phase_u}}, {"facets", {faces, 0}}};
}

/// How a pattern grows: within every capture, or from capture to capture; 1 at its end.
using Growth = double (*)(const Scan& scan, const Scan& last);
double in_captures(const Scan& scan, const Scan&) { return scan.through_capture; }
double over_captures(const Scan& scan, const Scan& last) {
  return (scan.capture + 1.0) / (last.capture + 1.0);
}

/// What scans of every class have in common where that grows: information and score of the classes, of what
/// is news in captures whose own means are not known.
MeanModel::Products growing_classes(const std::vector<Scan>& scans, Numbering number, int modulus,
                                    Growth growth) {
  MeanModel::Products sums{Eigen::MatrixXd::Zero(modulus, modulus), Eigen::VectorXd::Zero(modulus)};
  Eigen::VectorXd weighted(modulus);
  for (std::size_t first = 0, end = 0; first < scans.size(); first = end) {
    weighted.setZero();
    double weight = 0, score = 0;
    for (end = first; end < scans.size() && scans[end].group == scans[first].group; ++end) {
      const Scan& s = scans[end];
      const auto at = static_cast<Eigen::Index>(s.*number % modulus);
      const double size = growth(s, scans.back());
      weighted[at] += s.information(0, 0) * size;
      sums.square(at, at) += s.information(0, 0) * size * size;
      sums.along[at] += s.score[0] * size;
      weight += s.information(0, 0);
      score += s.score[0];
    }
    if (weight <= 0) continue;
    sums.square -= weighted * weighted.transpose() / weight;
    sums.along -= score / weight * weighted;
  }
  return sums;
}

/// A pattern of scans' numbers that grows.
struct GrowingPattern {
  double gain = 0, evidence = -1;
  std::string describes;
};

GrowingPattern growing_pattern(const std::vector<Scan>& scans, double price, std::int64_t longest) {
  struct Way {
    Growth growth;
    const char* says;
  };
  const double price_of_way = std::log(2.0);
  GrowingPattern best;
  for (const Way way :
       {Way{in_captures, "within every capture"}, Way{over_captures, "from capture to capture"}})
    for (const Numbering number : numberings)
      for (int modulus = 2; modulus <= static_cast<int>(std::min<std::int64_t>(8, longest - 1)); ++modulus) {
        if (way.growth == over_captures && scans.front().capture == scans.back().capture) continue;
        const double inflate =
            Classes(scans, number, static_cast<std::size_t>(modulus)).scatter(scans, number);
        MeanModel::Products sums = growing_classes(scans, number, modulus, way.growth);
        sums.square /= inflate;
        sums.along /= inflate;
        for (double scale_mm = least_pattern_mm; scale_mm < most_pattern_mm; scale_mm *= 2) {
          const Prior prior{Eigen::VectorXd::Zero(modulus), Eigen::VectorXd::Constant(modulus, scale_mm)};
          const MeanModel::Fit fit = MeanModel::solve(sums, prior, false);
          const double evidence = fit.evidence - price_of_pattern_size - price - price_of_way;
          if (evidence > best.evidence)
            best = {fit.gain, evidence,
                    "the range follows the number of the scan, the same every " + std::to_string(modulus) +
                        " scans, and more and more so " + way.says};
        }
      }
  return best;
}

/// Common ranges that depend on the scan's number only: mirror faces, which are taken off, or anything else.
void scan_numbers(std::vector<Scan>& scans, SpreadResult& result) {
  if (scans.size() < 20) return;
  const double of_numbers = scatter_of_numbers(scans);
  std::int64_t longest = 0;
  for (const Scan& s : scans) longest = std::max(longest, s.seq + 1);
  const double price = std::log(4.0) + std::log(static_cast<double>(numberings.size()));
  Suspect facet;
  facet.mechanism = mechanism("facet-wobble");
  facet.evidence = -1;
  bool drifts = false;
  Numbering counted_as = numberings.front();
  for (const Numbering number : numberings)
    for (std::size_t faces = 2; faces <= static_cast<std::size_t>(std::min<std::int64_t>(8, longest - 1));
         ++faces) {
      const Classes pattern(scans, number, faces);
      const double inflate = number == &Scan::seq ? of_numbers : pattern.scatter(scans, number);
      const auto [gain, evidence] = pattern.gain(inflate);
      // A multiple of the right number fits as well, and so does another count in captures that go on.
      if (evidence - price <= facet.evidence + 3) continue;
      facet.evidence = evidence - price;
      facet.gain = gain;
      facet.parameters = faces_of(pattern, inflate);
      counted_as = number;
      drifts = facet.evidence > accept_at && grows_or_fades(scans, number, pattern, inflate);
    }
  double every_gain = 0, every = -1;
  if (longest <= 400)
    std::tie(every_gain, every) =
        Classes(scans, &Scan::seq, static_cast<std::size_t>(longest)).gain(of_numbers);
  if (drifts && every < facet.evidence) every = facet.evidence;
  std::string describes =
      "the range depends on the number of the scan in its capture in a way that no mirror face and no "
      "swinging stage makes";
  const GrowingPattern growing = growing_pattern(scans, price, longest);
  facet.ahead = facet.evidence + odds::worth_a_name - growing.evidence;
  if (facet.ahead < 0 && growing.evidence > every) {
    every = growing.evidence;
    every_gain = growing.gain;
    describes = growing.describes;
    drifts = true;
  }
  // Captures that hardly see a face twice must say so better than any pattern of scans does.
  const bool repeats =
      facet.evidence > accept_at && 2 * facet.parameters.at("facets").value <= static_cast<double>(longest);
  if (facet.evidence > accept_at && facet.evidence > every + (repeats ? -3 : 1) && !drifts) {
    result.accepted.push_back(facet);
    const auto faces = static_cast<std::size_t>(std::lround(facet.parameters.at("facets").value));
    const Classes pattern(scans, counted_as, faces);
    for (Scan& s : scans)
      s.score -= s.information.col(0) * pattern.value(static_cast<std::size_t>(s.*counted_as) % faces);
  } else if (every > accept_rare_at) {
    Unexplained u;
    u.observable = Observable::range_mean;
    u.coordinate = Coordinate::scan_seq;
    u.gain = every_gain;
    u.evidence = every;
    u.from = 0;
    u.to = static_cast<double>(longest - 1);
    u.describes = describes;
    result.unknown.push_back(u);
  }
}

/// A stage that still swings: an angle that depends on the time since the move, the same in every capture.
void swinging(Reduced& reduced, SpreadResult& result) {
  struct Row {
    std::size_t first, last;
  };
  std::vector<Sector*> rows;
  for (Sector& s : reduced.sectors)
    if (s.approach != 0 && s.wvv > 0) rows.push_back(&s);
  if (rows.size() < 60) return;
  std::map<std::pair<int, int>, std::vector<std::size_t>> blocks;
  for (std::size_t i = 0; i < rows.size(); ++i) blocks[{rows[i]->group, rows[i]->number}].push_back(i);
  std::vector<double> precision;
  for (const Sector* s : rows) {
    const double sigma = reduced.groups[static_cast<std::size_t>(s->group)].sigma_mm;
    precision.push_back(1 / (sigma * sigma + 1.0 / 12));
  }
  Eigen::MatrixXd wave(static_cast<Eigen::Index>(rows.size()), 2);
  const auto shape = [&](double tau, double hz) {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const double t = rows[i]->since_move_s, size = rows[i]->approach * std::exp(-t / tau);
      wave(static_cast<Eigen::Index>(i), 0) = size * std::cos(2 * pi * hz * t);
      wave(static_cast<Eigen::Index>(i), 1) = -size * std::sin(2 * pi * hz * t);
    }
    for (const auto& [key, list] : blocks) {
      Eigen::RowVector2d mean = Eigen::RowVector2d::Zero();
      for (const std::size_t i : list) mean += wave.row(static_cast<Eigen::Index>(i));
      mean /= static_cast<double>(list.size());
      for (const std::size_t i : list) wave.row(static_cast<Eigen::Index>(i)) -= mean;
    }
    Eigen::Matrix2d square = Eigen::Matrix2d::Zero();
    Eigen::Vector2d along = Eigen::Vector2d::Zero();
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const Eigen::Vector2d x = wave.row(static_cast<Eigen::Index>(i)).transpose();
      square.noalias() += precision[i] * rows[i]->wvv * x * x.transpose();
      along += precision[i] * rows[i]->wdv * x;
    }
    square.diagonal().array() += 1e-9 + 1e-9 * square.diagonal().maxCoeff();
    struct Result {
      double gain;
      Eigen::Vector2d value;
    };
    const Eigen::Vector2d value = square.inverse() * along;
    return Result{0.5 * along.dot(value), value};
  };
  Suspect suspect;
  suspect.mechanism = mechanism("settling");
  double best_tau = 0.1, best_hz = 0;
  Eigen::Vector2d value = Eigen::Vector2d::Zero();
  const auto look = [&](double tau, double hz) {
    const auto r = shape(tau, hz);
    if (!(r.gain > suspect.gain)) return;
    suspect.gain = r.gain;
    best_tau = tau;
    best_hz = hz;
    value = r.value;
  };
  for (const double tau : {0.05, 0.1, 0.2, 0.4, 1.0})
    for (double hz = 0; hz < 19.5; hz += 0.5) look(tau, hz);
  double step_tau = 1.4, step_hz = 0.3;
  for (int pass = 0; pass < 12; ++pass) {
    const double tau = best_tau, hz = best_hz;
    for (const double t : {tau / step_tau, tau * step_tau}) look(std::clamp(t, 0.02, 3.0), hz);
    for (const double f : {hz - step_hz, hz + step_hz}) look(best_tau, std::clamp(f, 0.0, 19.9));
    if (best_tau == tau && best_hz == hz) {
      step_tau = std::sqrt(step_tau);
      step_hz /= 2;
    }
  }
  // Random angles of whole scans look like a swing now and then: their spread is the noise to be beaten.
  double excess = 0, count = 0;
  for (const Scan& s : scans_of(reduced)) {
    if (s.information(1, 1) <= 0) continue;
    excess += s.score[1] * s.score[1] / s.information(1, 1);
    count += 1;
  }
  const double inflate = count > 10 ? std::max(1.0, (excess - 2 * suspect.gain) / count) : 1;
  suspect.gain /= inflate;
  suspect.evidence = suspect.gain - 2 * price_of_size(suspect.gain) - odds::against_place(suspect.gain, 3) -
                     odds::against_place(suspect.gain, 20);
  if (suspect.evidence < accept_at) return;
  // All four together: a swing that fades sooner seems to begin larger.
  const auto swing = [&](double tau, double hz) {
    shape(tau, hz);
    return Eigen::VectorXd(wave * value);
  };
  constexpr double share = 0.02, aside_hz = 0.02;
  Eigen::MatrixXd slopes(wave.rows(), 4);
  shape(best_tau, best_hz);
  slopes.leftCols(2) = wave;
  slopes.col(2) = (swing(best_tau * (1 + share), best_hz) - swing(best_tau * (1 - share), best_hz)) /
                  (2 * share * best_tau);
  slopes.col(3) =
      (swing(best_tau, best_hz + aside_hz) - swing(best_tau, best_hz - aside_hz)) / (2 * aside_hz);
  Eigen::Matrix4d information = Eigen::Matrix4d::Zero();
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Eigen::Vector4d x = slopes.row(static_cast<Eigen::Index>(i)).transpose();
    information += precision[i] * rows[i]->wvv * x * x.transpose();
  }
  // What cannot be known better than by its order of magnitude stays finite.
  information(2, 2) += 1 / (best_tau * best_tau);
  information(3, 3) += 1 / (0.5 * 0.5 + 1 / (best_tau * best_tau));
  const Eigen::Matrix4d u2 = inflate * information.inverse();
  const double amplitude = value.norm();
  const Eigen::Vector2d out = value / amplitude, across(-out.y(), out.x());
  const Eigen::Matrix2d of_size = u2.topLeftCorner<2, 2>();
  suspect.parameters = {
      {"amplitude_deg", {amplitude * deg_per_rad, std::sqrt(out.dot(of_size * out)) * deg_per_rad}},
      {"phase_deg",
       {std::atan2(value[1], value[0]) * deg_per_rad,
        std::sqrt(across.dot(of_size * across)) / amplitude * deg_per_rad}},
      {"tau_s", {best_tau, std::sqrt(u2(2, 2))}},
      {"frequency_hz", {best_hz, std::sqrt(u2(3, 3))}}};
  result.accepted.push_back(suspect);
  shape(best_tau, best_hz);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double angle = wave.row(static_cast<Eigen::Index>(i)).dot(value);
    rows[i]->wd -= rows[i]->wv * angle;
    rows[i]->wdv -= rows[i]->wvv * angle;
  }
}

/// Random ranges and angles that a whole scan has in common.
void common_noise(const std::vector<Scan>& scans, const Reduced& reduced, SpreadResult& result) {
  if (scans.size() < 10) return;
  const auto likelihood = [&](double range2, double angle2) {
    double sum = 0;
    for (const Scan& s : scans) {
      if (s.scans < 2) continue;
      // Scans are counted from their capture's mean: of n scans, n - 1 are news, noise and all.
      const double news = 1 - 1.0 / s.scans;
      const Eigen::Matrix2d d = Eigen::Vector2d(range2, angle2).asDiagonal();
      const Eigen::Matrix2d m = Eigen::Matrix2d::Identity() + d * s.information;
      sum += 0.5 * s.score.dot(m.inverse() * d * s.score) -
             0.5 * news * std::log(std::max(1e-300, m.determinant()));
    }
    return sum;
  };
  // Profile on logarithmic grids, finer in each pass.
  double range2 = 0, angle2 = 0, best = 0;
  const auto improve = [&](double r, double a) {
    const double l = likelihood(r, a);
    if (l > best) {
      best = l;
      range2 = r;
      angle2 = a;
    }
  };
  double only_range = 0, only_range2 = 0, only_angle = 0, only_angle2 = 0;
  for (double r = 0.003; r < 20; r *= 1.5) {
    const double l = likelihood(r * r, 0);
    if (l > only_range) {
      only_range = l;
      only_range2 = r * r;
    }
  }
  const double most_deg = mechanism("angle-jitter")->parameters.front().largest;
  for (double a = 0.001; a < 2 * most_deg; a *= 1.5) {
    const double l = likelihood(0, std::pow(a * rad_per_deg, 2));
    if (l > only_angle) {
      only_angle = l;
      only_angle2 = std::pow(a * rad_per_deg, 2);
    }
  }
  improve(only_range2, 0);
  improve(0, only_angle2);
  improve(only_range2, only_angle2);
  double step = 1.4;
  for (int pass = 0; pass < 20 && best > 0; ++pass) {
    const double r = range2, a = angle2;
    for (const double f : {step, 1 / step}) improve(r * f, a);
    for (const double f : {step, 1 / step}) improve(range2, a * f);
    improve(0, angle2);
    improve(range2, 0);
    if (r == range2 && a == angle2) step = std::sqrt(step);
  }
  if (angle2 > std::pow(most_deg * rad_per_deg, 2)) {
    angle2 = only_angle = 0;
    range2 = only_range2;
    best = only_range;
  }
  const double range_gain = best - only_angle, angle_gain = best - only_range;
  const auto curvature = [&](double at, bool of_angle) {
    const double h = 0.1 * at;
    const auto l = [&](double x) { return of_angle ? likelihood(range2, x) : likelihood(x, angle2); };
    const double c = -(l(at + h) - 2 * l(at) + l(at - h)) / (h * h);
    return c > 0 ? 1 / std::sqrt(c) : at;
  };
  if (angle2 > 0 && angle_gain - price_of_size(angle_gain) > accept_at) {
    Suspect suspect;
    suspect.mechanism = mechanism("angle-jitter");
    suspect.gain = angle_gain;
    suspect.evidence = angle_gain - price_of_size(angle_gain);
    const double degree2 = deg_per_rad * deg_per_rad;
    suspect.parameters = {{"sigma_deg", root(angle2 * degree2, curvature(angle2, true) * degree2)}};
    result.accepted.push_back(suspect);
    result.noise.scan_angle_rad2 = angle2;
    for (const Group& group : reduced.groups)
      result.noise.angle_rad2.push_back(angle2 / std::max(1, group.scans));
  }
  if (range2 > 0 && range_gain - price_of_size(range_gain) > accept_at) {
    // The memory of the common range: lag-one correlation of its estimates.
    double products = 0, squares = 0;
    for (std::size_t i = 1; i < scans.size(); ++i) {
      if (scans[i].group != scans[i - 1].group) continue;
      const double a = scans[i].score[0] / std::max(1e-9, scans[i].information(0, 0)),
                   b = scans[i - 1].score[0] / std::max(1e-9, scans[i - 1].information(0, 0));
      products += a * b;
      squares += (a * a + b * b) / 2;
    }
    const double n = scans.front().scans;
    const double rho = std::clamp(squares > 0 ? products / squares + 1.5 / n : 0.0, 0.05, 0.98);
    double sigma2 = 0;
    for (const Group& group : reduced.groups) sigma2 = std::max(sigma2, group.sigma_mm * group.sigma_mm);
    Suspect suspect;
    suspect.mechanism = mechanism("correlated-noise");
    suspect.gain = range_gain;
    suspect.evidence = range_gain - price_of_size(range_gain);
    suspect.parameters = {{"rho", {rho, std::sqrt((1 - rho * rho) / static_cast<double>(scans.size()))}},
                          {"share", {std::min(1.0, range2 / (sigma2 + 1e-9)), 0.1}}};
    result.accepted.push_back(suspect);
    result.noise.scan_range_mm2 = range2;
    for (const Group& group : reduced.groups) {
      // Variance of the mean of n correlated values.
      double factor = 1;
      for (int k = 1; k < group.scans; ++k)
        factor += 2 * (1 - static_cast<double>(k) / group.scans) * std::pow(rho, k);
      result.noise.range_mm2.push_back(range2 * factor / std::max(1, group.scans));
    }
  }
}

// ---- memory -------------------------------------------------------------------------------------

/// Expected sums of lagged products of n demeaned AR(1) values of variance one, lags 0..3.
std::array<double, 4> lagged_of(int n, double rho) {
  std::array<double, 4> sums{};
  std::vector<double> row(static_cast<std::size_t>(n));
  double mean = 0;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) row[static_cast<std::size_t>(i)] += std::pow(rho, std::abs(i - j)) / n;
    mean += row[static_cast<std::size_t>(i)] / n;
  }
  for (int lag = 0; lag <= 3; ++lag)
    for (int i = 0; i + lag < n; ++i)
      sums[static_cast<std::size_t>(lag)] += (lag == 0 ? 1 : std::pow(rho, lag)) -
                                             row[static_cast<std::size_t>(i)] -
                                             row[static_cast<std::size_t>(i + lag)] + mean;
  return sums;
}

void memory(const Reduced& reduced, SpreadResult& result, double* discount) {
  std::map<int, std::pair<std::array<double, 4>, double>> by_length;  // sums in units of variance, cells
  for (const Group& group : reduced.groups) {
    if (group.scans < 4 || group.cells == 0) continue;
    auto& [sums, cells] = by_length[std::min(group.scans, 200)];
    const double scale = group.lagged[0] / (group.scans - 1.0) / static_cast<double>(group.cells);
    if (scale <= 0) continue;
    for (std::size_t k = 0; k < 4; ++k) sums[k] += group.lagged[k] / scale;
    cells += static_cast<double>(group.cells);
  }
  if (by_length.empty()) return;
  const auto misfit = [&](double rho, double share) {
    double sum = 0;
    for (const auto& [n, entry] : by_length) {
      const auto& [sums, cells] = entry;
      const auto ar = lagged_of(n, rho), white = lagged_of(n, 0);
      const double unit = sums[0] / (share * ar[0] + (1 - share) * white[0]);
      for (std::size_t k = 1; k <= 3 && static_cast<int>(k) < n; ++k) {
        const double expected = unit * (share * ar[k] + (1 - share) * white[k]);
        sum += std::pow(sums[k] - expected, 2) / (cells * (n - static_cast<double>(k)));
      }
    }
    return sum;
  };
  const double before = misfit(0, 0);
  double best = before, rho = 0, share = 0;
  for (const double r : {0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.87, 0.93, 0.97})
    for (const double s : {0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0}) {
      const double m = misfit(r, s);
      if (m >= best) continue;
      best = m;
      rho = r;
      share = s;
    }
  Suspect suspect;
  suspect.mechanism = mechanism("correlated-noise");
  suspect.gain = (before - best) / 2;
  suspect.evidence = suspect.gain - price_of_size(suspect.gain) - odds::against_place(suspect.gain, 2);
  if (suspect.evidence < accept_at) return;
  const double u = 1 / std::sqrt(1 + suspect.gain);
  suspect.parameters = {{"rho", {rho, u}}, {"share", {share, u}}};
  const bool there = std::ranges::any_of(
      result.accepted, [](const Suspect& s) { return s.mechanism->id == "correlated-noise"; });
  if (!there) result.accepted.push_back(suspect);
  // The mean of n such values scatters more than their number says, and they scatter less about it.
  double number = 0, factor = 0;
  for (const auto& [n, entry] : by_length) {
    double of_mean = 1, within = 1;
    for (int k = 1; k < n; ++k) {
      const double pair = 2 * (1 - static_cast<double>(k) / n) * std::pow(rho, k) * share;
      of_mean += pair;
      within -= pair / (n - 1.0);
    }
    factor += entry.second * of_mean / std::max(0.05, within);
    number += entry.second;
  }
  result.noise.factor = std::max(1.0, factor / number);
  *discount = (1 - rho * rho) / (1 + rho * rho) * share + (1 - share);
}

// ---- echoes -------------------------------------------------------------------------------------

void strays(const Reduced& reduced, SpreadResult& result) {
  double strays = 0, samples = 0;
  for (const Cell& cell : reduced.cells) {
    if (!cell.smooth || reduced.groups[static_cast<std::size_t>(cell.group)].scans < 4) continue;
    // A wide beam meets what stands behind an edge from farther away than most: no stray.
    constexpr double reach_rad = 1.2 * rad_per_deg;
    if (cell.at.gap_mm != 0 && std::abs(cell.at.edge_rad) < reach_rad) continue;
    strays += cell.far;
    samples += cell.n + cell.stray;
  }
  if (samples < 100) return;
  Suspect suspect;
  suspect.mechanism = mechanism("outliers");
  suspect.gain = 4 * strays;  // each lies where the noise leaves less than e^-18; distances are log-uniform
  suspect.evidence = suspect.gain - 4;
  const double fraction = strays / samples;
  suspect.parameters = {{"fraction", {fraction, std::sqrt(strays + 0.25) / samples}}};
  if (suspect.evidence > accept_rare_at) result.accepted.push_back(suspect);
}

void output_steps(const Reduced& reduced, SpreadResult& result, double* fixed_variance) {
  double best_step = 1, share = 0, total = 0;
  for (std::size_t q = 2; q <= 24; ++q) {
    double sum = 0;
    std::uint64_t most = 0;
    for (std::size_t r = 0; r < q; ++r) {
      const auto n = static_cast<std::uint64_t>(reduced.remainder[q * 25 + r]);
      sum += static_cast<double>(n);
      most = std::max(most, n);
    }
    if (sum < 200 || static_cast<double>(most) < 0.97 * sum) continue;
    best_step = static_cast<double>(q);
    share = static_cast<double>(most);
    total = sum;
  }
  if (best_step < 2) return;
  // A parked target without noise repeats itself too: then its spread is far below the step.
  double typical = 0;
  for (const Group& group : reduced.groups)
    typical += group.sigma_mm / static_cast<double>(reduced.groups.size());
  if (typical < 0.25 * best_step && reduced.cells.size() < 50) return;
  Suspect suspect;
  suspect.mechanism = mechanism("rounding");
  suspect.gain = share * std::log(best_step) - (total - share) * 5;
  suspect.evidence = suspect.gain - 4;
  suspect.parameters = {{"step_mm", {best_step, 0}}};
  if (suspect.evidence < accept_rare_at) return;
  result.accepted.push_back(suspect);
  *fixed_variance = best_step * best_step / 12;
}

/// Near an edge, unless its neighbours on both sides, farther than edges blur, see the target as well.
bool may_miss_its_target(const Reduced& reduced, std::size_t index) {
  constexpr double doubt_rad = 1.5 * rad_per_deg, blur_rad = 0.5 * rad_per_deg;
  constexpr double displaced_rad = 6 * rad_per_deg;  // 60 mm at half a metre
  const Cell& cell = reduced.cells[index];
  const double to_edge = std::abs(cell.at.edge_rad);
  if (to_edge < blur_rad) return true;
  // Nearer than `doubt_rad` to an edge its neighbours must see the target, on both sides; a beam without any
  // echo from farther inside needs only something of the target on both sides.
  const bool near = to_edge < doubt_rad;
  if (!near && (cell.n > 0 || to_edge > displaced_rad)) return false;
  const double from = near ? blur_rad : 0, to = near ? 2 * blur_rad : displaced_rad;
  const Group& group = reduced.groups[static_cast<std::size_t>(cell.group)];
  const auto sees_it = [&](const Cell& other) {
    return other.sight.target == cell.sight.target && 2 * other.n > other.n + other.stray + other.lost;
  };
  bool below = false, above = false;
  for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
    const double away = reduced.cells[i].beam_rad - cell.beam_rad;
    if (std::abs(away) < from || std::abs(away) > to || !sees_it(reduced.cells[i])) continue;
    (away < 0 ? below : above) = true;
  }
  return !below || !above;
}

void losses(const Reduced& reduced, SpreadResult& result) {
  struct Count {
    double intensity, beam_deg, lost, all;
  };
  std::vector<Count> counts;
  double lost = 0, all = 0;
  for (std::size_t i = 0; i < reduced.cells.size(); ++i) {
    const Cell& cell = reduced.cells[i];
    if (cell.n + cell.lost == 0) continue;
    if (std::abs(cell.at.incidence_rad) > 75 * rad_per_deg || may_miss_its_target(reduced, i)) continue;
    counts.push_back({cell.at.intensity, cell.beam_rad * deg_per_rad, static_cast<double>(cell.lost),
                      static_cast<double>(cell.n + cell.stray + cell.lost)});
    lost += cell.lost;
    all += counts.back().all;
  }
  if (lost < 3 || all < 100) return;
  // Cells that lost everything are as dark as the darkest seen.
  double darkest = 1e9;
  for (const Count& c : counts)
    if (std::isfinite(c.intensity)) darkest = std::min(darkest, c.intensity);
  for (Count& c : counts)
    if (!std::isfinite(c.intensity)) c.intensity = darkest;
  const double floor = 1e-6, rate = std::clamp(lost / all, floor, 1 - floor);
  const double constant = lost * std::log(rate) + (all - lost) * std::log(1 - rate);
  const double none = lost * std::log(1e-6);
  const auto likelihood = [&](auto probability) {
    double sum = 0;
    for (const Count& c : counts) {
      const double p = std::clamp(probability(c), floor, 1 - floor);
      sum += c.lost * std::log(p) + (c.all - c.lost) * std::log(1 - p);
    }
    return sum;
  };
  double best = constant, at = 0, width = 0;
  if (reduced.has_intensity) {
    double top = 0;
    for (const Count& c : counts) top = std::max(top, c.intensity);
    for (double i = std::max(3.0, darkest * 0.3); i < top; i *= 1.12)
      for (const double w : {0.03, 0.06, 0.1, 0.2, 0.35}) {
        const double l =
            likelihood([&](const Count& c) { return 1 / (1 + std::exp((c.intensity - i) / (w * i))); });
        if (l <= best) continue;
        best = l;
        at = i;
        width = w * i;
      }
  }
  double window = constant, centre = 0, elsewhere = lost;
  for (double c0 = -130; c0 <= 130; c0 += 6)
    for (const double w : {8.0, 14.0, 22.0}) {
      double in_lost = 0, in_all = 0;
      for (const Count& c : counts)
        if (std::abs(c.beam_deg - c0) < w) {
          in_lost += c.lost;
          in_all += c.all;
        }
      if (in_all < 1) continue;
      const double p_in = std::clamp(in_lost / in_all, floor, 1 - floor);
      const double p_out = std::clamp((lost - in_lost) / std::max(1.0, all - in_all), floor, 1 - floor);
      const double l = in_lost * std::log(p_in) + (in_all - in_lost) * std::log(1 - p_in) +
                       (lost - in_lost) * std::log(p_out) +
                       (all - in_all - lost + in_lost) * std::log(1 - p_out);
      if (l > window) {
        window = l;
        centre = c0;
        elsewhere = lost - in_lost;
      }
    }
  const bool light =
      std::ranges::any_of(result.accepted, [](const Suspect& s) { return s.mechanism->id == "sunlight"; });
  if (light && window > best - 8) return;  // part of it: background light also hides echoes
  Suspect suspect;
  suspect.mechanism = mechanism("dropout");
  suspect.gain = best - none;
  suspect.evidence = suspect.gain - 8;
  if (suspect.evidence < accept_rare_at) return;
  if (at > 0 && best - constant > 4 && best >= window - 3) {
    const double u = width / std::sqrt(1 + lost);
    suspect.parameters = {{"intensity_min", {at, u}}, {"width", {width, u}}};
    result.accepted.push_back(suspect);
    return;
  }
  // Light that falls in explains what is lost there, not what is lost everywhere.
  if (window - constant > 8 && elsewhere < 0.1 * lost) {
    Suspect sun;
    sun.mechanism = mechanism("sunlight");
    sun.gain = window - none;
    sun.evidence = window - none - 8;
    sun.parameters = {{"sigma_mm", {0, 1}}, {"centre_deg", {centre, 5}}, {"width_deg", {14, 5}}};
    if (!light) result.accepted.push_back(sun);
    return;
  }
  Unexplained u;
  u.observable = Observable::dropout;
  u.coordinate = Coordinate::beam;
  u.gain = constant - none;
  u.evidence = u.gain - 8;
  u.describes =
      "echoes are missing, " + rounded(100 * rate, 2) + " % of all, whatever their strength and angle";
  u.from = 180;
  u.to = -180;
  for (const Count& c : counts) {
    u.from = std::min(u.from, c.beam_deg);
    u.to = std::max(u.to, c.beam_deg);
  }
  if (lost >= 10) result.unknown.push_back(u);
}

/// Edges: how gradually the farther surface takes over.
void edges(const Reduced& reduced, SpreadResult& result) {
  struct Place {
    double away_deg, share, n;
  };
  std::map<int, std::vector<Place>> by_edge;
  int between = 0, mixed = 0, in_mixed = 0;
  for (const Cell& cell : reduced.cells) {
    if (cell.far_share < 0 || cell.edge < 0) continue;
    const int n = cell.n + cell.stray;
    if (n < 2) continue;
    by_edge[cell.edge].push_back({cell.at.edge_rad * deg_per_rad, cell.far_share, std::min(20.0, 1.0 * n)});
    between += cell.between;
    // Beside what the surfaces' places leave open.
    const double doubt = (2 * reduced.groups[static_cast<std::size_t>(cell.group)].sigma_mm + 8) /
                         std::max(1.0, cell.at.gap_mm);
    if (std::min(cell.far_share, 1 - cell.far_share) <= std::max(0.04, doubt)) continue;
    ++mixed;
    in_mixed += n;
  }
  const auto fit = [&](double width) {
    double sum = 0;
    for (const auto& [edge, places] : by_edge) {
      double best = -1e300;
      for (double shift = -1.2; shift <= 1.2; shift += std::clamp(width / 3, 0.01, 0.05)) {
        double l = 0;
        for (const Place& p : places) {
          const double far =
              std::clamp(0.5 * std::erfc((p.away_deg - shift) / width / std::sqrt(2.0)), 0.004, 0.996);
          l += p.n * (p.share * std::log(far) + (1 - p.share) * std::log(1 - far));
        }
        best = std::max(best, l);
      }
      sum += best;
    }
    return sum;
  };
  if (by_edge.empty() || mixed < 2) return;
  constexpr double hard_deg = 0.004;
  const double hard = fit(hard_deg);
  double best = hard, width = hard_deg;
  for (double w = 0.008; w < 0.6; w *= 1.25) {
    const double l = fit(w);
    if (l <= best) continue;
    best = l;
    width = w;
  }
  constexpr double finer = 1.03;
  for (double w = width / 1.25, from = width; w < 1.25 * from; w *= finer) {
    const double l = fit(w);
    if (l <= best) continue;
    best = l;
    width = w;
  }
  const auto reach = [&](double step) {  // to where the likelihood has fallen by a half
    double w = width;
    for (int k = 0; k < 40 && fit(w) > best - 0.5; ++k) w *= step;
    return w;
  };
  // A receiver that favours the stronger of two echoes changes over in less than the beam's width, by how
  // much is its own affair; where most samples of mixed beams are on one surface or the other, the width is
  // known from below only.
  const double own_affair = 2 * between < in_mixed ? 1.5 : 0.5;
  const double u = std::hypot((reach(finer) - reach(1 / finer)) / 2, own_affair * width);
  Suspect suspect;
  suspect.mechanism = mechanism("mixed-pixel");
  suspect.gain = best - hard + (between > 2 ? 2.0 * between : 0);
  suspect.evidence = suspect.gain - price_of_size(suspect.gain) - 2;
  suspect.parameters = {{"width_deg", {width, u}}};
  if (suspect.evidence <= accept_rare_at) return;
  result.accepted.push_back(suspect);
  result.noise.footprint_rad = width * rad_per_deg;
}

Estimate stated_noise(const Bench& bench) {
  Estimate stated{10, 10};
  if (const KnownMechanism* known = bench.knows("range-noise")) {
    const auto found = known->parameters.find("sigma_mm");
    if (found != known->parameters.end()) stated = found->second;
  }
  stated.u = std::max(stated.u, 0.02 * stated.value);
  return stated;
}

/// Where distances come in coarse steps, a cell's variance and memory depend on where its mean lies between
/// two of them. What makes less of a difference than that is not believed.
void distrust_beside_coarse_steps(const Reduced& reduced, SpreadResult& result) {
  const auto is = [](const char* id) { return [id](const Suspect& s) { return s.mechanism->id == id; }; };
  if (std::ranges::none_of(result.accepted, is("rounding"))) return;
  constexpr double share =
      0.05;  // of the variance; its log-likelihood grows by a quarter of the share's square a sample
  const double least = share * share / 4 * static_cast<double>(reduced.samples);
  std::erase_if(result.accepted, [&](const Suspect& s) {
    const bool of_noise = is("angle-jitter")(s) || is("correlated-noise")(s) || is("intensity-noise")(s) ||
                          is("sunlight")(s) || is("range-noise")(s);
    return of_noise && s.gain < least;
  });
}

}  // namespace

SpreadResult explain_spread(const Reduced& given) {
  Reduced reduced;  // only the sectors are changed: what a swinging stage explains is taken off
  reduced.bench = given.bench;
  reduced.groups = given.groups;
  reduced.sectors = given.sectors;
  SpreadResult result;
  double fixed = 1.0 / 12, discount = 1;
  output_steps(given, result, &fixed);
  strays(given, result);
  edges(given, result);
  swinging(reduced, result);
  std::vector<Scan> scans = scans_of(reduced);
  scan_numbers(scans, result);
  const bool numbered = !result.unknown.empty() || std::ranges::any_of(result.accepted, [](const Suspect& s) {
    return s.mechanism->id == "facet-wobble";
  });
  if (result.unknown.empty()) common_noise(scans, reduced, result);
  if (!numbered) memory(given, result, &discount);
  const std::vector<Pool> pools = pools_of(given);
  const Estimate stated = stated_noise(given.bench);
  const VarianceModel model(pools, stated, fixed, discount);
  VarianceSearch search(model, given.has_intensity);
  search.stated = stated;
  search.several_places = std::ranges::any_of(given.absent, [](const Absent& a) { return !a.empty(); });
  double jitter = 0;
  for (const Suspect& s : result.accepted)
    if (s.mechanism->id == "angle-jitter") jitter = 1;
  search.run(result, jitter);
  distrust_beside_coarse_steps(given, result);
  losses(given, result);
  return result;
}

}  // namespace fit::explain
