// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "fit/explain/model/channel.hpp"
#include "fit/explain/model/gaussian.hpp"
#include "fit/explain/model/readings.hpp"
#include "fit/explain/model/shared_errors.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain::channels {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using L = IntensityLaw;
using model::Reading;

/// Nominal reflectances, and surfaces that are of one grey, are so good.
constexpr double u_reflectance_relative = 0.08;
/// By how much a surface's echo differs from one capture to the next, whatever its law: speckle, and where
/// the beams meet it.
constexpr double u_capture = 0.002;
/// Whole counts are rounded by some lidars and cut off by others: up to half a count, all alike.
constexpr double cut_off_counts = 0.29;
/// What no law of intensity gets right to better: receivers bend, surfaces are not quite Lambertian.
constexpr double u_response = 0.02, u_incidence = 0.03;
/// Where the bench file leaves parts of the law open, its form is open as well.
constexpr double open_response = 0.3;
constexpr std::array<double, L::size> open{3, 1, 1, 1, 0, 0};  ///< Coefficients that are not stated.

/// Bells along x, `length` apart: together a smooth function of standard size one and that correlation
/// length.
MatrixXd bells(const VectorXd& x, double length) {
  constexpr double height = 0.75;  // of so many overlapping bells
  const double low = x.minCoeff(), high = x.maxCoeff();
  const Index count = static_cast<Index>(std::ceil((high - low) / length)) + 3;
  MatrixXd columns(x.size(), count);
  for (Index k = 0; k < count; ++k)
    columns.col(k) =
        height * (-0.5 * ((x.array() - low) / length - static_cast<double>(k - 1)).square()).exp();
  return columns;
}

std::pair<int, int> by_capture_and_surface(const Reading& r) { return {r.capture, r.surface}; }

/// Logarithms of mean counts against the law that the bench file states: normal around what effects add. A
/// surface's readings in one capture share an error.
class Echoes final : public model::NormalRows {
 public:
  Echoes(std::vector<Reading> readings, const IntensityClaim& claim, const Bench& bench)
      : readings_(std::move(readings)) {
    std::ranges::stable_sort(readings_, {}, by_capture_and_surface);
    std::vector<Row> rows_of_readings;
    for (const Reading& r : readings_) rows_of_readings.push_back({r.at, r.capture, r.off});
    set_rows(std::move(rows_of_readings));
    weight_ = column([](const Reading& r) { return 1 / r.sigma; });
    double log_scale = (weight_.array() / std::sqrt(2 * pi)).log().sum();
    for (Index first = 0, last = 0; first < rows(); first = last) {
      while (last < rows() && by_capture_and_surface(reading(last)) == by_capture_and_surface(reading(first)))
        ++last;
      VectorXd z = u_capture * weight_.segment(first, last - first);
      log_scale -= 0.5 * std::log1p(z.squaredNorm());
      shared_.emplace_back(first, std::move(z));
    }
    set_log_scale(log_scale);
    for (int k = 0; k < L::size; ++k) {
      const auto c = static_cast<std::size_t>(k);
      const double u = claim.stated[c] ? claim.u[c] : open[c];
      add([&](const Reading& r) { return slope(claim.law, k, r.at); }, u);
    }
    add_surfaces();
    add([](const Reading& r) { return 1 / r.at.intensity; }, cut_off_counts);
    add_open_forms(claim);
    open_wrong_greys(bench);
  }

