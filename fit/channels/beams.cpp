// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <map>

#include "fit/explain/model/gamma.hpp"

namespace fit::explain::channels {
namespace {

using model::IndependentRows;

constexpr std::size_t fewest_angles = 3;  // else a wall's own texture stays with the beam

/// A beam's mean less the line through its neighbours' on both sides, averaged over all captures: two of them
/// with half a weight each, so that its square is that often the variance of one beam's own error.
constexpr double squares_of_own = 1.5;

/// Such squares over that number: a gamma distribution around what noise leaves of them, to which adds what
/// every beam reads off by its own.
class Beams final : public model::GammaRows {
 public:
  Beams(std::vector<Row> rows, double least) : GammaRows(std::move(rows), least) {}
  [[nodiscard]] double response(Eigen::Index, const Effect& effect) const override {
    return effect.own_range_variance_mm2;
  }
};

/// Sums over the bends of one beam against its neighbours.
struct Bends {
  double weight = 0, sum = 0;
  void add(double bend, double of_weight) {
    weight += of_weight;
    sum += of_weight * bend;
  }
  [[nodiscard]] double mean() const { return sum / weight; }
};

struct Beam {
  Circumstances at;
  std::map<int, Bends> by_angle;  ///< Of the stage, hundredths of a degree: there it meets the same places.
  [[nodiscard]] Bends all() const {
    Bends all;
    for (const auto& [angle, bends] : by_angle) all.add(bends.mean(), bends.weight);
    return all;
  }
};

std::map<int, Beam> beams_of(const Reduced& reduced) {
  constexpr double per_step = 1000;  // to tell beams by their angle
  constexpr int fewest_samples = 3;
  std::map<int, Beam> beams;
  for (const Group& group : reduced.groups)
    for (std::size_t i = group.first_cell + 1; i + 1 < group.last_cell; ++i) {
      const Cell &a = reduced.cells[i - 1], &b = reduced.cells[i], &c = reduced.cells[i + 1];
      bool counts = true;
      for (const Cell* cell : {&a, &b, &c})
        counts = counts && cell->usable && cell->u_edge_mm == 0 && cell->n >= fewest_samples &&
                 cell->pooled_mm2 > 0 && cell->at.target == b.at.target;
      if (!counts || std::abs(a.beam_rad + c.beam_rad - 2 * b.beam_rad) > 1e-6) continue;
      const auto off = [](const Cell& cell) { return cell.mean_mm - cell.nominal_mm; };
      // What scans have in common is pooled by what is expected of it: where it is large, little is left.
      const auto variance = [](const Cell& cell) {
        return std::max(cell.pooled_mm2, cell.variance_mm2) / cell.n;
      };
      Beam& beam = beams[static_cast<int>(std::lround(b.beam_rad * deg_per_rad * per_step))];
      beam.at = b.at;
      beam.by_angle[static_cast<int>(std::lround(group.stage_rad * deg_per_rad * 100))].add(
          off(b) - (off(a) + off(c)) / 2, 1 / (variance(b) + (variance(a) + variance(c)) / 4));
    }
  return beams;
}

}  // namespace

model::ChannelKind make_beams() {
  model::ChannelKind kind;
  kind.id = "beams";
  kind.observable = Observable::range_variance;
  kind.shows = "what a beam reads off by its own, standard deviation";
  kind.unit = "mm";
  kind.is_square = true;
  kind.of_predicted = true;
  kind.rows = [](const Reduced& reduced, const MeanNoise&) -> std::unique_ptr<model::ChannelRows> {
    constexpr std::size_t fewest_beams = 20;
    // Sums with neighbours' weights of one half correlate by -2/3 with the next and 1/6 with the one after.
    constexpr double independent = 1 / (1 + 2 * (4.0 / 9 + 1.0 / 36));
    std::map<int, Beam> beams = beams_of(reduced);
    std::erase_if(beams, [](const auto& of) { return of.second.by_angle.size() < fewest_angles; });
    if (beams.size() < fewest_beams) return nullptr;
    // What does not repeat from one stage angle to the next is noise, whoever makes it, and as large as that:
    // of weighted means by the "sandwich" (White 1980), as the weights are noisy, too.
    double excess = 0, freedom = 0;
    for (const auto& [name, beam] : beams) {
      const Bends all = beam.all();
      const double mean = all.mean();
      const auto angles = static_cast<double>(beam.by_angle.size());
      for (const auto& [angle, bends] : beam.by_angle)
        excess += angles * std::pow(bends.weight * (bends.mean() - mean), 2) / all.weight;
      freedom += angles - 1;
    }
    excess /= freedom;
    std::vector<IndependentRows::Row> rows;
    double least = 1e300;
    for (const auto& [name, beam] : beams) {
      const Bends all = beam.all();
      IndependentRows::Row& row = rows.emplace_back();
      row.at = beam.at;
      row.capture = std::abs(name);  // held out beam by beam
      row.y = std::pow(all.mean(), 2) / squares_of_own;
      row.n = independent;
      row.expected = excess / all.weight / squares_of_own;
      least = std::min(least, row.expected / 2);
    }
    return std::make_unique<Beams>(std::move(rows), least);
  };
  return kind;
}

}  // namespace fit::explain::channels
