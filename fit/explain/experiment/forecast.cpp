// SPDX-License-Identifier: MIT
#include "fit/explain/experiment/forecast.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "fit/explain/experiment/planned.hpp"
#include "fit/explain/model/hypothesis.hpp"
#include "fit/explain/model/mean_model.hpp"
#include "fit/explain/reading.hpp"
#include "fit/explain/scene/stated_noise.hpp"

namespace fit::explain {
namespace {

constexpr int few_scans = 3;       // only where beams go is of interest
constexpr double k_95 = 1.959964;  // of a normal distribution

/// What the bench knows of mechanisms, ready to act, and which of them have values that count as uncertain:
/// where targets stand does so by itself. What happened once happens in no other recording.
struct Known {
  std::vector<Active> at_work, uncertain;

  explicit Known(const Bench& bench) : at_work(known_to_be_at_work(bench)) {
    std::erase_if(at_work, [](const Active& known) { return known.mechanism->happened_once(known.values); });
    uncertain = at_work;
    std::erase_if(uncertain, [](const Active& known) { return bool(known.mechanism->displaces); });
  }
};

/// Columns of all that is uncertain, for one standard uncertainty each.
Eigen::MatrixXd uncertainty_columns_of(const MeanModel& model, const Known& known, const Eigen::VectorXd& u) {
  const Eigen::MatrixXd places = model.nuisance_columns() * u.asDiagonal(),
                        values = uncertain_values(model, known.uncertain).columns;
  Eigen::MatrixXd all(model.rows(), places.cols() + values.cols());
  all << places, values;
  return all;
}

Reduced predicted(const Bench& twin, const Known& known, Reduced reduced) {
  predict(reduced, Nuisance(twin), known.at_work, false);
  reassign(reduced, Nuisance(twin), known.at_work, 0);  // angles may be off by degrees
  return reduced;
}

/// What the recordings leave open of `uncertainty_columns_of`'s coefficients.
Eigen::MatrixXd left_open(const Bench& twin, const Known& known, const Eigen::VectorXd& u,
                          const std::vector<const Recording*>& recordings) {
  const auto is_uncertain = [](double sigma) { return sigma > 0; };
  auto count = u.size();
  for (const Active& active : known.uncertain) count += std::ranges::count_if(active.sigma, is_uncertain);
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(count, count);
  for (Eigen::Index i = 0; i < u.size(); ++i) information(i, i) = 1;
  for (const Recording* recording : recordings) {
    Reduced reduced = predicted(twin, known, Reading({recording}, {}).take_reduced());
    if (reduced.usable_cells() == 0) continue;
    pool_variances(reduced);
    const MeanModel model(reduced, {});
    const Eigen::MatrixXd columns = model.whitened(uncertainty_columns_of(model, known, u));
    information += columns.transpose() * columns;
  }
  // A value on which no recording has any hold keeps the uncertainty that it is stated with.
  for (Eigen::Index i = 0; i < count; ++i) information(i, i) = std::max(information(i, i), 1.0);
  return information.ldlt().solve(Eigen::MatrixXd::Identity(count, count));
}

/// The twin with the recording's circumstances.
class SeenByTwin final : public Forwarded {
 public:
  SeenByTwin(const Bench& twin, const Recording& recording) : Forwarded(recording), twin_(twin) {}
  const Bench& bench() const override { return twin_; }

 private:
  const Bench& twin_;
};

long place_of(int capture, double beam_rad) {
  return 1000000L * capture + std::lround(beam_rad * deg_per_rad * 100);
}

}  // namespace

Forecast forecast(const Bench& twin, const std::vector<CaptureInfo>& planned,
                  const std::vector<const Recording*>& learnt_from) {
  const Known known(twin);
  const Eigen::VectorXd u = Nuisance::prior_sigma(twin);
  std::vector<SeenByTwin> seen;
  std::vector<const Recording*> list;
  seen.reserve(learnt_from.size());
  for (const Recording* recording : learnt_from) list.push_back(&seen.emplace_back(twin, *recording));
  const Eigen::MatrixXd covariance = left_open(twin, known, u, list);
  Reduced reduced =
      predicted(twin, known, reduce(Planned(twin, planned, law_of_bench(twin), few_scans, 0), {}));
  if (reduced.usable_cells() == 0)
    throw std::invalid_argument(
        "no beam of the planned captures meets a target squarely enough to predict it");
  const double unstated_mm = stated_noise(twin).value > 0 ? 0 : unstated_noise_mm;
  for (Cell& cell : reduced.cells)
    cell.pooled_mm2 = variance_of_sample(known.at_work, cell) + unstated_mm * unstated_mm + rounding_mm2;
  const MeanModel model(reduced, {});
  const Eigen::MatrixXd columns = uncertainty_columns_of(model, known, u);
  Forecast out;
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const Cell& cell = model.cell(i);
    const Eigen::VectorXd row = columns.row(i);
    out.beams.push_back({model.group(i).capture, cell.beam_rad, cell.at.incidence_rad, cell.nominal_mm,
                         std::sqrt(std::max(0.0, row.dot(covariance * row))), std::sqrt(cell.pooled_mm2)});
  }
  return out;
}

ForecastScore score(const Forecast& forecast, const Bench& twin, const Recording& recorded) {
  const Known known(twin);
  const SeenByTwin seen(twin, recorded);
  Reading reading({&seen}, {}, true);
  const Reduced reduced = predicted(twin, known, reading.take_reduced());
  std::map<std::int64_t, int> planned_as;  // by a capture's number; some may have been left out
  for (const CaptureInfo& capture : recorded.captures())
    planned_as.try_emplace(capture.id, static_cast<int>(planned_as.size()));
  std::map<long, const PredictedBeam*> predicted_at;
  for (const PredictedBeam& beam : forecast.beams)
    predicted_at[place_of(beam.capture, beam.beam_rad)] = &beam;
  ForecastScore out;
  double squares = 0, means = 0, expected = 0, within = 0, means_within = 0;
  for (const Cell& cell : reduced.cells) {
    const int capture = planned_as.at(reduced.capture_of(cell).id);
    const auto found = predicted_at.find(place_of(capture, cell.beam_rad));
    if (found == predicted_at.end() || cell.n < 1 || !cell.usable) continue;
    const PredictedBeam& beam = *found->second;
    const double u_sample = std::hypot(beam.u_mm, beam.sd_mm);
    const double u_mean = std::hypot(beam.u_mm, beam.sd_mm / std::sqrt(static_cast<double>(cell.n)));
    for (int k = 0; k < cell.n; ++k) {
      const double d =
          static_cast<double>(reduced.kept[cell.first_kept + static_cast<std::size_t>(k)]) - beam.range_mm;
      squares += d * d;
      within += std::abs(d) < k_95 * u_sample;
    }
    const double off = cell.mean_mm - beam.range_mm;
    means += off * off;
    expected += u_mean * u_mean;
    means_within += std::abs(off) < k_95 * u_mean;
    out.samples += cell.n;
    out.beams.push_back({beam.beam_rad * deg_per_rad, beam.range_mm, off, u_mean});
  }
  if (out.beams.empty()) throw std::invalid_argument("nothing of what was predicted was recorded");
  const auto n = static_cast<double>(out.samples), beams = static_cast<double>(out.beams.size());
  out.coverage_95 = within / n;
  out.coverage_95_of_means = means_within / beams;
  out.rms_mm = std::sqrt(squares / n);
  out.rms_of_means_mm = std::sqrt(means / beams);
  out.expected_rms_of_means_mm = std::sqrt(expected / beams);
  return out;
}

}  // namespace fit::explain