  [[nodiscard]] double response(Index row, const Effect& effect) const override {
    return reading(row).per_echo * effect.log_echo + effect.log_intensity;
  }
  [[nodiscard]] VectorXd log_likelihoods(const VectorXd& eta) const override {
    return VectorXd::NullaryExpr(rows(), [&](Index i) {
      const double u = std::hypot(reading(i).sigma, u_capture);
      return -std::log(std::sqrt(2 * pi) * u) - 0.5 * std::pow((statistic(i) - eta[i]) / u, 2);
    });
  }
  /// A root of the inverse of diag(sigma^2) + u_capture^2 within every block.
  [[nodiscard]] MatrixXd whitened(MatrixXd columns, const VectorXd&) const override {
    columns.array().colwise() *= weight_.array();
    for (const model::SharedErrors& errors : shared_) errors.whiten(columns);
    return columns;
  }
  [[nodiscard]] VectorXd information(const VectorXd&) const override { return weight_.cwiseAbs2(); }
  [[nodiscard]] std::string note(const VectorXd& before, const VectorXd& after) const override {
    const auto rms = [&](const VectorXd& eta) {
      double sum = 0;
      for (Index i = 0; i < rows(); ++i) sum += std::pow(statistic(i) - eta[i], 2);
      return rounded(100 * std::sqrt(sum / static_cast<double>(rows())), 2) + " %";
    };
    return "Intensities are compared with the bench's radiometry, which they leave by " + rms(before) +
           " where nothing is missing, and by " + rms(after) + " with what was found." + wrong_greys_;
  }

 private:
  [[nodiscard]] const Reading& reading(Index row) const { return readings_[static_cast<std::size_t>(row)]; }

  static double slope(const L& law, int k, const Circumstances& at) {
    constexpr double h = 0.01;
    L up = law, down = law;
    up.value[static_cast<std::size_t>(k)] += h;
    down.value[static_cast<std::size_t>(k)] -= h;
    return (up.log_counts(at.reflectance, at.cos_incidence, at.range_mm) -
            down.log_counts(at.reflectance, at.cos_incidence, at.range_mm)) /
           (2 * h);
  }

  [[nodiscard]] VectorXd column(const std::function<double(const Reading&)>& of_reading) const {
    return VectorXd::NullaryExpr(rows(), [&](Index i) { return of_reading(reading(i)); });
  }
  void add(const MatrixXd& columns, double sigma) {
    append_to_base({columns, Prior::around_zero(columns.cols(), std::max(1e-9, sigma))});
  }
  void add(const std::function<double(const Reading&)>& of_reading, double sigma) {
    add(MatrixXd(column(of_reading)), sigma);
  }

  [[nodiscard]] int surfaces() const {
    return 1 + std::ranges::max_element(readings_, {}, &Reading::surface)->surface;
  }
  /// Every surface its own grey.
  void add_surfaces() {
    for (int s = 0; s < surfaces(); ++s)
      add([&](const Reading& r) { return r.surface == s ? 1.0 : 0.0; }, u_reflectance_relative);
  }
  /// A grey that alone strains its prior by more than a form costs is stated wrong: it says nothing then. But
  /// not where a law that is stated wrong explains all greys as well.
  void open_wrong_greys(const Bench& bench) {
    constexpr double any_grey = 1, any_law = 0.5;  // of logarithms, and of the law's coefficients
    const MatrixXd white = whitened(base().columns, {});
    const inference::Quadratic all{white.transpose() * white,
                                   white.transpose() * white_residual(VectorXd::Zero(rows()))};
    Prior prior = base().prior;
    const Index count = surfaces();
    const double penalty = -std::log(numbers::forms_expected / static_cast<double>(count));
    const auto with = [](Prior wider, Index first, Index many, double sigma) {
      wider.sigma.segment(first, many) = wider.sigma.segment(first, many).cwiseMax(sigma);
      return wider;
    };
    double most = std::max(integrate(all, prior).log_evidence,
                           integrate(all, with(prior, 0, L::size, any_law)).log_evidence);
    std::vector<Index> wrong;
    for (;;) {
      Index next = -1;
      for (Index s = 0; s < count; ++s) {
        if (std::ranges::count(wrong, s)) continue;
        const double evidence = integrate(all, with(prior, L::size + s, 1, any_grey)).log_evidence - penalty;
        if (evidence <= most) continue;
        most = evidence;
        next = s;
      }
      if (next < 0) break;
      wrong.push_back(next);
      prior = with(prior, L::size + next, 1, any_grey);
    }
    if (wrong.empty()) return;
    const inference::Integral found = integrate(all, prior);
    for (const Index s : wrong) {
      const auto one = std::ranges::find(readings_, s, &Reading::surface);
      wrong_greys_ += " Target '" + bench.target_at(one->at.target).name + "' returns " +
                      rounded(std::exp(found.value[L::size + s]), 2) +
                      " times the counts that its reflectance (" + rounded(one->at.reflectance, 2) +
                      ") stands for: correct that.";
    }
    set_base({base().columns, prior});
  }
  void add_open_forms(const IntensityClaim& claim) {
    const auto smooth = [&](const VectorXd& x, double least, double length, double sigma) {
      if (x.maxCoeff() - x.minCoeff() > least) add(bells(x, length), sigma);
    };
    const bool whole =
        claim.stated[L::gain] && claim.stated[L::range_power] && claim.stated[L::reflectance_power];
    const VectorXd brightness = column([](const Reading& r) { return std::log(r.at.intensity); });
    smooth(brightness, 0.05, 0.7 * std::max(0.1, brightness.maxCoeff() - brightness.minCoeff()),
           whole ? u_response : open_response);
    // Nothing is claimed of the way in which echoes fall with range either.
    const VectorXd distance = column([](const Reading& r) { return std::log(r.at.range_mm); });
    if (!whole)
      smooth(distance, 0.05, 0.5 * std::max(0.1, distance.maxCoeff() - distance.minCoeff()), open_response);
    smooth(column([](const Reading& r) { return std::abs(r.at.incidence_rad) * deg_per_rad; }), 5, 20,
           u_incidence);
  }

