// SPDX-License-Identifier: MIT
#include "fit/explain/next_experiment.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "fit/explain/intensity.hpp"
#include "fit/explain/together.hpp"
#include "fit/median.hpp"

namespace fit::explain {
namespace {

constexpr double worth_doing = 3;  // expected log odds below which an experiment separates nothing

/// Counts against echo power as the session shows them: log I = a + b log power.
struct Brightness {
  double log_gain = std::log(1000.0), exponent = 0.5;

  static Brightness of(const Reduced& reduced) {
    Brightness b;
    double n = 0, x = 0, y = 0, xx = 0, xy = 0;
    for (const Cell& cell : reduced.cells) {
      if (!cell.smooth || !(cell.at.intensity > 1)) continue;
      const double lx = std::log(power(reduced, cell)), ly = std::log(cell.at.intensity);
      n += 1;
      x += lx;
      y += ly;
      xx += lx * lx;
      xy += lx * ly;
    }
    const double spread = n * xx - x * x;
    if (n < 10 || spread < 1e-3 * n * n) return b;
    b.exponent = std::clamp((n * xy - x * y) / spread, 0.1, 1.5);
    b.log_gain = (y - b.exponent * x) / n;
    return b;
  }
  static double power(const Reduced& reduced, const Cell& cell) {
    const CaptureInfo& info =
        reduced
            .captures[static_cast<std::size_t>(reduced.groups[static_cast<std::size_t>(cell.group)].capture)];
    const Target& target = reduced.bench.targets[static_cast<std::size_t>(cell.sight.target)];
    const double rho = reflectance_in(info, target);
    return rho * cell.sight.cos_incidence() * 1e6 / (cell.sight.range_mm * cell.sight.range_mm);
  }
};

/// A recording of an experiment that was never made: what the bench alone predicts, with its noise.
class Imagined : public Recording {
 public:
  Imagined(const Bench& bench, const Experiment& experiment, Brightness brightness, double sigma_mm)
      : bench_(bench), experiment_(experiment), brightness_(brightness), sigma_mm_(sigma_mm) {}
  const Bench& bench() const override { return bench_; }
  const std::vector<CaptureInfo>& captures() const override { return experiment_.captures; }
  const std::vector<TrackPose>& track() const override { return track_; }
  void for_each_scan(std::size_t index, const std::function<void(const ScanView&)>& visit) const override {
    const CaptureInfo& info = experiment_.captures[index];
    const Scene scene(bench_, Nuisance(bench_), info);
    const auto beams = static_cast<std::size_t>(info.beams());
    std::vector<double> range(beams, 0.0);
    std::vector<std::uint16_t> shown(beams, 0), intensity(beams, 0);
    for (std::size_t b = 0; b < beams; ++b) {
      const double beam = bench_.lidar.beam_angle(info.first_step + static_cast<int>(b) * info.cluster);
      const Sight sight = scene.look(info.stage_rad, beam);
      if (sight.target < 0) continue;
      range[b] = sight.range_mm;
      const Target& target = bench_.targets[static_cast<std::size_t>(sight.target)];
      const double rho = reflectance_in(info, target);
      const double power = rho * sight.cos_incidence() * 1e6 / (sight.range_mm * sight.range_mm);
      intensity[b] = static_cast<std::uint16_t>(
          std::clamp(std::exp(brightness_.log_gain + brightness_.exponent * std::log(power)), 1.0, 4000.0));
    }
    std::mt19937 random(static_cast<unsigned>(index) + 1);
    std::normal_distribution<double> noise;  // of a lidar without noise, too
    for (int seq = 0; seq < experiment_.scans; ++seq) {
      for (std::size_t b = 0; b < beams; ++b)
        shown[b] = range[b] > 0 ? static_cast<std::uint16_t>(std::clamp(
                                      std::round(range[b] + sigma_mm_ * noise(random)), 30.0, 60000.0))
                                : std::uint16_t{0};
      ScanView view;
      view.seq = seq;
      view.host_us = info.started_us + static_cast<std::int64_t>(seq * 1e6 / bench_.lidar.scan_hz);
      view.range_mm = shown;
      view.intensity = intensity;
      visit(view);
    }
  }

