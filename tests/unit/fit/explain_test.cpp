// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <span>

#include "../../support/imagined_room.hpp"
#include "fit/bench/empirical.hpp"
#include "fit/explain/experiment/next_experiment.hpp"
#include "fit/explain/explanation.hpp"
#include "fit/explain/reduction/reduce.hpp"
#include "fit/find_by_id.hpp"
#include "tests/support/rounds.hpp"

namespace explain_test {
namespace {

using fit::deg_per_rad;
using fit::rad_per_deg;
using fit::explain::explain;
using fit::explain::Explanation;

std::vector<std::string> names(const Explanation& e) {
  std::vector<std::string> list;
  for (const auto& found : e.mechanisms) list.push_back(found.mechanism->id);
  return list;
}

Explanation explanation_of(const ImaginedRoom& room) {
  const SyntheticRecording recording = room.record();
  return explain({&recording}, {});
}

/// A code disk off its axis, from its geometry rather than from the fitted sine.
double eccentric(double beam) {
  return std::atan2(0.002 * std::sin(beam + 1), 1 - 0.002 * std::cos(beam + 1));
}

/// A lidar put up by hand before a wall: 240 beams all round, every scan with its own first beam.
class WallByHand : public fit::Recording {
 public:
  using Ripple = std::function<double(double beam_rad)>;  ///< Added to the range, mm.

