// SPDX-License-Identifier: MIT
#include "fit/explain/stray_light.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iterator>
#include <map>

#include "fit/explain/odds.hpp"

namespace fit::explain {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double window_deg = 3;
constexpr double least_away_deg = 0.3;  // of a beam from where the surface changes
constexpr double beside_deg = 0.06;     // ... if it need not be told from a wide beam
constexpr double least_gap_mm = 15, largest_gap_mm = 3000;
constexpr double one_echo_mm = 500;  // farther apart they are two, and only the tail of one reaches the other
constexpr double halo_deg = 0.7, halo_ends_deg = 1.01;  // as fit/mechanisms/crosstalk.cpp and Scene::pull
// Logarithms of odds. Of 22 recordings with panels and nothing missing none came nearer than 4.6 to
// acceptance.
constexpr double accept_at = 1.5, separated_at = 3.5;
constexpr std::size_t fewest = 40;                   // rows of which anything is said
constexpr double doubt_beside_edges = 3;             // edges may be elsewhere by a part of a beam
constexpr double price = odds::against_any + 2 + 1;  // its size, and the forms of its halo that are tried

/// One beam of one group beside an edge.
struct Row {
  int target = 0;
  double away_deg = 0;  ///< From the change of surface.
  double gap_mm = 0;    ///< Range of the other surface less the own.
  double light = 1;     ///< Echo of the other surface over the own.
  double y_mm = 0, sigma_mm = 1;
  double turn_lever = 0, beam_deg = 0, step_deg = 0.25;
};

class Edges {
 public:
  Edges(const Reduced& reduced, const MeanResult& means)
      : reduced_(reduced), means_(means), at_work_(all_at_work(reduced.bench, means.best)) {
    std::ranges::copy_if(at_work_, std::back_inserter(everywhere_),
                         [](const Active& active) { return active.target < 0; });
    for (const Group& group : reduced.groups)
      if (group.scans > 2) collect(group);
  }
  [[nodiscard]] const std::vector<Row>& rows() const { return rows_; }

 private:
  struct Beam {
    const Cell* cell;
    double inside_deg;
    Sight near, far;
    double near_mm, far_mm;
    bool on_near;
  };

  void collect(const Group& group) {
    const CaptureInfo& info = reduced_.capture_of(group);
    if (is_turning(info)) return;
    const Scene scene = reduced_.scene_of(group, displaced(reduced_, means_.best.nuisance, at_work_));
    const std::vector<Edge> edges = scene.edges(group.stage_rad);
    for (const Edge& edge : edges) {
      if (edge.far_mm <= 0) continue;
      const double gap = edge.far_mm - edge.near_mm;
      if (gap < least_gap_mm || gap > largest_gap_mm) continue;
      take(group, info, scene, edges, edge);
    }
  }

