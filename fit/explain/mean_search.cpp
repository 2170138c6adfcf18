// SPDX-License-Identifier: MIT
#include "fit/explain/mean_search.hpp"

#include <nlopt.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <complex>
#include <exception>
#include <functional>
#include <iterator>
#include <set>
#include <thread>
#include <unsupported/Eigen/FFT>
#include <utility>

#include "fit/explain/spread.hpp"
#include "fit/median.hpp"

namespace fit::explain {
namespace {

using Role = Parameter::Role;

constexpr double price_of_mechanism = 4.0;  // log odds against any one of the catalogue
constexpr double price_of_unknown = 7.0;    // the catalogue is tried first
// Whoever asks suspects something. Of 92 recordings with nothing missing, one (whose wall stood 4.4 standard
// uncertainties off) was worth a name; none of the others came nearer than 0.9, or than 1.3 to an unnamed
// form.
constexpr double something_is_missing = 1.8;
constexpr double worth_a_name = 3;                 // a name that explains as much is preferred
constexpr double worth_a_name_beside_a_place = 2;  // ... of a step, or a period
constexpr double strained = 7;  // log of the odds at which stated uncertainties are not believed
constexpr double worth_a_first_name = 0.5, worth_a_first_form = -1, worth_a_move = 1.5, worth_fitting = -2;
constexpr std::size_t rows_of_search = 6000, rows_of_last_search = 30000, rows_of_judgement = 120000;
constexpr std::size_t finalists = 7;
// Fits after which a search stops trying other ways: twice what any recording of one or two effects needed.
constexpr double rows_of_patience = 6e6, least_patience = 200, most_patience = 1000;
constexpr double hardly_worse = 2.2, most_behind = 12;  // a rival that is simply more adjustable
constexpr double confirmed_by = 3;                      // log-likelihood of places not fitted to

bool moves_means(const Mechanism& m) {
  if (m.observable != Observable::range_mean) return false;
  return m.coordinate !=
         Coordinate::scan_seq;  // differs within a capture: seen in its scans, not in its means
}

bool is_known(const Bench& bench, const Term& term) {
  for (const KnownMechanism& known : bench.known) {
    if (known.mechanism != term.mechanism->id) continue;
    if (!term.mechanism->one_target) return true;
    const auto target = known.texts.find("target");
    if (target != known.texts.end() && term.target >= 0 &&
        target->second == bench.targets[static_cast<std::size_t>(term.target)].name)
      return true;
  }
  return false;
}

struct Scored {
  Term term;
  std::optional<Shape> shape;
  double evidence = -1e300, gain = 0;
};

/// Independent places that the search over a shape parameter looks at.
double places_of(const Parameter& p) { return std::max(1.5, p.starts / 3.0); }

/// Periods of gears are whole fractions of a turn.
bool possible(const Mechanism& m, const std::vector<double>& values) {
  if (m.id != "stage-periodic") return true;
  const double period = values[2];
  if (period < 24) return true;
  return std::abs(360 / period - std::round(360 / period)) < 0.02;
}

std::vector<double> starts_of(const Mechanism& m, const Parameter& p) {
  std::vector<double> list;
  if (m.id == "stage-periodic") {
    for (const double turn : {360.0, 180.0, 120.0, 90.0, 72.0, 60.0, 45.0, 36.0, 30.0}) list.push_back(turn);
    for (double v = 24; v > p.lower; v *= 0.965) list.push_back(v);
    return list;
  }
  for (int i = 0; i < p.starts; ++i) {
    const double x = p.starts > 1 ? static_cast<double>(i) / (p.starts - 1) : 0.5;
    list.push_back(p.logarithmic ? p.lower * std::pow(p.upper / p.lower, x)
                                 : p.lower + x * (p.upper - p.lower));
  }
  return list;
}

/// Worms make periods of a few degrees, a wheel or scale off its axis one or two periods in a turn; what lies
/// between is nothing that a stage has, but at a few stage angles it can imitate everything.
double price_of_gear(double period_deg) {
  constexpr double fewest_teeth_deg = 7.5, odd = 3;
  return period_deg < fewest_teeth_deg || std::abs(period_deg - 360) < 1 || std::abs(period_deg - 180) < 1
             ? 0
             : odd;
}

std::vector<double> steps_between(const std::set<double>& places) {
  std::vector<double> steps;
  for (auto a = places.begin(), b = std::next(a); b != places.end(); ++a, ++b) steps.push_back(*b - *a);
  return steps;
}

/// Whether stops so far apart show a period of the stage as something slow: then it is another name for a
/// scale or an eccentricity, by chance within a thousandth.
bool is_slow_by_alias(const Reduced& reduced, const Term& term) {
  if (term.mechanism->id != "stage-periodic") return false;
  constexpr double slow_deg = 180;
  std::set<double> stops;
  for (const Group& group : reduced.groups) stops.insert(group.stage_rad * deg_per_rad);
  if (stops.size() < 3 || stops.size() > 400) return false;
  const double spacing = median_of(steps_between(stops)), turns = spacing / term.values[2];
  const double left = std::abs(turns - std::round(turns));
  return turns > 0.5 && spacing > slow_deg * left;
}

/// How far out of the ordinary a size is: catalogues' orders of magnitude may be wrong, but not by anything.
double implausible(const Term& term) {
  double price = term.mechanism->id == "stage-periodic" ? price_of_gear(term.values[2]) : 0;
  for (std::size_t k = 0; k < term.values.size(); ++k) {
    const Parameter& p = term.mechanism->parameters[k];
    // At the end of what physics allows: the recording would rather have something else.
    if (p.role == Role::shape && (p.name == "reach_mm" || p.name == "tau_s") &&
        (term.values[k] > 0.98 * p.upper || term.values[k] < 1.02 * p.lower))
      price += 4;
    if (p.role != Role::size) continue;
    const double ratio = std::abs(term.values[k] - p.expected) / p.typical;
    if (ratio > 10) price += 0.5 * std::pow((ratio - 10) / 3, 2);
    const double u = term.sigma.empty() ? 0 : std::max(1e-12, term.sigma[k]);
    if (std::abs(term.values[k]) > p.largest)
      price += u > 0 ? 0.5 * std::pow((std::abs(term.values[k]) - p.largest) / u, 2) : 50;
    const bool phased = k + 1 < term.values.size() && term.mechanism->parameters[k + 1].role == Role::phase;
    if (p.sign != 0 && !phased && term.values[k] * p.sign < 0)
      price += u > 0 ? 0.7 + 0.5 * std::pow(term.values[k] / u, 2) : 50;
  }
  return price;
}

template <typename Work>
void on_two_cores(std::size_t count, const Work& work) {
  std::atomic<std::size_t> next{0};
  const auto run = [&] {
    for (std::size_t i = next++; i < count; i = next++) work(i);
  };
  std::exception_ptr failed;
  {
    const std::jthread other([&] {
      try {
        run();
      } catch (...) {
        failed = std::current_exception();  // The caller's, as if there were one thread.
      }
    });
    run();
  }
  if (failed) std::rethrow_exception(failed);
}

class Search {
 public:
  Search(Reduced& reduced, MeanNoise noise, const Progress& progress)
      : reduced_(reduced), noise_(std::move(noise)), progress_(progress) {}

