// SPDX-License-Identifier: MIT
// Edges before a surface farther off: a wide beam and angles that scatter look alike there, and nowhere else.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <random>
#include <string>

#include "fit/explain/explanation.hpp"
#include "fit/explain/inference/fit.hpp"
#include "fit/explain/inference/screen.hpp"
#include "fit/explain/inference/steps.hpp"
#include "fit/explain/model/channel.hpp"
#include "fit/explain/reduction/edge_shares.hpp"
#include "fit/explain/reduction/margins.hpp"
#include "fit/explain/reduction/seen_edges.hpp"
#include "plain_scenes.hpp"
#include "tests/support/rounds.hpp"

namespace explain_edges_test {
namespace {

using fit::explain::Explanation;
using plain_bench::degree;
using plain_bench::Deviation;
using plain_bench::PlainScene;

const fit::explain::Found* found(const Explanation& e, const std::string& id) {
  const auto is_it = [&](const fit::explain::Found& f) { return f.mechanism->id == id; };
  const auto at = std::ranges::find_if(e.mechanisms, is_it);
  return at == e.mechanisms.end() ? nullptr : &*at;
}

PlainScene boards() {
  return {.walls = plain_bench::furnished, .steps = 1081, .front_step = 540, .step_deg = 0.25};
}

/// Where the bench file says, so that edges can be found there by what conceals something at them.
PlainScene boards_in_place() {
  PlainScene scene = boards();
  scene.u_mm = scene.u_mount_mm = 0.1;
  scene.u_deg = scene.u_yaw_deg = 0.01;
  return scene;
}

Explanation explained(const PlainScene& scene, unsigned seed, const plain_bench::Conceal& conceal) {
  SyntheticRecording recording = plain_bench::recorded(scene, seed, conceal);
  plain_bench::turn_round(recording, scene, 8, 30);
  return fit::explain::explain({&recording}, {});
}

/// All angles of a scan are off by the same, drawn anew for every scan.
plain_bench::Conceal jitter(double sigma_deg) {
  return [sigma_deg](double, double, double time_s) {
    std::mt19937 of_scan(static_cast<unsigned>(std::lround(time_s * 40)));
    return Deviation{.beam_rad = sigma_deg * degree * std::normal_distribution<double>()(of_scan)};
  };
}

/// Every sample beside an edge is met at an angle of its own, as by a wide beam; elsewhere none is.
plain_bench::Conceal loose_at_edges(const PlainScene& scene, double sigma_deg, unsigned seed) {
  return [scene, sigma_deg, random = std::mt19937(seed)](double beam_rad, double stage_rad, double) mutable {
    const Deviation aside{.beam_rad = sigma_deg * degree * std::normal_distribution<double>()(random)};
    const auto middle = look(scene, {}, stage_rad, beam_rad),
               there = look(scene, {}, stage_rad, beam_rad, aside);
    const bool at_edge = middle && there && std::abs(middle->range_mm - there->range_mm) > 200;
    return at_edge ? aside : Deviation{};
  };
}

TEST_CASE("angles drawn anew for every scan widen edges, and are no wide beam", "[long]") {
  const Explanation e = explained(boards(), 5, jitter(0.15));
  INFO(to_text(e));
  const auto* angles = found(e, "angle-jitter");
  REQUIRE(angles);
  CHECK(angles->parameters.at("sigma_deg").value == Approx(0.15).epsilon(0.15));
  CHECK_FALSE(found(e, "mixed-pixel"));
}

/// Every scan states where its own beams begin, exactly.
class OwnBeginnings final : public fit::Forwarded {
 public:
  OwnBeginnings(const fit::Recording& of, const PlainScene& scene, const plain_bench::Conceal& off)
      : Forwarded(of), scene_(scene), off_(off) {}
  void for_each_scan(std::size_t index,
                     const std::function<void(const fit::ScanView&)>& visit) const override {
    const double start_s = captures()[index].since_power_on_s.value_or(0);
    Forwarded::for_each_scan(index, [&](fit::ScanView scan) {
      const double off_rad = off_(0, 0, start_s + 0.025 * static_cast<double>(scan.seq)).beam_rad;
      scan.geometry = fit::ScanGeometry{
          off_rad - scene_.front_step * scene_.step_deg * degree, scene_.step_deg * degree, {}};
      visit(scan);
    });
  }

