// SPDX-License-Identifier: MIT
// What an archive says of one lidar over time, and of all of them.
#include <catch2/catch.hpp>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <random>

#include "rig/archive/archive_folder.hpp"
#include "rig/archive/fleet.hpp"
#include "rig/archive/history.hpp"
#include "rig/archive/swapped.hpp"
#include "rig/archive/unknown_shapes.hpp"
#include "rig/errors.hpp"
#include "rig/report/report.hpp"
#include "tests/support/calibrations.hpp"
#include "tests/support/test_folder.hpp"

namespace archive_history_test {
namespace {

using Catch::Contains;
using nlohmann::json;

std::vector<std::size_t> points_of(const std::vector<rig::ChartSignal>& signals, const std::string& rule) {
  for (const auto& s : signals)
    if (s.rule.starts_with(rule)) return s.points;
  return {};
}

/// The nth of six calibrations in a year.
std::string date(int n) {
  char text[40];
  std::snprintf(text, sizeof text, "2025-%02d-10T08:00:00Z", 1 + 2 * n);
  return text;
}

/// A fleet as an index would give it: every lidar has its own offset and scale, and repeats by 0.1.
struct Fleet {
  std::vector<rig::SessionRecord> sessions;
  Fleet(int lidars, int calibrations, unsigned seed) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> own(0, 5), repeat(0, 0.1);
    for (int i = 0; i < lidars; ++i) {
      const double offset = own(random), scale = own(random), far = own(random);
      for (int k = 0; k < calibrations; ++k) {
        rig::SessionRecord r;
        r.serial = "H" + std::to_string(1000 + i), r.model = "UST-10LX", r.measured_utc = date(k);
        r.path = r.serial + "-" + std::to_string(k) + ".rig";
        r.content_sha256 = r.path;
        r.values = {{"range", "offset_mm", "Offset", "mm", offset + repeat(random), 0.3, 0.6},
                    {"range", "scale", "Scale", "", scale + repeat(random), 0.3, 0.6},
                    {"range", "far_mm", "Far", "mm", far + repeat(random), 0.3, 0.6}};
        sessions.push_back(r);
      }
    }
  }
  rig::SessionRecord& of(int lidar, int calibration, int calibrations = 6) {
    return sessions[static_cast<std::size_t>(lidar * calibrations + calibration)];
  }
};

rig::ArchivedExplanation wave_along_beam(double amplitude_mm, double phase, double from = -120,
                                         double to = 120) {
  rig::ArchivedExplanation e;
  e.verdict = "unknown-physics";
  e.unknown_coordinate = "beam_deg", e.unknown_observable = "range-mean", e.unknown_channel = "range_mm";
  e.unknown_describes =
      "the range error waves along beam: period 40 deg, amplitude " + std::to_string(amplitude_mm) + " mm";
  for (double at = from; at <= to; at += 4) {
    e.curve_at.push_back(at);
    e.curve.push_back(amplitude_mm * std::sin(at * 2 * M_PI / 40 + phase));
  }
  return e;
}

}  // namespace

TEST_CASE("control chart: each rule holds where it should and nowhere else") {
  const std::vector<double> quiet = {0.5, -0.4, 0.9, -0.8, 0.2, -0.1, 0.7, -0.6};
  CHECK(rig::chart_signals(quiet).empty());
  const std::vector<double> one = {0, 3.1, 0.2, -3.2};
  CHECK(points_of(rig::chart_signals(one), "Western Electric 1") == std::vector<std::size_t>{1, 3});
  const std::vector<double> two = {0, 2.1, 0.5, 2.2, -0.1};
  CHECK(points_of(rig::chart_signals(two), "Western Electric 2") == std::vector<std::size_t>{1, 3});
  const std::vector<double> opposite = {0, 2.1, -2.2};
  CHECK(rig::chart_signals(opposite).empty());
  const std::vector<double> four = {1.1, 1.2, 0.5, 1.4, 1.3};
  CHECK(points_of(rig::chart_signals(four), "Western Electric 3") == std::vector<std::size_t>{0, 1, 3, 4});
  const std::vector<double> eight = {-0.1, -0.5, -0.2, -0.9, -0.4, -0.3, -0.6, -0.2, 0.5};
  CHECK(points_of(rig::chart_signals(eight), "Western Electric 4").size() == 8);
  const std::vector<double> rising = {-0.9, -0.5, -0.2, 0.1, 0.3, 0.9, 0.2};
  CHECK(points_of(rig::chart_signals(rising), "Nelson 3") == std::vector<std::size_t>{0, 1, 2, 3, 4, 5});
}

