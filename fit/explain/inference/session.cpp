// SPDX-License-Identifier: MIT
#include "fit/explain/inference/session.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "fit/explain/model/autoregression.hpp"
#include "fit/explain/model/hypothesis.hpp"
#include "fit/explain/model/neighbours.hpp"
#include "fit/explain/model/scans.hpp"
#include "fit/explain/model/stage_stops.hpp"
#include "fit/explain/numbers.hpp"
#include "fit/explain/reduction/edge_shares.hpp"
#include "fit/explain/reduction/margins.hpp"

namespace fit::explain::inference {

using Eigen::Index;

bool Hypothesis::has(const Kind& kind) const {
  return std::ranges::any_of(terms, [&](const Term& term) { return term.kind == &kind; });
}

std::vector<const Kind*> Hypothesis::kinds() const {
  std::vector<const Kind*> list;
  for (const Term& term : terms) list.push_back(term.kind);
  std::ranges::sort(list);
  return list;
}

Hypothesis Hypothesis::less(const std::function<bool(const Term&)>& these) const {
  Hypothesis others;
  std::ranges::remove_copy_if(terms, std::back_inserter(others.terms), these);
  return others;
}

namespace {

std::size_t mean_channel() { return model::channel_of("mean"); }

/// How much worse means are known for what a hypothesis says of scans, and for what these show: they draw
/// errors of their own, and autocorrelated noise averages out slowly.
MeanNoise noise_by(const Reduced& reduced, MeanNoise noise, const std::vector<Active>& known,
                   const std::vector<Term>& terms) {
  Effect all = effect_of(known, Circumstances{});
  for (const Term& term : terms) all += term.kind->mechanism->act(Circumstances{}, term.values);
  noise.scan_range_mm2 = std::max(0.0, all.scan_range_variance_mm2);
  noise.scan_angle_rad2 = all.scan_angle_variance_rad2;
  noise.spread_rad = std::sqrt(std::pow(std::max(all.footprint_rad, all.light_rad), 2) +
                               all.scan_angle_variance_rad2 + all.beam_angle_variance_rad2);
  noise.ar1_rho = all.ar1_rho;
  noise.ar1_share = std::clamp(all.ar1_share, 0.0, 1.0);
  const std::vector<model::ScanPart> scans = model::scan_parts(reduced, model::fewest_in_common, 1);
  const model::ScatterOfScans ranges = model::scatter_of_scans(scans, false),
                              angles = model::scatter_of_scans(scans, true);
  double slowly = 0, cells = 0;
  for (const Group& group : reduced.groups) {
    const int n = std::max(1, group.scans);
    noise.range_mm2.push_back(std::max(noise.scan_range_mm2, ranges.for_means(n)) / n);
    noise.angle_rad2.push_back(std::max(noise.scan_angle_rad2, angles.for_means(n)) / n);
    slowly += static_cast<double>(group.cells) * model::added_to_mean(group.scans, all.ar1_rho);
    cells += static_cast<double>(group.cells);
  }
  const auto is_none = [](double variance) { return variance <= 0; };
  if (std::ranges::all_of(noise.range_mm2, is_none)) noise.range_mm2.clear();
  if (std::ranges::all_of(noise.angle_rad2, is_none)) noise.angle_rad2.clear();
  if (cells > 0) noise.factor = std::max(noise.factor, 1 + all.ar1_share * slowly / cells);
  noise.neighbours = 1 + std::max(0.0, all.shared_by_neighbours);
  if (noise.neighbours > 1) noise.neighbours_of_target = model::inflation_of_targets(reduced);
  return noise;
}

/// The stage's angle errs at every stop, and at every capture there: with mount and targets fitted at the
/// present prediction.
void add_errors_of_stops(const Reduced& reduced, MeanNoise& noise) {
  noise.stop_rad2 = 0;
  if (reduced.usable_cells() == 0 || stops_of(reduced).empty()) return;
  const Reduced rows = merged(reduced, numbers::search_rows);
  const MeanModel model = model_of(rows, noise, explain::Hypothesis(rows.bench));
  noise.stop_rad2 = variance_of_stops_rad2(rows, model);
  const double of_capture = variance_within_stops_rad2(rows, model);
  if (of_capture == 0) return;
  noise.angle_rad2.resize(reduced.groups.size(), 0.0);
  for (std::size_t g = 0; g < noise.angle_rad2.size(); ++g)
    if (stands_still(reduced, g) || (g + 1 < reduced.groups.size() && stands_still(reduced, g + 1)))
      noise.angle_rad2[g] += of_capture;
}

std::shared_ptr<const Squared> white_base_of(const ChannelRows& rows) {
  if (!rows.has_fixed_information()) return nullptr;
  const Columns& base = rows.base();
  Eigen::MatrixXd columns(rows.rows(), base.columns.cols());
  if (columns.cols() > 0) columns = base.columns * units_of(base.prior.sigma).asDiagonal();
  return std::make_shared<const Squared>(squared(rows.whitened(std::move(columns), {})));
}

}  // namespace

Session::Session(Reduced& reduced, MeanNoise noise, const Nuisance& there)
    : reduced_(reduced), known_(known_effects(reduced.bench)), noise_(std::move(noise)) {
  Hypothesis nothing;
  make_channels(noise_);
  nothing.base = Eigen::VectorXd::Zero(count_base());
  if (channels_[mean_channel()]) {
    const Eigen::VectorXd moved = there.as_vector() - Nuisance(reduced.bench).as_vector();
    nothing.base.segment(first_base(mean_channel()), moved.size()) = moved;
  }
  std::vector<Hypothesis> none;
  linearise(nothing, none);
  kinds_ = std::make_shared<const std::vector<Kind>>(model::kinds_of(reduced_, channels_));
  at_starts_.assign(kinds_->size(), {});
}

void Session::make_channels(const MeanNoise& noise) {
  // Hypotheses know which channels there are. One that has no rows any more, as no edge shows at the present
  // prediction, keeps those it had.
  auto before = std::exchange(channels_, {});
  offsets_.clear();
  white_base_.clear();
  for (const model::ChannelKind& kind : model::channel_kinds()) {
    const std::size_t c = channels_.size();
    auto rows = before.empty() || before[c] ? kind.rows(reduced_, noise) : nullptr;
    if (rows && c != mean_channel()) append_uncertainty(known_, *rows);  // the means have theirs
    if (!rows && !before.empty()) rows = std::move(before[c]);
    channels_.push_back(std::move(rows));
    Eigen::VectorXd offset(channels_.back() ? channels_.back()->rows() : 0);
    for (Index i = 0; i < offset.size(); ++i) offset[i] = channels_.back()->offset(i);
    if (!kind.of_predicted)  // else the predictions have it
      for (Index i = 0; i < offset.size(); ++i) {
        const double known = channels_.back()->response(i, effect_of(known_, channels_.back()->at(i)));
        if (std::isfinite(known)) offset[i] += known;
      }
    offsets_.push_back(std::move(offset));
    white_base_.push_back(channels_.back() ? white_base_of(*channels_.back()) : nullptr);
  }
}

const std::vector<Session::AtStart>& Session::at_start(const Kind& kind, std::size_t start) const {
  auto& by_start = at_starts_[static_cast<std::size_t>(&kind - kinds_->data())];
  if (by_start.empty()) by_start.assign(kind.starts.size(), std::vector<AtStart>(channels_.size()));
  for (std::size_t c = 0; c < channels_.size(); ++c) {
    AtStart& at = by_start[start][c];
    if (!kind.acts_in[c]) continue;
    const ChannelRows& rows = *channels_[c];
    const auto& base = white_base_[c];
    if (at.columns.rows() == 0) {
      Eigen::MatrixXd columns = model::columns_of(rows, kind, kind.starts[start], &kind.acts_in[c]);
      if (base) {
        columns = rows.whitened(std::move(columns), {});
        at.square = square_of_columns(columns);
      }
      at.columns = columns.cast<float>();
      if (kind.acts_in[c].without_size) {
        const Eigen::VectorXd effect = model::effect_without_size(rows, kind, kind.starts[start]);
        if (!effect.isZero(0)) at.without_size = effect.cast<float>();
      }
    }
    if (base && at.with_base.cols() == 0)
      at.with_base = transpose_product(base->white, at.columns.cast<double>());
  }
  return by_start[start];
}

void Session::keep_starts(std::size_t channel, bool same_rows, bool same_noise) {
  for (auto& by_start : at_starts_)
    for (auto& by_channel : by_start) {
      AtStart& at = by_channel[channel];
      // A little farther on columns change by less than a screen asks for.
      if (!same_rows || (white_base_[channel] && !same_noise)) at = {};
      at.with_base = {};
    }
}

Index Session::first_base(std::size_t channel) const {
  Index count = 0;
  for (std::size_t c = 0; c < channel; ++c)
    if (channels_[c]) count += channels_[c]->base().prior.mean.size();
  return count;
}

Nuisance Session::nuisance(const Hypothesis& h) const {
  Nuisance n(reduced_.bench);
  if (!channels_[mean_channel()]) return n;
  const Eigen::VectorXd stated = n.as_vector();
  n.set(stated + h.base.segment(first_base(mean_channel()), stated.size()));
  return n;
}

double Session::mean_range_mm() const {
  double sum = 0, count = 0;
  for (const Cell& cell : reduced_.cells) {
    if (!cell.usable) continue;
    sum += cell.at.range_mm;
    count += 1;
  }
  return count > 0 ? sum / count : 0;
}

void Session::keep_combs(Hypothesis& at, std::vector<Hypothesis>& following) {
  if (std::ranges::none_of(at.terms, [](const Term& term) { return term.kind->bins.has_value(); })) return;
  const double before_mm = mean_range_mm();
  predict(reduced_, nuisance(at), means_at_work(at), false);
  const double farther_mm = mean_range_mm() - before_mm;
  for (Term& term : at.terms) model::follow(term, farther_mm);
  for (Hypothesis& h : following)
    for (Term& term : h.terms) model::follow(term, farther_mm);
}

std::vector<Active> Session::means_at_work(const Hypothesis& h) const {
  std::vector<Active> at_work = known_terms(reduced_.bench);
  for (const Term& term : h.terms)
    if (term.kind->moves_means()) at_work.push_back(as_active(term));
  return at_work;
}

void Session::linearise(Hypothesis& at, std::vector<Hypothesis>& following) {
  keep_combs(at, following);
  const std::vector<Active> at_work = means_at_work(at);
  std::vector<Active> from_scan_to_scan;
  for (const Active& known : known_)
    if (known.mechanism->coordinate == Coordinate::scan_seq) from_scan_to_scan.push_back(known);
  for (const Term& term : at.terms)
    if (term.kind->mechanism->coordinate == Coordinate::scan_seq)
      from_scan_to_scan.push_back(as_active(term));
  const Nuisance there = nuisance(at);
  model::expect_from_scan_to_scan(reduced_, from_scan_to_scan);
  predict(reduced_, there, at_work, false);
  reduction::share_out_again(reduced_, there, at_work);
  MeanNoise noise = noise_by(reduced_, noise_, known_, at.terms);
  add_errors_of_stops(reduced_, noise);
  const auto row_counts = [&] {
    std::vector<Index> counts;
    for (const auto& rows : channels_) counts.push_back(rows ? rows->rows() : 0);
    return counts;
  };
  const std::vector<Index> before = row_counts();
  const bool is_as_noisy = noise == present_noise_;
  present_noise_ = std::move(noise);
  pool_variances(reduced_, present_noise_);
  reduction::state_u_of_wide_beams(reduced_, present_noise_.spread_rad);
  reduction::state_u_of_other_targets(reduced_, there, at_work);
  for (const Active& active : at_work)
    if (const auto bin = active.mechanism->parameter_of(Parameter::Scale::bin))
      reduction::state_u_of_bin_edges(
          reduced_, active.values[*bin], active.values[*bin + 1],
          present_noise_.stop_rad2 + std::pow(reduced_.bench.stage_resolution_rad, 2) / 12);
  make_channels(present_noise_);
  const std::vector<Index> now = row_counts();
  for (std::size_t c = 0; c < channels_.size(); ++c) keep_starts(c, now[c] == before[c], is_as_noisy);
  // Coefficients count from the bench file, not from where the prediction is.
  const std::size_t mean = mean_channel();
  const Eigen::VectorXd moved = there.as_vector() - Nuisance(reduced_.bench).as_vector();
  if (channels_[mean]) offsets_[mean] -= channels_[mean]->base().columns.leftCols(moved.size()) * moved;
  for (std::size_t c = 0; c < channels_.size(); ++c)
    for (const Term& term : at.terms)
      if (model::channel_kinds()[c].of_predicted && channels_[c] && term.kind->moves_means() &&
          !term.kind->coefficients.empty() && (c == mean || term.kind->acts_in[c]))
        offsets_[c] -= model::columns_of(*channels_[c], *term.kind, term.values) * model::coefficients(term);
}

}  // namespace fit::explain::inference