 private:
  PlainScene scene_;
  plain_bench::Conceal off_;
};

TEST_CASE("scans that begin each at an angle of its own, and say so, are no wide beam", "[long]") {
  const double reach_deg = GENERATE(0.002, 0.2);
  const PlainScene scene{plain_bench::furnished};
  const plain_bench::Conceal begins = [reach_deg](double, double, double time_s) {
    std::mt19937 of_scan(static_cast<unsigned>(std::lround(time_s * 40)));
    return Deviation{.beam_rad =
                         std::uniform_real_distribution<double>(-reach_deg, reach_deg)(of_scan) * degree};
  };
  SyntheticRecording recording = plain_bench::recorded(scene, 11, begins);
  plain_bench::turn_round(recording, scene, 8, 30);
  const OwnBeginnings stated(recording, scene, begins);
  const Explanation e = fit::explain::explain({&stated}, {});
  INFO(reach_deg << " deg: " << to_text(e));
  CHECK(e.verdict == "nothing-missing");
}

TEST_CASE("edges are where a lidar far off the stage's axis sees them") {
  SyntheticRecording recording =
      plain_bench::recorded(boards_in_place(), 6, [](double, double stage_rad, double) {
        return Deviation{.origin_mm = std::polar(1.0, stage_rad) * plain_bench::Point(0, 36)};
      });
  plain_bench::turn_round(recording, boards_in_place(), 8, 4);
  fit::explain::Reduced reduced = fit::explain::reduce(recording, {});
  const auto on_the_wrong_side = [&] {
    int wrong = 0, all = 0;
    for (const fit::explain::Cell& cell : reduced.cells) {
      if (cell.far_share < 0 || std::abs(cell.at.edge_rad) > 3 * degree) continue;
      wrong += (cell.far_share > 0.5) != (cell.at.edge_rad < 0);
      ++all;
    }
    REQUIRE(all > 500);
    return wrong / static_cast<double>(all);
  };
  const std::vector<fit::Active> arm{{fit::not_owned(*fit::find_mechanism("lidar-arm")), {0, 36}}};
  fit::explain::reduction::share_out_again(reduced, fit::explain::Nuisance(reduced.bench), {});
  CHECK(on_the_wrong_side() > 0.1);
  fit::explain::reduction::share_out_again(reduced, fit::explain::Nuisance(reduced.bench), arm);
  CHECK(on_the_wrong_side() < 0.01);
}

TEST_CASE("how much angles happen to scatter in a few scans is no course of the noise", "[long]") {
  const PlainScene scene{.walls = plain_bench::furnished, .steps = 271, .front_step = 135, .step_deg = 1};
  SyntheticRecording recording = plain_bench::recorded(scene, 8, jitter(0.4));
  plain_bench::turn_round(recording, scene, 24, 8);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  const auto* angles = found(e, "angle-jitter");
  REQUIRE(angles);
  CHECK(e.mechanisms.size() == 1);
  CHECK_FALSE(e.unknown);
  const auto& sigma = angles->parameters.at("sigma_deg");
  CHECK(std::abs(sigma.value - 0.4) < 3 * sigma.u);
  CHECK(sigma.u > 0.4 / std::sqrt(2.0 * 24 * 7) / 2);  // of so many scans, however many beams
}

TEST_CASE("angles drawn anew for every scan shift a corridor's walls to and fro, and are no lamp",
          "[rounds]") {
  for (const unsigned seed : some_of<unsigned>({21, 22})) {
    const PlainScene scene{.walls = plain_bench::corridor, .steps = 271, .front_step = 135, .step_deg = 1};
    SyntheticRecording recording = plain_bench::recorded(scene, seed, jitter(0.03));
    plain_bench::turn_round(recording, scene, 16, 150);
    const Explanation e = fit::explain::explain({&recording}, {});
    INFO(to_text(e));
    CHECK(found(e, "angle-jitter"));
    CHECK_FALSE(e.unknown);
  }
}

TEST_CASE("a stage that swings after its moves sweeps edges to and fro, and is no wide beam", "[long]") {
  constexpr double first_s = 1800, each_s = 20;
  const PlainScene scene{.walls = plain_bench::furnished};
  const auto swinging = [](double, double, double time_s) {
    const double since_s = std::fmod(time_s - first_s, each_s);
    return Deviation{.stage_rad = 0.1 * degree * std::exp(-since_s / 0.45) * std::cos(12.6 * since_s)};
  };
  SyntheticRecording recording = plain_bench::recorded(scene, 12, swinging);
  for (int i = 0; i < 8; ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = (i * 41.3 - 140) * degree;
    capture.approach = 1;
    capture.last_step = scene.steps - 1;
    capture.since_power_on_s = first_s + each_s * i;
    recording.add(capture, 40);
  }
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(found(e, "settling"));
  CHECK(e.mechanisms.size() == 1);
  CHECK_FALSE(e.unknown);
}

TEST_CASE("a beam that times all that it meets is no stray light and no light over corners", "[long]") {
  const PlainScene scene{.walls = {{{3200, -2100}, {3200, 1400}},
                                   {{3200, 1400}, {-2300, 1800}},
                                   {{-2300, 1800}, {-2300, -2100}},
                                   {{-2300, -2100}, {3200, -2100}}},
                         .u_yaw_deg = 0.1};
  SyntheticRecording recording = plain_bench::recorded(scene, 9, plain_bench::mean_over_beam(scene, 0.4));
  plain_bench::turn_round(recording, scene, 14, 40);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  for (const auto& named : e.mechanisms) CHECK(named.mechanism->id == "mixed-pixel");
  const bool may_be_it =
      found(e, "mixed-pixel") || std::ranges::any_of(e.undecided_between, [](const auto& set) {
        return std::ranges::count(set, "mixed-pixel") > 0;
      });
  CHECK(may_be_it);
}

TEST_CASE("a beam that meets either surface beside an edge, and no noisier wall, is a wide one") {
  const PlainScene scene = boards_in_place();
  const plain_bench::Conceal wide = loose_at_edges(scene, 0.2, 7);
  const Explanation e = explained(scene, 6, wide);
  INFO(to_text(e));
  const auto* beam = found(e, "mixed-pixel");
  REQUIRE(beam);
  const fit::Estimate width = beam->parameters.at("width_deg");
  CHECK(std::abs(width.value - 0.2) < 2 * width.u);
  CHECK(width.value == Approx(0.2).epsilon(0.15));
  CHECK_FALSE(found(e, "angle-jitter"));
  const auto shares = std::ranges::find(e.spread_curves, fit::Coordinate::edge_distance,
                                        &fit::explain::SpreadCurve::coordinate);
  REQUIRE(shares != e.spread_curves.end());
  CHECK(shares->recorded.front() > 0.9);
  CHECK(shares->recorded.back() < 0.1);
}

/// Stops so far apart, around where the middle beam meets the edge of a board.
void step_over_edge(SyntheticRecording& recording, const PlainScene& scene) {
  constexpr double edge_deg = 12.1, step_deg = 0.03;
  for (int i = 0; i < 40; ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = (edge_deg + (i - 20) * step_deg) * degree;
    capture.approach = i == 0 ? 0 : 1;
    capture.last_step = scene.steps - 1;
    capture.since_power_on_s = 1800 + 5 * i;
    capture.started_us = 5000000LL * i;
    recording.add(capture, 20);
  }
}

void turn_round(SyntheticRecording& recording, const PlainScene& scene) {
  plain_bench::turn_round(recording, scene, 8, 30);
}

/// Intensities (and ranges) of a recording made anew: `of_beam` has the nominal scene, where the beam points
/// and what was recorded of it.
template <class OfBeam>
SyntheticRecording remade(const PlainScene& scene, unsigned seed, const OfBeam& of_beam,
                          void (*record)(SyntheticRecording&, const PlainScene&) = turn_round) {
  const SyntheticRecording plain =
      plain_bench::recorded(scene, seed, [](double, double, double) { return Deviation{}; });
  SyntheticRecording recording(
      plain.bench(), [maker = plain.maker(), of_beam, scene](const fit::CaptureInfo& info, std::int64_t seq,
                                                             auto& range, auto& intensity) {
        maker(info, seq, range, intensity);
        for (std::size_t k = 0; k < range.size(); ++k)
          of_beam((static_cast<double>(k) - scene.front_step) * scene.step_deg * degree, info.stage_rad,
                  range[k], intensity[k]);
      });
  record(recording, scene);
  return recording;
}

/// What a receiver makes of a wide beam that ranges one of its echoes, the first or the strongest, and has a
/// power of that one's light for its counts.
struct OneEcho {
  PlainScene scene;
  double width_deg = 0.15;
  bool first = true;
  double power = 1;