  MeanResult run() {
    Hypothesis empty(reduced_.bench);
    pool_variances(reduced_, noise_);
    place(empty, true);  // with what the bench knows at work, once: evidences compare on the same cells only
    find_excess(empty);
    settle(empty);
    report(0.05);
    Hypothesis best(reduced_.bench);
    if (is_larger_than(rows_of_search)) {
      // A large session is searched with neighbouring beams taken together first; what is found there is the
      // start of the full search.
      Reduced few = merged(reduced_, rows_of_search);
      Search coarse(few, noise_, progress_);
      best = coarse.explore(empty);
      cut_short_ = coarse.cut_short_;
      settle(best);
    } else {
      best = explore(empty);
    }
    report(0.8);
    MeanResult result(reduced_.bench);
    if (is_larger_than(rows_of_judgement)) {
      // So many cells say the same as fewer of them taken together; only the figures are of all.
      place(best);
      Reduced some = merged(reduced_, rows_of_judgement);
      Search fewer(some, noise_, progress_);
      fewer.decide(best, result);
      cut_short_ = cut_short_ || fewer.cut_short_;
      fit(best);
      measure(best, result);
    } else if (is_larger_than(rows_of_search)) {
      decide(best, result);
    } else {
      judge(best, result);
    }
    doubt_aliases(result.best);
    place(result.best);
    result.cut_short = cut_short_;
    report(1);
    return result;
  }

  double scatter_of_groups(const Hypothesis& best);
  [[nodiscard]] const MeanNoise& noise() const { return noise_; }

 private:
  /// How far names may be behind unnamed functions: farther where only what a mechanism depends on is
  /// certain, not its curve; less far behind a step or a wave, which hardly resemble anything else.
  static double preference(const Hypothesis& named, const Hypothesis& unnamed) {
    constexpr double uncertain_curve = 0.5;
    double sum = 0;
    for (const Shape& shape : unnamed.shapes) {
      const bool same = std::ranges::any_of(named.terms, [&](const Term& term) {
        return term.mechanism->formula_error > uncertain_curve &&
               term.mechanism->coordinate == shape.coordinate;
      });
      sum += shape.kind != Shape::Kind::smooth ? worth_a_name_beside_a_place
             : same                            ? 2 * worth_a_name
                                               : worth_a_name;
    }
    return sum;
  }

  /// What was found among fewer cells, looked at once more and judged.
  void decide(Hypothesis& best, MeanResult& result) {
    best = climb(best, 4, !best.shapes.empty());
    judge(best, result);
  }

  /// Both ways up from a start, which may be far from its best values.
  Hypothesis explore(Hypothesis empty) {
    fit(empty);
    Hypothesis best = climb(empty, finalists);
    report(0.4);
    if (best.terms.size() + best.shapes.size() > 0 && has_patience()) {
      // Another way up: whatever is there may be one unnamed function instead of several mechanisms.
      const Hypothesis other = from_unnamed(empty);
      if (says_more(other, best, empty)) best = other;
    }
    if (!best.shapes.empty() && has_patience()) {
      // And one unnamed function may hide that several mechanisms explain more together.
      const Hypothesis other = climb(empty, finalists, true, false);
      if (other.evidence > best.evidence - preference(other, best)) best = other;
    }
    report(0.6);
    return best;
  }

  /// A recording that nothing fits well would be searched for many minutes.
  bool has_patience() {
    const double limit = std::clamp(rows_of_patience / static_cast<double>(reduced_.cells.size()),
                                    least_patience, most_patience);
    cut_short_ = cut_short_ || fits_ > limit;
    return !cut_short_;
  }

  void report(double share) const {
    if (progress_) progress_(share, "comparing mechanisms");
  }

  void place(const Hypothesis& h, bool may_leave_out = false) { predict_at(reduced_, h, may_leave_out); }

  /// Fits, and says anew which cells meet what, until that has settled: beams by a corner of walls that stand
  /// otherwise than stated would be laid to the wrong one.
  void settle(Hypothesis& h) {
    constexpr int most_passes = 4;
    fit(h);
    bool most = fits_most(h);
    if (h.terms.empty() && !most) {
      const Hypothesis other = trimmed(h);
      if (fits_most(other)) {
        h = other;
        most = true;
      }
    }
    for (int pass = 0; pass < most_passes; ++pass) {
      if (reassign(reduced_, h.nuisance, all_at_work(reduced_.bench, h), noise_.footprint_rad, most) == 0)
        break;
      pool_variances(reduced_, noise_);
      fit(h);
      most = fits_most(h);
    }
  }

  /// How far the beams are off at a hypothesis, in standard uncertainties; in the order of the smooth cells.
  std::vector<double> deviations(const Hypothesis& h) {
    place(h);
    const MeanModel model(reduced_, noise_);
    std::vector<double> list(static_cast<std::size_t>(model.rows()));
    for (Eigen::Index i = 0; i < model.rows(); ++i)
      list[static_cast<std::size_t>(i)] = std::abs(model.raw_residual()[i]) / model.sigma_of_mean(i);
    return list;
  }

  /// Whether most beams are explained but for noise. Otherwise mount and walls were bent to explain something
  /// else, and no beam may be left out by where they stand.
  bool fits_most(const Hypothesis& h) {
    constexpr double median_of_chance = 0.6745;
    return h.shapes.empty() && median_of(deviations(h)) < 1.4 * median_of_chance;
  }

  /// Mount and walls fitted to the beams that agree with each other: what lies far off, such as beams that
  /// meet another wall than the bench file says, has no say.
  Hypothesis trimmed(Hypothesis h) {
    constexpr int most_passes = 8;
    std::size_t before = 0;
    for (int pass = 0; pass < most_passes; ++pass) {
      const std::vector<double> off = deviations(h);
      const double far = std::max(4.0, 2.5 * 1.4826 * median_of(std::vector(off)));
      std::vector<Cell*> without;
      std::size_t row = 0;
      for (Cell& cell : reduced_.cells)
        if (cell.smooth && off[row++] > far) without.push_back(&cell);
      for (Cell* cell : without) cell->smooth = false;
      fit(h);
      for (Cell* cell : without) cell->smooth = true;
      if (without.size() == before) break;
      before = without.size();
    }
    return h;
  }

  void find_excess(Hypothesis& empty) {
    MeanModel model(reduced_, noise_);
    Base base = base_columns(model, empty);
    model.set_base(std::move(base.all.columns_mm), base.all.prior);
    excess_ = excess_scatter(model);
    // Four standard errors of a median of squares of which neighbours share two beams.
    const double doubt = 4 * 3.4 / std::sqrt(std::max<double>(60, static_cast<double>(model.rows())));
    if (excess_ > 1 + doubt)
      noise_.factor *= excess_;
    else
      excess_ = 1;
  }

  /// Beside a name, what is left is sooner a fault of its formula.
  static double price_of_unnamed(const Hypothesis& h) {
    return static_cast<double>(h.shapes.size()) * (price_of_unknown + (h.terms.empty() ? 0 : worth_a_name));
  }

  /// A hypothesis as it stands, how well it does there, and where a Gauss-Newton step leads.
  struct Trial {
    Hypothesis here, next;
    double density = 0;  ///< Log, mount, walls and mechanisms as they stand.
  };