  std::vector<Reading> readings_;
  VectorXd weight_;
  std::vector<model::SharedErrors> shared_;  ///< Of a surface in a capture.
  std::string wrong_greys_;                  ///< Sentences.
};

/// A gain that is not stated is the recording's.
void take_gain(const Reduced& reduced, IntensityClaim& claim) {
  if (claim.stated[L::gain]) return;
  double sum = 0;
  const std::vector<Reading> readings = model::readings_of(reduced, claim.law, numbers::search_rows);
  for (const Reading& r : readings) sum += r.off;
  if (!readings.empty()) claim.law.value[L::gain] += sum / static_cast<double>(readings.size());
}

}  // namespace

model::ChannelKind make_intensity() {
  model::ChannelKind kind;
  kind.id = "intensity";
  kind.observable = Observable::intensity;
  kind.shows = "logarithm of intensity over the bench file's law";
  kind.table = "log_intensity";
  kind.always_drawn = {Coordinate::beam, Coordinate::range, Coordinate::incidence};
  kind.rows = [](const Reduced& reduced, const MeanNoise&) -> std::unique_ptr<model::ChannelRows> {
    std::optional<IntensityClaim> claim = claimed_intensity(reduced.bench);
    if (!claim || !reduced.has_intensity) return nullptr;
    take_gain(reduced, *claim);
    std::vector<Reading> readings = model::readings_of(reduced, claim->law, numbers::search_rows);
    if (readings.empty()) return nullptr;
    return std::make_unique<Echoes>(std::move(readings), *claim, reduced.bench);
  };
  kind.restate = [](const Reduced& reduced, const std::vector<Estimate>& nuisances, Bench& bench) {
    IntensityClaim claim = *claimed_intensity(bench);
    take_gain(reduced, claim);
    claim.law = fold_corrections(bench, claim.law);
    std::array<double, L::size> u{};
    for (std::size_t k = 0; k < L::size; ++k) {
      constexpr double hardly_known = 1e-5;
      claim.law.value[k] += nuisances[k].value;
      u[k] = nuisances[k].u > hardly_known ? nuisances[k].u : 0;
    }
    const double noise = model::sample_noise(reduced);
    state_intensity(bench, claim.law, u, noise > 0 ? std::optional(noise) : claim.relative_noise);
  };
  return kind;
}

}  // namespace fit::explain::channels