  void operator()(double beam_rad, double stage_rad, std::uint16_t& range, std::uint16_t& intensity) const {
    constexpr double weakest = 0.05, echo_mm = 300, full = 3e6;
    struct Ray {
      double range_mm, counts;
    };
    std::vector<Ray> rays;
    double light = 0;
    for (int i = -12; i <= 12; ++i) {
      const double weight = std::exp(-0.5 * i * i / 16.0);
      light += weight;
      if (const auto met = look(scene, {}, stage_rad, beam_rad + i / 4.0 * width_deg * degree))
        rays.push_back({met->range_mm, weight * full * std::cos(met->incidence_rad) / met->range_mm});
    }
    const auto middle = look(scene, {}, stage_rad, beam_rad);
    std::ranges::sort(rays, {}, &Ray::range_mm);
    Ray taken{0, 0};
    for (std::size_t begin = 0; middle && begin < rays.size();) {
      std::size_t end = begin;
      double counts = 0;
      for (; end < rays.size() && rays[end].range_mm < rays[begin].range_mm + echo_mm; ++end)
        counts += rays[end].counts / light;
      const double there = rays[(begin + end) / 2].range_mm;
      begin = end;
      if (counts * middle->range_mm < weakest * full || counts < taken.counts) continue;
      taken = {there, counts};
      if (first) break;
    }
    if (taken.counts <= 0) return;
    if (std::abs(taken.range_mm - middle->range_mm) > echo_mm)
      range = static_cast<std::uint16_t>(std::lround(range + taken.range_mm - middle->range_mm));
    intensity = static_cast<std::uint16_t>(1000 * std::pow(taken.counts / 1000, power));
  }
};

TEST_CASE("a wide beam whose receiver takes the first echo shows in the light that is missing beside edges") {
  const PlainScene scene = boards_in_place();
  const SyntheticRecording recording = remade(scene, 14, OneEcho{scene});
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  const auto* beam = found(e, "mixed-pixel");
  REQUIRE(beam);
  // How much a receiver compresses its counts is not known: that leaves a quarter of the width open.
  CHECK(beam->parameters.at("width_deg").value == Approx(0.15).epsilon(0.25));
  CHECK_FALSE(found(e, "angle-jitter"));
}

/// A few beams, which meet the edge of a board and little else.
PlainScene few_beams(int beside) {
  PlainScene scene = boards_in_place();
  scene.steps = 2 * beside + 1;
  scene.front_step = beside;
  return scene;
}
PlainScene seventeen_beams() { return few_beams(8); }

TEST_CASE("a wide beam shows where no beam is farther from the edge than light reaches") {
  const bool first = GENERATE(true, false);
  const PlainScene scene = few_beams(2);
  const SyntheticRecording recording = remade(scene, 19, OneEcho{scene, 0.2, first, 0.5}, step_over_edge);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  const auto* beam = found(e, "mixed-pixel");
  REQUIRE(beam);
  CHECK(beam->parameters.at("width_deg").value == Approx(0.2).epsilon(0.25));
}

TEST_CASE(
    "an edge passed in small steps by a few beams shows how wide they are, in a receiver of all light") {
  const PlainScene scene = seventeen_beams();
  constexpr double width = 0.06 * degree;
  const auto all_light = [scene](double beam_rad, double stage_rad, auto&, auto& intensity) {
    double counts = 0, weights = 0;
    for (int i = -10; i <= 10; ++i) {
      const double weight = std::exp(-0.5 * i * i / 16.0);
      weights += weight;
      if (const auto met = look(scene, {}, stage_rad, beam_rad + i / 4.0 * width))
        counts += weight * 3e6 * std::cos(met->incidence_rad) / met->range_mm;
    }
    intensity = static_cast<std::uint16_t>(counts / weights);
  };
  const SyntheticRecording recording = remade(scene, 17, all_light, step_over_edge);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  const auto* beam = found(e, "mixed-pixel");
  REQUIRE(beam);
  CHECK(beam->parameters.at("width_deg").value == Approx(0.06).epsilon(0.25));
}

TEST_CASE("boards with a dark rim are no wide beam", "[long]") {
  const auto explained_of = [](const PlainScene& scene,
                               void (*record)(SyntheticRecording&, const PlainScene&)) {
    const auto with_rim = [scene](double beam_rad, double stage_rad, auto&, auto& intensity) {
      const auto met = look(scene, {}, stage_rad, beam_rad);
      if (!met || met->wall < 4) return;
      const auto from = scene.walls[met->wall].from, to = scene.walls[met->wall].to,
                 at = std::polar(met->range_mm, stage_rad + beam_rad);
      if (std::min(std::abs(at - from), std::abs(at - to)) < 15) intensity /= 2;
    };
    const SyntheticRecording recording = remade(scene, 15, with_rim, record);
    return fit::explain::explain({&recording}, {});
  };
  const Explanation all_round = explained_of(boards_in_place(), turn_round),
                    in_small_steps = explained_of(seventeen_beams(), step_over_edge),
                    by_few_beams = explained_of(few_beams(2), step_over_edge);
  INFO(to_text(all_round) << to_text(in_small_steps) << to_text(by_few_beams));
  CHECK_FALSE(found(all_round, "mixed-pixel"));
  CHECK_FALSE(found(in_small_steps, "mixed-pixel"));
  CHECK_FALSE(found(by_few_beams, "mixed-pixel"));
}

TEST_CASE("a dirty window that dims some beams makes none of them wide where they meet edges") {
  PlainScene scene = boards_in_place();
  scene.steps = 271;
  scene.front_step = 135;
  scene.step_deg = 1;
  const auto dimmed = [](double beam_rad, double, auto&, auto& intensity) {
    const double away = std::remainder(beam_rad / degree, 60.0) / 6;
    intensity = static_cast<std::uint16_t>(intensity * (1 - 0.4 * std::exp(-0.5 * away * away)));
  };
  const SyntheticRecording recording = remade(scene, 23, dimmed);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK_FALSE(found(e, "mixed-pixel"));
}

TEST_CASE("weak echoes of stray light past the edges of nearer boards are no wide beam") {
  const PlainScene scene = boards_in_place();
  const auto with_halo = [scene](double beam_rad, double stage_rad, auto& range, auto& intensity) {
    constexpr double leak_of_degree = 0.08, half_deg = 0.65, weakest = 0.003, compressed = 0.45;
    const auto own = look(scene, {}, stage_rad, beam_rad);
    double light = 0, sum_mm = 0, counts = 0;
    for (double aside = -1.5; own && aside <= 1.5; aside += 0.05) {
      const auto met = look(scene, {}, stage_rad, beam_rad + aside * degree);
      if (!met || met->range_mm > own->range_mm - 500) continue;
      const double share = 0.05 * leak_of_degree * std::exp2(-std::pow(aside / half_deg, 2.0));
      light += share, sum_mm += share * met->range_mm;
      counts = 3e6 * std::cos(met->incidence_rad) / met->range_mm;
    }
    if (light < weakest) return;
    range = static_cast<std::uint16_t>(std::lround(range + sum_mm / light - own->range_mm));
    intensity = static_cast<std::uint16_t>(std::pow(light, compressed) * counts);
  };
  const SyntheticRecording recording = remade(scene, 16, with_halo);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK_FALSE(found(e, "mixed-pixel"));
}

TEST_CASE("few samples between two surfaces are a wide beam's, and neither outliers nor loose angles") {
  const PlainScene scene = boards_in_place();
  const auto blended = [&](const plain_bench::Sample& sample, std::mt19937&) {
    const auto seen_at = [&](double aside) {
      return look(scene, {}, sample.stage_rad, sample.beam_rad + aside * degree);
    };
    const auto left = seen_at(-0.12), right = seen_at(0.12);
    const bool at_edge = left && right && std::abs(left->range_mm - right->range_mm) > 200;
    return at_edge ? (left->range_mm + right->range_mm) / 2 : sample.range_mm;
  };
  SyntheticRecording recording = plain_bench::recorded(
      scene, 12, [](double, double, double) { return Deviation{}; }, blended);
  plain_bench::turn_round(recording, scene, 6, 6);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "mixed-pixel");
}

TEST_CASE("outliers that lie between two surfaces beside an edge are no wide beam's") {
  const auto anywhere = [](const plain_bench::Sample& sample, std::mt19937& random) {
    std::uniform_real_distribution<double> draw;
    return draw(random) < 0.034 ? 60 + 9940 * draw(random) : sample.range_mm;
  };
  PlainScene scene = boards_in_place();
  scene.steps = 271;
  scene.front_step = 135;
  scene.step_deg = 1;
  SyntheticRecording recording = plain_bench::recorded(
      scene, 19, [](double, double, double) { return Deviation{}; }, anywhere);
  plain_bench::turn_round(recording, scene, 30, 60);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "outliers");
  CHECK(e.undecided_between.empty());
}

