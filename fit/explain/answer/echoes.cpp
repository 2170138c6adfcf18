// SPDX-License-Identifier: MIT
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "fit/bench/empirical.hpp"
#include "fit/bench/radiometer.hpp"
#include "fit/explain/answer/twin.hpp"
#include "fit/explain/inference/runs.hpp"
#include "fit/numeric/median.hpp"

namespace fit::explain {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using L = IntensityLaw;

constexpr std::size_t rows_at_most = 6000;
constexpr double u_reflectance_relative = 0.1;  // nominal reflectances are
constexpr double least_sigma = 0.01;       // no law is better, and the tables take the rest
constexpr double worth_a_table = 0.003;

struct Echo {
  const Cell* cell = nullptr;
  double reflectance = 0.5, log_counts = 0, sigma = least_sigma;
  std::size_t surface = 0;
};

/// The lidar equation with an unknown grey of every surface, by damped least squares, and what it leaves
/// along brightness, range, incidence and beam as tables.
class Description {
 public:
  explicit Description(const Reduced& reduced) : reduced_(reduced) { collect(); }

  [[nodiscard]] bool possible() const { return echoes_.size() >= 30; }

  void write(Bench& bench) {
    fit();
    described_.relative_noise = sample_noise();
    for (std::size_t s = 0; s < surfaces_.size(); ++s)
      described_.surfaces[s].gain = std::exp(gains_[static_cast<Index>(s)]);
    describe_intensity(bench, described_);
    tables(bench);
  }

 private:
  void collect() {
    std::size_t usable = 0;
    for (const Cell& c : reduced_.cells) usable += is_usable(c);
    const std::size_t stride = 1 + usable / rows_at_most;
    std::size_t number = 0;
    for (const Cell& c : reduced_.cells)
      if (is_usable(c) && number++ % stride == 0) add(c);
    gains_ = VectorXd::Zero(static_cast<Index>(surfaces_.size()));
  }
  static bool is_usable(const Cell& c) {
    return c.usable && c.n > 0 && c.stray == 0 && std::isfinite(c.counts) && c.at.intensity >= 3;
  }
  void add(const Cell& c) {
    const Target& target = reduced_.bench.target_at(c.at.target);
    Echo e;
    e.cell = &c;
    e.reflectance = c.at.reflectance;
    e.log_counts = std::log(c.at.intensity);
    e.sigma = std::hypot(least_sigma, 0.3 / c.at.intensity);
    const auto found = std::ranges::find_if(
        surfaces_, [&](const auto& s) { return s.first == target.name && s.second == e.reflectance; });
    e.surface = static_cast<std::size_t>(found - surfaces_.begin());
    if (found == surfaces_.end()) {
      surfaces_.emplace_back(target.name, e.reflectance);
      described_.surfaces.push_back({target.name, e.reflectance, 1});
    }
    echoes_.push_back(e);
  }

  [[nodiscard]] double lawful(const Echo& e, const L& law) const {
    return law.log_counts(e.reflectance, e.cell->at.cos_incidence, e.cell->at.range_mm);
  }
  [[nodiscard]] double predicted(const Echo& e) const {
    return lawful(e, described_.law) + gains_[static_cast<Index>(e.surface)];
  }

  void fit() {
    double best = 1e300;
    L law;
    VectorXd gains;
    // Where detectors see all of the spot only from some distance, and where they bend: from several starts.
    for (const double overlap : {0.0, 4.4})
      for (const double full : {20.0, 8.0}) {
        L start;
        start.value = {6.8, 1, 0.5, 0.5, overlap, full};
        const double cost = descend(start, overlap > 0, full < 20);
        if (cost >= best - 2) continue;  // the simpler one, unless it is worse
        best = cost;
        law = described_.law;
        gains = gains_;
      }
    described_.law = law;
    gains_ = gains;
  }

  [[nodiscard]] double cost(const L& start) const {
    double sum = 0.5 * (gains_ / u_reflectance_relative).squaredNorm();
    for (int k = 1; k < L::size; ++k)
      sum += 0.5 * std::pow(described_.law.value[static_cast<std::size_t>(k)] -
                                start.value[static_cast<std::size_t>(k)],
                            2);
    for (const Echo& e : echoes_) {
      // Logarithm beyond three sigmas: a law that bends need not be thrown off by where it bends most.
      const double z = (e.log_counts - predicted(e)) / (3 * e.sigma);
      sum += 4.5 * std::log1p(z * z);
    }
    return sum;
  }

