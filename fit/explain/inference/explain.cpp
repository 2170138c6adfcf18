// SPDX-License-Identifier: MIT
#include "fit/explain/inference/explain.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>
#include <string>

#include "fit/explain/inference/search.hpp"
#include "fit/explain/inference/steps.hpp"
#include "fit/explain/numbers.hpp"
#include "fit/explain/scene/stated_noise.hpp"

namespace fit::explain::inference {
namespace {

using Eigen::Index;

double noise_floor(const Reduced& reduced, const MeanNoise& noise) {
  const Reduced rows = merged(reduced, numbers::search_rows);  // as the channel has them
  const MeanModel model(rows, noise);
  double sum = 0, count = 0;
  for (Index i = 0; i < model.rows(); ++i) {
    const Cell& cell = model.cell(i);
    if (cell.u_edge_mm > 0 || cell.mixed_mm > 0) continue;  // what an edge leaves open is no noise
    sum += model.variance_of_mean(i);
    ++count;
  }
  return std::sqrt(sum / std::max(1.0, count));
}

/// The constant variance is the first coefficient of its channel; a mechanism that adds to it is the same.
double constant_noise_of(const Session& session, const Hypothesis& best) {
  double variance = 0;
  const std::size_t c = model::channel_of("variance");
  if (session.channels()[c]) variance += best.base[session.first_base(c)];
  for (const Term& term : best.terms)
    if (is_constant_noise(*term.kind->mechanism)) variance += std::pow(term.values.front(), 2);
  return std::sqrt(std::max(0.0, variance));
}

/// Without a term, and without all other sizes of its mechanism that may be missing apart.
Hypothesis without(const Hypothesis& h, const Kind& kind) {
  return h.less([&](const Term& term) {
    return term.kind == &kind ||
           (kind.size && term.kind->mechanism == kind.mechanism && term.kind->target == kind.target);
  });
}

/// Held-out figures of what has a name alone, where functions without one move means.
HeldOutFigures without_functions(const Session& session, const Fitted& best, const HeldOutFigures& after,
                                 Fits& fits) {
  const auto is_function = [](const Term& term) { return term.kind->is_form() && term.kind->moves_means(); };
  if (std::ranges::none_of(best.hypothesis.terms, is_function)) return after;
  return hold_out(session, fits(best.hypothesis.less(is_function)));
}

/// A channel's nuisances as a hypothesis has them.
std::vector<Estimate> nuisances_of(const Session& session, const Fitted& f, std::size_t channel) {
  std::vector<Estimate> list;
  const Index first = session.first_base(channel),
              count = session.channels()[channel]->base().prior.mean.size();
  const Eigen::MatrixXd unit = Eigen::MatrixXd::Identity(f.design.mean.size(), f.design.mean.size())
                                   .middleCols(first, count),
                        covariance = f.optimum.factor.solve(unit).middleRows(first, count);
  for (Index k = 0; k < count; ++k)
    list.push_back({f.hypothesis.base[first + k], f.design.sigma[first + k] * std::sqrt(covariance(k, k))});
  return list;
}

/// What a form does beside the means, in words.
Unexplained described(const Session& session, const Term& term, double gain) {
  const Shape shape = as_shape(term);
  std::size_t c = 0;
  while (!term.kind->acts_in[c]) ++c;
  const ChannelRows& rows = *session.channels()[c];
  Course course;
  course.what = term.kind->acts_on;
  course.unit = model::channel_kinds()[c].unit.empty() ? "" : " " + model::channel_kinds()[c].unit;
  if (model::channel_kinds()[c].is_square) course.unit += "^2";
  if (term.kind->is_share) course.unit.clear();
  const bool on_a_target = shape.is_along_one_target();
  course.coordinate =
      on_a_target ? place_along(session.reduced().bench, shape.target) : name_of(shape.coordinate);
  course.unit_of_coordinate = on_a_target ? " mm" : unit_of(shape.coordinate);
  for (Index i = 0; i < rows.rows(); ++i) {
    const double at = model::place_of(shape.coordinate, shape.target, rows.at(i));
    if (!std::isfinite(at)) continue;
    course.add(at);
    course.add_value(at, rows.response(i, term.kind->mechanism->act(rows.at(i), term.values)));
  }
  const Described says = shape.form->says(shape, course);
  Unexplained u;
  u.observable = term.kind->mechanism->observable;
  u.coordinate = shape.coordinate;
  u.gain = gain;
  u.describes = says.text;
  u.from = on_a_target ? shape.target : says.from;
  u.to = on_a_target ? shape.target : says.to;
  return u;
}

/// Log-likelihood that may be gained by something that is only what named mechanisms leave of their causes.
double left_by_named(const Fitted& best, const Inferred& inferred) {
  double sum = 0;
  for (std::size_t i = 0; i < inferred.gain.size(); ++i)
    for (std::size_t t = 0; t < best.hypothesis.terms.size(); ++t)
      if (best.hypothesis.terms[t].kind == inferred.posterior.named[i].term.kind)
        sum += std::pow(share_left(best, t), 2) * std::max(0.0, inferred.gain[i].fitted);
  return sum;
}

/// What the bench file and its tables can say of channels beside the means.
void restate(const Session& session, const Fitted& nothing, const Fitted& best, Inferred& out) {
  const double left = left_by_named(best, out);
  for (std::size_t c = 0; c < session.channels().size(); ++c) {
    const auto& rows = session.channels()[c];
    const model::ChannelKind& channel = model::channel_kinds()[c];
    if (!rows) continue;
    const Eigen::VectorXd& eta = best.optimum.eta[c];
    if (std::string note = rows->note(nothing.optimum.eta[c], eta); !note.empty())
      out.notes.push_back(std::move(note));
    std::ranges::copy_if(rows->unexplained(eta), std::back_inserter(out.unknown),
                         [&](const Unexplained& u) { return u.gain > left; });
    if (channel.restate) out.restated.push_back({c, nuisances_of(session, best, c)});
  }
  out.tables = tables_of(session, best, out.posterior);
}

void measure(const Session& session, const Fitted& nothing, const Explored& explored, Fits& fits,
             Inferred& out) {
  const Hypothesis& best = explored.best.hypothesis;
  out.means.before = hold_out(session, nothing, true);
  out.curves = curves_of(session, nothing, explored.best, out.posterior);
  out.means.after = hold_out(session, explored.best);
  const double all = out.means.after.log_likelihood;
  // In absolute figures the means alone are told, to which the gain of all channels is added.
  out.means.after.log_likelihood =
      out.means.before.log_likelihood + all - hold_out(session, nothing).log_likelihood;
  out.means.without_functions = without_functions(session, explored.best, out.means.after, fits);
  const auto gain_of = [&](const Term& term) {
    const Fitted& less = fits(without(best, *term.kind));
    return Gain{all - hold_out(session, less).log_likelihood,
                explored.best.optimum.log_likelihood - less.optimum.log_likelihood};
  };
  for (const Named& named : out.posterior.named) out.gain.push_back(gain_of(named.term));
  for (const Named& form : out.posterior.forms)
    if (!form.term.kind->moves_means())
      out.unknown.push_back(described(session, form.term, gain_of(form.term).held_out));
}

/// The best hypothesis as far as means go; of undecided sets, the best member.
void take_means(const Session& session, const Hypothesis& best, MeanResult& means) {
  means.best.nuisance = session.nuisance(best);
  for (const Term& term : best.terms) {
    if (!term.kind->moves_means()) continue;
    if (term.kind->is_form()) {
      means.best.shapes.push_back(as_shape(term));
      continue;
    }
    means.best.terms.push_back(as_active(term));
  }
}

/// Once everything is where it fits best.
void refuse_nothing_that_fits(const Reduced& reduced) {
  if (reduced.usable_cells() > 0) return;
  throw std::invalid_argument(
      "none of the " + std::to_string(reduced.cells.size()) +
      " cells of the recording can be compared with the bench" +
      (reduced.off_targets > 0 ? ": " + std::to_string(reduced.off_targets) + " lie more than " +
                                     rounded(off_target_mm, 3) + " mm off its targets"
                               : "") +
      ". Check that it is the bench file of this set-up, and that beams meet targets away from edges");
}

/// Where most beams agree that mount and targets are, if not all the time, then with the one thing more that
/// explains the most: what was moved meanwhile leaves most beams off, and others meet what nobody expects.
/// That is looked for from where the bench file has them, and from where all beams together do: what moves
/// many beams by little is clear only there.
Placed place(Reduced& reduced, const MeanNoise& noise, const Progress& progress) {
  Placed placed = fit_placements(reduced, noise);
  refuse_nothing_that_fits(reduced);
  if (placed.fits_most) return placed;
  MeanNoise wider = noise;
  wider.factor *= placed.excess;
  std::vector<Active> moved;
  double most = -1e300;
  for (const Nuisance& there : {placed.by_all, placed.there}) {
    Session session(reduced, wider, there);
    const Hypothesis best = best_of_one(session, progress);
    if (best.log_posterior() <= most) continue;
    most = best.log_posterior();
    moved.clear();
    for (const Term& term : best.terms)
      if (term.kind->moves_means() && !term.kind->is_form()) moved.push_back(as_active(term));
  }
  return moved.empty() ? placed : fit_placements(reduced, noise, moved);
}

}  // namespace

Shape as_shape(const Term& term) {
  Shape shape = *term.kind->form;
  const std::size_t count = term.kind->coefficients.size();
  shape.values.assign(term.values.begin(), term.values.begin() + static_cast<std::ptrdiff_t>(count));
  if (term.sigma.size() >= count)
    shape.u.assign(term.sigma.begin(), term.sigma.begin() + static_cast<std::ptrdiff_t>(count));
  shape.at = term.values[count];
  shape.length = term.values[count + 1];
  shape.size *= term.factor;
  return shape;
}

Inferred infer(Reduced& reduced, const MeanNoise& noise, const Progress& progress) {
  Inferred out{.kinds = nullptr, .posterior = {}, .means = MeanResult(reduced.bench)};
  const Placed placed = place(reduced, noise, progress);
  if (!reduced.has_intensity)
    out.notes.emplace_back(
        "No intensities were recorded. What follows the echo is compared with the one that reflectances, "
        "distances and incidence make by the bench file's law of intensity, or a plain receiver's.");
  out.means.excess = placed.excess;
  out.means.noise = noise;
  out.means.noise.factor *= out.means.excess;
  Session session(reduced, out.means.noise, placed.there);
  out.kinds = session.shared_kinds();
  const Explored explored = explore(session, progress);
  out.posterior = posterior_of(explored);
  Fits fits(session);
  join_what_looks_alike(session, explored.best, fits, out.posterior);
  out.means.noise = session.noise();
  take_means(session, explored.best.hypothesis, out.means);
  out.means.shapes_carry_over = forms_carry_over(session, explored.best);
  if (!out.means.shapes_carry_over)
    out.notes.emplace_back(
        "Captures do not show that unnamed functions are the same in all of them: predictions of other "
        "recordings leave them out.");
  const Fitted& nothing = fits({});
  measure(session, nothing, explored, fits, out);
  restate(session, nothing, explored.best, out);
  for (const Term& term : explored.best.hypothesis.terms)
    if (term.kind->mechanism->coordinate == Coordinate::scan_seq)
      out.of_scans.push_back({term.kind->mechanism, term.values});
  out.sigma_mm = constant_noise_of(session, explored.best.hypothesis);
  out.means.noise_floor_mm = noise_floor(reduced, out.means.noise);
  list_beside_means(out);
  return out;
}

}  // namespace fit::explain::inference
