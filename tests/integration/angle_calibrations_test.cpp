// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>

#include "fit/numeric/angle.hpp"
#include "rig/fitting/fitting.hpp"
#include "rig/report/certificate.hpp"
#include "rig/report/certificate_page.hpp"
#include "sim/simple_engine.hpp"
#include "tests/support/results.hpp"
#include "tests/support/test_folder.hpp"

namespace angle_calibrations_test {
namespace {

constexpr double deg = fit::rad_per_deg;

/// The demo's bench: true centre (-1.63, -12.65) mm, window 0.05 deg.
constexpr const char* bench_text = R"({
  "schema": "bench/1",
  "lidar": {"model": "UST-10LX", "steps": 1081, "front_step": 540, "step_deg": 0.25, "scan_hz": 40,
            "accuracy": {"u_beam_eccentricity_deg": 0, "u_range_mm": 0, "u_range_scale": 0, "u_range_walk_mm": 0},
            "mount": {"x_mm": {"value": 0, "u": 10}, "y_mm": {"value": 0, "u": 10}, "yaw_deg": {"value": 0, "u": 0.3}}},
  "stage": {"resolution_deg": 0.01, "accuracy": {"u_scale": 0, "u_eccentricity_deg": 0, "u_backlash_deg": 0}},
  "targets": [{"name": "board", "from_mm": [1400, -200], "to_mm": [1400, 200], "u_mm": 1, "u_deg": 0.1},
              {"name": "background", "from_mm": [2200, -1200], "to_mm": [2200, 1200], "u_mm": 5, "u_deg": 0.1}]
})";

class Session {
 public:
  enum class Bench {
    as_stated,
    imperfect  ///< As far as its file's uncertainties say: the board's place, and every stop of the stage.
  };

  Session(const std::string& name, unsigned seed, Bench kind = Bench::as_stated)
      : path_(folder_ / (name + std::to_string(seed) + ".rig")) {
    constexpr double window_deg = 0.05;
    fit::Bench truth = fit::parse_bench(bench_text);
    truth.lidar.mount = {{1.63}, {12.65}, {0}};
    if (kind == Bench::imperfect) {
      rounding_.emplace(seed);
      fit::Target& board = truth.targets[0];
      std::normal_distribution<double> shift_mm(0, 1), turn_deg(0, 0.1);
      const double shift = shift_mm(*rounding_), turned = std::tan(turn_deg(*rounding_) * deg);
      for (Eigen::Vector2d* end : {&board.from_mm, &board.to_mm}) end->x() += shift - turned * end->y();
    }
    sim::SimpleOptions options;
    options.edge_window_rad = window_deg * deg;
    engine_ = std::make_unique<sim::SimpleEngine>(truth, options, seed);
    store_ = std::make_unique<rig::SessionStore>(path_, rig::SessionStore::Mode::create);
    store_->set("bench", bench_text);
  }

  /// The stage stands where it was told to but for `off_deg`, and came there by `approach`.
  void capture(double stage_deg, int first_step, int last_step, long scans) {
    fit::CaptureInfo info;
    info.step = "edge";
    info.stage_rad = stage_deg * deg;
    info.approach = approach;
    info.target = "board";
    info.first_step = first_step, info.last_step = last_step;
    const auto id = store_->begin_capture(info);
    const double stands_deg =
        stage_deg + off_deg +
        (rounding_ ? std::uniform_real_distribution<double>(-0.005, 0.005)(*rounding_) : 0);
    std::vector<std::uint32_t> range(1081), intensity(1081);
    for (long seq = 0; seq < scans; ++seq) {
      engine_->scan(
          static_cast<double>(seq) * 0.025,
          [&](double) {
            return sim::StageMoment{stands_deg * deg, 0};
          },
          range, intensity);
      std::vector<std::uint16_t> r, i;
      for (int k = first_step; k <= last_step; ++k) {
        const std::uint32_t value = range[static_cast<std::size_t>(k)];
        r.push_back(value > 65000 || value < 20 ? std::uint16_t{0} : static_cast<std::uint16_t>(value));
        i.push_back(static_cast<std::uint16_t>(intensity[static_cast<std::size_t>(k)]));
      }
      store_->add_scan(id, {seq, seq * 25, seq * 25000, r, i, {}});
    }
    store_->commit_capture(id);
  }

  /// The stage angle, in hundredths of a degree, next to where the beam meets the board's right edge.
  static double near_edge_deg(int step) {
    const double beam = (step - 540) * 0.25 * deg;
    double stage = 0;
    for (int i = 0; i < 20; ++i) {
      const double x = 1400 - (std::cos(stage) * 1.63 - std::sin(stage) * 12.65);
      const double y = -200 - (std::sin(stage) * 1.63 + std::cos(stage) * 12.65);
      stage = std::atan2(y, x) - beam;
    }
    return std::round(stage / deg * 100) / 100;
  }
  void follow_edge(int step, int stops_each_side, long scans) {
    const double middle = near_edge_deg(step);
    for (int i = -stops_each_side; i <= stops_each_side; ++i)
      capture(middle + 0.01 * i, step - 8, step + 8, scans);
  }
  nlohmann::json fit(const std::string& kind) {
    return rig::run_fit(kind, {{path_, store_.get()}}, nlohmann::json::object());
  }
  int approach = 1;
  double off_deg = 0;
  rig::SessionStore& store() { return *store_; }
  const std::string& path() const { return path_; }

 private:
  TestFolder folder_;
  std::string path_;
  std::unique_ptr<sim::SimpleEngine> engine_;
  std::optional<std::mt19937> rounding_;
  std::unique_ptr<rig::SessionStore> store_;
};

