// SPDX-License-Identifier: MIT
#include "fit/explain/mean_search.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <set>
#include <thread>
#include <utility>

#include "fit/explain/candidate.hpp"
#include "fit/explain/odds.hpp"
#include "fit/explain/sampling.hpp"
#include "fit/median.hpp"

namespace fit::explain {
namespace {

using Role = Parameter::Role;

constexpr std::size_t rows_of_search = 6000, rows_of_last_search = 30000, rows_of_judgement = 120000;
constexpr std::size_t finalists = 7;
// Fits after which a search stops trying other ways: twice what any recording of one or two effects needed.
constexpr double rows_of_patience = 6e6, least_patience = 200, most_patience = 1000;
constexpr double hardly_worse = 2.2, most_behind = 12;  // a rival that is simply more adjustable
constexpr double confirmed_by = 3;                      // log-likelihood of places not fitted to

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
      : reduced_(reduced),
        stops_apart_deg_(stops_apart_deg(reduced)),
        noise_(std::move(noise)),
        progress_(progress) {}

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

 private:
  /// How far names may be behind unnamed functions: less far behind a step or a wave, which hardly resemble
  /// anything else. A mechanism of which only the coordinate is certain may be farther behind another curve
  /// of that, but no step behind a step: its own curve has taken up what it could.
  static double preference(const Hypothesis& named, const Hypothesis& unnamed) {
    double sum = 0;
    for (const Shape& shape : unnamed.shapes) {
      const bool same = std::ranges::any_of(named.terms, [&](const Term& term) {
        return has_free_curve(*term.mechanism) && term.mechanism->coordinate == shape.coordinate;
      });
      if (shape.form->tells_a_place)
        sum += same ? 0 : odds::worth_a_name_beside_a_place;
      else
        sum += same ? 2 * odds::worth_a_name : odds::worth_a_name;
    }
    return sum;
  }

