// SPDX-License-Identifier: MIT
#include "fit/explain/answer/chapters.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "fit/explain/scene/stated_noise.hpp"
#include "fit/numeric/angle.hpp"

namespace fit::explain::answer {
namespace {

/// Log odds against one mechanism of the catalogue, asked for by itself: against any one of all, where
/// whoever asks suspects something.
constexpr double against_any = 4.0 - 1.8;

Found found_steps(const Suspect& suspect) {
  constexpr double by_chance = 4;  // of the gain
  Found found;
  found.mechanism = suspect.mechanism;
  found.parameters = suspect.parameters;
  found.probability = std::min(0.999, 1 / (1 + std::exp(against_any - (suspect.gain - by_chance))));
  found.says = suspect.mechanism->says(found);
  // What Akaike expects of other captures.
  found.log_likelihood_gain = suspect.gain - static_cast<double>(suspect.parameters.size());
  found.gain_is_expected = true;
  found.evidence = "Its log-likelihood is higher by " + rounded(suspect.gain, 3) + ", of which " +
                   rounded(by_chance, 2) + " would be chance.";
  return found;
}

/// The functions without a name that were needed: the place of the first, and all in words.
Unexplained of_shapes(const Reduced& reduced, const Inferred& inferred) {
  const MeanResult& means = inferred.means;
  const MeanModel model(reduced, means.noise);
  const Shape& shape = means.best.shapes.front();
  const Described first = describe(shape, model);
  Unexplained u;
  u.observable = Observable::range_mean;
  u.coordinate = shape.coordinate;
  u.describes = first.text;
  u.from = shape.is_along_one_target() ? shape.target : first.from;
  u.to = shape.is_along_one_target() ? shape.target : first.to;
  for (std::size_t i = 1; i < means.best.shapes.size(); ++i)
    u.describes += "; and " + describe(means.best.shapes[i], model).text;
  return u;
}

std::string in_words(const Freedom& freedom, const Bench& bench) {
  return (freedom.target < 0 ? "The lidar's mount "
                             : "Target '" + bench.target_at(freedom.target).name + "' ") +
         freedom.in_words;
}

}  // namespace

void report_coarse_steps(const Inferred& inferred, Explanation& out) {
  const auto steps = std::ranges::find(inferred.accepted, find_mechanism("rounding"), &Suspect::mechanism);
  if (steps == inferred.accepted.end()) return;
  out.mechanisms.push_back(found_steps(*steps));
  out.after.log_likelihood += out.mechanisms.back().log_likelihood_gain;
  add_known(out.bench, as_known(*steps->mechanism, steps->parameters));
}

void report_unknown(const Reduced& reduced, const Inferred& inferred, Explanation& out) {
  std::vector<Unexplained> all = inferred.unknown;
  if (!inferred.means.best.shapes.empty()) all.insert(all.begin(), of_shapes(reduced, inferred));
  if (all.empty()) return;
  out.unknown = all.front();
  for (std::size_t i = 1; i < all.size(); ++i) out.unknown->describes += "; and " + all[i].describes;
}

void doubt_bench_file(const Reduced& reduced, const Inferred& inferred, Explanation& out) {
  constexpr double hardly_possible = 3.5;  // standard uncertainties
  const Eigen::VectorXd all_off =
      inferred.means.best.nuisance.as_vector() - Nuisance(reduced.bench).as_vector();
  const double* next_off = all_off.data();
  for (const Freedom& freedom : freedoms_of(reduced.bench)) {
    const double off = *next_off++;
    if (freedom.u <= 0 || std::abs(off) < hardly_possible * freedom.u) continue;
    out.notes.push_back(in_words(freedom, reduced.bench) + " comes out " +
                        rounded(off * (freedom.is_angle ? deg_per_rad : 1), 3) +
                        (freedom.is_angle ? " deg" : " mm") + " from what the bench file states, " +
                        rounded(std::abs(off) / freedom.u, 2) +
                        " times its uncertainty: check the bench file before looking for physics.");
  }
}

void correct_bench(const Inferred& inferred, Bench& bench) {
  const Nuisance& n = inferred.means.best.nuisance;
  Mount& mount = bench.lidar.mount;
  mount.x_mm.value = n.x_mm;
  mount.y_mm.value = n.y_mm;
  mount.yaw_rad.value = n.yaw_rad;
  for (std::size_t i = 0; i < bench.targets.size(); ++i) {
    Target& target = bench.targets[i];
    const Displacement& off = n.targets[i];
    if (target.round) {
      RoundShape shape = *target.round;
      const Eigen::Vector2d outward = target.outward_normal();
      shape.centre_mm += off.out_mm * outward + off.aside_mm * Eigen::Vector2d(-outward.y(), outward.x());
      shape.radius_mm += off.thicker_mm;
      target.set_round(shape);
      continue;
    }
    const Eigen::Vector2d middle = (target.from_mm + target.to_mm) / 2 + off.out_mm * target.outward_normal(),
                          half = (target.to_mm - target.from_mm) / 2;
    const Eigen::Vector2d turned = Eigen::Rotation2Dd(off.turn_rad) * half;
    target.from_mm = middle - turned;
    target.to_mm = middle + turned;
  }
  if (inferred.sigma_mm > 0) state_noise(bench, inferred.sigma_mm);
}

}  // namespace fit::explain::answer
