// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "fit/explain/answer/chapters.hpp"
#include "fit/explain/scene/stated_noise.hpp"
#include "fit/numeric/angle.hpp"

namespace fit::explain::answer {
namespace {

using Eigen::Index;

/// Mount and targets as the bench file states them and as they were found, in the order of `Nuisance`.
struct Stated {
  Eigen::VectorXd stated, found, u;

  explicit Stated(const Reduced& reduced, const Inferred& inferred)
      : stated(Nuisance(reduced.bench).as_vector()),
        found(inferred.means.best.nuisance.as_vector()),
        u(Nuisance::prior_sigma(reduced.bench)) {}
};

std::string in_words(const Freedom& freedom, const Bench& bench) {
  return (freedom.target < 0 ? "The lidar's mount "
                             : "Target '" + bench.target_at(freedom.target).name + "' ") +
         freedom.in_words();
}

}  // namespace

void doubt_bench_file(const Reduced& reduced, const Inferred& inferred, Explanation& out) {
  constexpr double hardly_possible = 3.5;  // standard uncertainties
  const Stated file(reduced, inferred);
  const std::vector<Freedom> freedoms = freedoms_of(reduced.bench);
  for (Index i = 0; i < file.stated.size(); ++i) {
    const double off = file.found[i] - file.stated[i];
    if (file.u[i] <= 0 || std::abs(off) < hardly_possible * file.u[i]) continue;
    const Freedom& freedom = freedoms[static_cast<std::size_t>(i)];
    out.notes.push_back(in_words(freedom, reduced.bench) + " comes out " +
                        rounded(off * (freedom.is_angle() ? deg_per_rad : 1), 3) +
                        (freedom.is_angle() ? " deg" : " mm") + " from what the bench file states, " +
                        rounded(std::abs(off) / file.u[i], 2) +
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
    if (target.round) {
      RoundShape shape = *target.round;
      const Eigen::Vector2d outward = target.outward_normal();
      shape.centre_mm +=
          n.offset_mm[i] * outward + n.aside_mm[i] * Eigen::Vector2d(-outward.y(), outward.x());
      shape.radius_mm += n.thicker_mm[i];
      target.set_round(shape);
      continue;
    }
    const Eigen::Vector2d middle =
                              (target.from_mm + target.to_mm) / 2 + n.offset_mm[i] * target.outward_normal(),
                          half = (target.to_mm - target.from_mm) / 2;
    const Eigen::Vector2d turned = Eigen::Rotation2Dd(n.turn_rad[i]) * half;
    target.from_mm = middle - turned;
    target.to_mm = middle + turned;
  }
  if (inferred.sigma_mm > 0) state_noise(bench, inferred.sigma_mm);
}

}  // namespace fit::explain::answer