TEST_CASE(
    "drift: slopes and their intervals are right as often as they say, with and without the archive's word") {
  std::mt19937_64 random(11);
  std::normal_distribution<double> noise(0, 0.5);
  const std::vector<double> years = {0, 0.2, 0.4, 0.6, 0.8, 1.0};
  for (const double sigma : {0.5, 0.0}) {
    int held = 0, small_p = 0;
    constexpr int rounds = 4000;
    for (int i = 0; i < rounds; ++i) {
      std::vector<double> still, moving;
      for (const double t : years) {
        still.push_back(3 + noise(random));
        moving.push_back(3 + 2 * t + noise(random));
      }
      const rig::Drift drift = rig::drift_of(years, moving, sigma, sigma > 0 ? 60 : 0);
      held += std::abs(drift.per_year - 2) < drift.expanded;
      small_p += rig::drift_of(years, still, sigma, sigma > 0 ? 60 : 0).p_value < 0.05;
    }
    CHECK(held == Approx(0.9545 * rounds).margin(4 * std::sqrt(0.0455 * 0.9545 * rounds)));
    CHECK(small_p == Approx(0.05 * rounds).margin(4 * std::sqrt(0.05 * 0.95 * rounds)));
  }
  CHECK(rig::drift_of(std::vector<double>{0, 1}, std::vector<double>{0, 1}, 1, 10).degrees_of_freedom == 0);
  CHECK(rig::drift_of(std::vector<double>{1, 1, 1}, std::vector<double>{0, 1, 2}, 1, 10).degrees_of_freedom ==
        0);
}

TEST_CASE(
    "repeatability: a tenth of jumping pairs hardly widens it, and its degrees of freedom are what they "
    "say") {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal(0, 2);
  std::vector<double> estimates;
  for (int i = 0; i < 2000; ++i) {
    std::vector<double> differences;
    for (int k = 0; k < 80; ++k) differences.push_back(normal(random) - normal(random));
    estimates.push_back(rig::repeatability_of(differences).sigma);
  }
  const double mean = std::accumulate(estimates.begin(), estimates.end(), 0.0) / 2000;
  double squares = 0;
  for (const double e : estimates) squares += (e - mean) * (e - mean) / 2000;
  CHECK(mean == Approx(2).epsilon(0.02));
  CHECK(rig::Repeatability{2, 80}.degrees_of_freedom() == Approx(mean * mean / (2 * squares)).epsilon(0.15));
  std::vector<double> with_jumps;
  for (int k = 0; k < 200; ++k) with_jumps.push_back(k % 10 == 0 ? 100 : normal(random) - normal(random));
  CHECK(rig::repeatability_of(with_jumps).sigma == Approx(2).epsilon(0.3));
}

TEST_CASE("history: E_n, an adjustment, a drift with its interval, and what to do next") {
  Fleet fleet(10, 6, 5);
  for (int k = 0; k < 6; ++k) fleet.of(4, k).values[0].value += 1.5 * k;  // 9 mm a year.
  for (int k = 0; k < 6; ++k)
    fleet.of(4, k).limits = {{"range.offset_mm", "pass", {}, fleet.of(4, 5).values[0].value + 3}};
  fleet.of(6, 3).item_state = "as left";
  for (int k = 3; k < 6; ++k) fleet.of(6, k).values[0].value += 20;
  const json drifting = rig::history_of(fleet.sessions, "H1004");
  const json& q = drifting.at("quantities").at(1);
  REQUIRE(q.at("quantity") == "range.offset_mm");
  CHECK(std::abs(q.at("drift").at("per_year").get<double>() - 9) < q.at("drift").at("U").get<double>());
  CHECK(q.at("drift").at("significant") == true);
  CHECK(q.at("points").at(5).at("e_n").get<double>() ==
        Approx(q.at("points").at(5).at("change").get<double>() / std::hypot(0.6, 0.6)));
  CHECK(q.at("chart").at("signals").at(0).at("rule").get<std::string>().starts_with("Western Electric 1"));
  // Room of 3 mm less U of 0.6 at 9 mm a year with its uncertainty: three months.
  CHECK(q.at("interval").at("months") == 3);
  CHECK(drifting.at("recommended").at("months") == 3);
  const json still = rig::history_of(fleet.sessions, "H1003");
  CHECK(still.at("quantities").at(1).at("drift").at("significant") == false);
  CHECK(still.at("recommended").at("months") == 4);  // Twice the two months so far.
  const json adjusted = rig::history_of(fleet.sessions, "H1006");
  const json& after = adjusted.at("quantities").at(1);
  CHECK(after.at("drift").at("calibrations") == 3);
  CHECK(after.at("drift").at("significant") == false);
  CHECK(after.at("chart").at("signals").empty());
  CHECK_THROWS_WITH(rig::history_of(fleet.sessions, "H1O04"), Contains("H1004"));
}