TEST_CASE("edges of a narrow beam that stand elsewhere than stated are hard") {
  PlainScene scene = boards();
  scene.u_mm = 8;
  const Explanation e = explained(scene, 8, [](double, double, double) { return Deviation{}; });
  INFO(to_text(e));
  CHECK(e.verdict == fit::explain::nothing_missing);
}

TEST_CASE("edges of a lidar that stands turned by more than an edge is looked for are hard") {
  PlainScene scene = boards();
  scene.u_yaw_deg = 3;
  const double turned = 1.8 * degree;
  const Explanation e =
      explained(scene, 13, [&](double, double, double) { return Deviation{.beam_rad = turned}; });
  INFO(to_text(e));
  CHECK_FALSE(found(e, "mixed-pixel"));
  CHECK_FALSE(found(e, "angle-jitter"));
  CHECK_FALSE(e.unknown);
}

TEST_CASE("surfaces that stand elsewhere because all angles are off are no wide beam") {
  PlainScene scene = boards();
  scene.u_yaw_deg = 0.2;
  const double turned = 1.7 * degree;
  const Explanation e =
      explained(scene, 15, [&](double, double, double) { return Deviation{.beam_rad = turned}; });
  INFO(to_text(e));
  CHECK_FALSE(found(e, "mixed-pixel"));
  CHECK_FALSE(e.unknown);
}

