// SPDX-License-Identifier: MIT
// rig-twin: records a session again from its twin. Every scan of SESSION is made anew by the model engine
// from a bench file (what `rig explain` writes as "bench"), at the same stage angles, times and target
// positions.
#include <SQLiteCpp/SQLiteCpp.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "sim/model_engine.hpp"

namespace {

struct Capture {
  std::int64_t id = 0;
  double starts_s = 0, stage_rad = 0, rate_rad_s = 0;
  int approach = 0, first_step = 0, last_step = 0;
  sim::SceneState scene;
};

std::vector<Capture> captures_of(SQLite::Database& database) {
  std::vector<Capture> captures;
  double power_on_s = 0;
  SQLite::Statement row(database,
                        "SELECT id, started_us, since_power_on_s, stage_deg, stage_rate_deg_s, approach, "
                        "first_step, last_step, target, target_shift_mm, reflectance, temperature_c FROM "
                        "capture ORDER BY started_us, id");
  while (row.executeStep()) {
    Capture c;
    c.id = row.getColumn(0).getInt64();
    const double started_s = static_cast<double>(row.getColumn(1).getInt64()) * 1e-6;
    if (!row.isColumnNull(2)) power_on_s = row.getColumn(2).getDouble() - started_s;
    c.starts_s = power_on_s + started_s;
    c.stage_rad = row.getColumn(3).getDouble() * fit::rad_per_deg;
    c.rate_rad_s = row.getColumn(4).getDouble() * fit::rad_per_deg;
    c.approach = row.getColumn(5).getInt();
    c.first_step = row.getColumn(6).getInt();
    c.last_step = row.getColumn(7).getInt();
    if (!row.isColumnNull(8)) c.scene.target = row.getColumn(8).getString();
    c.scene.target_shift_mm = row.getColumn(9).getDouble();
    if (!row.isColumnNull(10)) c.scene.reflectance = row.getColumn(10).getDouble();
    if (!row.isColumnNull(11)) c.scene.temperature_c = row.getColumn(11).getDouble();
    captures.push_back(c);
  }
  return captures;
}

/// The stage as the session tells it: it reaches every capture's angle from the side that is written down.
class Stage {
 public:
  explicit Stage(const std::vector<Capture>& captures) : captures_(captures) {}
  [[nodiscard]] sim::StageMoment at(double time_s) const {
    std::size_t i = 0;
    while (i + 1 < captures_.size() && time_s >= captures_[i + 1].starts_s - move_s) ++i;
    const Capture& c = captures_[i];
    if (time_s >= c.starts_s) return {c.stage_rad + c.rate_rad_s * (time_s - c.starts_s), c.rate_rad_s};
    const double rate = c.approach * fit::rad_per_deg / move_s;
    return {c.stage_rad + rate * (time_s - c.starts_s), rate};
  }

 private:
  static constexpr double move_s = 0.4;
  const std::vector<Capture>& captures_;
};

std::string text_of(const std::string& path) {
  std::ifstream in(path);
  if (!in) throw std::runtime_error(path + " cannot be read");
  return {std::istreambuf_iterator<char>(in), {}};
}

void record(const std::string& session, const std::string& bench_file, const std::string& out,
            std::uint64_t seed) {
  std::filesystem::copy_file(session, out, std::filesystem::copy_options::overwrite_existing);
  SQLite::Database database(out, SQLite::OPEN_READWRITE);
  const fit::Bench bench = fit::parse_bench(text_of(bench_file), bench_file);
  const auto engine = sim::make_model_engine(bench, seed);
  const std::vector<Capture> captures = captures_of(database);
  const Stage stage(captures);
  std::vector<std::uint32_t> range(static_cast<std::size_t>(bench.lidar.steps)), intensity(range.size());
  SQLite::Transaction transaction(database);
  SQLite::Statement update(database,
                           "UPDATE scan SET range_mm = ?, intensity = ? WHERE capture = ? AND seq = ?");
  std::string moved;
  for (const Capture& capture : captures) {
    if (!moved.empty() && moved != capture.scene.target) {
      sim::SceneState back = capture.scene;
      back.target = moved;
      back.target_shift_mm = 0;
      back.reflectance = -1;
      engine->set_scene(back);
    }
    engine->set_scene(capture.scene);
    moved = capture.scene.target;
    SQLite::Statement scans(database,
                            "SELECT seq, host_us - (SELECT started_us FROM capture WHERE id = scan.capture) "
                            "FROM scan WHERE capture = ? ORDER BY seq");
    scans.bind(1, capture.id);
    while (scans.executeStep()) {
      engine->scan(
          capture.starts_s + static_cast<double>(scans.getColumn(1).getInt64()) * 1e-6,
          [&](double time_s) { return stage.at(time_s); }, range, intensity);
      std::vector<std::uint16_t> r, i;
      for (int step = capture.first_step; step <= capture.last_step; ++step) {
        const std::uint32_t value = range[static_cast<std::size_t>(step)];
        r.push_back(value <= 4 || value >= 65000 ? std::uint16_t{0} : static_cast<std::uint16_t>(value));
        i.push_back(static_cast<std::uint16_t>(intensity[static_cast<std::size_t>(step)]));
      }
      update.reset();
      update.bind(1, r.data(), static_cast<int>(2 * r.size()));
      update.bind(2, i.data(), static_cast<int>(2 * i.size()));
      update.bind(3, capture.id);
      update.bind(4, scans.getColumn(0).getInt64());
      update.exec();
    }
  }
  transaction.commit();
}

}  // namespace

int main(int argc, char** argv) {
  const bool asks_for_help = argc == 2 && std::string(argv[1]) == "--help";
  if (argc < 4) {
    std::fputs(
        "usage: rig-twin SESSION.rig BENCH.json OUT.rig [SEED]\n"
        "Records SESSION.rig again, as the bench file says that it would be.\n",
        asks_for_help ? stdout : stderr);
    return asks_for_help ? 0 : 2;
  }
  try {
    record(argv[1], argv[2], argv[3], argc > 4 ? std::stoull(argv[4]) : 1);
    return 0;
  } catch (const std::exception& problem) {
    std::fprintf(stderr, "rig-twin: %s\n", problem.what());
    return 1;
  }
}