  void take(const Group& group, const CaptureInfo& info, const Scene& scene, const std::vector<Edge>& edges,
            const Edge& edge) {
    const double yaw = means_.best.nuisance.yaw_rad;
    const Sight behind =
        scene.look(group.stage_rad, edge.bearing_rad - edge.near_side * 0.02 - group.stage_rad - yaw);
    const int near_target = edge.id / 2;
    if (behind.target < 0 || behind.target == near_target) return;
    std::vector<Beam> beams;
    for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
      const Cell& cell = reduced_.cells[i];
      if (cell.n < 2) continue;
      const double bearing = group.stage_rad + yaw + cell.beam_rad;
      const double inside = wrap_angle(bearing - edge.bearing_rad) * edge.near_side * deg_per_rad;
      if (std::abs(inside) > window_deg) continue;
      const bool nearest = std::ranges::none_of(edges, [&](const Edge& other) {
        return &other != &edge &&
               std::abs(wrap_angle(bearing - other.bearing_rad)) * deg_per_rad < std::abs(inside);
      });
      if (!nearest) continue;
      const Effect effect = effect_of(everywhere_, cell.at);
      Beam beam{&cell,
                inside,
                scene.look_at(near_target, group.stage_rad, cell.beam_rad, effect),
                scene.look_at(behind.target, group.stage_rad, cell.beam_rad, effect),
                0,
                0,
                true};
      beam.near_mm = beam.near.range_mm + effect.range_mm;
      beam.far_mm = beam.far.range_mm + effect.range_mm;
      beam.on_near = std::abs(cell.mean_mm - beam.near_mm) < std::abs(cell.mean_mm - beam.far_mm);
      beams.push_back(beam);
    }
    if (beams.size() < 6) return;
    std::ranges::sort(beams, {}, &Beam::inside_deg);
    // Where the far surface's beams end and the near one's begin: no beam may lie on the wrong side.
    const auto first_near = std::ranges::find(beams, true, &Beam::on_near);
    if (first_near == beams.begin() || first_near == beams.end()) return;
    if (std::any_of(first_near, beams.end(), [](const Beam& b) { return !b.on_near; })) return;
    const double change = (first_near->inside_deg + std::prev(first_near)->inside_deg) / 2;
    if (std::abs(change) > 1.5) return;
    for (const Beam& beam : beams) add(group, info, beam, change);
  }

  void add(const Group& group, const CaptureInfo& info, const Beam& beam, double change) {
    const Cell& cell = *beam.cell;
    const double away = std::abs(beam.inside_deg - change);
    if (away < beside_deg || cell.stray > 0 || cell.lost > 0 || cell.at.corner_mm < 60) return;
    const Sight &own = beam.on_near ? beam.near : beam.far, &other = beam.on_near ? beam.far : beam.near;
    if (std::abs(own.incidence_rad) > 70 * rad_per_deg) return;
    Row row;
    row.target = reduced_.same_as[static_cast<std::size_t>(own.target)];
    row.away_deg = away;
    row.gap_mm = other.range_mm - own.range_mm;
    row.light = echo_power(info, reduced_.bench, other) / echo_power(info, reduced_.bench, own);
    row.y_mm = cell.mean_mm - (beam.on_near ? beam.near_mm : beam.far_mm);
    if (std::abs(row.y_mm) > 0.6 * std::abs(row.gap_mm)) return;
    row.sigma_mm =
        std::max(group.sigma_mm, std::sqrt(cell.variance_mm2)) * std::sqrt(means_.noise.factor / cell.n);
    row.turn_lever = own.per_turn;
    row.beam_deg = cell.beam_rad * deg_per_rad;
    row.step_deg = reduced_.bench.lidar.step_rad * deg_per_rad;
    rows_.push_back(row);
  }

  const Reduced& reduced_;
  const MeanResult& means_;
  std::vector<Active> at_work_, everywhere_;  ///< All, and those that act on no target in particular.
  std::vector<Row> rows_;
};

/// Share of a neighbour's light at an angle.
using Halo = std::function<double(double angle_deg)>;

/// What stray light of size one does to a beam, mm.
double pull_of(const Row& row, const Halo& halo) {
  double sum = 0;
  for (int side = 1; side * row.step_deg < window_deg; ++side)
    if (side * row.step_deg > row.away_deg) sum += halo(side * row.step_deg);
  return sum * row.light * row.gap_mm;
}

double lorentz(double angle_deg) {
  return angle_deg > halo_ends_deg ? 0 : 1 / (1 + std::pow(angle_deg / halo_deg, 2));
}

constexpr std::array widths_deg{0.08, 0.12, 0.16, 0.2, 0.25, 0.3, 0.36, 0.43, 0.5};

/// Share of a beam of that standard half width beyond the change of surface.
double beyond(const Row& row, double width_deg) {
  return 0.5 * std::erfc(row.away_deg / width_deg / std::sqrt(2.0));
}

/// What a beam of that standard half width does where its echoes are one: front and back by their light, mm.
double mixed_mm(const Row& row, double width_deg) {
  const double far = beyond(row, width_deg) * row.light;
  return row.gap_mm * far / (far + 1 - beyond(row, width_deg));
}