TEST_CASE(
    "history: nine of ten values lie within control limits that the archive gives, whatever the stated "
    "uncertainties") {
  const Fleet fleet(40, 6, 8);
  const auto histories = rig::histories_of(fleet.sessions);
  const auto repeat = rig::repeatabilities_of(histories);
  CHECK(repeat.at("UST-10LX/range.offset_mm").differences == 200);
  CHECK(repeat.at("UST-10LX/range.offset_mm").sigma == Approx(0.1).epsilon(0.2));
  int alarmed = 0;
  for (int i = 0; i < 40; ++i)
    for (const json& q : rig::history_of(fleet.sessions, "H" + std::to_string(1000 + i)).at("quantities"))
      alarmed += !q.at("chart").at("signals").empty();
  CHECK(alarmed < 12);  // Of 120 charts without anything to find.
}

TEST_CASE("fleet: drifts are reported, and of many lidars that do not drift none is") {
  Fleet fleet(40, 6, 21);
  CHECK(rig::fleet_of(fleet.sessions).at("drifts").empty());
  for (int k = 0; k < 6; ++k) fleet.of(7, k).values[1].value -= 0.2 * k;
  const json found = rig::fleet_of(fleet.sessions);
  REQUIRE(found.at("drifts").size() == 1);
  CHECK(found.at("drifts").at(0).at("serial") == "H1007");
  CHECK(std::abs(found.at("drifts").at(0).at("per_year").get<double>() + 1.2) <
        found.at("drifts").at(0).at("U").get<double>());
  CHECK(found.at("common_drifts").empty());
  for (auto& r : fleet.sessions)
    r.values[2].value += 0.3 * (r.measured_utc[6] - '0');  // Everything moves: the bench.
  const json bench = rig::fleet_of(fleet.sessions);
  REQUIRE(bench.at("common_drifts").size() == 1);
  CHECK(bench.at("common_drifts").at(0).at("quantity") == "range.far_mm");
}

TEST_CASE(
    "fleet: a session with another lidar's serial number is reported with that lidar; one that jumped to "
    "nobody's is reported too") {
  Fleet fleet(40, 6, 33);
  CHECK(rig::fleet_of(fleet.sessions).at("strange").empty());
  fleet.of(3, 2).serial = "H1030";
  for (auto& v : fleet.of(11, 4).values) v.value += 400;
  const json strange = rig::fleet_of(fleet.sessions).at("strange");
  REQUIRE(strange.size() == 2);
  for (int k = 0; k < 6; ++k)
    fleet.of(20, k).values[0].value += 1.5 * k;  // A lidar that drifts is not strange.
  CHECK(rig::fleet_of(fleet.sessions).at("strange").size() == 2);
  CHECK(rig::fleet_of(fleet.sessions).at("drifts").size() == 1);
  for (const json& s : strange) {
    if (s.at("session") == fleet.of(3, 2).path) {
      CHECK(s.at("looks_like") == "H1003");
      CHECK(s.at("serial") == "H1030");
    } else {
      CHECK(s.at("session") == fleet.of(11, 4).path);
      CHECK(s.at("looks_like") == "");
    }
  }
}