  WallByHand(
      double true_mm, double yaw_rad, double scatter_rad, unsigned seed,
      Ripple ripple = [](double) { return 0.0; })
      : true_mm_(true_mm),
        yaw_rad_(yaw_rad),
        scatter_rad_(scatter_rad),
        seed_(seed),
        ripple_(std::move(ripple)) {
    const std::string away = std::to_string(std::lround(true_mm / 100) * 100);
    bench_ = fit::parse_bench(
        R"({"schema": "bench/1", "lidar": {"steps": 240, "front_step": 0, "step_deg": 1.5,
      "scan_hz": 10, "mount": {"yaw_deg": {"value": 0, "u": 2}}}, "targets": [{"name": "wall", "from_mm": [)" +
        away + R"(, -600], "to_mm": [)" + away + R"(, 600], "u_mm": 5, "u_deg": 2, "placed_anew": true}]})");
    fit::CaptureInfo info;
    info.target = "wall";
    info.last_step = 239;
    captures_.push_back(info);
  }
  [[nodiscard]] const fit::Bench& bench() const override { return bench_; }
  [[nodiscard]] const std::vector<fit::CaptureInfo>& captures() const override { return captures_; }
  [[nodiscard]] const std::vector<fit::TrackPose>& track() const override { return track_; }
  void for_each_scan(std::size_t, const std::function<void(const fit::ScanView&)>& visit) const override {
    std::mt19937 random(seed_);
    std::normal_distribution<double> noise(0, 2), angle;
    std::uniform_real_distribution<double> first(0, 1.5 * rad_per_deg);
    for (int seq = 0; seq < 150; ++seq) {
      fit::ScanView scan;
      scan.seq = seq;
      scan.host_us = 100000LL * seq;
      scan.geometry = fit::ScanGeometry{first(random), 1.5 * rad_per_deg, 0.1};
      std::vector<std::uint16_t> range(240);
      for (std::size_t k = 0; k < range.size(); ++k) {
        const double beam = scan.geometry->first_rad + static_cast<double>(k) * scan.geometry->step_rad;
        const double slant = fit::wrap_angle(beam + yaw_rad_ + scatter_rad_ * angle(random));
        const double along = true_mm_ / std::max(0.1, std::cos(slant));
        range[k] =
            static_cast<std::uint16_t>(std::lround(along + ripple_(fit::wrap_angle(beam)) + noise(random)));
      }
      scan.range_mm = range;
      visit(scan);
    }
  }

 private:
  double true_mm_, yaw_rad_, scatter_rad_;
  unsigned seed_;
  Ripple ripple_;
  fit::Bench bench_;
  std::vector<fit::CaptureInfo> captures_;
  std::vector<fit::TrackPose> track_;
};

}  // namespace

TEST_CASE("walls put up by hand before a lidar with its own geometry are explained together") {
  const double scatter = GENERATE(0.0, 0.4);
  const WallByHand near(503, 0.01, scatter * rad_per_deg, 1), middle(996, -0.015, scatter * rad_per_deg, 2),
      far(1504, 0.02, scatter * rad_per_deg, 3), unseen(2003, 0.005, scatter * rad_per_deg, 4);
  const Explanation e = explain({&near, &middle, &far}, {});
  INFO(to_text(e));
  CHECK(e.several_places);
  const auto prediction = fit::explain::predict_recording(e.predictor, unseen);
  CHECK(prediction.samples > 2000);
  CHECK(prediction.after.coverage_95 == Approx(0.95).margin(0.02));
  if (scatter == 0) {
    CHECK(e.verdict == "nothing-missing");
    CHECK(prediction.after.log_likelihood == Approx(prediction.before.log_likelihood).margin(0.02));
    return;
  }
  // Where every beam draws its own angle and no edge is seen, stretched echoes look alike.
  CHECK(e.mechanisms.empty());
  REQUIRE(e.undecided_between.size() == 1);
  CHECK(e.undecided_between.front() == std::vector<std::string>{"angle-jitter", "incidence-noise"});
  CHECK(prediction.after.log_likelihood > prediction.before.log_likelihood + 0.05);
}

TEST_CASE("an unnamed function that all recordings show predicts another one") {
  const bool alike = GENERATE(true, false);
  std::vector<std::unique_ptr<WallByHand>> walls;
  for (const int number : {0, 1, 2, 3}) {
    const double phase = alike ? 0 : std::vector{0.3, 2.2, 5.1, 3.4}[static_cast<std::size_t>(number)];
    walls.push_back(std::make_unique<WallByHand>(
        std::vector{503, 996, 1504, 750}[static_cast<std::size_t>(number)], 0.005 * number, 0, 1 + number,
        [phase](double beam) {
          return 3 * std::sin(9 * beam + phase) + 2 * std::cos(23 * beam + 2 * phase);
        }));
  }
  const Explanation e = explain({walls[0].get(), walls[1].get(), walls[2].get()}, {});
  INFO((alike ? "alike: " : "each its own: ") << to_text(e));
  CHECK(e.verdict == "unknown-physics");
  const auto prediction = fit::explain::predict_recording(e.predictor, *walls[3]);
  INFO("means " << prediction.before.rms_of_means_mm << " mm before, " << prediction.after.rms_of_means_mm
                << " mm after");
  // Of three recordings that each have a function of their own, others may still be believed to share one:
  // intervals hold, but means may be farther off than without.
  CHECK(prediction.after.coverage_95 > 0.9);
  if (!alike) return;
  CHECK_FALSE(e.correction.empty());
  CHECK(prediction.after.rms_of_means_mm < 0.6 * prediction.before.rms_of_means_mm);
}

TEST_CASE("nothing is found where nothing is missing") {
  for (const unsigned seed : {1u, 2u, 3u, 4u}) {
    ImaginedRoom room;
    room.seed = seed;
    const Explanation e = explanation_of(room);
    INFO("seed " << seed << ": " << to_text(e));
    CHECK(e.verdict == "nothing-missing");
    CHECK(e.after.coverage == Approx(0.95).margin(0.015));
  }
}

TEST_CASE("nothing is found where the stage turned and nothing is missing", "[rounds]") {
  // Beams aslant are far from their first prediction there: what is sorted out must not depend on the noise.
  for (const unsigned seed : some_of<unsigned>({1, 2, 3})) {
    ImaginedRoom room;
    room.seed = seed;
    room.rate_deg_s = 25;
    room.every_beam = 2;
    const Explanation e = explanation_of(room);
    INFO("seed " << seed << ": " << to_text(e));
    CHECK(e.verdict == "nothing-missing");
    CHECK(e.after.coverage == Approx(0.95).margin(0.015));
    CHECK(e.after.rms_mm < 1.035 * e.noise_floor_mm);  // three standard errors of the rms of 4000 rows
  }
}

TEST_CASE("a code disk off its axis is named, measured and proven on captures not fitted to") {
  ImaginedRoom room;
  room.bend = eccentric;
  const Explanation e = explanation_of(room);
  INFO(to_text(e));
  REQUIRE(names(e) == std::vector<std::string>{"encoder-eccentricity"});
  const auto& found = e.mechanisms.front();
  CHECK(found.probability > 0.99);
  const auto& amplitude = found.parameters.at("amplitude_deg");
  CHECK(std::abs(amplitude.value - 0.002 * deg_per_rad) < 4 * amplitude.u + 0.002);
  CHECK(found.log_likelihood_gain > 100);
  CHECK(e.after.rms_mm < 1.03 * e.noise_floor_mm);
  CHECK(e.before.rms_mm > 1.2 * e.noise_floor_mm);
  CHECK(e.located.front().coordinate == fit::Coordinate::beam);
}

TEST_CASE("what was found, taken into the bench, leaves nothing to explain") {
  ImaginedRoom room;
  room.bend = eccentric;
  const SyntheticRecording recording = room.record();
  const Explanation first = explain({&recording}, {});
  REQUIRE(first.bench.knows("encoder-eccentricity"));
  class Again : public fit::Forwarded {
   public:
    Again(const fit::Recording& of, const fit::Bench& bench) : Forwarded(of), bench_(bench) {}
    const fit::Bench& bench() const override { return bench_; }

   private:
    const fit::Bench& bench_;
  } const again(recording, first.bench);
  const Explanation second = explain({&again}, {});
  INFO(to_text(second));
  CHECK(second.verdict == "nothing-missing");
  // The bench survives its file format.
  CHECK(fit::parse_bench(fit::to_json_text(first.bench)).knows("encoder-eccentricity"));
}

TEST_CASE("mirror faces are told whatever face a capture begins with") {
  ImaginedRoom room;
  room.scans = 9;
  room.pause_s = 20.025;  // an odd number of turns
  room.face = [](std::int64_t turn) { return turn % 2 == 0 ? 0.4 : -0.4; };
  const Explanation e = explanation_of(room);
  INFO(to_text(e));
  REQUIRE(names(e) == std::vector<std::string>{"facet-wobble"});
  const auto& found = e.mechanisms.front().parameters;
  CHECK(found.at("facets").value == 2);
  CHECK(std::abs(found.at("amplitude_mm").value - 0.4) < 4 * found.at("amplitude_mm").u);
}

TEST_CASE("a pattern of scans that grows is no mirror") {
  ImaginedRoom room;
  room.scans = 9;
  room.pause_s = 20.025;
  room.face = [](std::int64_t turn) { return (turn % 2 == 0 ? 1 : -1) * 3e-5 * static_cast<double>(turn); };
  const Explanation e = explanation_of(room);
  INFO(to_text(e));
  CHECK(names(e).empty());
  REQUIRE(e.unknown);
  CHECK(e.unknown->coordinate == fit::Coordinate::scan_seq);
  CHECK_THAT(e.unknown->describes, Catch::Contains("same every 2 scans, and more and more so"));
}

TEST_CASE("a step of the range along the beams is told as one, or nothing is told for certain", "[rounds]") {
  for (const double step_mm : some_of<double>({0.3, 0.5, 1, 2, 0.7})) {
    ImaginedRoom room;
    room.stretch = [step_mm](double beam, double, double) { return beam > 0.3 ? step_mm : 0; };
    const Explanation e = explanation_of(room);
    INFO(step_mm << " mm: " << to_text(e));
    for (const auto& found : e.mechanisms) CHECK(found.probability < 0.9);
    if (step_mm >= 1) {
      REQUIRE(e.unknown);
      CHECK_THAT(e.unknown->describes, Catch::Contains("range steps by"));
    }
  }
}

TEST_CASE("an experiment is planned between a mechanism and an unnamed step") {
  ImaginedRoom room;
  const SyntheticRecording recording = room.record();
  Explanation e;
  fit::explain::Shape step;
  step.form = fit::find_by_id(fit::explain::all_forms(), "step");
  step.at = 20;
  step.size = 0.2;
  step.values = {0.2};
  e.unnamed_suspects.push_back({step, {}, {}});
  CHECK_FALSE(fit::explain::best_experiment({&recording}, e, {}));
  e.suspects.push_back({fit::not_owned(*fit::find_mechanism("encoder-eccentricity")), {0.01, 60}});
  const auto next = fit::explain::best_experiment({&recording}, e, {});
  REQUIRE(next);
  CHECK(next->expected > 3);
  CHECK(next->groups.size() == 2);
  // What was done and decided nothing is not proposed again.
  SyntheticRecording done(recording.bench(), recording.maker());
  for (fit::CaptureInfo info : next->captures) {
    info.since_power_on_s.reset();
    done.add(info, 1);
  }
  const auto other = fit::explain::best_experiment({&recording, &done}, e, {});
  CHECK((!other || other->title != next->title));
  // What nobody could see, no experiment tells apart.
  e.unnamed_suspects.front().shape.values = {1e-5};
  e.suspects.front().values = {1e-6, 60};
  CHECK_FALSE(fit::explain::best_experiment({&recording}, e, {}));
}

TEST_CASE("an experiment is planned between what may be missing and nothing, in range and in noise") {
  ImaginedRoom room;
  const SyntheticRecording recording = room.record();
  const auto is_decided = [&](const Explanation& e, const std::string& id) {
    const auto next = fit::explain::best_experiment({&recording}, e, {});
    REQUIRE(next);
    CHECK(next->expected > 3);
    CHECK(next->groups == std::vector<std::vector<std::string>>{{id}, {"nothing-missing"}});
  };
  Explanation in_range;
  in_range.suspects.push_back({fit::not_owned(*fit::find_mechanism("encoder-eccentricity")), {0.01, 60}});
  CHECK_FALSE(fit::explain::best_experiment({&recording}, in_range, {}));
  in_range.may_be_nothing = true;
  is_decided(in_range, "encoder-eccentricity");

  Explanation in_noise;
  fit::explain::Suspect jitter;
  jitter.mechanism = fit::find_mechanism("angle-jitter");
  jitter.parameters = {{"sigma_deg", {0.1, 0.01}}};
  in_noise.noise_suspects.push_back(jitter);
  CHECK_FALSE(fit::explain::best_experiment({&recording}, in_noise, {}));
  in_noise.may_be_nothing = true;
  is_decided(in_noise, "angle-jitter");
}

TEST_CASE("a curve without a name says the same of another recording, and is told from a name") {
  ImaginedRoom room;
  room.thermometer = true;
  const SyntheticRecording recording = room.record();
  const auto model_of = [](fit::explain::Reduced& reduced) {
    pool_variances(reduced);
    return fit::explain::MeanModel(reduced, {});
  };
  fit::explain::Reduced first = fit::explain::reduce(recording, {});
  const fit::explain::MeanModel model = model_of(first);
  fit::explain::Shape curve;
  curve.form = fit::find_by_id(fit::explain::all_forms(), "smooth");
  curve.coordinate = fit::Coordinate::time;
  curve.length = 0.5;
  curve.values = {0.8, -0.3, 0.1};
  curve.values.resize(static_cast<std::size_t>(curve.form->terms(curve)));
  const fit::explain::SeenShape seen = fit::explain::seen(curve, model);
  CHECK((effect_of(model, seen) - effect_of(model, curve)).cwiseAbs().maxCoeff() < 1e-9);

  // The same captures and as many again, an hour later.
  SyntheticRecording longer(recording.bench(), recording.maker());
  for (const double later_s : {0.0, 3600.0})
    for (fit::CaptureInfo info : recording.captures()) {
      *info.since_power_on_s += later_s;
      info.started_us += static_cast<std::int64_t>(later_s * 1e6);
      longer.add(info, 2);
    }
  fit::explain::Reduced second = fit::explain::reduce(longer, {});
  const fit::explain::MeanModel of_longer = model_of(second);
  const Eigen::VectorXd effect = effect_of(of_longer, seen);
  for (Eigen::Index i = 0; i < of_longer.rows(); ++i) {
    const double at = coordinate_at(of_longer, fit::Coordinate::time, i);
    if (at > seen.at.back()) CHECK(effect[i] == seen.value.back());
    if (std::abs(at - seen.at.front()) < 1) CHECK(std::abs(effect[i] - seen.value.front()) < 0.01);
  }
  // Over five times the span it is as stiff as before: its form has five times the terms.
  CHECK(columns_of(of_longer, seen).columns.cols() > 3 * columns_of(model, curve).columns.cols());

  Explanation e;
  e.unnamed_suspects.push_back(seen);
  e.suspects.push_back({fit::not_owned(*fit::find_mechanism("temperature")), {0.2}});
  const auto next = fit::explain::best_experiment({&recording}, e, {});
  REQUIRE(next);
  CHECK(next->expected > 3);
  CHECK(next->groups.size() == 2);
}

TEST_CASE("a wall that stands turned is told as such, exactly, and nothing else is accused") {
  const double turned_deg = GENERATE(-0.7, 0.6, 1.5);
  ImaginedRoom room;
  room.every_beam = 2;
  room.sigma_mm = 2;
  room.third_wall_turned_deg = turned_deg;
  const Explanation e = explanation_of(room);
  INFO("turned by " << turned_deg << " deg: " << to_text(e));
  REQUIRE(names(e) == std::vector<std::string>{"target-tilt"});
  CHECK(e.mechanisms.front().target == "wall 3");
  const auto& tilt = e.mechanisms.front().parameters.at("tilt_deg");
  CHECK(std::abs(tilt.value - turned_deg) < 4 * tilt.u);
  CHECK(e.after.rms_mm < 1.02 * e.noise_floor_mm);
}

TEST_CASE("an offset and a scale together are no wave that a regular ladder aliases") {
  // Far more than the bench file's uncertainty lets the board take up: two sets hold the two, and no single
  // name is given to both.
  const fit::Bench bench = fit::parse_bench(R"({"schema": "bench/1", "lidar": {"steps": 1081,
    "front_step": 540, "step_deg": 0.25, "scan_hz": 40}, "targets": [{"name": "board", "from_mm": [300, -300],
    "to_mm": [300, 300], "u_mm": 3}]})");
  constexpr double offset_mm = 39, scale = 2.5e-4, sigma_mm = 5;
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, sigma_mm);
  SyntheticRecording ladder(bench, [&](const fit::CaptureInfo& capture, std::int64_t,
                                       std::vector<std::uint16_t>& range, std::vector<std::uint16_t>&) {
    for (std::size_t i = 0; i < range.size(); ++i) {
      const double slant = (static_cast<double>(i) - 8) * 0.25 * rad_per_deg,
                   far = (300 + capture.target_shift_mm) / std::cos(slant);
      range[i] = static_cast<std::uint16_t>(std::lround(far * (1 + scale) + offset_mm + noise(random)));
    }
  });
  for (int i = 0; i < 50; ++i) {
    fit::CaptureInfo capture;
    capture.target = "board";
    capture.target_shift_mm = 170.0 * i;
    capture.first_step = 532;
    capture.last_step = 548;
    capture.started_us = 30'000'000LL * i;
    ladder.add(capture, 60);
  }
  const Explanation e = explain({&ladder}, {});
  INFO(to_text(e));
  CHECK(names(e).empty());
  const auto some_set_holds = [&](const char* id) {
    return std::ranges::any_of(e.undecided_between,
                               [&](const auto& set) { return std::ranges::count(set, id) > 0; });
  };
  CHECK(some_set_holds("zero-offset"));
  CHECK(some_set_holds("range-scale"));
}

