// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "../../support/imagined_room.hpp"
#include "fit/explain/explanation.hpp"
#include "fit/explain/model/channel.hpp"
#include "fit/explain/model/combs.hpp"
#include "fit/explain/model/gaussian.hpp"
#include "fit/explain/model/widths.hpp"

namespace explain_one_model_test {
namespace {

using fit::explain::Explanation;
using namespace fit::explain::inference;

Explanation by_one_model(const ImaginedRoom& room) {
  const SyntheticRecording recording = room.record();
  return fit::explain::explain({&recording}, {});
}

std::vector<std::string> named(const Explanation& e) {
  std::vector<std::string> list;
  for (const auto& found : e.mechanisms) list.push_back(found.mechanism->id);
  return list;
}

fit::explain::model::Kind one_size(double typical, double expected, int sign) {
  fit::explain::model::Kind kind;
  kind.coefficients.push_back({.expected = expected, .typical = typical, .sign = sign});
  return kind;
}

}  // namespace

TEST_CASE("one model: the evidence of one size is the integral over its prior") {
  const Quadratic likelihood{Eigen::MatrixXd::Constant(1, 1, 4.0), Eigen::VectorXd::Constant(1, 6.0)};
  const fit::explain::Prior prior{Eigen::VectorXd::Constant(1, 0.5), Eigen::VectorXd::Constant(1, 2.0)};
  double sum = 0;
  for (double x = -20; x < 20; x += 1e-3) {
    const double z = (x - 0.5) / 2;
    sum += 1e-3 * std::exp(6 * x - 2 * x * x - z * z / 2) / (2 * std::sqrt(2 * fit::pi));
  }
  CHECK(integrate(likelihood, prior).log_evidence == Approx(std::log(sum)).epsilon(1e-6));
}

TEST_CASE("one model: a size of the wrong sign is no evidence, however far it is off") {
  const Quadratic away{Eigen::MatrixXd::Constant(1, 1, 100.0), Eigen::VectorXd::Constant(1, -100.0)};
  CHECK(integrate_over_factors(away, one_size(1, 0, 1)).log_evidence < 0.1);
  CHECK(integrate_over_factors(away, one_size(1, 0, 0)).log_evidence > 40);
}

TEST_CASE("one model: a size a hundred times the catalogue's costs more than a typical one, but not all") {
  // Both are seen as clearly, ten standard uncertainties from zero.
  const auto seen = [](double size) {
    return Quadratic{Eigen::MatrixXd::Constant(1, 1, 100 / (size * size)),
                     Eigen::VectorXd::Constant(1, 100 / size)};
  };
  const double typical = integrate_over_factors(seen(1), one_size(1, 0, 0)).log_evidence,
               huge = integrate_over_factors(seen(100), one_size(1, 0, 0)).log_evidence;
  CHECK(huge < typical - 3);
  CHECK(huge > 30);
}

TEST_CASE("one model: every channel's score and information are the slopes of its likelihood") {
  ImaginedRoom room;
  room.captures = 20;  // more cells than the channel of means has rows
  const SyntheticRecording recording = room.record();
  fit::explain::Reduced reduced = fit::explain::reduce(recording, {});
  reduced.bench.known.push_back({"radiometry", {{"counts_at_1m", 900}, {"range_power", 1}}, {}});
  for (std::size_t i = 0; i < reduced.cells.size(); i += 3) {
    reduced.cells[i].lost = 3;
    reduced.cells[i].far = reduced.cells[i].stray = 2;
  }
  fit::explain::pool_variances(reduced);
  for (const auto& kind : fit::explain::model::channel_kinds()) {
    // Of edges, which the room has not.
    if (std::ranges::count(std::array{"edge", "blend", "footprint"}, kind.id) > 0) continue;
    const auto rows = kind.rows(reduced, {});
    INFO(kind.id);
    REQUIRE(rows);
    const double at = kind.id == "variance" ? 30 : 0.3, step = 1e-4 * at;
    const Eigen::VectorXd eta = Eigen::VectorXd::Constant(rows->rows(), at);
    // No pattern that a channel takes off, as whole scans' does its mean.
    const Eigen::VectorXd one =
        Eigen::VectorXd::NullaryExpr(rows->rows(), [](Eigen::Index i) { return 1 + 0.1 * (i % 7); });
    const double slope =
        (rows->log_likelihood(eta + step * one) - rows->log_likelihood(eta - step * one)) / (2 * step);
    const Eigen::MatrixXd white = rows->whitened(one, eta);
    CHECK((white.transpose() * rows->white_residual(eta))(0, 0) == Approx(slope).epsilon(1e-4));
    CHECK(white.squaredNorm() > 0);
  }
}

TEST_CASE("one model: the score of a width is the slope of its likelihood, which is the one that was given") {
  const auto given = [](double width_deg) { return -50 * std::pow(std::log(width_deg / 0.2), 2); };
  const fit::explain::model::WidthLikelihood width(given);
  for (const double deg : {0.01, 0.05, 0.13, 0.2, 0.31, 0.8}) {
    const double at = deg * deg, step = 1e-5 * at;
    INFO(deg);
    CHECK(width.log_likelihood(at) == Approx(given(deg)).margin(0.1));
    const double slope = (width.log_likelihood(at + step) - width.log_likelihood(at - step)) / (2 * step);
    CHECK(width.score(at) == Approx(slope).epsilon(1e-3).margin(1e-3));
    CHECK(width.information(at) > 0);
  }
  CHECK(std::sqrt(width.best_deg2()) == Approx(0.2).epsilon(0.1));
  // Less than no width is none, whatever a sum of terms comes to: flat, and no bend.
  constexpr double hard = fit::explain::model::WidthLikelihood::hard_deg2;
  CHECK(width.log_likelihood(hard / 2) == width.log_likelihood(hard));
  CHECK(width.score(hard / 2) == 0);
  CHECK(width.information(hard / 2) < 1e-3 * width.information(hard));
}

TEST_CASE("one model: nothing is missing where nothing is") {
  ImaginedRoom room;
  for (room.seed = 1; room.seed <= 2; ++room.seed) {
    const Explanation e = by_one_model(room);
    INFO(to_text(e));
    CHECK(e.verdict == "nothing-missing");
    CHECK(e.after.coverage == Approx(0.95).margin(0.02));
  }
}

TEST_CASE("one model: a wrong scale of the range is named, and the bench's priors are not bent for it") {
  ImaginedRoom room;
  room.stretch = [](double, double range_mm, double) { return 0.003 * range_mm; };
  const Explanation e = by_one_model(room);
  INFO(to_text(e));
  REQUIRE(named(e) == std::vector<std::string>{"range-scale"});
  const auto& scale = e.mechanisms.front().parameters.at("scale");
  CHECK(std::abs(scale.value - 0.003) < 4 * scale.u);
  // Every capture sees the same walls: only what the bench file states of these tells, so that no capture
  // gains what the others do not know as well. Walls that took it up would stand 7 mm and more aside.
  const fit::Bench stated = ImaginedRoom::bench();
  for (std::size_t i = 0; i < stated.targets.size(); ++i) {
    const Eigen::Vector2d moved = (e.bench.targets[i].from_mm + e.bench.targets[i].to_mm -
                                   stated.targets[i].from_mm - stated.targets[i].to_mm) /
                                  2;
    CHECK(std::abs(moved.dot(stated.targets[i].outward_normal())) < 5);
  }
}

TEST_CASE(
    "one model: means, variances and strays are one fit: what acts in two channels is found beside the "
    "other") {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> share;
  ImaginedRoom room;
  room.scans = 30;
  room.stretch = [&](double, double range_mm, double) {
    const double anywhere = share(random);
    return anywhere < 0.01 ? 300 + 50000 * anywhere - range_mm / 3 : 0.003 * range_mm;
  };
  const Explanation e = by_one_model(room);
  INFO(to_text(e));
  auto list = named(e);
  std::ranges::sort(list);
  CHECK(list == std::vector<std::string>{"outliers", "range-scale"});
}

TEST_CASE("one model: of tens of thousands of combs the one in the recording is proposed") {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> place(800, 5000);
  std::normal_distribution<double> noise(0, 3);
  std::vector<fit::explain::model::RowScore> rows;
  const double zero = GENERATE(0, 0.4);
  for (int i = 0; i < 3000; ++i) {
    const double at = place(random), counted = at / 7.3 + zero;
    rows.push_back({at, 7.3 * (std::round(counted) - counted) + noise(random), 0});
  }
  fit::Parameter bins;
  bins.lower = 0.25;
  bins.upper = 40;
  const auto proposed = fit::explain::model::combs_in(rows, bins, zero > 0);
  REQUIRE_FALSE(proposed.empty());
  CHECK(proposed.front().bin == Approx(7.3).epsilon(2e-4));
  const double middle = 2900, teeth = middle / proposed.front().bin + proposed.front().zero,
               truth = middle / 7.3 + zero;
  CHECK(std::abs(teeth - truth - std::round(teeth - truth)) < 0.1);
}

TEST_CASE("beams of a turning stage taken together do not scatter by what the mount is off") {
  const fit::Bench bench = fit::parse_bench(R"({"schema": "bench/1", "lidar": {"steps": 241,
    "front_step": 120, "step_deg": 0.25, "scan_hz": 40, "mount": {"yaw_deg": {"value": 0, "u": 1}}},
    "targets": [{"name": "wall", "from_mm": [1500, 6000], "to_mm": [1500, -6000], "u_mm": 3}]})");
  const double yaw = 1.5 * fit::rad_per_deg;
  SyntheticRecording turning(bench, [yaw](const fit::CaptureInfo& info, std::int64_t seq,
                                          std::vector<std::uint16_t>& range, std::vector<std::uint16_t>&) {
    const double stage = info.stage_rad + info.stage_rate_rad_s * 0.025 * static_cast<double>(seq);
    for (std::size_t i = 0; i < range.size(); ++i) {
      const double bearing = stage + yaw + (static_cast<double>(i) - 120) * 0.25 * fit::rad_per_deg;
      range[i] = static_cast<std::uint16_t>(std::lround(1500 / std::cos(bearing)));
    }
  });
  fit::CaptureInfo capture;
  capture.last_step = 240;
  capture.stage_rad = 30 * fit::rad_per_deg;
  capture.stage_rate_rad_s = 1e-6;
  turning.add(capture, 40);
  fit::explain::Reduced reduced = fit::explain::reduce(turning, {});
  fit::explain::Nuisance there(bench);
  there.yaw_rad = yaw;
  predict(reduced, there, {}, false);
  double seen = 0, of_joining = 0, cells = 0;
  for (const fit::explain::Cell& cell : reduced.cells) {
    if (!cell.usable) continue;
    seen += cell.variance_mm2;
    of_joining += cell.of_joining_mm2();
    cells += 1;
  }
  REQUIRE(cells > 500);
  CHECK(of_joining / cells > 0.3);  // as much as a beam angle that scatters
  CHECK(seen / cells - of_joining / cells == Approx(fit::explain::rounding_mm2).margin(0.02));
}

}  // namespace explain_one_model_test