  Trial tried(const Hypothesis& h) {
    ++fits_;
    place(h);
    MeanModel model(reduced_, noise_);
    Base base = base_columns(model, h);
    model.set_base(std::move(base.all.columns_mm), base.all.prior);
    const MeanModel::Posterior posterior = model.posterior();
    Trial trial{h, h, 0};
    Hypothesis& next = trial.next;
    next.evidence = posterior.log_evidence - base.all.price -
                    price_of_mechanism * static_cast<double>(h.terms.size()) - price_of_unnamed(h);
    for (const Shape& shape : h.shapes) next.evidence -= shape.price;
    if (!h.terms.empty() || !h.shapes.empty()) next.evidence += something_is_missing;
    const Eigen::VectorXd nuisance = h.nuisance.as_vector();
    next.nuisance.set(nuisance + posterior.value.head(nuisance.size()));
    trial.density = model.density_here(nuisance.size());
    next.density = trial.density;
    for (std::size_t t = 0; t < h.terms.size(); ++t) {
      Term& term = next.terms[t];
      const auto first = base.term_first[t], count = base.term_count[t];
      const std::vector<double> now = linear_coefficients(term);
      Eigen::VectorXd x = posterior.value.segment(first, count);
      for (std::size_t k = 0; k < now.size(); ++k) x[static_cast<Eigen::Index>(k)] += now[k];
      set_coefficients(term, x, posterior.covariance.block(first, first, count, count));
      next.evidence -= implausible(term);
    }
    for (std::size_t s = 0; s < h.shapes.size(); ++s) {
      const Eigen::Index first = base.shape_first[s], last = base.shape_first[s + 1];
      next.shapes[s].values.assign(posterior.value.data() + first, posterior.value.data() + last);
    }
    return trial;
  }

  /// Part of the way from one to the other, which differs in values only.
  static Hypothesis on_the_way(const Hypothesis& from, const Hypothesis& to, double share) {
    if (share >= 1) return to;
    const auto mixed = [share](const auto& a, const auto& b) { return (1 - share) * a + share * b; };
    Hypothesis between = to;
    between.nuisance.set(mixed(from.nuisance.as_vector(), to.nuisance.as_vector()));
    for (std::size_t t = 0; t < to.terms.size(); ++t) {
      Term& term = between.terms[t];
      const std::vector<double> a = linear_coefficients(from.terms[t]), b = linear_coefficients(to.terms[t]);
      Eigen::VectorXd middle(static_cast<Eigen::Index>(a.size()));
      for (std::size_t k = 0; k < a.size(); ++k) middle[static_cast<Eigen::Index>(k)] = mixed(a[k], b[k]);
      for (std::size_t k = 0; k < term.values.size(); ++k)
        if (term.mechanism->parameters[k].role == Role::shape)
          term.values[k] = mixed(from.terms[t].values[k], to.terms[t].values[k]);
      const std::vector<double> sigma = term.sigma;
      set_coefficients(term, middle, Eigen::MatrixXd::Zero(middle.size(), middle.size()));
      term.sigma = sigma;
    }
    return between;
  }

  /// Steps until the evidence has settled. That of the first step is a promise of the linear model around the
  /// values before it, and is not counted. Before a wall that is met squarely, mount and wall turn ranges to
  /// second order only: there a whole step would go back and forth between two sides.
  void fit(Hypothesis& h) {
    constexpr int usual_steps = 5, most_steps = 25;
    constexpr double settled = 0.05, least_share = 0.1;
    Trial now = tried(h);
    Hypothesis best = now.next;
    best.evidence = -1e300;
    double share = 1;
    for (int pass = 1; pass < (share < 1 ? most_steps : usual_steps); ++pass) {
      Trial then = tried(on_the_way(now.here, now.next, share));
      if (then.density < now.density - settled) {
        share /= 2;
        if (share < least_share && best.evidence > -1e299) break;
        if (share >= least_share) continue;
      }
      const double settling = std::abs(then.next.evidence - now.next.evidence);
      now = std::move(then);
      if (now.next.evidence > best.evidence || share < 1) {
        best = on_the_way(now.here, now.next, share);
        best.evidence = now.next.evidence;
        best.density = now.density;
      }
      if (settling < settled) break;
    }
    h = best;
  }

  // ---- looking for one more
  // --------------------------------------------------------------------------------
  [[nodiscard]] bool is_larger_than(std::size_t rows) const {
    return static_cast<std::size_t>(std::ranges::count_if(reduced_.cells, &Cell::smooth)) > rows;
  }

  /// The means as a hypothesis leaves them.
  [[nodiscard]] MeanModel model_of(const Reduced& reduced, const Hypothesis& h) const {
    MeanModel model(reduced, noise_);
    Base base = base_columns(model, h);
    model.set_base(std::move(base.all.columns_mm), base.all.prior);
    return model;
  }

  /// Every mechanism not in `h` (nor in `but`), on top of it.
  std::vector<Scored> scan(const Hypothesis& h, const Term* but, bool named, bool unnamed) {
    place(h);
    std::optional<Reduced> few;
    if (is_larger_than(rows_of_last_search)) few = merged(reduced_, rows_of_last_search);
    const MeanModel model = model_of(few ? *few : reduced_, h);
    std::vector<Term> terms;
    if (named) {
      for (const Mechanism& m : catalogue()) {
        if (!moves_means(m)) continue;
        for (int target = m.one_target ? 0 : -1;
             target < (m.one_target ? static_cast<int>(reduced_.bench.targets.size()) : 0); ++target) {
          Term term{&m, target, std::vector<double>(m.parameters.size(), 0.0), {}};
          if (h.has(term) || (but && but->same(term)) || is_known(reduced_.bench, term)) continue;
          terms.push_back(term);
        }
      }
    }
    const std::vector<Shape> shapes = unnamed ? shapes_to_try(model) : std::vector<Shape>();
    // Fine combs are gone where neighbouring beams are taken together.
    std::optional<MeanModel> every;
    if (few && std::ranges::any_of(terms, [](const Term& term) { return is_comb(*term.mechanism); }))
      every = model_of(reduced_, h);
    std::vector<Scored> list(terms.size() + shapes.size());
    on_two_cores(list.size(), [&](std::size_t i) {
      if (i >= terms.size())
        list[i] = look(model, shapes[i - terms.size()]);
      else
        list[i] = look(every && is_comb(*terms[i].mechanism) ? *every : model, terms[i]);
    });
    std::erase_if(list, [](const Scored& s) { return !(s.evidence > worth_fitting); });
    std::ranges::sort(list, [](const Scored& a, const Scored& b) { return a.evidence > b.evidence; });
    return list;
  }

  static MeanModel::Fit evaluate(const MeanModel& model, const Term& term) {
    const Columns c = linear_columns(model, term);
    return MeanModel::solve(model.products(c.columns_mm), c.prior, true);
  }