TEST_CASE("a bias that no mechanism makes is called unknown and described") {
  ImaginedRoom room;
  room.stretch = [](double beam, double, double) { return 4 * std::sin(7 * beam + 0.4); };
  const Explanation e = explanation_of(room);
  INFO(to_text(e));
  CHECK(e.verdict == "unknown-physics");
  REQUIRE(e.unknown);
  CHECK(e.unknown->coordinate == fit::Coordinate::beam);
  for (const auto& found : e.mechanisms) CHECK(found.probability <= 0.9);
}

TEST_CASE("a warm-up whose thermometer follows it is answered with both suspects and an experiment") {
  ImaginedRoom room;
  room.thermometer = true;
  room.stretch = [](double, double, double time) { return 4 * (1 - std::exp(-time / 400)); };
  const SyntheticRecording recording = room.record();
  const Explanation e = explain({&recording}, {});
  INFO(to_text(e));
  REQUIRE(e.verdict == "undecided");
  REQUIRE(e.undecided_between.size() == 1);
  const auto& set = e.undecided_between.front();
  CHECK(std::ranges::count(set, "warm-up") == 1);
  CHECK(std::ranges::count(set, "temperature") == 1);
  const auto next = fit::explain::best_experiment({&recording}, e, {});
  REQUIRE(next);
  CHECK(next->expected > 3);
  // At a temperature that is held, only the time since power-on is left.
  for (const fit::CaptureInfo& capture : next->captures)
    CHECK(capture.temperature_c == next->captures.front().temperature_c);
  CHECK(next->captures.back().started_us < 3600'000'000LL);
}