TEST_CASE("edges seen from many sides by a lidar that stands turned are hard", "[long]") {
  const double turned = 1.7 * degree;
  SyntheticRecording recording = plain_bench::recorded(
      boards(), 16, [&](double, double, double) { return Deviation{.beam_rad = turned}; });
  plain_bench::turn_round(recording, boards(), 60, 8);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK_FALSE(found(e, "mixed-pixel"));
  CHECK_FALSE(e.unknown);
}

TEST_CASE("that few edges lie within the scatter of angles says how little they scatter", "[long]") {
  SyntheticRecording recording = plain_bench::recorded(boards_in_place(), 17, jitter(0.02));
  plain_bench::turn_round(recording, boards_in_place(), 60, 20);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  const auto* angles = found(e, "angle-jitter");
  REQUIRE(angles);
  CHECK(e.mechanisms.size() == 1);
  CHECK(angles->parameters.at("sigma_deg").value == Approx(0.02).epsilon(0.2));
}

TEST_CASE("a few samples between two surfaces do not hide how wide a beam is", "[long]") {
  const PlainScene scene = boards_in_place();
  const plain_bench::Conceal wide = loose_at_edges(scene, 0.08, 3);
  const auto blended = [&](const plain_bench::Sample& sample, std::mt19937& draw) {
    const auto left = look(scene, {}, sample.stage_rad, sample.beam_rad - 0.05 * degree),
               right = look(scene, {}, sample.stage_rad, sample.beam_rad + 0.05 * degree);
    const bool at_edge = left && right && std::abs(left->range_mm - right->range_mm) > 200;
    const bool both = std::uniform_real_distribution<double>()(draw) < 0.3;
    return at_edge && both ? (left->range_mm + right->range_mm) / 2 : sample.range_mm;
  };
  SyntheticRecording recording = plain_bench::recorded(scene, 14, wide, blended);
  plain_bench::turn_round(recording, scene, 60, 20);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "mixed-pixel");
  CHECK(e.mechanisms.front().parameters.at("width_deg").value == Approx(0.08).epsilon(0.25));
}