 private:
  const Bench& bench_;
  const Experiment& experiment_;
  Brightness brightness_;
  double sigma_mm_;
  std::vector<TrackPose> track_;
};

void number(Experiment& e, double pause_s, double first_s) {
  double time = first_s;
  int id = 1;
  double before = 0;
  for (CaptureInfo& c : e.captures) {
    c.id = id++;
    c.started_us = static_cast<std::int64_t>((time - first_s) * 1e6);
    c.since_power_on_s = time;
    time += pause_s;
    if (c.approach == 0) c.approach = c.stage_rad > before ? 1 : c.stage_rad < before ? -1 : 0;
    before = c.stage_rad;
  }
}

CaptureInfo whole_scene(const Bench& bench, double stage_deg) {
  CaptureInfo c;
  c.stage_rad = stage_deg * rad_per_deg;
  c.first_step = 0;
  c.last_step = bench.lidar.steps - 1;
  return c;
}

/// Beams that meet the target from stage angle 0, and how far it may be moved out.
CaptureInfo aimed(const Bench& bench, const Target& target) {
  const Eigen::Vector2d middle = (target.from_mm + target.to_mm) / 2;
  const double bearing = std::atan2(middle.y(), middle.x()) - bench.lidar.mount.yaw_rad.value;
  const int centre =
      bench.lidar.front_step + static_cast<int>(std::lround(wrap_angle(bearing) / bench.lidar.step_rad));
  CaptureInfo c;
  c.first_step = std::clamp(centre - 8, 0, bench.lidar.steps - 1);
  c.last_step = std::clamp(centre + 8, 0, bench.lidar.steps - 1);
  c.target = target.name;
  return c;
}

/// What an experiment may find: a mechanism or an unnamed form, as it came out and as it may adjust.
struct Suspected {
  std::function<Eigen::VectorXd(const MeanModel&)> effect_mm;
  std::function<Columns(const MeanModel&)> columns;
};

Suspected suspected(const Term& term) {
  return {[&term](const MeanModel& model) { return effect_of(model, term); },
          [&term](const MeanModel& model) {
            Columns c = linear_columns(model, term);
            c.prior.mean.setZero();
            c.prior.sigma *= 10;
            add(c, shape_columns(model, term));
            add(c, freedom_columns(model, term));
            return c;
          }};
}

/// Where a step stands, or how long a period is, is held as it came out: promises are a little too good.
Suspected suspected(const Shape& shape) {
  return {[&shape](const MeanModel& model) { return effect_of(model, shape); },
          [&shape](const MeanModel& model) {
            Columns c = columns_of(model, shape);
            c.prior.sigma *= 10;
            return c;
          }};
}

/// Every suspect once, whatever the number of sets it is in.
std::vector<Suspected> suspects_of(const Explanation& explanation) {
  std::vector<const Term*> terms;
  for (const Term& term : explanation.suspects)
    if (std::ranges::none_of(terms, [&](const Term* other) { return other->same(term); }))
      terms.push_back(&term);
  std::vector<Suspected> list;
  for (const Term* term : terms) list.push_back(suspected(*term));
  for (const Shape& shape : explanation.unnamed_suspects) list.push_back(suspected(shape));
  return list;
}

/// Smallest evidence that the effect of one leaves when another tries to take it up.
double separation(const Reduced& all, const Explanation& explanation) {
  constexpr std::size_t enough = 12000;
  const std::optional<Reduced> few =
      all.cells.size() > enough ? std::optional(merged(all, enough)) : std::nullopt;
  MeanModel model(few ? *few : all, {});
  const double share =
      static_cast<double>(all.cells.size()) / std::max<double>(1, static_cast<double>(model.rows()));
  const std::vector<Suspected> suspects = suspects_of(explanation);
  double least = 1e300;
  for (std::size_t rival = 0; rival < suspects.size(); ++rival) {
    Columns base;
    base.columns_mm = model.nuisance_columns();
    base.prior.mean = Eigen::VectorXd::Zero(base.columns_mm.cols());
    base.prior.sigma = Nuisance::prior_sigma(all.bench);
    add(base, suspects[rival].columns(model));
    model.set_base(base.columns_mm, {Eigen::VectorXd::Zero(base.columns_mm.cols()), base.prior.sigma});
    for (std::size_t truth = 0; truth < suspects.size(); ++truth) {
      if (truth == rival) continue;
      const Eigen::VectorXd left = model.remainder(suspects[truth].effect_mm(model));
      double sum = 0;
      for (Eigen::Index i = 0; i < model.rows(); ++i) sum += std::pow(left[i] / model.sigma_of_mean(i), 2);
      least = std::min(least, share * sum / 2);
    }
  }
  return least;
}

}  // namespace

std::vector<Experiment> possible_experiments(const Bench& bench, const StageTravel& travel) {
  std::vector<Experiment> list;
  const double from = travel.from_rad * deg_per_rad, to = travel.to_rad * deg_per_rad;
  Experiment round{Experiment::Kind::all_round,
                   "",
                   "The whole scene from stage angles all round, from both sides",
                   {},
                   10,
                   0};
  std::vector<double> angles;
  for (double a = std::max(-180.0, from); a <= std::min(165.0, to); a += 15) angles.push_back(a);
  for (const double a : angles) round.captures.push_back(whole_scene(bench, a));
  for (auto a = angles.rbegin(); a != angles.rend(); ++a) round.captures.push_back(whole_scene(bench, *a));
  number(round, 12, 1800);
  list.push_back(round);
  Experiment fine{Experiment::Kind::both_sides, "", "Small stage steps from both sides", {}, 20, 0};
  for (double a = std::max(-8.0, from); a <= std::min(8.0, to); a += 0.37)
    fine.captures.push_back(whole_scene(bench, a));
  const std::size_t up = fine.captures.size();
  for (std::size_t i = 0; i < up; ++i) fine.captures.push_back(fine.captures[up - 1 - i]);
  number(fine, 6, 1800);
  list.push_back(fine);
  for (const Target& target : bench.targets) {
    const double distance = std::abs(target.from_mm.dot(target.outward_normal()));
    Experiment ladder{Experiment::Kind::ladder,
                      target.name,
                      "Target '" + target.name + "' at many distances, bright and dark",
                      {},
                      60,
                      0};
    for (const double rho : {0.85, 0.4, 0.12})
      for (double shift = 0; distance + shift < 8000; shift += 650) {
        CaptureInfo c = aimed(bench, target);
        c.target_shift_mm = shift;
        c.reflectance = rho;
        ladder.captures.push_back(c);
      }
    number(ladder, 20, 3600);
    list.push_back(ladder);
    Experiment greys{Experiment::Kind::greys,
                     target.name,
                     "Target '" + target.name + "' in many greys at two distances",
                     {},
                     60,
                     0};
    for (const double shift : {0.0, 1000.0})
      for (const double rho : {0.9, 0.5, 0.28, 0.16, 0.09, 0.05}) {
        CaptureInfo c = aimed(bench, target);
        c.target_shift_mm = shift;
        c.reflectance = rho;
        greys.captures.push_back(c);
      }
    number(greys, 20, 3600);
    list.push_back(greys);
  }
  Experiment heat{
      Experiment::Kind::heat, "", "The lidar's housing heated and cooled after warm-up", {}, 40, 0};
  for (const double t : {20.0, 26.0, 32.0, 38.0, 32.0, 26.0, 20.0}) {
    CaptureInfo c = whole_scene(bench, 0);
    c.temperature_c = t;
    heat.captures.push_back(c);
  }
  number(heat, 900, 7200);
  list.push_back(heat);
  Experiment cold{Experiment::Kind::cold_start,
                  "",
                  "From a cold start, at a housing temperature that is held",
                  {},
                  10,
                  0};
  for (int i = 0; i < 60; ++i) {
    CaptureInfo c = whole_scene(bench, 0);
    c.temperature_c = 25;
    cold.captures.push_back(c);
  }
  number(cold, 60, 30);
  list.push_back(cold);
  Experiment turning{Experiment::Kind::turning, "", "The stage turns at two rates, both ways", {}, 40, 0};
  for (const double rate : {10.0, 30.0})
    for (const double sign : {1.0, -1.0}) {
      CaptureInfo c = whole_scene(bench, -sign * std::min({60.0, -from, to}) / 2);
      c.stage_rate_rad_s = sign * rate * rad_per_deg;
      c.approach = sign > 0 ? 1 : -1;
      turning.captures.push_back(c);
    }
  number(turning, 20, 1800);
  list.push_back(turning);
  return list;
}

namespace {

/// What an experiment would tell beside what is recorded: the least evidence between any two suspects.
double expected_of(Reduced& all, const Explanation& explanation) {
  double least = 1e300;
  if (explanation.rivals_in_range() > 1) {
    pool_variances(all);
    least = separation(all, explanation);
  }
  if (explanation.light_suspects.size() > 1)
    least = std::min(least, separation_of_light(all, explanation.light_suspects));
  return least < 1e300 ? least : 0;
}

double typical_sigma(const Reduced& reduced) {
  std::vector<double> sigmas;
  for (const Group& g : reduced.groups) sigmas.push_back(g.sigma_mm);
  return median_of(sigmas);
}

/// Distances and greys for a target that people put up.
std::vector<Experiment> experiments_by_hand(const Bench& bench, const std::vector<const Recording*>& so_far) {
  std::vector<Experiment> list;
  for (const Target& target : bench.targets) {
    const bool used = std::ranges::any_of(so_far, [&](const Recording* recording) {
      return std::ranges::any_of(recording->captures(),
                                 [&](const CaptureInfo& c) { return c.target == target.name; });
    });
    if (!used) continue;
    const double nominal = std::abs(target.from_mm.dot(target.outward_normal()));
    const auto add = [&](const char* title, const std::vector<double>& distances,
                         const std::vector<double>& greys) {
      Experiment e{Experiment::Kind::ladder, target.name, "Target '" + target.name + "' " + title, {}, 100};
      e.by_hand = true;
      for (const double rho : greys)
        for (const double distance : distances) {
          CaptureInfo c = whole_scene(bench, 0);
          c.target = target.name;
          c.target_shift_mm = distance - nominal;
          if (greys.size() > 1) c.reflectance = rho;
          e.captures.push_back(c);
        }
      number(e, 60, 3600);
      list.push_back(e);
    };
    const double white = target.reflectance.value_or(0.8);
    add("at close and far distances", {300, 500, 700, 1000, 1400, 2000, 2800, 4000}, {white});
    add("in steps of 70 mm", {600, 670, 740, 810, 880, 950, 1020, 1090, 1160, 1230}, {white});
    add("in three greys at three distances", {600, 1200, 2400}, {0.85, 0.35, 0.1});
  }
  return list;
}

}  // namespace

std::optional<Experiment> best_experiment(const std::vector<const Recording*>& recordings,
                                          const Explanation& explanation, const StageTravel& travel) {
  if (!explanation.has_rivals() || recordings.empty()) return {};
  Reduced so_far = reduce(*recordings.front(), {});
  for (std::size_t i = 1; i < recordings.size(); ++i) append(so_far, reduce(*recordings[i], {}));
  const Brightness brightness = Brightness::of(so_far);
  const double sigma = typical_sigma(so_far);
  if (so_far.groups.empty()) return {};
  std::optional<Experiment> best;
  for (Experiment& e : possible_experiments(so_far.bench, travel)) {
    const Imagined imagined(so_far.bench, e, brightness, sigma);
    Reduced all = so_far;
    append(all, reduce(imagined, {}));
    e.expected = expected_of(all, explanation);
    if (e.expected > worth_doing && (!best || e.expected > best->expected)) best = e;
  }
  return best;
}

std::optional<Experiment> best_experiment_by_hand(const std::vector<const Recording*>& recordings,
                                                  const Explanation& explanation) {
  if (!explanation.has_rivals() || recordings.empty() || recordings.front()->bench().targets.empty())
    return {};
  const Bench& bench = recordings.front()->bench();
  const Reduced first = reduce(*recordings.front(), {});
  const Brightness brightness = Brightness::of(first);
  const double sigma = typical_sigma(first);
  std::optional<Experiment> best;
  for (Experiment& e : experiments_by_hand(bench, recordings)) {
    const Imagined imagined(bench, e, brightness, sigma);
    std::vector<const Recording*> list = recordings;
    list.push_back(&imagined);
    const Together together(list);
    std::optional<Reduced> all;
    for (std::size_t i = 0; i < list.size(); ++i) {
      Reduced one = reduce(*together.recordings()[i], {}, together.standing(i));
      if (all)
        append(*all, one);
      else
        all = std::move(one);
    }
    e.expected = expected_of(*all, explanation);
    if (e.expected > worth_doing && (!best || e.expected > best->expected)) best = e;
  }
  return best;
}

}  // namespace fit::explain