namespace {

/// The room at one temperature of the housing, read or not, where every range is longer by so much.
std::unique_ptr<SyntheticRecording> at_temperature(std::optional<double> celsius, double more_mm) {
  ImaginedRoom room;
  room.stretch = [=](double, double, double) { return more_mm; };
  const SyntheticRecording source = room.record();
  auto recording = std::make_unique<SyntheticRecording>(source.bench(), source.maker());
  for (fit::CaptureInfo info : source.captures()) {
    info.temperature_c = celsius;
    recording->add(info, room.scans);
  }
  return recording;
}

}  // namespace

TEST_CASE("temperatures of several sessions count from the first that was read", "[long]") {
  const auto cool = at_temperature(20, 0), warm = at_temperature(32, 6);
  auto all = fit::explain::reduce(*cool, {});
  reduce_into(all, *warm, {});
  CHECK(all.cells.front().at.temperature_k == 0);
  CHECK(all.cells.back().at.temperature_k == 12);
  const Explanation e = explain({cool.get(), warm.get()}, {});
  INFO(to_text(e));
  REQUIRE(names(e) == std::vector<std::string>{"temperature"});
  const auto& slope = e.mechanisms.front().parameters.at("slope_mm_per_k");
  CHECK(std::abs(slope.value - 0.5) < 4 * slope.u);
}