  /// What was found among fewer cells, looked at once more and judged.
  void decide(Hypothesis& best, MeanResult& result) {
    fit(best);  // Evidences compare on the same cells only.
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
    const MeanModel model = model_of(reduced_, noise_, empty);
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
    return static_cast<double>(h.shapes.size()) *
           (odds::price_of_unknown + (h.terms.empty() ? 0 : odds::worth_a_name));
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
                    odds::price_of_mechanism * static_cast<double>(h.terms.size()) - price_of_unnamed(h);
    for (const Shape& shape : h.shapes) next.evidence -= shape.price;
    if (!h.terms.empty() || !h.shapes.empty()) next.evidence += odds::something_is_missing;
    const Eigen::VectorXd nuisance = h.nuisance.as_vector();
    next.nuisance.set(nuisance + posterior.value.head(nuisance.size()));
    trial.density = model.density_here(nuisance.size());
    next.density = trial.density;
    next.adjusted = 0;
    for (Eigen::Index k = nuisance.size(); k < posterior.value.size(); ++k)
      if (const double free = base.all.prior.sigma[k]; free > 0)
        next.adjusted += 1 - posterior.covariance(k, k) / (free * free);
    for (std::size_t t = 0; t < h.terms.size(); ++t) {
      Term& term = next.terms[t];
      const auto first = base.term_first[t], count = base.term_count[t];
      const std::vector<double> now = linear_coefficients(term);
      Eigen::VectorXd x = posterior.value.segment(first, count);
      for (std::size_t k = 0; k < now.size(); ++k) x[static_cast<Eigen::Index>(k)] += now[k];
      set_coefficients(term, x, posterior.covariance.block(first, first, count, count));
      next.evidence -= odds::against(term);
      if (term.mechanism->one_target)
        next.evidence -= std::log(static_cast<double>(reduced_.bench.targets.size()));
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

  // ---- looking for one more ---------------------------------------------------------------------
  [[nodiscard]] bool is_larger_than(std::size_t rows) const {
    return static_cast<std::size_t>(std::ranges::count_if(reduced_.cells, &Cell::smooth)) > rows;
  }

  /// Every mechanism not in `h` (nor in `but`), on top of it.
  std::vector<Candidate> scan(const Hypothesis& h, const Term* but, bool named, bool unnamed) {
    place(h);
    std::optional<Reduced> few;
    if (is_larger_than(rows_of_last_search)) few = merged(reduced_, rows_of_last_search);
    const MeanModel model = model_of(few ? *few : reduced_, noise_, h);
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
    const std::vector<Shape> shapes = unnamed ? forms_to_try(model) : std::vector<Shape>();
    // Fine combs are gone where neighbouring beams are taken together.
    std::optional<MeanModel> every;
    if (few && std::ranges::any_of(terms, [](const Term& term) { return is_comb(*term.mechanism); }))
      every = model_of(reduced_, noise_, h);
    std::vector<Candidate> list(terms.size() + shapes.size());
    on_two_cores(list.size(), [&](std::size_t i) {
      if (i >= terms.size())
        list[i] = look(model, shapes[i - terms.size()]);
      else
        list[i] = look(every && is_comb(*terms[i].mechanism) ? *every : model, terms[i], stops_apart_deg_);
    });
    std::erase_if(list, [](const Candidate& s) { return !(s.evidence > odds::worth_fitting); });
    std::ranges::sort(list, [](const Candidate& a, const Candidate& b) { return a.evidence > b.evidence; });
    return list;
  }

  // ---- moves ------------------------------------------------------------------------------------
  Hypothesis extended(const Hypothesis& h, const Candidate& scored) {
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

  std::vector<Hypothesis> best_of(const Hypothesis& h, const std::vector<Candidate>& list,
                                  std::size_t tries) {
    std::vector<Hypothesis> results;
    if (!has_patience()) tries = 1;
    for (const Candidate& scored : list) {
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
        std::vector<Candidate> list = scan(h, nullptr, true, unnamed_too && h.shapes.size() < 2);
        // Unnamed functions are many: only the best of them competes.
        bool unnamed = false;
        std::erase_if(list,
                      [&](const Candidate& s) { return s.shape ? std::exchange(unnamed, true) : false; });
        const auto candidates = best_of(h, list, tries);
        const bool first = h.terms.empty() && h.shapes.empty() && !candidates.empty();
        const double worth = !first                              ? odds::worth_a_move
                             : candidates.front().shapes.empty() ? odds::worth_a_first_name
                                                                 : odds::worth_a_first_form;
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
  Hypothesis without_shape(const Hypothesis& h, std::size_t shape) {
    Hypothesis less = h;
    less.shapes.erase(less.shapes.begin() + static_cast<std::ptrdiff_t>(shape));
    fit(less);
    return less;
  }

  Hypothesis pruned(Hypothesis h) {
    for (bool again = true; again && h.terms.size() + h.shapes.size() > 1;) {
      again = false;
      for (std::size_t t = 0; t < h.terms.size() && !again; ++t) {
        const Hypothesis less = without(h, t);
        if (less.evidence < h.evidence - odds::worth_a_move) continue;
        h = less;
        again = true;
      }
      for (std::size_t s = 0; s < h.shapes.size() && !again; ++s) {
        Hypothesis less = h;
        less.shapes.erase(less.shapes.begin() + static_cast<std::ptrdiff_t>(s));
        fit(less);
        if (less.evidence < h.evidence - odds::worth_a_move) continue;
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

  /// From the best of every form.
  Hypothesis from_unnamed(const Hypothesis& empty) {
    std::vector<Candidate> list = scan(empty, nullptr, false, true);
    std::set<const Form*> kinds;
    std::erase_if(list, [&](const Candidate& s) { return !kinds.insert(s.shape->form).second; });
    Hypothesis best = empty;
    for (const Candidate& start : list) {
      const Hypothesis other = climb(extended(empty, start), finalists);
      if (says_more(other, best, empty)) best = other;
    }
    return best;
  }

  /// A period or the place of a step tells people more than a curve that explains hardly more.
  static bool says_more(const Hypothesis& one, const Hypothesis& other, const Hypothesis& empty) {
    constexpr double hardly = 0.01;  // of what is explained
    const auto rank = [](const Hypothesis& h) {
      return !h.shapes.empty() && h.shapes.front().form->tells_a_place ? 1 : 0;
    };
    const double margin = hardly * std::max(0.0, std::max(one.evidence, other.evidence) - empty.evidence);
    const bool both_unnamed =
        !one.shapes.empty() && !other.shapes.empty() && one.terms.empty() && other.terms.empty();
    const double sign = both_unnamed ? rank(one) - rank(other) : 0;
    return one.evidence + sign * margin > other.evidence;
  }

  // ---- judgement --------------------------------------------------------------------------------
  void judge(Hypothesis& best, MeanResult& result);
  void measure(const Hypothesis& best, MeanResult& result);
  void doubt_aliases(Hypothesis& best);
  void keep_what_transfers(Hypothesis& best);
  [[nodiscard]] double strain(const Hypothesis& h) const;
  std::vector<Term> only_priors(const Term& term, const Hypothesis& without);
  std::vector<int> blocks_and_floor(MeanResult& result, int* count) const;
  HeldOutFigures held_out(const Hypothesis& h, const std::vector<int>& blocks, int count);

  Reduced& reduced_;
  std::optional<double> stops_apart_deg_;
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
  const MeanModel model = model_of(reduced_, noise_, h);
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
    const MeanModel model = model_of(reduced_, noise_, h);
    std::vector<int> blocks;
    for (Eigen::Index i = 0; i < model.rows(); ++i) blocks.push_back(model.group(i).capture);
    return model.unseen(blocks, places);
  };
  while (best.terms.size() + best.shapes.size() > 0) {
    const std::vector<double> now = unseen(best);
    std::optional<Hypothesis> better;
    double least = 0;
    for (std::size_t k = 0; k < best.terms.size() + best.shapes.size(); ++k) {
      const Hypothesis less =
          k < best.terms.size() ? without(best, k) : without_shape(best, k - best.terms.size());
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
  const std::vector<Candidate> list = scan(without, nullptr, true, false);
  if (list.empty()) return set;
  const auto own = std::ranges::find_if(list, [&](const Candidate& s) { return s.term.same(term); });
  const double evidence = own == list.end() ? list.front().evidence : own->evidence;
  for (const Candidate& other : list) {
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

/// Akaike's: how well it fits, less one for everything that its mechanisms adjusted to the recording.
double adjusted_fit(const Hypothesis& h) { return h.density - h.adjusted; }

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
      if (gain > odds::strained && strain(less) - strain(best) > 0.4 * gain) {
        const std::vector<Term> set = only_priors(best.terms[t], less);
        if (set.size() == 1 && says_where_a_target_stands(set.front())) continue;
        result.stated_otherwise.push_back(set);
      }
      best = less;
      again = true;
      break;
    }
    for (std::size_t s = 0; !again && s < best.shapes.size(); ++s) {
      const Hypothesis less = without_shape(best, s);
      if (held_out(less, blocks, count).log_likelihood < result.after.log_likelihood) continue;
      best = less;
      again = true;
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
    const std::vector<Candidate> list = scan(less, &best.terms[t], true, best.shapes.empty());
    const double first_evidence = list.empty() ? 0 : list.front().evidence;
    std::set<const Form*> forms;  // Of every form, the best one.
    for (const Candidate& scored : list) {
      if (scored.shape && !forms.insert(scored.shape->form).second) continue;
      if (rivals.size() > (has_patience() ? 7 : 3) ||
          (rivals.size() > 2 && scored.evidence < 0.3 * first_evidence))
        break;
      if (!scored.shape && is_set_aside(result, scored.term)) continue;
      const Hypothesis other = extended(less, scored);
      Rival rival;
      if (scored.shape)
        rival.shape = other.shapes.back();
      else
        rival.term = other.terms.back();
      rival.behind = best.evidence - other.evidence +
                     (scored.shape && other.terms.empty() ? preference(best, other) : 0);
      rival.fits_as_well =
          rival.behind < most_behind && adjusted_fit(other) > adjusted_fit(best) - hardly_worse;
      if (rival.behind < -0.5 && (!better || better->evidence < other.evidence)) better = other;
      if (rival.shape)
        rival.behind = std::max(std::min(0.0, rival.behind), rival.behind - odds::more_than_forms_show);
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

/// On a regular ladder a wave looks the same as others whose turns differ by whole numbers from rung to rung:
/// the longest that fits as well is told, and the uncertainty of its period holds them all.
void Search::doubt_aliases(Hypothesis& best) {
  constexpr double as_good = 1.5;
  const std::optional<double> rung = rung_mm(reduced_);
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
  const MeanModel model = model_of(reduced_, noise_, best);
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
