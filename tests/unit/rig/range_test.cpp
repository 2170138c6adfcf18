// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>

#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"
#include "rig/import/import_session.hpp"
#include "rig/report/certificate.hpp"
#include "rig/report/report.hpp"
#include "rig/session/session_store.hpp"
#include "tests/support/test_folder.hpp"

namespace range_test {
namespace {

nlohmann::json value_of(const nlohmann::json& result, const std::string& name) {
  for (const auto& value : result.at("values"))
    if (value.at("name") == name) return value;
  FAIL("no value " << name);
  return {};
}

/// What one beam of a scan reports.
struct Echo {
  std::uint16_t range_mm, intensity;
};

/// A UST-10LX so mounted, before one target.
void set_bench(rig::SessionStore& store, const std::string& mount, const std::string& target) {
  store.set("bench", R"({"schema":"bench/1",
      "lidar":{"model":"UST-10LX","steps":1081,"front_step":540,"step_deg":0.25,"scan_hz":40,
               "mount":)" +
                         mount + R"(},"targets":[)" + target + "]}");
}

/// A capture of so many scans, 25 ms apart; `echo(scan, step)` says what each of its beams reports.
template <class Reports>
void add_capture(rig::SessionStore& store, const fit::CaptureInfo& info, int scans, Reports echo) {
  const auto id = store.begin_capture(info);
  for (int i = 0; i < scans; ++i) {
    std::vector<std::uint16_t> range, intensity;
    for (int step = info.first_step; step <= info.last_step; ++step) {
      const Echo seen = echo(i, step);
      range.push_back(seen.range_mm), intensity.push_back(seen.intensity);
    }
    fit::ScanView scan;
    scan.seq = i, scan.host_us = 25000 * i;
    scan.range_mm = range, scan.intensity = intensity;
    store.add_scan(id, scan);
  }
  store.commit_capture(id);
}

}  // namespace

TEST_CASE("four real recordings before a wall give range errors with honest uncertainty, and no Fourier(2)") {
  const std::filesystem::path real =
      std::filesystem::path(RIG_SOURCE_DIR) / ".." / "shared" / "real" / "lds02-wall";
  if (!std::filesystem::exists(real)) {
    WARN("skipped: the real recordings are not here (" << real.string() << ")");
    return;
  }
  const TestFolder place;
  rig::ImportRequest request;
  for (const char* name : {"0.5m", "1m", "1.5m", "2m"})
    request.files.push_back((real / (std::string("lidar_calibration_") + name)).string());
  request.output = rig::check_output({place / "wall.rig"});
  rig::import_session(request);
  nlohmann::json result;
  {
    const rig::SessionStore session(request.output.path(), rig::SessionStore::Mode::read);
    result = rig::run_fit("range", {{request.output.path(), &session}}, nlohmann::json::object());
  }
  for (const char* name : {"error_at_500_mm", "error_at_1000_mm", "error_at_1500_mm", "error_at_2000_mm"}) {
    const auto value = value_of(result, name);
    INFO(value.dump());
    // The distances themselves are only known to 5 mm: no smaller uncertainty may be claimed.
    CHECK(value.at("u").get<double>() >= 5);
    CHECK(value.at("u").get<double>() < 6);
    CHECK(std::abs(value.at("value").get<double>()) < 2 * value.at("U").get<double>());
  }
  const auto& captures = result.at("tables").at(0).at("rows");
  REQUIRE(captures.size() == 4);
  for (const auto& row : captures) CHECK(row.at(6).get<double>() > 200);  // Most frequent intensity.
  const auto& tables = result.at("tables");
  // The beam square on the wall lies around angle 0.
  for (const auto& row : tables.at(tables.size() - 2).at("rows"))
    CHECK(std::abs(row.at(2).get<double>()) < 3);
  const std::string text = result.dump();
  CHECK_THAT(text, Catch::Contains("has 6 coefficients and needs points at 8 places or more; there are 4"));
  CHECK_THAT(text, Catch::Contains("only one surface was measured"));
  // Two levels 4 mm apart are how this device reports 1 m; neither is nonsense.
  for (const auto& row : result.at("tables").back().at("rows")) CHECK(row.at(3).get<int>() < 5);
  {
    rig::SessionStore session(request.output.path(), rig::SessionStore::Mode::append);
    session.add_result("range", result.dump());
  }
  rig::write_report(request.output.path(), rig::check_output({place / "wall.html"}));
  CHECK(std::filesystem::file_size(place / "wall.html") > 20000);
}

TEST_CASE("the five families stand in the paper's order, each with coefficients that give its figures") {
  const TestFolder place;
  const std::vector<int> counts = {70, 110, 170, 290, 430, 600, 720, 960, 1200, 1440, 1700, 2040, 2380};
  const auto file_of = [&](const std::string& name, bool odd) {
    const std::string file = place / name;
    rig::SessionStore store(file, rig::SessionStore::Mode::create);
    set_bench(store, R"({"x_mm":0,"y_mm":0,"yaw_deg":0})",
              R"({"name":"sample","from_mm":[200,-100],"to_mm":[200,100],"u_mm":0.3,"u_deg":0.1})");
    for (std::size_t c = odd ? 1 : 0; c < counts.size(); c += 2) {
      fit::CaptureInfo info;
      info.step = "capture " + std::to_string(counts[c]), info.target = "sample";
      info.first_step = info.last_step = 540;
      const double truth_mm = 200 + 30 * std::exp(-counts[c] / 500.0);
      add_capture(store, info, 400, [&](int i, int) {
        const double dither = (i % 20 - 9.5) / 5;  // Millimetres are too coarse a grid for the mean.
        return Echo{static_cast<std::uint16_t>(std::lround(truth_mm + dither)),
                    static_cast<std::uint16_t>(counts[c])};
      });
    }
    return file;
  };
  const std::string first = file_of("first.rig", false), second = file_of("second.rig", true);
  const rig::SessionStore one(first, rig::SessionStore::Mode::read),
      two(second, rig::SessionStore::Mode::read);
  const nlohmann::json result =
      rig::run_fit("range", {{first, &one}, {second, &two}}, nlohmann::json::object());
  const auto table = [&](const std::string& title) {
    for (const auto& candidate : result.at("tables"))
      if (candidate.at("title").get<std::string>().find(title) != std::string::npos) return candidate;
    FAIL("no table " << title);
    return nlohmann::json();
  };
  const auto paper = table("Five families of curves (Zhao et al.)");
  CHECK_THAT(paper.at("title").get<std::string>(), Catch::Contains("from Huber's means of all samples"));
  CHECK(paper.at("columns") == nlohmann::json({"experiment", "exponential(2)", "Fourier(2)", "polynomial(3)",
                                               "power(2)", "rational(3,3)"}));
  REQUIRE(paper.at("rows").size() == 2);
  CHECK(paper.at("rows").at(0).at(0) == "A1 intensity: RMSE (mm)");
  CHECK(paper.at("rows").at(1).at(0) == "A1 intensity: R2");
  // The polynomial by its printed coefficients, highest power first, against what was put in.
  std::vector<double> p;
  bool is_polynomial = false;
  const nlohmann::json coefficients = table("coefficients of every family");
  for (const auto& row : coefficients.at("rows")) {
    if (!row.at(0).get<std::string>().empty())
      is_polynomial = row.at(0).get<std::string>().starts_with("polynomial(3)");
    if (is_polynomial) p.push_back(std::stod(row.at(2).get<std::string>()));
  }
  REQUIRE(p.size() == 4);
  double rss = 0;
  for (const int x : counts)
    rss += std::pow(((p[0] * x + p[1]) * x + p[2]) * x + p[3] - 30 * std::exp(-x / 500.0), 2);
  const double rmse = std::sqrt(rss / static_cast<double>(counts.size() - 4));
  CHECK(std::stod(paper.at("rows").at(0).at(3).get<std::string>()) == Approx(rmse).epsilon(0.05));
  // It is kept in the first session, whose certificate must name the other.
  CHECK_THAT(result.at("notes").dump(),
             Catch::Contains("first.rig") && Catch::Contains("second.rig, SHA-256 " + two.content_hash()));
  rig::SessionStore(first, rig::SessionStore::Mode::append).add_result("range", result.dump());
  const nlohmann::json conditions =
      rig::make_certificate(rig::SessionStore(first, rig::SessionStore::Mode::read), first).at("conditions");
  const std::string captures = " (" + std::to_string(two.recording()->captures().size()) + " captures)";
  CHECK_THAT(conditions.dump(), Catch::Contains("Recordings of the result range") &&
                                    Catch::Contains("second.rig" + captures) &&
                                    Catch::Contains("are of the session that keeps it"));
}

TEST_CASE("where the lidar sits on its stage is part of a range error's uncertainty, along the beam") {
  const TestFolder place;
  const std::string file = place / "board.rig";
  {
    rig::SessionStore store(file, rig::SessionStore::Mode::create);
    set_bench(store, R"({"x_mm":{"value":0,"u":15},"y_mm":{"value":0,"u":40},"yaw_deg":0})",
              R"({"name":"board","from_mm":[1400,-200],"to_mm":[1400,200],"u_mm":2,"u_deg":0.1})");
    fit::CaptureInfo info;
    info.step = "capture 2[beam_deg=0]", info.target = "board";
    info.first_step = info.last_step = 540;
    add_capture(store, info, 200, [](int i, int) {
      return Echo{static_cast<std::uint16_t>(1400 + i % 3), 1500};
    });
  }
  const rig::SessionStore session(file, rig::SessionStore::Mode::read);
  const nlohmann::json result = rig::run_fit("range", {{file, &session}}, nlohmann::json::object());
  // The board is square on the stage's zero: 15 mm along the beam count and 40 mm across it do not.
  CHECK(value_of(result, "error_at_1400_mm").at("u").get<double>() ==
        Approx(std::hypot(15, 2)).epsilon(0.01));
  CHECK(result.at("tables").at(0).at("rows").at(0).at(0) == "step 2, beam 0 deg");
  CHECK_THAT(result.at("budget").dump(), Catch::Contains("lidar's place on the stage"));
  CHECK_THAT(result.at("notes").dump(), Catch::Contains("calibrate it first"));
}

/// A wall measured at these places, in a session whose bench file has it at others.
void set_ladder(const std::string& file, const std::vector<double>& stated_mm,
                const std::vector<double>& true_mm) {
  rig::SessionStore store(file, rig::SessionStore::Mode::create);
  set_bench(store, R"({"x_mm":0,"y_mm":0,"yaw_deg":0})",
            R"({"name":"wall","from_mm":[500,-300],"to_mm":[500,300],"u_mm":1,"u_deg":0.1})");
  for (std::size_t i = 0; i < stated_mm.size(); ++i) {
    fit::CaptureInfo info;
    info.step = "wall " + std::to_string(i), info.target = "wall", info.target_shift_mm = stated_mm[i] - 500;
    info.first_step = 536, info.last_step = 544;
    const auto mm = static_cast<std::uint16_t>(std::lround(true_mm[i] * 1.004 + 6));
    add_capture(store, info, 100, [&](int scan, int) {
      return Echo{static_cast<std::uint16_t>(mm + scan % 3 - 1), static_cast<std::uint16_t>(2e6 / mm)};
    });
  }
}

TEST_CASE("a distance that is wrong is told, on the terminal before any figure, though it bends the curve") {
  const TestFolder place;
  const std::vector<double> few = {500, 700, 1000, 1600, 2000, 3000},
                            many = {400, 500, 600, 700, 850, 1000, 1200, 1400, 1600, 2000, 2500, 3000};
  const bool of_few = GENERATE(true, false);
  const std::vector<double>& stated_mm = of_few ? few : many;
  const auto fitted = [&](const std::string& file, double wrong_by_mm) {
    std::vector<double> true_mm = stated_mm;
    true_mm[true_mm.size() - 3] += wrong_by_mm;
    set_ladder(file, stated_mm, true_mm);
    const rig::SessionStore session(file, rig::SessionStore::Mode::read);
    return rig::run_fit("range", {{file, &session}}, nlohmann::json::object());
  };
  const nlohmann::json right = fitted(place / "right.rig", 0),
                       wrong = fitted(place / "wrong.rig", of_few ? -100 : 40);
  CHECK(right.value("contradictions", nlohmann::json::array()).empty());
  CHECK_THAT(wrong.at("contradictions").dump(),
             Catch::Contains(of_few ? "a target stood elsewhere than stated" : "step 9 lies 39."));
  const std::string text = rig::to_text(wrong);
  CHECK(text.find("DOUBTFUL: ") < text.find("Range error at"));
}

TEST_CASE(
    "a lidar that warms up while it is calibrated is told so, and its first mean is as uncertain as that") {
  const TestFolder place;
  const auto fitted = [&](const std::string& file, double warm_up_mm) {
    rig::SessionStore store(file, rig::SessionStore::Mode::create);
    set_bench(store, R"({"x_mm":0,"y_mm":0,"yaw_deg":0})",
              R"({"name":"wall","from_mm":[500,-300],"to_mm":[500,300],"u_mm":0.1})");
    std::mt19937_64 random(8);
    std::normal_distribution<double> normal;
    for (int i = 0; i < 8; ++i) {
      fit::CaptureInfo info;
      info.step = "step " + std::to_string(i + 1);
      info.target = "wall", info.target_shift_mm = 300.0 * i;
      info.first_step = info.last_step = 540;
      add_capture(store, info, 2000, [&](int scan, int) {
        const double before = std::exp(-(2000 * i + scan) / 3000.0);  // 75 s
        return Echo{
            static_cast<std::uint16_t>(std::lround(500 + 300 * i - warm_up_mm * before + 4 * normal(random))),
            1000};
      });
    }
    return rig::run_fit("range", {{file, &store}}, nlohmann::json::object());
  };
  const nlohmann::json steady = fitted(place / "steady.rig", 0), cold = fitted(place / "cold.rig", 12);
  CHECK(steady.dump().find("drift within") == std::string::npos);
  CHECK_THAT(cold.at("contradictions").dump(),
             Catch::Contains("drift within the captures, most surely in step, step 1: by"));
  CHECK_THAT(cold.at("contradictions").dump(), Catch::Contains("Let the lidar warm up, and measure again"));
  CHECK(value_of(steady, "error_at_500_mm").at("u").get<double>() < 0.2);
  CHECK(value_of(cold, "error_at_500_mm").at("u").get<double>() > 1);
  CHECK_THAT(cold.at("budget").dump(), Catch::Contains("drift within the capture"));
}

TEST_CASE("a surface that comes back to its place shows that the lidar drifted meanwhile") {
  const TestFolder place;
  const auto measured = [&](const std::string& file, double drift_mm) {
    auto made = std::make_unique<rig::SessionStore>(file, rig::SessionStore::Mode::create);
    rig::SessionStore& store = *made;
    set_bench(store, R"({"x_mm":0,"y_mm":0,"yaw_deg":0})",
              R"({"name":"wall","from_mm":[500,-300],"to_mm":[500,300],"u_mm":0.3})");
    std::mt19937_64 random(9);
    std::normal_distribution<double> normal;
    for (int i = 0; i < 7; ++i) {
      fit::CaptureInfo info;
      const int rung = i < 6 ? i : 0;
      info.step = i < 6 ? "capture 3.2[rung=" + std::to_string(i) + "]" : "capture 4.2[surface=paper again]";
      info.target = "wall", info.target_shift_mm = 300.0 * rung, info.reflectance = 0.85;
      info.first_step = info.last_step = 540;
      // Between the captures, none of which shows it.
      add_capture(store, info, 500, [&](int, int) {
        return Echo{
            static_cast<std::uint16_t>(std::lround(500 + 300 * rung + drift_mm * i / 6 + 4 * normal(random))),
            1000};
      });
    }
    return made;
  };
  const auto fitted = [&](const std::string& file, double drift_mm) {
    return rig::run_fit("range", {{file, measured(file, drift_mm).get()}}, nlohmann::json::object());
  };
  CHECK(fitted(place / "steady.rig", 0).value("contradictions", nlohmann::json::array()).empty());
  CHECK_THAT(
      fitted(place / "cold.rig", 4).at("contradictions").dump(),
      Catch::Contains("Two captures of reflectance 0.85 at 500 mm differ: step 4.2, paper again reads") &&
          Catch::Contains(" mm farther than step 3.2, rung 0, U = "));
  CHECK_THAT(fitted(place / "other-way.rig", -4).at("contradictions").dump(),
             Catch::Contains(" mm nearer than ") && !Catch::Contains("reads -"));
  const auto one = measured(place / "one.rig", 4), other = measured(place / "other.rig", 0);
  const nlohmann::json both =
      rig::run_fit("range", {{place / "one.rig", one.get()}, {place / "other.rig", other.get()}},
                   nlohmann::json::object());
  CHECK_THAT(both.at("contradictions").dump(), Catch::Contains("differ: one.rig, step 4.2"));
}

TEST_CASE("a target that is moved while the stage stands shows no edge") {
  const TestFolder place;
  const std::string file = place / "ladder.rig";
  set_ladder(file, {500, 700, 1000, 1600}, {500, 700, 1000, 1600});
  const rig::SessionStore session(file, rig::SessionStore::Mode::read);
  CHECK_THROWS_WITH(rig::run_fit("sensitivity", {{file, &session}}, nlohmann::json::object()),
                    Catch::Contains("no beam passes an edge"));
}

TEST_CASE("a target that steps back beside the square beam is reported, and its face alone is used") {
  const TestFolder place;
  const std::string file = place / "stepped.rig";
  {
    rig::SessionStore store(file, rig::SessionStore::Mode::create);
    set_bench(store, R"({"x_mm":0,"y_mm":0,"yaw_deg":0})",
              R"({"name":"wall","from_mm":[1000,-600],"to_mm":[1000,600],"u_mm":1,"u_deg":5})");
    std::mt19937 random(3);
    std::normal_distribution<double> noise(0, 6);
    for (int c = 0; c < 4; ++c) {
      fit::CaptureInfo info;
      info.step = "wall " + std::to_string(c), info.target = "wall", info.target_shift_mm = 100.0 * c;
      info.first_step = 300, info.last_step = 780;
      const auto id = store.begin_capture(info);
      for (int i = 0; i < 60; ++i) {
        std::vector<std::uint16_t> range;
        for (int k = 300; k <= 780; ++k) {
          const double direction = (k - 540) * 0.25 * fit::rad_per_deg, face = 1000 + 100.0 * c;
          const bool beyond = face * std::tan(direction) > 250;
          range.push_back(static_cast<std::uint16_t>(
              std::lround((face + (beyond ? 80 : 0)) / std::cos(direction) + noise(random))));
        }
        fit::ScanView scan;
        scan.seq = i, scan.host_us = 25000 * i, scan.range_mm = range;
        store.add_scan(id, scan);
      }
      store.commit_capture(id);
    }
  }
  const rig::SessionStore session(file, rig::SessionStore::Mode::read);
  const nlohmann::json result = rig::run_fit("range", {{file, &session}}, nlohmann::json::object());
  CHECK_THAT(result.at("notes").dump(), Catch::Contains("is not one flat face") &&
                                            Catch::Contains("to the left") &&
                                            Catch::Contains("mm farther away"));
  // As one wall its normal would be turned by 3 deg and more.
  for (const auto& table : result.at("tables"))
    if (table.at("title").get<std::string>().starts_with("The beam"))
      for (const auto& row : table.at("rows")) CHECK(std::abs(row.at(2).get<double>()) < 0.5);
}

TEST_CASE("a flat board is one flat face, whatever noise does to its outermost beam") {
  const TestFolder place;
  const std::string file = place / "flat.rig";
  {
    rig::SessionStore store(file, rig::SessionStore::Mode::create);
    set_bench(store, R"({"x_mm":0,"y_mm":0,"yaw_deg":0})",
              R"({"name":"board","from_mm":[1400,-200],"to_mm":[1400,200],"u_mm":1,"u_deg":0.5})");
    std::mt19937 random(3);
    std::normal_distribution<double> noise(0, 8);
    for (int c = 0; c < 8; ++c) {
      fit::CaptureInfo info;
      info.step = "board " + std::to_string(c), info.target = "board";
      info.first_step = 514, info.last_step = 566;
      add_capture(store, info, 200, [&](int, int beam) {
        const double direction = (beam - 540) * 0.25 * fit::rad_per_deg;
        return Echo{static_cast<std::uint16_t>(std::lround(1400 / std::cos(direction) + noise(random))),
                    1500};
      });
    }
  }
  const rig::SessionStore session(file, rig::SessionStore::Mode::read);
  const nlohmann::json result = rig::run_fit("range", {{file, &session}}, nlohmann::json::object());
  CHECK_THAT(result.at("notes").dump(), !Catch::Contains("not one flat face"));
}

TEST_CASE("a round post is a target for range errors: its nearest point, found by its own echoes") {
  // By the tangent from a point to a circle, as on paper: the post stands a little beside where the bench
  // file says.
  constexpr double error_mm = 8, radius_mm = 60, aside_mm = 1.5, mount_x_mm = 12, pi = 3.14159265358979;
  const TestFolder place;
  const std::string file = place / "post.rig";
  {
    rig::SessionStore store(file, rig::SessionStore::Mode::create);
    set_bench(store,
              R"({"x_mm":{"value":12,"u":0.2},"y_mm":{"value":0,"u":0.2},"yaw_deg":{"value":0,"u":0.2}})",
              R"({"name":"post","centre_mm":[1500,0],"radius_mm":60,"u_mm":1,"u_radius_mm":0.1})");
    std::mt19937 chance(11);
    std::normal_distribution<double> noise(0, 6);
    for (const double shift_mm : {0.0, 500.0, 1000.0, 1500.0}) {
      fit::CaptureInfo info;
      info.step = "capture " + std::to_string(static_cast<int>(shift_mm)), info.target = "post";
      info.target_shift_mm = shift_mm;
      info.first_step = 510, info.last_step = 570;
      const double x = 1500 + shift_mm - mount_x_mm, y = aside_mm;
      add_capture(store, info, 400, [&](int, int step) {
        const double angle = (step - 540) * 0.25 * pi / 180,
                     along = x * std::cos(angle) + y * std::sin(angle),
                     beside = x * std::sin(angle) - y * std::cos(angle);
        const bool hit = std::abs(beside) < radius_mm;
        const double truth =
            hit ? along - std::sqrt(radius_mm * radius_mm - beside * beside) : 6000 / std::cos(angle);
        return Echo{static_cast<std::uint16_t>(std::lround(truth + error_mm + noise(chance))),
                    static_cast<std::uint16_t>(hit ? 1500 : 900)};
      });
    }
  }
  const rig::SessionStore session(file, rig::SessionStore::Mode::read);
  const nlohmann::json result = rig::run_fit("range", {{file, &session}}, nlohmann::json::object());
  int seen = 0;
  for (const nlohmann::json& value : result.at("values")) {
    if (!value.at("name").get<std::string>().starts_with("error_at_")) continue;
    ++seen;
    INFO(value.dump());
    CHECK(std::abs(value.at("value").get<double>() - error_mm) < 1);
    CHECK(std::abs(value.at("value").get<double>() - error_mm) < 2 * value.at("u").get<double>());
    CHECK(value.at("u").get<double>() < 1.5);
  }
  CHECK(seen == 4);
}

}  // namespace range_test