TEST_CASE("captures of which nobody read the temperature may have been as warm as rooms are") {
  constexpr double slope_mm_per_k = 0.4, unread_c = 33;
  ImaginedRoom room;
  const auto celsius_of = [](long capture) { return std::array{18.0, unread_c, 38.0}[capture % 3]; };
  room.stretch = [&](double, double, double time_s) {
    return slope_mm_per_k * (celsius_of(std::lround((time_s - 30) / room.pause_s)) - unread_c);
  };
  const SyntheticRecording source = room.record();
  SyntheticRecording recording(source.bench(), source.maker());
  for (long i = 0; i < std::ssize(source.captures()); ++i) {
    fit::CaptureInfo info = source.captures()[static_cast<std::size_t>(i)];
    if (i % 3 != 1) info.temperature_c = celsius_of(i);
    recording.add(info, room.scans);
  }
  CHECK(fit::explain::reduce(recording, {}).cells.front().at.temperature_k == 18 - fit::explain::steady_c);
  const Explanation e = explain({&recording}, {});
  INFO(to_text(e));
  CHECK_FALSE(e.unknown);
  REQUIRE(names(e) == std::vector<std::string>{"temperature"});
  const auto& slope = e.mechanisms.front().parameters.at("slope_mm_per_k");
  CHECK(std::abs(slope.value - slope_mm_per_k) < 4 * slope.u);
}