  /// Best shape of one mechanism: grid, then NLopt from the best places.
  Scored look(const MeanModel& model, Term term) const {
    const auto& parameters = term.mechanism->parameters;
    std::vector<std::size_t> shapes;
    for (std::size_t k = 0; k < parameters.size(); ++k)
      if (parameters[k].role == Role::shape) shapes.push_back(k);
    Scored best;
    best.term = term;
    std::vector<std::pair<double, std::vector<double>>> tried;
    const auto attempt = [&](const std::vector<double>& values) {
      Term t = term;
      t.values = values;
      if (!possible(*t.mechanism, values) || is_slow_by_alias(reduced_, t)) return -1e300;
      const MeanModel::Fit f = evaluate(model, t);
      set_coefficients(t, f.value, f.sigma.cwiseAbs2().asDiagonal());
      const double evidence = f.evidence - implausible(t);
      if (evidence > best.evidence) {
        best.evidence = evidence;
        best.gain = f.gain;
        best.term = t;
      }
      return evidence;
    };
    std::vector<std::vector<double>> grids{term.values};
    if (is_comb(*term.mechanism))
      grids = combs(model, term);
    else
      for (const std::size_t k : shapes) {
        std::vector<std::vector<double>> more;
        for (const auto& values : grids)
          for (const double v : starts_of(*term.mechanism, parameters[k])) {
            more.push_back(values);
            more.back()[k] = v;
          }
        grids = std::move(more);
      }
    for (const auto& values : grids) tried.emplace_back(attempt(values), values);
    if (!shapes.empty() && best.gain > 3) {
      std::ranges::sort(tried, [](const auto& a, const auto& b) { return a.first > b.first; });
      for (std::size_t s = 0; s < std::min<std::size_t>(2, tried.size()); ++s)
        if (tried[s].first > tried[0].first - 8) refine(tried[s].second, shapes, term, attempt);
    }
    for (const std::size_t k : shapes) best.evidence -= price_of_shape(best.gain, places_of(parameters[k]));
    if (term.mechanism->one_target)
      best.evidence -= 0.5 * std::log(static_cast<double>(reduced_.bench.targets.size()));
    return best;
  }

  /// A comb of bins fits only within a thousandth of its width, so tens of thousands are possible: those
  /// whose first harmonic shows in the residual's spectrum along the range are tried by their plain
  /// correlation, and the best of these are fitted.
  static std::vector<std::vector<double>> combs(const MeanModel& model, const Term& term) {
    const Parameter& p = term.mechanism->parameters[1];
    const Eigen::VectorXd residual = model.residual();
    std::vector<double> range, score;
    double low = 1e300, high = 0;
    for (Eigen::Index i = 0; i < model.rows(); ++i) {
      range.push_back(model.cell(i).sight.range_mm);
      score.push_back(residual[i] / std::pow(model.sigma_of_mean(i), 2));
      low = std::min(low, range.back());
      high = std::max(high, range.back());
    }
    const auto along = [&](double bin) {
      double sum = 0;
      for (std::size_t i = 0; i < range.size(); ++i)
        sum += score[i] * (bin * std::round(range[i] / bin) - range[i]);
      return sum / bin;
    };
    std::vector<std::pair<double, double>> lines = comb_lines(range, score, low, high, p);
    std::vector<std::pair<double, std::vector<double>>> tried;
    const double apart = 1 / (8 * (high - low + p.upper));  // of two frequencies within one line
    for (const auto& [strength, frequency] : lines)
      for (int k = -2; k <= 2; ++k) {
        const double bin = std::clamp(1 / (frequency + k * apart / 2), p.lower, p.upper);
        tried.push_back({along(bin), {term.values[0], bin}});
      }
    const std::size_t keep = std::min<std::size_t>(6, tried.size());
    std::partial_sort(tried.begin(), tried.begin() + static_cast<std::ptrdiff_t>(keep), tried.end(),
                      [](const auto& a, const auto& b) { return a.first > b.first; });
    std::vector<std::vector<double>> best;
    for (std::size_t i = 0; i < keep; ++i) best.push_back(tried[i].second);
    return best;
  }

  /// Frequencies (per mm) of the strongest waves along the range that have a comb's phase, strongest first.
  static std::vector<std::pair<double, double>> comb_lines(const std::vector<double>& range,
                                                           const std::vector<double>& score, double low,
                                                           double high, const Parameter& bins) {
    constexpr std::size_t kept = 24, most = std::size_t{1} << 20;
    const double step = bins.lower / 8;
    std::size_t size = 1024;
    while (size < most && static_cast<double>(size) * step < 4 * (high - low + bins.upper)) size *= 2;
    std::vector<double> grid(size, 0.0);
    for (std::size_t i = 0; i < range.size(); ++i) {
      const double at = (range[i] - low) / step;
      if (at + 1 < static_cast<double>(size)) grid[static_cast<std::size_t>(at + 0.5)] += score[i];
    }
    std::vector<std::complex<double>> spectrum;
    Eigen::FFT<double> transform;
    transform.fwd(spectrum, grid);
    std::vector<std::pair<double, double>> lines;
    const double least = 1 / (static_cast<double>(size) * step);
    for (std::size_t k = 1; k < size / 2; ++k) {
      const double frequency = static_cast<double>(k) * least;
      if (frequency < 1 / bins.upper || frequency > 1 / bins.lower) continue;
      // Rounding reads short just above a multiple of the bin: minus a sine.
      const double strength = std::imag(spectrum[k] * std::polar(1.0, -2 * pi * frequency * low));
      if (lines.size() == kept && strength <= lines.back().first) continue;
      lines.emplace_back(strength, frequency);
      std::ranges::sort(lines, std::greater<>());
      if (lines.size() > kept) lines.pop_back();
    }
    return lines;
  }

  template <typename Attempt>
  void refine(const std::vector<double>& start, const std::vector<std::size_t>& shapes, const Term& term,
              const Attempt& attempt) const {
    const auto& parameters = term.mechanism->parameters;
    const auto n = static_cast<unsigned>(shapes.size());
    struct Context {
      const Attempt& attempt;
      std::vector<double> values;
      const std::vector<std::size_t>& shapes;
      const std::vector<Parameter>& parameters;
    } context{attempt, start, shapes, parameters};
    std::vector<double> x, lower, upper, first;
    for (const std::size_t k : shapes) {
      const Parameter& p = parameters[k];
      const auto in = [&](double v) { return p.logarithmic ? std::log(v) : v; };
      x.push_back(in(std::clamp(start[k], p.lower, p.upper)));
      lower.push_back(in(p.lower));
      upper.push_back(in(p.upper));
      first.push_back((upper.back() - lower.back()) / std::max(2, p.starts) / 2);
    }
    nlopt_opt optimiser = nlopt_create(NLOPT_LN_NELDERMEAD, n);
    nlopt_set_lower_bounds(optimiser, lower.data());
    nlopt_set_upper_bounds(optimiser, upper.data());
    nlopt_set_initial_step(optimiser, first.data());
    nlopt_set_maxeval(optimiser, 15 + 15 * static_cast<int>(n));
    nlopt_set_ftol_abs(optimiser, 0.02);
    nlopt_set_max_objective(
        optimiser,
        [](unsigned size, const double* at, double*, void* data) {
          auto& c = *static_cast<Context*>(data);
          std::vector<double> values = c.values;
          for (unsigned i = 0; i < size; ++i)
            values[c.shapes[i]] = c.parameters[c.shapes[i]].logarithmic ? std::exp(at[i]) : at[i];
          return c.attempt(values);
        },
        &context);
    double value = 0;
    nlopt_optimize(optimiser, x.data(), &value);
    nlopt_destroy(optimiser);
  }