TEST_CASE(
    "fleet: the same unknown shape in several lidars is one finding; another phase, size or coordinate is "
    "another") {
  Fleet fleet(12, 1, 2);
  for (const int i : {1, 5, 8})
    fleet.of(i, 0, 1).explanation = wave_along_beam(3 + 0.2 * i, 0.1 * i / 8, -120 + i, 110 + i);
  fleet.of(2, 0, 1).explanation = wave_along_beam(3, M_PI);
  fleet.of(3, 0, 1).explanation = wave_along_beam(12, 0);
  fleet.of(4, 0, 1).explanation = wave_along_beam(3, 0);
  fleet.of(4, 0, 1).explanation->unknown_coordinate = "stage_deg";
  rig::ArchivedExplanation noise;
  noise.verdict = "unknown-physics", noise.unknown_coordinate = "beam_deg",
  noise.unknown_observable = "range-variance";
  noise.unknown_describes = "the scatter is 1.8 times as large from 20 deg on";
  fleet.of(6, 0, 1).explanation = noise;
  noise.unknown_describes = "the scatter is 2.1 times as large from 22 deg on; and something else by 7 mm";
  fleet.of(7, 0, 1).explanation = noise;
  const auto shapes = rig::unknown_shapes(fleet.sessions);
  REQUIRE(shapes.size() == 5);
  CHECK(shapes[0].serials() == std::vector<std::string>{"H1001", "H1005", "H1008"});
  CHECK(shapes[0].form == "wave");
  CHECK(shapes[0].size == Approx(4 / std::sqrt(2)).epsilon(0.1));
  CHECK(shapes[1].serials() == std::vector<std::string>{"H1006", "H1007"});
  const std::string page = rig::fleet_html(rig::fleet_of(fleet.sessions));
  CHECK_THAT(page, Contains("The same unknown physics in 3 lidars and 3 sessions"));
}

TEST_CASE(
    "fleet: how often a mechanism was named, and its sizes by model and age; whatever a session says is text "
    "on the page") {
  Fleet fleet(4, 6, 2);
  for (int k = 0; k < 6; ++k) {
    rig::ArchivedExplanation e;
    e.verdict = "explained";
    e.mechanisms = {{"range-walk", 0.9 + 0.01 * k, {{"size_mm", {10.0 + k, 1}}}}};
    fleet.of(k % 2, k).explanation = e;
  }
  fleet.of(1, 5).measured_utc = "2027-01-01T00:00:00Z";
  fleet.of(0, 0).serial = "<script>alert(1)</script>";
  const json found = rig::fleet_of(fleet.sessions);
  const json& walk = found.at("mechanisms").at(0);
  CHECK(walk.at("sessions") == 6);
  CHECK(walk.at("lidars") == 3);
  CHECK(walk.at("least_probability") == Approx(0.9));
  REQUIRE(walk.at("sizes").size() == 2);
  CHECK(walk.at("sizes").at(0).at("median") == Approx(12));
  CHECK(walk.at("sizes").at(1).at("age_years") == 1);
  CHECK_THAT(rig::fleet_html(found), !Contains("<script>"));
  CHECK_THAT(rig::history_html(rig::history_of(fleet.sessions, "<script>alert(1)</script>")),
             !Contains("<script>"));
}

TEST_CASE(
    "certificate: the previous calibration stands beside the new one, and makes it another certificate") {
  const TestFolder folder;
  Calibration before, now, other;
  before.values = {{"offset_mm", 1.0, 0.1}, {"scale", 2.0, 0.1}};
  now.measured_utc = "2026-07-01T09:00:00Z", now.values = {{"offset_mm", 2.5, 0.1}},
  now.item_state = "as found";
  other.serial = "H0002", other.measured_utc = "2026-06-01T09:00:00Z",
  other.values = {{"offset_mm", 9.0, 0.1}};
  before.write(folder / "before.rig");
  now.write(folder / "now.rig");
  other.write(folder / "other.rig");
  rig::ArchiveIndex index(folder / "index.sqlite", true);
  (void)rig::add_to_archive(folder.path(), index);
  const auto sessions = index.sessions();
  const json previous =
      rig::previous_calibration(sessions, rig::read_session_record(folder.path(), "now.rig"));
  CHECK(previous.at("session") == "before.rig");
  REQUIRE(previous.at("values").size() == 1);
  CHECK(previous.at("values").at(0).at("e_n").get<double>() == Approx(1.5 / std::hypot(0.2, 0.2)));
  CHECK(rig::previous_calibration(sessions, rig::read_session_record(folder.path(), "before.rig")).is_null());
  (void)rig::issue_report(folder / "now.rig", folder / "now.html", previous);
  const std::string page = file_text(folder / "now.html");
  CHECK_THAT(page, Contains("Previous calibration") && Contains("1.00 ± 0.20 mm") &&
                       Contains("2.50 ± 0.20 mm") && Contains("5.30"));
  CHECK_THAT(page, Contains("results as found, before an adjustment"));
  (void)rig::issue_report(folder / "now.rig", folder / "plain.html");
  CHECK_THAT(file_text(folder / "plain.html"), !Contains("Previous calibration"));
}

}  // namespace archive_history_test