/// Rows with the places of their targets taken out.
class Residuals {
 public:
  Residuals(const std::vector<Row>& rows, std::size_t targets) : rows_(rows) {
    const auto n = static_cast<Index>(rows.size()), k = static_cast<Index>(2 * targets);
    base_ = MatrixXd::Zero(n, k);
    VectorXd y(n);
    for (Index i = 0; i < n; ++i) {
      const Row& row = rows[static_cast<std::size_t>(i)];
      base_(i, 2 * row.target) = 1.0 / row.sigma_mm;                                     // 1 mm
      base_(i, 2 * row.target + 1) = row.turn_lever * 0.1 * rad_per_deg / row.sigma_mm;  // 0.1 deg
      y[i] = row.y_mm / row.sigma_mm;
    }
    MatrixXd normal = base_.transpose() * base_;
    normal.diagonal().array() += 1;
    factor_.compute(normal);
    rest_ = without_base(y);
  }

  struct Fit {
    double size = 0, u = 0, gain = 0, misfit = 0;
  };
  [[nodiscard]] Fit fit(const VectorXd& effect_mm) const {
    const VectorXd x = without_base(whitened(effect_mm));
    const double square = x.squaredNorm();
    if (square < 1e-9) return {};
    Fit f;
    f.size = x.dot(rest_) / square;
    if (f.size <= 0) return {};
    f.u = 1 / std::sqrt(square);
    f.gain = 0.5 * f.size * f.size * square;
    f.misfit = (rest_ - f.size * x).squaredNorm() / std::max<double>(1, static_cast<double>(x.size()));
    return f;
  }
  /// Gain of an effect of this very size.
  [[nodiscard]] double gain(const VectorXd& effect_mm) const {
    const VectorXd x = without_base(whitened(effect_mm));
    return x.dot(rest_) - 0.5 * x.squaredNorm();
  }
  [[nodiscard]] double misfit() const {
    return rest_.squaredNorm() / std::max<double>(1, static_cast<double>(rest_.size()));
  }

 private:
  [[nodiscard]] VectorXd whitened(VectorXd v) const {
    for (Index i = 0; i < v.size(); ++i) v[i] /= rows_[static_cast<std::size_t>(i)].sigma_mm;
    return v;
  }
  [[nodiscard]] VectorXd without_base(const VectorXd& v) const {
    return v - base_ * factor_.solve(base_.transpose() * v);
  }
  const std::vector<Row>& rows_;
  MatrixXd base_;
  Eigen::LLT<MatrixXd> factor_;
  VectorXd rest_;
};

/// Places along the beam angle that carry at least a quarter of the largest information.
std::vector<Located> where(const std::vector<Row>& rows, const VectorXd& effect_mm, double gain) {
  constexpr double width = 2;
  std::map<int, double> information;
  double most = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    double& sum = information[static_cast<int>(std::floor(rows[i].beam_deg / width))];
    sum += std::pow(effect_mm[static_cast<Index>(i)] / rows[i].sigma_mm, 2);
    most = std::max(most, sum);
  }
  std::vector<Located> list;
  for (const auto& [bin, sum] : information) {
    if (sum < most / 4) continue;
    if (!list.empty() && list.back().to > width * bin - width / 2)
      list.back().to = width * (bin + 1);
    else
      list.push_back({Coordinate::beam, width * bin, width * (bin + 1), Observable::range_mean,
                      std::exp(-std::min(600.0, gain))});
  }
  return list;
}