  static Scored look(const MeanModel& model, Shape shape) {
    Scored best;
    const double price = shape.price;
    shape.size = 1;
    const Columns unit = shape_of(model, shape);
    const MeanModel::Products products = model.products(unit.columns_mm);
    if (products.square.trace() < 1e-9) return best;
    for (double size : {0.1, 0.3, 1.0, 3.0, 10.0, 30.0}) {
      if (shape.channel != Channel::range) size *= 0.02 * rad_per_deg;
      Prior prior = unit.prior;
      prior.sigma *= size;
      const MeanModel::Fit f = MeanModel::solve(products, prior, false);
      if (f.evidence - price <= best.evidence) continue;
      best.evidence = f.evidence - price;
      best.gain = f.gain;
      shape.size = size;
      best.shape = shape;
    }
    return best;
  }

  /// Unnamed functions of every coordinate, with the price of having looked at so many.
  static std::vector<Shape> shapes_to_try(const MeanModel& model) {
    std::vector<Shape> list;
    const auto consider = [&](Shape shape, double price) {
      shape.price = price;
      list.push_back(shape);
    };
    struct Place {
      Coordinate coordinate;
      Channel channel;
    };
    const std::vector<Place> places{
        {Coordinate::beam, Channel::range},       {Coordinate::beam, Channel::beam_angle},
        {Coordinate::stage, Channel::range},      {Coordinate::stage, Channel::stage_angle},
        {Coordinate::range, Channel::range},      {Coordinate::intensity, Channel::range},
        {Coordinate::incidence, Channel::range},  {Coordinate::time, Channel::range},
        {Coordinate::time, Channel::stage_angle}, {Coordinate::temperature, Channel::range}};
    for (const Place& place : places) {
      double low = 1e300, high = -1e300;
      std::set<double> values;
      for (Eigen::Index i = 0; i < model.rows(); ++i) {
        const double v = coordinate_at(model, place.coordinate, i);
        if (!std::isfinite(v)) continue;
        low = std::min(low, v);
        high = std::max(high, v);
        if (values.size() < 400) values.insert(v);
      }
      if (!(high - low > 1e-6) || values.size() < 4) continue;
      for (const double length : {0.5, 0.2, 0.08})
        if (values.size() > 2 / length)
          consider({Shape::Kind::smooth, place.coordinate, place.channel, length, 0, 1, 0, {}},
                   price_of_scale(1, 1));
      if (place.coordinate == Coordinate::incidence || place.coordinate == Coordinate::temperature) continue;
      const std::vector<double> steps = quantiles(model, place.coordinate, 40);
      for (const double at : steps)
        consider({Shape::Kind::step, place.coordinate, place.channel, 0, at, 1, 0, {}},
                 std::log(static_cast<double>(steps.size())) + price_of_scale(1, 1));
      if (place.channel == Channel::range &&
          (place.coordinate == Coordinate::beam || place.coordinate == Coordinate::range ||
           place.coordinate == Coordinate::time)) {
        std::vector<std::pair<double, double>> bumps;  // width, middle
        for (const double share : {0.012, 0.024, 0.048})
          for (double at = low; at < high; at += 1.5 * share * (high - low))
            bumps.emplace_back(share * (high - low), at);
        for (const auto& [width, at] : bumps)
          consider({Shape::Kind::bump, place.coordinate, place.channel, width, at, 1, 0, {}},
                   std::log(static_cast<double>(bumps.size())) + price_of_scale(1, 1));
      }
      if (place.coordinate == Coordinate::beam) {
        // Whole numbers of lobes in a turn, and any other number: coarse slits, gears.
        for (int lobes = 3; lobes <= 12; ++lobes)
          consider({Shape::Kind::wave, place.coordinate, place.channel, 0, 360.0 / lobes, 1, 0, {}},
                   std::log(10.0) + price_of_scale(1, 1));
        for (double cycles = 4; cycles < 20; cycles += 0.4)
          consider({Shape::Kind::wave, place.coordinate, place.channel, 0, (high - low) / cycles, 1, 0, {}},
                   std::log(40.0) + price_of_scale(1, 1));
      } else if (place.coordinate == Coordinate::time) {
        for (double turns = 1.5; turns < 12; turns *= 1.08)
          consider({Shape::Kind::wave, place.coordinate, place.channel, 0, (high - low) / turns, 1, 0, {}},
                   std::log(15.0) + price_of_scale(1, 1));
      }
    }
    return list;
  }

  static std::vector<double> quantiles(const MeanModel& model, Coordinate coordinate, int count) {
    std::vector<double> values;
    for (Eigen::Index i = 0; i < model.rows(); i += std::max<Eigen::Index>(1, model.rows() / 4000)) {
      const double v = coordinate_at(model, coordinate, i);
      if (std::isfinite(v)) values.push_back(v);
    }
    std::ranges::sort(values);
    std::vector<double> list;
    for (int q = 1; q < count; ++q) {
      const std::size_t i = values.size() * static_cast<std::size_t>(q) / static_cast<std::size_t>(count);
      const double v = values[i];
      double next = v;
      for (std::size_t j = i; j < values.size() && next <= v; ++j) next = values[j];
      const double middle = (v + next) / 2;
      if (next > v && (list.empty() || middle > list.back() + 1e-9)) list.push_back(middle);
    }
    return list;
  }

  // ---- moves
  // -----------------------------------------------------------------------------------------------
  Hypothesis extended(const Hypothesis& h, const Scored& scored) {
    Hypothesis more = h;
    if (scored.shape) {
      more.shapes.push_back(*scored.shape);
    } else {
      Term term = scored.term;
      term.sigma.clear();
      more.terms.push_back(term);
    }
    fit(more);
    return more;
  }

  std::vector<Hypothesis> best_of(const Hypothesis& h, const std::vector<Scored>& list, std::size_t tries) {
    std::vector<Hypothesis> results;
    if (!has_patience()) tries = 1;
    for (const Scored& scored : list) {
      if (results.size() >= tries || scored.evidence < list.front().evidence - 15) break;
      results.push_back(extended(h, scored));
    }
    std::ranges::sort(results, [](const auto& a, const auto& b) { return a.evidence > b.evidence; });
    return results;
  }

  /// Adds, drops and exchanges until nothing helps. `unnamed`: functions without a name may be added too.
  Hypothesis climb(Hypothesis h, std::size_t tries, bool exchange = true, bool unnamed_too = true) {
    for (int move = 0; move < 8; ++move) {
      bool moved = false;
      if (h.terms.size() + h.shapes.size() < 4) {
        std::vector<Scored> list = scan(h, nullptr, true, unnamed_too && h.shapes.size() < 2);
        // Unnamed functions are many: only the best of them competes.
        bool unnamed = false;
        std::erase_if(list, [&](const Scored& s) { return s.shape ? std::exchange(unnamed, true) : false; });
        const auto candidates = best_of(h, list, tries);
        const bool first = h.terms.empty() && h.shapes.empty() && !candidates.empty();
        const double worth = !first                              ? worth_a_move
                             : candidates.front().shapes.empty() ? worth_a_first_name
                                                                 : worth_a_first_form;
        if (!candidates.empty() && candidates.front().evidence > h.evidence + worth) {
          h = candidates.front();
          moved = true;
        }
      }
      if (moved) {
        h = pruned(h);
        continue;
      }
      if (!exchange || !has_patience()) break;
      const Hypothesis other = exchanged(h, tries);
      if (other.evidence <= h.evidence + 0.5) break;
      h = pruned(other);
    }
    return h;
  }