TEST_CASE("samples of both surfaces at a few of a sweep's stops are no chance of where hard edges are",
          "[long]") {
  const PlainScene scene = seventeen_beams();
  const bool is_soft = GENERATE(true, false);
  const plain_bench::Conceal soft = loose_at_edges(scene, is_soft ? 0.012 : 0, 7);
  SyntheticRecording recording = plain_bench::recorded(scene, 18, soft);
  for (int i = 0; i < 90; ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = (11.6 + 0.01 * i) * degree;  // past the edge of the nearer board
    capture.approach = 1;
    capture.last_step = scene.steps - 1;
    capture.since_power_on_s = 1800 + 3.0 * i;
    recording.add(capture, 40);
  }
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  const auto is_reported = [&](const std::string& id) {
    return found(e, id) || std::ranges::any_of(e.undecided_between, [&](const auto& set) {
             return std::ranges::find(set, id) != set.end();
           });
  };
  CHECK(is_reported("mixed-pixel") == is_soft);
  if (!is_soft) CHECK(e.verdict == fit::explain::nothing_missing);
}

TEST_CASE("the score of an edge's width is the slope of its likelihood, and hard edges have none") {
  SyntheticRecording recording =
      plain_bench::recorded(boards(), 9, [](double, double, double) { return Deviation{}; });
  plain_bench::turn_round(recording, boards(), 4, 10);
  const fit::explain::Reduced reduced = fit::explain::reduce(recording, {});
  const auto rows =
      fit::explain::model::channel_kinds()[fit::explain::model::channel_of("edge")].rows(reduced, {});
  REQUIRE(rows);
  REQUIRE(rows->rows() > 6);
  for (const double at : {0.0003, 0.01, 0.3}) {
    const Eigen::VectorXd eta = Eigen::VectorXd::Constant(rows->rows(), at),
                          one = Eigen::VectorXd::Ones(rows->rows());
    const double step = 1e-4 * at,
                 slope = (rows->log_likelihood(eta + step * one) - rows->log_likelihood(eta - step * one)) /
                         (2 * step);
    CHECK(rows->whitened(one, eta).col(0).dot(rows->white_residual(eta)) == Approx(slope).epsilon(1e-3));
    CHECK(slope <= 0);
  }
}

}  // namespace

