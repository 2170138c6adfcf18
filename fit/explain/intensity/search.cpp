// SPDX-License-Identifier: MIT
#include "fit/explain/intensity/search.hpp"

#include <algorithm>
#include <cmath>

#include "fit/explain/intensity/named.hpp"
#include "fit/explain/intensity/unnamed.hpp"
#include "fit/explain/odds.hpp"
#include "fit/median.hpp"

namespace fit::explain::intensity {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double worth_it = 1.5;
constexpr double hopeless = -50;
constexpr int most_suspicions = 5;

/// All that was stated may be wrong, and whatever is left may be a function of everything.
std::vector<Suspicion> most_flexible(const Readings& readings) {
  std::vector<Suspicion> everything;
  Suspicion law;
  law.mechanism = find_mechanism(law_of_intensity);
  law.coefficients = stated_coefficients(readings.claim);
  law.size = 1;
  everything.push_back(law);
  for (Suspicion s : smooth_functions(readings)) {
    if (s.length != finest) continue;
    s.size = 0.2;
    everything.push_back(s);
  }
  return everything;
}

/// Factor on the variance of rows by which they scatter, single or a dozen neighbours together, whichever is
/// worse; 0 when there are too few to say.
double excess_of(const Readings& readings, const VectorXd& residual) {
  std::vector<double> together, single;
  for (Index i = 0; i < readings.count();) {
    const Cell& first = readings.cell(i);
    double sum = 0, weight = 0;
    Index k = i;
    for (; k < readings.count() && k < i + 12 && readings.cell(k).group == first.group &&
           readings.cell(k).at.target == first.at.target;
         ++k) {
      const double sigma = readings.row(k).sigma, w = 1 / (sigma * sigma);
      sum += w * residual[k];
      weight += w;
      single.push_back(std::pow(residual[k] / sigma, 2));
    }
    together.push_back(sum * sum / weight);
    i = k;
  }
  if (together.size() < 4) return 0;
  return std::max(median_of(together), median_of(single)) / median_of_normal_squares;
}

}  // namespace

void weigh(Readings& readings) {
  const std::vector<Suspicion> everything = most_flexible(readings);
  for (int pass = 0; pass < 3; ++pass) {
    const double excess = excess_of(readings, model_of(readings, everything).residual());
    if (excess < 1.05) break;
    for (Reading& row : readings.rows) row.sigma *= std::sqrt(excess);
    readings.excess *= excess;
  }
}

std::vector<Suspicion> suspects(const Readings& readings, const std::vector<Suspicion>& accepted) {
  const Model model = model_of(readings, accepted);
  std::vector<Suspicion> list;
  const auto taken = [&](const Suspicion& s) {
    return std::ranges::any_of(accepted, [&](const Suspicion& a) { return a.same_as(s); });
  };
  const Suspicion law = look_at_law(readings, model);
  if (!law.coefficients.empty() && !taken(law)) list.push_back(law);
  // There may be several spots of dirt, and several glossy targets.
  const int targets = static_cast<int>(readings.reduced.bench.targets.size());
  for (const Mechanism* m : beside_the_law()) {
    list.push_back(look(readings, model, *m, -1));
    if (!is_of_surfaces(*m) || targets < 2) continue;
    for (int t = 0; t < targets; ++t) list.push_back(look(readings, model, *m, t));
  }
  std::vector<Suspicion> unnamed = smooth_functions(readings);
  for (const Suspicion& patch : patches(readings, model)) unnamed.push_back(patch);
  for (Suspicion& s : unnamed) {
    if (taken(s)) continue;
    find_size(readings, model, s);
    list.push_back(s);
  }
  std::erase_if(list, [](const Suspicion& s) { return s.evidence < hopeless; });
  std::ranges::sort(list, [](const Suspicion& a, const Suspicion& b) { return a.evidence > b.evidence; });
  return list;
}

std::vector<Suspicion> search(const Readings& readings) {
  std::vector<Suspicion> accepted;
  for (int round = 0; round < most_suspicions; ++round) {
    const std::vector<Suspicion> list = suspects(readings, accepted);
    // Whoever asks suspects something.
    const double worth = accepted.empty() ? worth_it - odds::something_is_missing : worth_it;
    if (list.empty() || list.front().evidence < worth) break;
    accepted.push_back(list.front());
    settle(readings, accepted);
  }
  return accepted;
}

void settle(const Readings& readings, std::vector<Suspicion>& accepted) {
  for (int pass = 0; pass < 3; ++pass)
    for (std::size_t t = 0; t < accepted.size(); ++t)
      if (accepted[t].acts()) refine(readings, model_of(readings, without(accepted, t)), accepted[t], 150);
}

}  // namespace fit::explain::intensity