  Hypothesis without(const Hypothesis& h, std::size_t term) {
    Hypothesis less = h;
    less.terms.erase(less.terms.begin() + static_cast<std::ptrdiff_t>(term));
    fit(less);
    return less;
  }

  Hypothesis pruned(Hypothesis h) {
    for (bool again = true; again && h.terms.size() + h.shapes.size() > 1;) {
      again = false;
      for (std::size_t t = 0; t < h.terms.size() && !again; ++t) {
        const Hypothesis less = without(h, t);
        if (less.evidence < h.evidence - worth_a_move) continue;
        h = less;
        again = true;
      }
      for (std::size_t s = 0; s < h.shapes.size() && !again; ++s) {
        Hypothesis less = h;
        less.shapes.erase(less.shapes.begin() + static_cast<std::ptrdiff_t>(s));
        fit(less);
        if (less.evidence < h.evidence - worth_a_move) continue;
        h = less;
        again = true;
      }
    }
    return h;
  }

  Hypothesis exchanged(const Hypothesis& h, std::size_t tries) {
    Hypothesis best = h;
    for (std::size_t t = 0; t < h.terms.size(); ++t) {
      const Hypothesis less = without(h, t);
      for (Hypothesis& other : best_of(less, scan(less, &h.terms[t], true, false), tries))
        if (other.evidence > best.evidence) best = other;
    }
    // A named mechanism that does what an unnamed function did may make others needless too.
    for (std::size_t s = 0; s < h.shapes.size(); ++s) {
      Hypothesis less = h;
      less.shapes.erase(less.shapes.begin() + static_cast<std::ptrdiff_t>(s));
      fit(less);
      for (const Hypothesis& other : best_of(less, scan(less, nullptr, true, false), tries)) {
        const Hypothesis fewer = pruned(other);
        if (fewer.evidence > best.evidence) best = fewer;
      }
    }
    return best;
  }

  /// From the best curve, the best step and the best wave.
  Hypothesis from_unnamed(const Hypothesis& empty) {
    std::vector<Scored> list = scan(empty, nullptr, false, true);
    std::set<Shape::Kind> kinds;
    std::erase_if(list, [&](const Scored& s) { return !kinds.insert(s.shape->kind).second; });
    Hypothesis best = empty;
    for (const Scored& start : list) {
      const Hypothesis other = climb(extended(empty, start), finalists);
      if (says_more(other, best, empty)) best = other;
    }
    return best;
  }

  /// A period or the place of a step tells people more than a curve that explains hardly more.
  static bool says_more(const Hypothesis& one, const Hypothesis& other, const Hypothesis& empty) {
    constexpr double hardly = 0.01;  // of what is explained
    const auto rank = [](const Hypothesis& h) {
      return h.shapes.empty() || h.shapes.front().kind == Shape::Kind::smooth ? 0 : 1;
    };
    const double margin = hardly * std::max(0.0, std::max(one.evidence, other.evidence) - empty.evidence);
    const bool both_unnamed =
        !one.shapes.empty() && !other.shapes.empty() && one.terms.empty() && other.terms.empty();
    const double sign = both_unnamed ? rank(one) - rank(other) : 0;
    return one.evidence + sign * margin > other.evidence;
  }

  // ---- judgement
  // -------------------------------------------------------------------------------------------
  void judge(Hypothesis& best, MeanResult& result);
  void measure(const Hypothesis& best, MeanResult& result);
  void doubt_aliases(Hypothesis& best);
  void keep_what_transfers(Hypothesis& best);
  [[nodiscard]] double strain(const Hypothesis& h) const;
  std::vector<Term> only_priors(const Term& term, const Hypothesis& without);
  std::vector<int> blocks_and_floor(MeanResult& result, int* count) const;
  HeldOutFigures held_out(const Hypothesis& h, const std::vector<int>& blocks, int count);