/// Four positions, turned by 54, 119 and 34.5 deg from one to the next.
void measure_centre(Session& session, long stop_scans, long scans) {
  for (const int step : {908, 692, 216, 78}) {
    session.follow_edge(step, 4, stop_scans);
    session.capture(Session::near_edge_deg(step) + 0.04, step - 8, step + 8, scans);
  }
}

}  // namespace

TEST_CASE(
    "angular sensitivity: the simulated device's window of 0.05 deg is found, with a table like the "
    "paper's") {
  Session session("sensitivity", 1);
  session.follow_edge(560, 12, 1000);
  const auto result = session.fit("sensitivity");
  const fit::Estimate window = value_of(result, "window_deg");
  CHECK(std::abs(window.value - 0.05) < 0.01);
  CHECK(std::abs(window.value - 0.05) < 3 * window.u);
  // Each of some five stops within the window is off by the stage's resolution, 0.003 deg of standard
  // deviation.
  CHECK(window.u < 0.006);
  CHECK(value_of(result, "window_counted_deg").value == Approx(0.05).margin(0.0101));
  CHECK(result.at("tables").at(0).at("rows").size() >= 10);
  session.store().add_result("sensitivity", result.dump());
  CHECK(rig::to_html(rig::make_certificate(session.store(), session.path())).find("Edge transition width") !=
        std::string::npos);
}

TEST_CASE("rotation centre: four positions give it within its stated uncertainty, below 0.5 mm") {
  Session session("centre", 1);
  measure_centre(session, 300, 2000);
  const auto result = session.fit("centre");
  const fit::Estimate x = value_of(result, "centre_x_mm"), y = value_of(result, "centre_y_mm");
  INFO(result.at("tables").dump(1));
  CHECK(std::abs(x.value + 1.63) < 3 * x.u);
  CHECK(std::abs(y.value + 12.65) < 3 * y.u);
  CHECK(2 * x.u < 0.5);
  CHECK(2 * y.u < 0.5);
  // 0.01 deg over the square root of 12 moves the edge by 0.07 mm at 1.4 m.
  double squares = 0, resolution = 0;
  for (const auto& line : result.at("budget")) {
    if (line.at("quantity") != "centre_x_mm" || line.at("kind") == "combined") continue;
    squares += std::pow(line.at("u").get<double>(), 2);
    if (line.at("source").get<std::string>().starts_with("resolution")) resolution = line.at("u");
  }
  CHECK(std::sqrt(squares) == Approx(x.u).epsilon(1e-6));
  CHECK(resolution > 0.02);
  CHECK(resolution < 0.15);
  CHECK(result.at("tables").at(2).at("rows").size() == 7);  // Six pairs and the paper's mean of three.
}

namespace {

/// Errors in units of their standard uncertainty. Uncertainties that are too small or too large show: of
/// normal errors 95 % are below 2, and their mean is 0.80.
struct Errors {
  int below_2 = 0, count = 0;
  double sum = 0;
  void add(const fit::Estimate& found, double truth) {
    const double error = std::abs(found.value - truth) / found.u;
    below_2 += error < 2;
    ++count;
    sum += error;
  }
  [[nodiscard]] double mean() const { return sum / count; }
};

}  // namespace

TEST_CASE("rotation centre and window: over 50 seeds errors are about as large as their uncertainties say") {
  Errors in_x, in_y, in_window;
  constexpr unsigned seeds = 50;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    Session session("coverage", seed, Session::Bench::imperfect);
    measure_centre(session, 100, 300);
    const auto centre = session.fit("centre"), sensitivity = session.fit("sensitivity");
    in_x.add(value_of(centre, "centre_x_mm"), -1.63);
    in_y.add(value_of(centre, "centre_y_mm"), -12.65);
    in_window.add(value_of(sensitivity, "window_deg"), 0.05);
  }
  for (const Errors& errors : {in_x, in_y, in_window}) {
    WARN("covered: " << errors.below_2 << " of " << seeds << ", mean of |error|/u " << errors.mean());
    // 50 draws of 95 % lie within 44 .. 50 in 99 % of all cases; from above only their size can be judged.
    // The centre's x is stated about twice as uncertain as it is here.
    CHECK(errors.below_2 >= 44);
    CHECK(errors.mean() > 0.35);
    CHECK(errors.mean() < 1.1);
  }
}

TEST_CASE("backlash: over 50 seeds errors are about as large as their uncertainties say") {
  Errors errors;
  constexpr unsigned seeds = 50;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    std::mt19937 random(seed);
    // From either side the stage stops where its resolution of 0.01 deg lets it.
    std::uniform_real_distribution<double> play_deg(0, 0.06), rounding_deg(-0.005, 0.005);
    const double play = play_deg(random);
    Session session("backlash", seed);
    for (const int approach : {1, -1}) {
      session.approach = approach;
      session.off_deg = -approach * play / 2 + rounding_deg(random);
      session.follow_edge(560, 9, 100);
    }
    errors.add(value_of(session.fit("sensitivity"), "backlash_deg"), play);
  }
  WARN("covered: backlash " << errors.below_2 << " of " << seeds << ", mean of |error|/u " << errors.mean());
  CHECK(errors.below_2 >= 44);
  CHECK(errors.mean() > 0.5);
  CHECK(errors.mean() < 1.1);
}

TEST_CASE("a session without an edge says what is missing") {
  Session session("nothing", 1);
  session.capture(0, 500, 580, 20);
  CHECK_THROWS_WITH(session.fit("sensitivity"), Catch::Contains("no beam passes an edge of 'board'"));
  session.follow_edge(560, 8, 100);
  CHECK_THROWS_WITH(session.fit("centre"), Catch::Contains("at least two stage angles"));
}

}  // namespace angle_calibrations_test