TEST_CASE("a channel whose edges no longer show keeps its rows, and another hypothesis can be fitted") {
  using namespace fit::explain;
  const PlainScene scene = boards();
  SyntheticRecording recording =
      plain_bench::recorded(scene, 6, [](double, double, double) { return Deviation{}; });
  plain_bench::turn_round(recording, scene, 6, 10);
  Reduced reduced = reduce(recording, {});
  const inference::Placed placed = inference::fit_placements(reduced, {});
  inference::Session session(reduced, {}, placed.there);
  const auto& edges = session.channels()[model::channel_of("edge")];
  REQUIRE(edges);
  const Eigen::Index rows = edges->rows();
  const inference::Fitted before = inference::fit(session, {});
  REQUIRE_FALSE(inference::screen(session, before).empty());

  const bool all = GENERATE(true, false);
  for (std::size_t i = 0; i < reduced.cells.size(); ++i)
    if (all || i < reduced.cells.size() / 2) reduced.cells[i].edge = -1;
  std::vector<fit::explain::inference::Hypothesis> none;
  auto there = before.hypothesis;
  session.linearise(there, none);
  REQUIRE(session.channels()[model::channel_of("edge")]);
  CHECK((session.channels()[model::channel_of("edge")]->rows() == rows) == all);
  const inference::Fitted after = inference::fit(session, before.hypothesis);
  CHECK(std::isfinite(after.hypothesis.log_posterior()));
  CHECK_FALSE(inference::screen(session, after).empty());
}