  Reduced& reduced_;
  MeanNoise noise_;
  const Progress& progress_;
  double excess_ = 1;
  int fits_ = 0;
  bool cut_short_ = false;
  bool transfers_ = true;   ///< Nothing was dropped because other places do not confirm it.
  bool may_change_ = true;  ///< The last comparison may still find a better explanation, once.
};

/// Whole captures go to one block each in turn; a session of few captures is cut into sectors of beams.
std::vector<int> blocks_of(const MeanModel& model, const Reduced& reduced, int* count) {
  std::vector<int> blocks;
  const bool few = reduced.captures.size() < 6;
  *count = few ? 6 : static_cast<int>(std::min<std::size_t>(8, reduced.captures.size()));
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    if (few) {
      blocks.push_back(static_cast<int>((model.cell(i).beam_rad + 4) * deg_per_rad / 9) % *count);
    } else {
      blocks.push_back(model.group(i).capture % *count);
    }
  }
  return blocks;
}

/// Blocks of the held-out figures, and the noise floor.
std::vector<int> Search::blocks_and_floor(MeanResult& result, int* count) const {
  const MeanModel model(reduced_, noise_);
  double sum = 0;
  for (Eigen::Index i = 0; i < model.rows(); ++i) sum += model.variance_of_mean(i);
  result.noise_floor_mm = std::sqrt(sum / std::max<double>(1, static_cast<double>(model.rows())));
  return blocks_of(model, reduced_, count);
}

HeldOutFigures Search::held_out(const Hypothesis& h, const std::vector<int>& blocks, int count) {
  place(h);
  MeanModel model(reduced_, noise_);
  Base base = base_columns(model, h);
  model.set_base(std::move(base.all.columns_mm), base.all.prior);
  const MeanModel::HeldOut out = model.held_out(blocks, count);
  const double n = std::max(1.0, out.cells);
  return {out.log_likelihood, std::sqrt(out.squares / n), out.within_2u / n, out.cells};
}

/// Drops what the recordings of other places do not confirm, the least confirmed first. A place stands for
/// itself: all that it says together counts, for and against.
void Search::keep_what_transfers(Hypothesis& best) {
  const int places = static_cast<int>(reduced_.captures.size());
  if (places < 3 || std::ranges::all_of(reduced_.absent, [](const Absent& a) { return a.empty(); })) return;
  const auto unseen = [&](const Hypothesis& h) {
    place(h);
    MeanModel model(reduced_, noise_);
    const Base base = base_columns(model, h);
    model.set_base(base.all.columns_mm, base.all.prior);
    std::vector<int> blocks;
    for (Eigen::Index i = 0; i < model.rows(); ++i) blocks.push_back(model.group(i).capture);
    return model.unseen(blocks, places);
  };
  while (best.terms.size() + best.shapes.size() > 0) {
    const std::vector<double> now = unseen(best);
    std::optional<Hypothesis> better;
    double least = 0;
    for (std::size_t k = 0; k < best.terms.size() + best.shapes.size(); ++k) {
      Hypothesis less = best;
      if (k < best.terms.size())
        less.terms.erase(less.terms.begin() + static_cast<std::ptrdiff_t>(k));
      else
        less.shapes.erase(less.shapes.begin() + static_cast<std::ptrdiff_t>(k - best.terms.size()));
      fit(less);
      const std::vector<double> then = unseen(less);
      double gain = 0;
      int confirmed = 0;
      for (std::size_t b = 0; b < now.size(); ++b) {
        gain += now[b] - then[b];
        confirmed += now[b] > then[b];
      }
      if (gain > confirmed_by && 2 * confirmed > places) continue;
      const double score = 2 * confirmed > places ? gain : std::min(gain, 0.0) - 1;
      if (better && score > least) continue;
      least = score;
      better = less;
    }
    if (!better) return;
    best = *better;
    transfers_ = false;
  }
}

/// Half the squared distance of mount and targets from what the bench file states, in its uncertainties.
double Search::strain(const Hypothesis& h) const {
  const Eigen::VectorXd u = Nuisance::prior_sigma(reduced_.bench),
                        off = h.nuisance.as_vector() - Nuisance(reduced_.bench).as_vector();
  double sum = 0;
  for (Eigen::Index i = 0; i < u.size(); ++i)
    if (u[i] > 0) sum += 0.5 * off[i] * off[i] / (u[i] * u[i]);
  return sum;
}

/// A term that only the bench file's uncertainties show, and others that would relieve them as well.
std::vector<Term> Search::only_priors(const Term& term, const Hypothesis& without) {
  std::vector<Term> set{term};
  constexpr double as_good = 4;
  const std::vector<Scored> list = scan(without, nullptr, true, false);
  if (list.empty()) return set;
  const auto own = std::ranges::find_if(list, [&](const Scored& s) { return s.term.same(term); });
  const double evidence = own == list.end() ? list.front().evidence : own->evidence;
  for (const Scored& other : list) {
    if (set.size() > 4 || other.evidence < evidence - as_good) break;
    if (std::ranges::none_of(set, [&](const Term& t) { return t.mechanism == other.term.mechanism; }))
      set.push_back(other.term);
  }
  return set;
}

/// Then the name says the same as that the bench file is wrong.
bool says_where_a_target_stands(const Term& term) {
  return term.mechanism->id == "target-offset" || term.mechanism->id == "target-tilt";
}

/// Whether a term was set aside, because the bench file's uncertainties alone speak for it.
bool is_set_aside(const MeanResult& result, const Term& term) {
  return std::ranges::any_of(result.stated_otherwise, [&](const std::vector<Term>& set) {
    return std::ranges::any_of(set, [&](const Term& other) { return other.same(term); });
  });
}

/// Akaike's: how well it fits, less one for everything that its mechanisms may adjust.
double adjusted_fit(const Hypothesis& h) {
  double fit = h.density;
  for (const Term& term : h.terms) fit -= static_cast<double>(term.values.size());
  return fit;
}

void Search::judge(Hypothesis& best, MeanResult& result) {
  auto said = std::move(result.stated_otherwise);
  result = MeanResult(reduced_.bench);
  result.stated_otherwise = std::move(said);
  keep_what_transfers(best);
  int count = 0;
  const std::vector<int> blocks = blocks_and_floor(result, &count);
  // What does not help on captures it has not seen is not believed. If the bench file's uncertainties alone
  // speak for it, it is one of several ways in which the bench file may be wrong.
  for (bool again = true; again;) {
    again = false;
    result.without.clear();
    result.after = held_out(best, blocks, count);
    for (std::size_t t = 0; t < best.terms.size(); ++t) {
      const Hypothesis less = without(best, t);
      result.without.push_back(held_out(less, blocks, count));
      if (result.without.back().log_likelihood < result.after.log_likelihood) continue;
      const double gain = best.evidence - less.evidence;
      if (gain > strained && strain(less) - strain(best) > 0.4 * gain) {
        const std::vector<Term> set = only_priors(best.terms[t], less);
        if (set.size() == 1 && says_where_a_target_stands(set.front())) continue;
        result.stated_otherwise.push_back(set);
      }
      best = less;
      again = true;
      break;
    }
  }
  Hypothesis nothing(reduced_.bench);
  fit(nothing);
  result.before = held_out(nothing, blocks, count);
  for (std::size_t t = 0; t < best.terms.size(); ++t) {
    std::vector<Rival> rivals;
    std::optional<Hypothesis> better;
    const Hypothesis less = without(best, t);
    rivals.push_back({{}, {}, best.evidence - less.evidence});
    const std::vector<Scored> list = scan(less, &best.terms[t], true, best.shapes.empty());
    const double first_evidence = list.empty() ? 0 : list.front().evidence;
    bool unnamed = false;
    for (const Scored& scored : list) {
      if (scored.shape && std::exchange(unnamed, true)) continue;
      if (rivals.size() > (has_patience() ? 7 : 3) ||
          (rivals.size() > 2 && scored.evidence < 0.3 * first_evidence))
        break;
      if (!scored.shape && is_set_aside(result, scored.term)) continue;
      const Hypothesis other = extended(less, scored);
      Rival rival;
      if (scored.shape)
        rival.shape = scored.shape;
      else
        rival.term = other.terms.back();
      rival.behind = best.evidence - other.evidence +
                     (scored.shape && other.terms.empty() ? preference(best, other) : 0);
      rival.fits_as_well =
          rival.behind < most_behind && adjusted_fit(other) > adjusted_fit(best) - hardly_worse;
      if (rival.behind < -0.5 && (!better || better->evidence < other.evidence)) better = other;
      rivals.push_back(rival);
    }
    std::ranges::sort(rivals, [](const Rival& a, const Rival& b) { return a.behind < b.behind; });
    if (may_change_ && better) {
      best = *better;
      may_change_ = false;
      return judge(best, result);
    }
    double others = 0;
    for (const Rival& rival : rivals) others += std::exp(-std::clamp(rival.behind, -30.0, 60.0));
    result.probability.push_back(1 / (1 + others));
    result.rivals.push_back(rivals);
  }
  fit(best);
  place(best);
  result.best = best;
  result.noise = noise_;
  result.excess = excess_;
  result.transfers = transfers_;
}

/// Millimetres from one place of a regular ladder to the next.
std::optional<double> rung_of(const Reduced& reduced) {
  std::set<double> places;
  for (const CaptureInfo& capture : reduced.captures)
    if (capture.target) places.insert(capture.target_shift_mm);
  if (places.size() < 5) return {};
  const std::vector<double> apart = steps_between(places);
  const auto [least, most] = std::ranges::minmax(apart);
  if (most > 1.02 * least) return {};
  return least;
}

/// On a regular ladder a wave looks the same as others whose turns differ by whole numbers from rung to rung:
/// the longest that fits as well is told, and the uncertainty of its period holds them all.
void Search::doubt_aliases(Hypothesis& best) {
  constexpr double as_good = 1.5;
  const std::optional<double> rung = rung_of(reduced_);
  if (!rung) return;
  for (std::size_t t = 0; t < best.terms.size(); ++t) {
    if (best.terms[t].mechanism->id != "cyclic-error") continue;
    constexpr std::size_t period = 2;
    const Parameter& p = best.terms[t].mechanism->parameters[period];
    fit(best);
    std::vector<Hypothesis> others{best};
    for (const int turns : {-3, -2, -1, 1, 2, 3}) {
      const double other = 1 / std::abs(1 / best.terms[t].values[period] + turns / *rung);
      if (other < p.lower || other > p.upper) continue;
      others.push_back(best);
      others.back().terms[t].values[period] = other;
      fit(others.back());
    }
    double top = -1e300, squares = 0, weight = 0;
    for (const Hypothesis& h : others) top = std::max(top, h.evidence);
    const Hypothesis* longest = nullptr;
    for (const Hypothesis& h : others)
      if (h.evidence > top - as_good &&
          (!longest || h.terms[t].values[period] > longest->terms[t].values[period]))
        longest = &h;
    const double told = longest->terms[t].values[period];
    for (const Hypothesis& h : others) {
      const double w = std::exp(h.evidence - top);
      squares += w * std::pow(h.terms[t].values[period] - told, 2);
      weight += w;
    }
    best = *longest;
    best.terms[t].sigma[period] = std::hypot(best.terms[t].sigma[period], std::sqrt(squares / weight));
  }
}

/// The figures of what was judged, from all cells.
void Search::measure(const Hypothesis& best, MeanResult& result) {
  int count = 0;
  const std::vector<int> blocks = blocks_and_floor(result, &count);
  result.after = held_out(best, blocks, count);
  result.without.clear();
  for (std::size_t t = 0; t < best.terms.size(); ++t)
    result.without.push_back(held_out(without(best, t), blocks, count));
  Hypothesis nothing(reduced_.bench);
  fit(nothing);
  result.before = held_out(nothing, blocks, count);
  result.best = best;
  result.noise = noise_;
  result.excess = excess_;
  place(best);
}

/// Variance (mm^2) of what whole groups are off beyond what their cells say.
double Search::scatter_of_groups(const Hypothesis& best) {
  place(best);
  MeanModel model(reduced_, noise_);
  Base base = base_columns(model, best);
  model.set_base(std::move(base.all.columns_mm), base.all.prior);
  const Eigen::VectorXd residual = model.residual();
  std::vector<double> sum(reduced_.groups.size(), 0.0), weight(reduced_.groups.size(), 0.0);
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const auto g = static_cast<std::size_t>(model.cell(i).group);
    const double w = 1 / (model.sigma_of_mean(i) * model.sigma_of_mean(i));
    sum[g] += w * residual[i];
    weight[g] += w;
  }
  double squares = 0, typical = 0;
  int groups = 0;
  for (std::size_t g = 0; g < sum.size(); ++g) {
    if (weight[g] <= 0) continue;
    squares += sum[g] * sum[g] / weight[g];
    typical += 1 / weight[g];
    ++groups;
  }
  if (groups < 10) return 0;
  const double ratio = squares / groups;
  if (ratio < 1 + 4 * std::sqrt(2.0 / groups)) return 0;
  return (ratio - 1) * typical / groups;
}

}  // namespace