TEST_CASE("temperatures of sessions count from a housing that is not heated where one of them has none") {
  const auto cool = at_temperature(18, 0), unread = at_temperature({}, 0), hot = at_temperature(38, 0);
  auto all = fit::explain::reduce(*cool, {});
  CHECK(all.cells.front().at.temperature_k == 0);
  reduce_into(all, *unread, {});
  reduce_into(all, *hot, {});
  CHECK(all.cells.front().at.temperature_k == 18 - fit::explain::steady_c);
  CHECK(all.cells.back().at.temperature_k == 38 - fit::explain::steady_c);
}

/// What was recorded, with another bench file.
SyntheticRecording with_bench(const fit::Bench& bench, const SyntheticRecording& recorded, long scans) {
  SyntheticRecording recording(bench, recorded.maker());
  for (const fit::CaptureInfo& info : recorded.captures()) recording.add(info, scans);
  return recording;
}

bool has_note(const Explanation& e, const std::string& text) {
  return std::ranges::any_of(e.notes,
                             [&](const std::string& note) { return note.find(text) != std::string::npos; });
}

TEST_CASE("the bench file of another room is told as that, first of all") {
  ImaginedRoom room;
  room.captures = 4;
  const SyntheticRecording own = room.record();
  fit::Bench other = own.bench();
  for (fit::Target& wall : std::span(other.targets).subspan(1)) wall.from_mm *= 1.4, wall.to_mm *= 1.4;
  const SyntheticRecording recording = with_bench(other, own, room.scans);
  const Explanation wrong = explain({&recording}, {}), right = explain({&own}, {});
  REQUIRE_FALSE(wrong.notes.empty());
  CHECK_THAT(wrong.notes.front(), Catch::Contains("is it the bench file of this set-up?"));
  for (const std::string& note : right.notes) CHECK_THAT(note, !Catch::Contains("is it the bench file"));
}