  /// The normal equations of one step.
  struct Normal {
    MatrixXd square;
    VectorXd along;
  };
  [[nodiscard]] Normal normal_at(const L& start, bool free_overlap, bool free_full) const {
    const Index n = L::size + gains_.size();
    Normal normal{MatrixXd::Zero(n, n), VectorXd::Zero(n)};
    VectorXd row(L::size);
    for (const Echo& e : echoes_) {
      const double here = lawful(e, described_.law);
      row.setZero();
      for (int k = 0; k < L::size; ++k) {
        if ((k == L::overlap && !free_overlap) || (k == L::full && !free_full)) continue;
        L up = described_.law;
        up.value[static_cast<std::size_t>(k)] += 1e-4;
        row[k] = (lawful(e, up) - here) / 1e-4;
      }
      const Index g = L::size + static_cast<Index>(e.surface);
      const double r = e.log_counts - here - gains_[static_cast<Index>(e.surface)], z = r / (3 * e.sigma);
      const double w = 1 / (e.sigma * e.sigma * (1 + z * z));
      normal.square.topLeftCorner(L::size, L::size) += w * row * row.transpose();
      normal.square.block(0, g, L::size, 1) += w * row;
      normal.square(g, g) += w;
      normal.along.head(L::size) += w * r * row;
      normal.along[g] += w * r;
    }
    normal.square.bottomLeftCorner(gains_.size(), L::size) =
        normal.square.topRightCorner(L::size, gains_.size()).transpose();
    for (Index k = 1; k < L::size; ++k) {
      const auto at = static_cast<std::size_t>(k);
      normal.square(k, k) += 1;
      normal.along[k] -= described_.law.value[at] - start.value[at];
    }
    for (Index g = L::size; g < n; ++g) {
      normal.square(g, g) += 1 / (u_reflectance_relative * u_reflectance_relative);
      normal.along[g] -= gains_[g - L::size] / (u_reflectance_relative * u_reflectance_relative);
    }
    return normal;
  }

  /// Levenberg-Marquardt; what is not free stays at its start.
  double descend(const L& start, bool free_overlap, bool free_full) {
    described_.law = start;
    gains_.setZero();
    double now = cost(start), damping = 1e-2;
    Normal normal = normal_at(start, free_overlap, free_full);
    for (int pass = 0; pass < 40; ++pass) {
      MatrixXd damped = normal.square;
      damped.diagonal() *= 1 + damping;
      const VectorXd step = damped.ldlt().solve(normal.along);
      const L law = described_.law;
      const VectorXd gains = gains_;
      for (int k = 0; k < L::size; ++k) described_.law.value[static_cast<std::size_t>(k)] += step[k];
      gains_ += step.tail(gains_.size());
      const double next = cost(start);
      if (!(next < now)) {
        described_.law = law;
        gains_ = gains;
        damping *= 10;
        if (damping > 1e8) break;
        continue;
      }
      const bool settled = now - next < 1e-3;
      now = next;
      damping = std::max(1e-9, damping / 10);
      if (settled) break;
      normal = normal_at(start, free_overlap, free_full);
    }
    return now;
  }

  /// What the law leaves, one coordinate after the other, each beside the ones before.
  void tables(Bench& bench) const {
    VectorXd rest(static_cast<Index>(echoes_.size()));
    for (std::size_t i = 0; i < echoes_.size(); ++i)
      rest[static_cast<Index>(i)] = echoes_[i].log_counts - predicted(echoes_[i]);
    table(bench, "intensity", rest, [this](const Echo& e) { return std::exp(predicted(e)); });
    table(bench, "range_mm", rest, [](const Echo& e) { return e.cell->at.range_mm; });
    table(bench, "incidence_deg", rest, [](const Echo& e) { return e.cell->at.incidence_rad * deg_per_rad; });
    table(bench, "beam_deg", rest, [](const Echo& e) { return e.cell->at.beam_rad * deg_per_rad; });
  }
  template <typename At>
  void table(Bench& bench, const char* coordinate, VectorXd& rest, const At& at) const {
    std::vector<WeighedValue> list;
    for (std::size_t i = 0; i < echoes_.size(); ++i)
      list.push_back({at(echoes_[i]), rest[static_cast<Index>(i)], std::pow(echoes_[i].sigma, -2)});
    constexpr std::size_t places = 30;
    RunMeans means = means_over_runs(std::move(list), std::max<std::size_t>(20, echoes_.size() / places));
    if (means.at.size() < 3) return;
    const EmpiricalFunction f{coordinate, "log_intensity", "", std::move(means.at), std::move(means.value)};
    VectorXd left = rest;
    for (std::size_t i = 0; i < echoes_.size(); ++i)
      left[static_cast<Index>(i)] -= f.value_at(at(echoes_[i]));
    const double gain = (rest.squaredNorm() - left.squaredNorm()) / static_cast<double>(echoes_.size());
    if (gain < worth_a_table * worth_a_table) return;
    rest = left;
    add_empirical(bench, f);
  }

  /// Relative noise of one sample: the middle one of all beams.
  [[nodiscard]] double sample_noise() const {
    std::vector<double> list;
    for (const Echo& e : echoes_)
      if (e.cell->n > 2 && e.cell->at.intensity > 30)
        list.push_back(e.cell->intensity_sd / e.cell->at.intensity);
    return list.empty() ? 0.01 : median_of(list);
  }

  const Reduced& reduced_;
  std::vector<Echo> echoes_;
  std::vector<std::pair<std::string, double>> surfaces_;
  DescribedIntensity described_;
  VectorXd gains_;
};

}  // namespace

void describe_echoes(const Reduced& reduced, Bench& bench) {
  Description description(reduced);
  if (description.possible()) description.write(bench);
}

}  // namespace fit::explain