void predict_at(Reduced& reduced, const Hypothesis& h, bool may_leave_out) {
  predict(reduced, h.nuisance, all_at_work(reduced.bench, h), may_leave_out);
}

std::vector<Active> all_at_work(const Bench& bench, const Hypothesis& h) {
  std::vector<Active> list = h.active();
  for (const Term& known : known_terms(bench)) list.push_back(known.active());
  return list;
}

bool Hypothesis::has(const Term& term) const {
  return std::ranges::any_of(terms, [&](const Term& t) { return t.same(term); });
}

std::vector<Active> Hypothesis::active() const {
  std::vector<Active> list;
  for (const Term& term : terms) list.push_back(term.active());
  return list;
}

std::vector<Term> known_terms(const Bench& bench) {
  std::vector<Term> list;
  for (const KnownMechanism& known : bench.known) {
    const Mechanism* m = find_mechanism(known.mechanism);
    if (!m || !moves_means(*m)) continue;
    Term term{m, -1, m->values(known.parameters), {}};
    for (const Parameter& p : m->parameters) {
      const auto found = known.parameters.find(p.name);
      term.sigma.push_back(found == known.parameters.end() ? 0 : found->second.u);
    }
    if (m->one_target) {
      const auto name = known.texts.find("target");
      for (std::size_t i = 0; i < bench.targets.size(); ++i)
        if (name != known.texts.end() && bench.targets[i].name == name->second)
          term.target = static_cast<int>(i);
      if (term.target < 0) continue;
    }
    list.push_back(term);
  }
  return list;
}

Base base_columns(const MeanModel& model, const Hypothesis& h) {
  Base base;
  const Bench& bench = model.bench();
  base.all.columns_mm = model.nuisance_columns();
  const Nuisance stated(bench);
  base.all.prior.mean = stated.as_vector() - h.nuisance.as_vector();
  base.all.prior.sigma = Nuisance::prior_sigma(bench);
  for (const Term& term : known_terms(bench)) {
    Columns c = linear_columns(model, term);
    std::size_t k = 0;
    for (std::size_t p = 0; p < term.values.size(); ++p) {
      if (term.mechanism->parameters[p].role != Role::size) continue;
      const bool phased = p + 1 < term.values.size() && term.mechanism->parameters[p + 1].role == Role::phase;
      const double u = phased ? std::hypot(term.sigma[p], term.values[p] * term.sigma[p + 1] * rad_per_deg)
                              : term.sigma[p];
      for (int copy = 0; copy < (phased ? 2 : 1); ++copy, ++k) {
        c.prior.mean[static_cast<Eigen::Index>(k)] = 0;
        c.prior.sigma[static_cast<Eigen::Index>(k)] = std::max(1e-12, 1.5 * u);
      }
    }
    add(base.all, c);
    add(base.all, freedom_columns(model, term));
  }
  for (const Term& term : h.terms) {
    Columns c = linear_columns(model, term);
    const std::vector<double> now = linear_coefficients(term);
    double ratio = least_stretch(c.prior);
    for (std::size_t k = 0; k < now.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      ratio = std::max(ratio, 1.2 * std::abs(now[k] - c.prior.mean[i]) / c.prior.sigma[i]);
    }
    for (std::size_t k = 0; k < now.size(); ++k) c.prior.mean[static_cast<Eigen::Index>(k)] -= now[k];
    c.prior.sigma *= ratio;
    c.price = price_of_scale(ratio, static_cast<double>(now.size()));
    add(c, shape_columns(model, term));
    base.term_first.push_back(base.all.columns_mm.cols());
    base.term_count.push_back(c.columns_mm.cols());
    add(base.all, c);
    add(base.all, freedom_columns(model, term));
  }
  for (const Shape& shape : h.shapes) {
    base.shape_first.push_back(base.all.columns_mm.cols());
    add(base.all, shape_of(model, shape));
  }
  base.shape_first.push_back(base.all.columns_mm.cols());
  return base;
}

MeanResult search_means(Reduced& reduced, const MeanNoise& noise, const Progress& progress) {
  Search search(reduced, noise, progress);
  MeanResult result = search.run();
  const double scatter2 = search.scatter_of_groups(result.best);
  if (scatter2 <= 0 || !noise.range_mm2.empty()) return result;
  // Whole captures are off at random: their cells are worth far less than their number says.
  MeanNoise wider = noise;
  wider.range_mm2.assign(reduced.groups.size(), scatter2);
  Search again(reduced, wider, progress);
  MeanResult second = again.run();
  second.scatter_mm = std::sqrt(scatter2);
  return second;
}

}  // namespace fit::explain