/// What is to be explained beside edges, and how well stray light does it.
class Beside {
 public:
  Beside(std::vector<Row> rows, std::size_t targets) : rows_(std::move(rows)), residuals_(rows_, targets) {
    // How far stray light reaches differs from receiver to receiver.
    halos_.emplace_back(lorentz);
    for (const double h : {0.4, 0.55, 0.75, 1.0, 1.3})
      halos_.emplace_back([h](double angle) { return std::exp(-angle * angle / (h * h)); });
    double misfit = residuals_.misfit();
    for (const Halo& halo : halos_) {
      const auto f = fit([&](const Row& row) { return pull_of(row, halo); });
      if (f.gain <= best_) continue;
      best_ = f.gain;
      misfit = f.misfit;
    }
    // What no form takes away is noise that was not known of.
    excess_ = std::max(1.0, misfit);
    best_ /= excess_;
    formula_mm_ = effect([](const Row& row) { return pull_of(row, lorentz); });
    found_ = residuals_.fit(formula_mm_);
  }

  [[nodiscard]] bool shows(double least) const { return best_ - price >= least && found_.size > 0; }
  [[nodiscard]] double best() const { return best_; }
  /// What beams that are too wide, or any other blur, would explain instead.
  [[nodiscard]] double rival() const;
  /// Of beams that are too wide, those that explain most.
  [[nodiscard]] double width_deg() const;
  [[nodiscard]] StrayLight said(double evidence) const {
    StrayLight light;
    light.suspect.mechanism = find_mechanism(crosstalk);
    light.suspect.gain = best_;
    light.suspect.evidence = evidence;
    light.suspect.parameters = {{"leak", {found_.size, found_.u * std::sqrt(excess_)}}};
    light.located = where(rows_, formula_mm_, best_);
    return light;
  }

 private:
  template <typename OfRow>
  [[nodiscard]] VectorXd effect(OfRow of_row) const {
    VectorXd v(static_cast<Index>(rows_.size()));
    for (std::size_t i = 0; i < rows_.size(); ++i) v[static_cast<Index>(i)] = of_row(rows_[i]);
    return v;
  }
  template <typename OfRow>
  [[nodiscard]] Residuals::Fit fit(OfRow of_row) const {
    return residuals_.fit(effect(of_row));
  }

  std::vector<Row> rows_;
  Residuals residuals_;
  std::vector<Halo> halos_;
  double best_ = 0, excess_ = 1;
  VectorXd formula_mm_;
  Residuals::Fit found_;
};

double Beside::rival() const {
  double rival = 0;
  for (const double w : widths_deg) {
    // A wide beam mixes front and back by their light; or by a share that knows nothing of light.
    rival = std::max(rival, residuals_.gain(effect([w](const Row& row) { return mixed_mm(row, w); })));
    rival = std::max(rival, fit([w](const Row& row) { return row.gap_mm * beyond(row, w); }).gain);
  }
  for (const Halo& halo : halos_)
    rival = std::max(rival, fit([&](const Row& row) {
                              Row plain = row;
                              plain.light = 1;
                              return pull_of(plain, halo);
                            }).gain);
  return rival / excess_;
}

double Beside::width_deg() const {
  const auto gain = [this](double w) {
    return residuals_.gain(effect([w](const Row& row) { return mixed_mm(row, w); }));
  };
  return std::ranges::max(widths_deg, {}, gain);
}

bool is_crosstalk(const Term& term) { return term.mechanism->id == crosstalk; }

/// As if the search had not met crosstalk. What has no name may have been crosstalk as well.
MeanResult without_crosstalk(MeanResult means) {
  std::erase_if(means.best.terms, is_crosstalk);
  means.best.shapes.clear();
  return means;
}

/// Rows at least so far from the change of surface, between surfaces whose echoes are one.
std::vector<Row> of_one_echo(const std::vector<Row>& rows, double away_deg) {
  std::vector<Row> list;
  std::ranges::copy_if(rows, std::back_inserter(list), [away_deg](const Row& row) {
    return row.away_deg >= away_deg && std::abs(row.gap_mm) < one_echo_mm;
  });
  return list;
}

/// Log of the odds for crosstalk against nothing and against its rival: their odds add.
double odds_for(const Beside& beside, double rival) {
  return -std::log(std::exp(price - beside.best()) + std::exp(rival - beside.best()));
}