TEST_CASE("a mean whose beam meets two surfaces is doubtful by what is known of both, and alone in its row") {
  fit::explain::Reduced reduced;
  const auto cell = [](double edge_deg, double gap_mm, double corner_mm) {
    fit::explain::Cell c;
    c.usable = true;
    c.at.edge_rad = edge_deg * degree;
    c.at.gap_mm = gap_mm;
    c.at.corner_mm = corner_mm;
    c.at.spread_mm = {-1, -4, -16};
    c.sight.range_mm = 2000;
    return c;
  };
  constexpr double far_mm = 1e9;
  reduced.cells = {cell(0.5, 300, far_mm), cell(-0.5, 300, far_mm), cell(0.8, 300, far_mm),
                   cell(0.5, 0, far_mm),   cell(5, 300, 20),        cell(5, 300, 30)};
  fit::explain::reduction::state_u_of_wide_beams(reduced, 0.2 * degree);
  std::vector<double> mixed_mm;
  for (const auto& c : reduced.cells) mixed_mm.push_back(c.mixed_mm);
  const double quarter_mm = 1;  // of what the mean over the beam makes of a corner
  CHECK(mixed_mm == std::vector<double>{300, 300, 0, 0, quarter_mm, 0});
  fit::explain::reduction::state_u_of_wide_beams(reduced, 0);
  for (const auto& c : reduced.cells) CHECK(c.mixed_mm == 0);
}

TEST_CASE("a hard edge between two beams lies in their middle, whatever the step of the search") {
  std::vector<fit::explain::Beside> beams;
  for (int k = -6; k <= 6; ++k)
    beams.push_back({.inside_deg = 0.25 * k + 0.1, .far_share = k < 0 ? 1.0 : 0.0, .n = 20});
  const fit::explain::PlaceOfEdge narrow = fit::explain::place_of_edge(beams, 0.005, 0);
  CHECK(std::abs(narrow.shift_deg - (0.1 - 0.125)) < 0.01);
  // One beam sees both surfaces alike: the edge is at it.
  beams[6].far_share = 0.5;
  const fit::explain::PlaceOfEdge wide = fit::explain::place_of_edge(beams, 0.05, 0.3);
  CHECK(std::abs(wide.shift_deg - 0.1) < 0.02);
  CHECK(wide.log_likelihood < 0);
}

}  // namespace explain_edges_test