TEST_CASE("sessions that do not say how long the lidar had been on are compared with a note") {
  ImaginedRoom room;
  room.captures = 4;
  const SyntheticRecording first = room.record();
  SyntheticRecording second(first.bench(), first.maker());
  for (fit::CaptureInfo info : first.captures()) {
    info.since_power_on_s.reset();
    second.add(info, room.scans);
  }
  const auto noted = [](const Explanation& e) { return has_note(e, "how long the lidar had been on"); };
  CHECK(noted(explain({&first, &second}, {})));
  CHECK_FALSE(noted(explain({&first, &first}, {})));
  CHECK_FALSE(noted(explain({&second}, {})));
}

TEST_CASE("a recording of which nothing can be compared with the bench has no answer") {
  ImaginedRoom room;
  room.captures = 4;
  const SyntheticRecording own = room.record();
  fit::Bench other = own.bench();
  for (fit::Target& wall : other.targets) wall.from_mm *= 3, wall.to_mm *= 3;
  const SyntheticRecording recording = with_bench(other, own, room.scans);
  CHECK_THROWS_WITH(explain({&recording}, {}), Catch::Contains("can be compared with the bench") &&
                                                   Catch::Contains("is the bench file of this set-up"));
}

TEST_CASE("sessions whose bench files say other things are explained with a note") {
  ImaginedRoom room;
  room.captures = 4;
  const SyntheticRecording first = room.record();
  fit::Bench other = first.bench();
  other.lidar.mount.x_mm.value += 20;
  const SyntheticRecording second = with_bench(other, first, room.scans);
  const auto noted = [](const Explanation& e) { return has_note(e, "do not say the same of: mount."); };
  CHECK(noted(explain({&first, &second}, {})));
  CHECK_FALSE(noted(explain({&first, &first}, {})));
}