std::optional<StrayLight> beside_edges(const Reduced& reduced, const MeanResult& means) {
  const Edges edges(reduced, means);
  if (edges.rows().size() < fewest) return {};
  std::vector<Row> clear = of_one_echo(edges.rows(), least_away_deg);
  if (clear.size() >= fewest) {
    const Beside beside(std::move(clear), reduced.bench.targets.size());
    if (beside.shows(accept_at)) {
      const double rival = beside.rival();
      if (rival > beside.best() + separated_at) return {};
      StrayLight light = beside.said(odds_for(beside, rival));
      light.or_mixed_pixel = rival > beside.best() - separated_at;
      light.width_deg = beside.width_deg();
      return light;
    }
  }
  // The beams nearest to the edges alone cannot tell stray light from a beam that is wider than known.
  const Beside nearest(edges.rows(), reduced.bench.targets.size());
  if (!nearest.shows(accept_at + doubt_beside_edges)) return {};
  StrayLight light = nearest.said(nearest.best() - price);
  light.or_mixed_pixel = true;
  light.width_deg = nearest.width_deg();
  return light;
}

}  // namespace

std::optional<StrayLight> stray_light(const Reduced& reduced, const MeanResult& means) {
  if (reduced.bench.knows(crosstalk)) return {};
  if (std::ranges::none_of(means.best.terms, is_crosstalk)) return beside_edges(reduced, means);
  const std::optional<StrayLight> light = beside_edges(reduced, without_crosstalk(means));
  return light && !light->or_mixed_pixel ? light : std::nullopt;  // the means have told it from a wide beam
}

Eigen::MatrixXd evidence_between(const Reduced& reduced, const EdgeSuspects& suspects) {
  const std::size_t targets = reduced.bench.targets.size();
  const MeanResult as_stated(reduced.bench);
  const Edges edges(reduced, as_stated);
  Eigen::MatrixXd evidence = Eigen::MatrixXd::Zero(2, 2);
  std::vector<Row> clear = of_one_echo(edges.rows(), least_away_deg);
  if (clear.size() >= fewest) {
    for (Row& row : clear) row.y_mm = suspects.leak * pull_of(row, lorentz);
    const Beside beside(std::move(clear), targets);
    evidence(0, 1) = std::max(0.0, odds_for(beside, beside.rival()));
  }
  std::vector<Row> near = of_one_echo(edges.rows(), 0);
  if (near.size() >= fewest) {
    for (Row& row : near) row.y_mm = mixed_mm(row, suspects.width_deg);
    const Beside beside(std::move(near), targets);
    evidence(1, 0) = std::max(0.0, beside.rival() - std::max(price, beside.best()));
  }
  return evidence;
}

void take_off(const StrayLight& light, Reduced& reduced) {
  reduced.bench.known.push_back({crosstalk, light.suspect.parameters, {}});
  const double leak = light.suspect.parameters.at("leak").value;
  constexpr double reach_rad = 1.3 * rad_per_deg;  // a degree, and what is not known of the edges' places
  for (Cell& cell : reduced.cells) {
    if (cell.smooth && std::abs(cell.at.edge_rad) < reach_rad) {
      cell.smooth = false;
      ++reduced.left_out;
    }
    if (cell.far_share < 0 || !(cell.at.gap_mm > 0)) continue;
    const double pulled = leak * cell.at.pull_mm / cell.at.gap_mm;
    if (pulled == 0) continue;
    cell.far_share = std::clamp(cell.far_share - pulled, 0.0, 1.0);
    const double margin =
        (6 * reduced.groups[static_cast<std::size_t>(cell.group)].sigma_mm + 15) / cell.at.gap_mm;
    if (std::abs(pulled) > 0.3 * margin) cell.between = 0;
    cell.beside = 0;  // its samples are as they came
  }
}

}  // namespace fit::explain
