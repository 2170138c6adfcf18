// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "fit/explain/seen_edges.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"

namespace fit::explain::spread {
namespace {

/// A beam beside an edge, in one capture.
struct SeenBeside {
  int capture, edge;
  Beside beam;
  int samples, between;
  bool mixed;  ///< Sees both surfaces, beyond what their places leave open.
};

std::vector<SeenBeside> beside_edges(const Reduced& reduced) {
  std::vector<SeenBeside> list;
  for (const Cell& cell : reduced.cells) {
    if (cell.far_share < 0 || cell.edge < 0) continue;
    const int n = cell.n + cell.stray;
    if (n < 2) continue;
    const Group& group = reduced.groups[static_cast<std::size_t>(cell.group)];
    const double doubt = (2 * group.sigma_mm + 8) / std::max(1.0, cell.at.gap_mm);
    const bool mixed = std::min(cell.far_share, 1 - cell.far_share) > std::max(0.04, doubt);
    list.push_back({group.capture,
                    cell.edge,
                    {cell.at.edge_rad * deg_per_rad, cell.far_share, std::min(20.0, 1.0 * n)},
                    n,
                    cell.between,
                    mixed});
  }
  return list;
}

/// What the beams beside edges see. The place of an edge is a nuisance of each capture: whatever moves it
/// (mount, target, stage, placement) shows as beams that see one surface or the other, never as a beam that
/// sees both.
class BesideEdges {
 public:
  explicit BesideEdges(const std::vector<SeenBeside>& list) {
    for (const SeenBeside& seen : list) {
      by_edge_[{seen.edge, seen.capture}].push_back(seen.beam);
      between_ += seen.between;
      if (!seen.mixed) continue;
      ++mixed_;
      in_mixed_ += seen.samples;
    }
  }

  [[nodiscard]] bool suffice() const { return !by_edge_.empty() && mixed_ >= 2; }
  /// Samples on neither surface.
  [[nodiscard]] int between() const { return between_; }
  /// Whether most samples of mixed beams lie between the surfaces.
  [[nodiscard]] bool are_blended() const { return 2 * between_ >= in_mixed_; }

  /// Log-likelihood of beams that wide, every edge being where it fits best in every capture.
  [[nodiscard]] double likelihood(double width_deg) const {
    double sum = 0;
    for (const auto& [edge, beams] : by_edge_) sum += best_place(beams, width_deg).likelihood;
    return sum;
  }

  /// Shares of the farther surface along the angle from every edge: as recorded, of a beam without width, and
  /// of one that wide.
  [[nodiscard]] SpreadCurve shares(double width_deg) const {
    constexpr int points = 25;
    constexpr double reach = 5;
    struct Sums {
      double beams = 0, inside = 0, samples = 0, far = 0, expected = 0, hard = 0;
    };
    std::vector<Sums> sums(points);
    for (const auto& [edge, beams] : by_edge_) {
      const double edge_deg = best_place(beams, width_deg).shift_deg;
      for (const Beside& b : beams) {
        const double inside = b.inside_deg - edge_deg, at = (inside / width_deg / reach + 1) / 2;
        if (at < 0 || at >= 1) continue;
        Sums& s = sums[static_cast<std::size_t>(at * points)];
        s.beams += 1;
        s.inside += inside;
        s.samples += b.n;
        s.far += b.n * b.far_share;
        s.expected += b.n * 0.5 * std::erfc(inside / width_deg / std::sqrt(2.0));
        s.hard += b.n * (inside < 0 ? 1 : 0);
      }
    }
    SpreadCurve curve;
    curve.shows = "share of the farther surface";
    curve.observable = Observable::range_distribution;
    curve.coordinate = Coordinate::edge_distance;
    for (const Sums& s : sums) {
      if (s.samples <= 0) continue;
      const double share = s.far / s.samples, least = 0.5 / s.samples,
                   u = std::sqrt(std::max(least, share * (1 - share)) / s.samples);
      curve.add(s.inside / s.beams, {share, u}, s.hard / s.samples, s.expected / s.samples);
    }
    return curve;
  }

 private:
  /// Where beams that wide have an edge.
  struct Place {
    double shift_deg = 0, likelihood = -1e300;
  };
  [[nodiscard]] static Place best_place(const std::vector<Beside>& beams, double width_deg) {
    Place best;
    for (double shift = -edge_reach_deg; shift <= edge_reach_deg;
         shift += std::clamp(width_deg / 3, 0.01, 0.05)) {
      const double likelihood = likelihood_of_edge(beams, shift, width_deg);
      if (likelihood > best.likelihood) best = {shift, likelihood};
    }
    return best;
  }

  std::map<std::pair<int, int>, std::vector<Beside>> by_edge_;  ///< Edge and capture.
  int between_ = 0, mixed_ = 0, in_mixed_ = 0;
};

constexpr double hard_deg = 0.004, finer = 1.03;

/// The standard width of the beam that explains most, deg.
double best_width(const BesideEdges& beams) {
  constexpr double coarse = 1.25;
  double best = beams.likelihood(hard_deg), width = hard_deg;
  const auto try_width = [&](double w) {
    const double l = beams.likelihood(w);
    if (l <= best) return;
    best = l;
    width = w;
  };
  for (double w = 0.008; w < 0.6; w *= coarse) try_width(w);
  for (double w = width / coarse, from = width; w < coarse * from; w *= finer) try_width(w);
  return width;
}

/// What a beam of that width gains over one without.
double gain_of_edges(const BesideEdges& beams, double width_deg) {
  return beams.likelihood(width_deg) - beams.likelihood(hard_deg) +
         (beams.between() > 2 ? 2.0 * beams.between() : 0);
}

}  // namespace

void edges(const Reduced& reduced, SpreadResult& result) {
  const std::vector<SeenBeside> list = beside_edges(reduced);
  const BesideEdges beams(list);
  if (!beams.suffice()) return;
  const double width = best_width(beams), best = beams.likelihood(width);
  const auto reach = [&](double step) {  // to where the likelihood has fallen by a half
    double w = width;
    for (int k = 0; k < 40 && beams.likelihood(w) > best - 0.5; ++k) w *= step;
    return w;
  };
  // A receiver that favours the stronger of two echoes changes over in less than the beam's width, by how
  // much is its own affair; where most samples of mixed beams are on one surface or the other, the width is
  // known from below only.
  const double own_affair = beams.are_blended() ? 0.5 : 1.5;
  const double u = std::hypot((reach(finer) - reach(1 / finer)) / 2, own_affair * width);
  Suspect suspect = suspected(ids::mixed_pixel);
  suspect.gain = gain_of_edges(beams, width);
  suspect.evidence = suspect.gain - price_of_size(suspect.gain) - 2;
  suspect.parameters = {{"width_deg", {width, u}}};
  if (suspect.evidence <= accept_rare_at) return;
  result.accepted.push_back(suspect);
  result.curves.push_back(beams.shares(width));
  result.noise.footprint_rad = width * rad_per_deg;
}

}  // namespace fit::explain::spread