TEST_CASE("the twin of several sessions knows nothing of targets that its own scene lacks") {
  ImaginedRoom room;
  room.captures = 4;
  const SyntheticRecording first = room.record();
  fit::Bench other = first.bench();
  fit::Target& moved = other.targets.back();
  const Eigen::Vector2d along = (moved.to_mm - moved.from_mm).normalized(),
                        aside(40 * along.y(), -40 * along.x());
  moved.name = "wall of the second";
  moved.from_mm += aside, moved.to_mm += aside;
  const SyntheticRecording second = with_bench(other, first, room.scans);
  const Explanation e = explain({&first, &second}, {});
  INFO(to_text(e));
  REQUIRE(names(e) == std::vector<std::string>{"target-offset"});
  std::set<std::string> scene;
  for (const fit::Target& target : e.bench.targets) scene.insert(target.name);
  CHECK_FALSE(scene.contains(moved.name));
  for (const fit::KnownMechanism& known : e.bench.known)
    if (const auto target = known.texts.find("target"); target != known.texts.end())
      CHECK(scene.contains(target->second));
  for (const fit::EmpiricalFunction& function : fit::empirical_functions(e.bench))
    CHECK((function.target.empty() || scene.contains(function.target)));
}

TEST_CASE("sessions of two lidars are not explained together") {
  ImaginedRoom room;
  const SyntheticRecording one = room.record();
  fit::Bench other = one.bench();
  other.lidar.front_step = 384;
  SyntheticRecording two(other, one.maker());
  two.add(one.captures().front(), 4);
  CHECK_THROWS_WITH(explain({&one, &two}, {}),
                    Catch::Contains("not of one lidar") && Catch::Contains("step 384"));
}

TEST_CASE("numbers in sentences have as many digits as said, and no powers of ten") {
  CHECK(fit::rounded(140.2, 2) == "140");
  CHECK(fit::rounded(-12345.6, 4) == "-12350");
  CHECK(fit::rounded(999.6, 3) == "1000");
  CHECK(fit::rounded(99.4, 2) == "99");
  CHECK(fit::rounded(0.012345, 3) == "0.0123");
  CHECK(fit::rounded(0, 3) == "0");
}

TEST_CASE("intensities that some scans of a capture lack are not read") {
  class Dim : public fit::Forwarded {
   public:
    using Forwarded::Forwarded;
    void for_each_scan(std::size_t i, const std::function<void(const fit::ScanView&)>& v) const override {
      Forwarded::for_each_scan(i, [&](fit::ScanView scan) {
        if (scan.seq % 2 == 1) scan.intensity = {};
        v(scan);
      });
    }
  };
  const SyntheticRecording whole = ImaginedRoom().record();
  const Dim dim(whole);
  const fit::explain::Reduced reduced = fit::explain::reduce(dim, {});
  CHECK(reduced.cells.size() == fit::explain::reduce(whole, {}).cells.size());
  CHECK_FALSE(reduced.has_intensity);
}

TEST_CASE("an explanation as JSON keeps the contract") {
  ImaginedRoom room;
  room.bend = eccentric;
  const auto json = to_json(explanation_of(room));
  CHECK(json.at("schema") == "explanation/1");
  for (const char* key :
       {"verdict", "located", "mechanisms", "undecided_between", "next_experiment", "fit", "bench"})
    CHECK(json.contains(key));
  const auto& m = json.at("mechanisms").at(0);
  CHECK(m.at("parameters").at("amplitude_deg").at("u").get<double>() > 0);
  CHECK(m.at("held_out").at("rms_after_mm").get<double>() <
        m.at("held_out").at("rms_before_mm").get<double>());
  CHECK(json.at("fit").at("noise_floor_mm").get<double>() > 0);
}

TEST_CASE("a recording without anything to compare is refused with a reason") {
  const fit::Bench bench;
  SyntheticRecording empty(bench, [](const auto&, auto, auto&, auto&) {});
  CHECK_THROWS_WITH(explain({&empty}, {}), Catch::Contains("no targets"));
}

}  // namespace explain_test
