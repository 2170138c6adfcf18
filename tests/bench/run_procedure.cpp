// SPDX-License-Identifier: MIT
// A whole run over real sockets and a pseudo-terminal, the simulator on a thread of its own: how much longer
// than its physics a procedure takes, how many stops an edge search saves, and how fast scans reach the
// session.
#include <SQLiteCpp/SQLiteCpp.h>
#include <benchmark/benchmark.h>
#include <sys/resource.h>
#include <unistd.h>

#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/asio/write.hpp>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "fit/range/edge.hpp"
#include "lidar/response.hpp"
#include "rig/runner/operators.hpp"
#include "rig/runner/runner.hpp"
#include "rig/runner/scip_source.hpp"
#include "rig/stage/stage_factory.hpp"
#include "sim/pty_port.hpp"
#include "sim/scip_server.hpp"
#include "sim/simple_engine.hpp"
#include "sim/stage_device.hpp"

namespace {

namespace asio = boost::asio;

fit::Bench board_bench() {
  return fit::parse_bench(R"({"schema": "bench/1", "lidar": {"model": "UST-10LX"},
    "stage": {"language": "zaber", "limits_deg": [-170, 170], "speed_deg_s": 20},
    "targets": [{"name": "board", "from_mm": [1400, -200], "to_mm": [1400, 200]},
                {"name": "background", "from_mm": [2200, -900], "to_mm": [2200, 900]}],
    "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": 5}}]})");
}

/// Both simulated devices, served by a thread of their own.
class SimThread {
 public:
  explicit SimThread(double speed = sim::SimClock::max_speed)
      : bench_(board_bench()),
        clock_(speed),
        engine_(std::make_shared<sim::SimpleEngine>(bench_, sim::simple_options(bench_), 1)) {
    sim::StageDeviceOptions options;
    options.physics = sim::usual_stage_physics("zaber");
    options.physics.speed_deg_s = 20;
    options.homed = true;
    physics_ = options.physics;
    stage_ = sim::make_stage_device(options);
    lidar_ =
        std::make_unique<sim::UstDevice>(bench_.lidar, sim::UstIdentity(), engine_,
                                         [this](double time_s) { return stage_->mechanics().truth(time_s); });
    server_ =
        std::make_unique<sim::ScipServer>(io_.get_executor(), sim::ScipServer::Options(), clock_, *lidar_);
    port_ = std::make_unique<sim::PtyPort>(io_.get_executor(), *stage_, clock_, sim::PtyPort::Options());
    path_ = port_->path();
    lidar_port_ = server_->port();
    thread_ = std::thread([this] { io_.run(); });
  }
  ~SimThread() {
    asio::post(io_, [this] {
      server_->stop();
      io_.stop();
    });
    thread_.join();
  }
  [[nodiscard]] std::string stage_url() const { return "serial:" + path_ + "?settle_s=0"; }
  [[nodiscard]] rig::Endpoint lidar() const { return {"127.0.0.1", lidar_port_}; }
  [[nodiscard]] const sim::StagePhysics& physics() const { return physics_; }

 private:
  fit::Bench bench_;
  asio::io_context io_{1};
  sim::SimClock clock_;
  std::shared_ptr<sim::SimpleEngine> engine_;
  std::unique_ptr<sim::StageDevice> stage_;
  std::unique_ptr<sim::UstDevice> lidar_;
  std::unique_ptr<sim::ScipServer> server_;
  std::unique_ptr<sim::PtyPort> port_;
  sim::StagePhysics physics_;
  std::string path_;
  std::uint16_t lidar_port_ = 0;
  std::thread thread_;
};

double cpu_s(int who) {
  rusage used{};
  getrusage(who, &used);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

struct Outcome {
  double wall_s = 0;
  double capturing_s = 0;                     ///< From the first scan on, until all is committed.
  double rig_cpu_s = 0, simulator_cpu_s = 0;  ///< Processor time of that.
  std::size_t captures = 0;
  long scans = 0;
  double edge_rad = std::nan(""), edge_u_rad = 0;  ///< Where the middle beam passes the board's end.
};

Outcome run(SimThread& sim, const std::string& steps) {
  static int number = 0;
  const std::string file =
      (std::filesystem::temp_directory_path() /
       ("bench-run-" + std::to_string(getpid()) + "-" + std::to_string(++number) + ".rig"))
          .string();
  const fit::Bench bench = board_bench();
  Outcome outcome;
  {
    rig::SessionStore session(file, rig::SessionStore::Mode::create);
    asio::io_context io(1);
    const auto lidar = rig::make_scip_source(io.get_executor(), sim.lidar());
    const auto clock = rig::make_real_clock();
    const auto person = rig::make_absent_operator();
    std::unique_ptr<rig::Stage> stage;
    auto opening = rig::open_stage(io.get_executor(), sim.stage_url(), rig::StageOptions());
    asio::co_spawn(io, std::move(opening),
                   [&](const std::exception_ptr& why, std::unique_ptr<rig::Stage> opened) {
                     if (why) std::rethrow_exception(why);
                     stage = std::move(opened);
                   });
    io.run();
    io.restart();
    rig::RunnerParts parts{*lidar, *stage, *clock, *person, nullptr, nullptr};
    rig::Runner runner(rig::parse_procedure("procedure: bench\nsteps:\n  - home\n" + steps, "bench.yaml"),
                       bench, session, parts);
    using Clock = std::chrono::steady_clock;
    const auto from = Clock::now();
    Clock::time_point first_scan = from;
    double rig_cpu_s = 0, all_cpu_s = 0;
    runner.observe([&](const rig::RunState& now) {
      if (now.done != 1 || now.unit != "scans" || first_scan != from) return;
      first_scan = Clock::now();
      rig_cpu_s = cpu_s(RUSAGE_THREAD), all_cpu_s = cpu_s(RUSAGE_SELF);
    });
    auto running = runner.run();
    asio::co_spawn(io, std::move(running), [](const std::exception_ptr& why, bool) {
      if (why) std::rethrow_exception(why);
    });
    io.run();
    outcome.wall_s = std::chrono::duration<double>(Clock::now() - from).count();
    outcome.capturing_s = std::chrono::duration<double>(Clock::now() - first_scan).count();
    outcome.rig_cpu_s = cpu_s(RUSAGE_THREAD) - rig_cpu_s;
    outcome.simulator_cpu_s = cpu_s(RUSAGE_SELF) - all_cpu_s - outcome.rig_cpu_s;
    const auto recording = session.recording();
    outcome.captures = recording->captures().size();
    for (std::size_t i = 0; i < outcome.captures; ++i)
      recording->for_each_scan(i, [&](const fit::ScanView&) { ++outcome.scans; });
    if (outcome.captures > 1)
      for (const fit::EdgeCrossing& crossing : fit::find_edge_crossings(*recording))
        if (crossing.step == bench.lidar.front_step && std::isnan(outcome.edge_rad)) {
          outcome.edge_rad = crossing.response.edge_rad.value;
          outcome.edge_u_rad = crossing.response.edge_rad.u;
        }
  }
  std::filesystem::remove(file);
  return outcome;
}

// --- a sweep as in experiment A4: 31 stops, 0.01 deg apart, 1,000 scans each
// ------------------------------------

constexpr int stops = 31, scans_a_stop = 1000;

/// A move from rest to rest.
double move_s(double deg, const sim::StagePhysics& physics) {
  const double ramp_deg = physics.speed_deg_s * physics.speed_deg_s / physics.acceleration_deg_s2;
  if (deg < ramp_deg) return 2 * std::sqrt(deg / physics.acceleration_deg_s2);
  return deg / physics.speed_deg_s + physics.speed_deg_s / physics.acceleration_deg_s2;
}

/// Nothing but the moves, the run-up against the play, and the scans.
double physics_of_sweep_s(const sim::StagePhysics& physics) {
  return stops * scans_a_stop / 40.0 + (stops - 1) * move_s(0.01, physics) + move_s(9.5, physics) +
         move_s(0.5, physics);
}

constexpr int scans_of_probe = 40;

double probe_s(SimThread& sim, int count) {
  const std::string last_deg = std::to_string(10 + 0.01 * (count - 1));
  return run(sim, "  - sweep: {start_deg: 10, stop_deg: " + last_deg + ", step_deg: 0.01, samples: " +
                      std::to_string(scans_of_probe) + ", beams_deg: [-1, 1]}\n  - move: {to_deg: 0}\n")
      .wall_s;
}

/// What a stop takes beyond its move and its scans does not depend on their number: two sweeps at real speed,
/// one of more stops, tell it, and what a run takes once.
void procedure_ours(benchmark::State& state) {
  SimThread sim(1);
  const double limit_s = physics_of_sweep_s(sim.physics());
  double took_s = 0;
  for (auto _ : state) {
    constexpr int few = 3, more = 11;
    const double few_s = probe_s(sim, few), more_s = probe_s(sim, more);
    const double stop_s =
        (more_s - few_s) / (more - few) - scans_of_probe / 40.0 - move_s(0.01, sim.physics());
    const double once_s = few_s - few * (stop_s + scans_of_probe / 40.0) - 2 * move_s(9.5, sim.physics()) -
                          move_s(0.5, sim.physics());
    took_s = limit_s + stops * stop_s + once_s;
    state.SetIterationTime(took_s);
    state.counters["a_stop_s"] = stop_s;
    state.counters["once_s"] = once_s;
  }
  state.counters["over_limit_percent"] = 100 * (took_s / limit_s - 1);
  state.counters["goal"] = 0.99;
}

void procedure_limit(benchmark::State& state) {
  sim::StagePhysics physics = sim::usual_stage_physics("zaber");
  physics.speed_deg_s = 20;
  for (auto _ : state) state.SetIterationTime(physics_of_sweep_s(physics));
}

// --- finding an edge to 0.01 deg within 3 deg to both sides
// -----------------------------------------------------

constexpr double edge_step_deg = 0.01;

/// Time at a real lidar's pace; stops; and the edge's angle by the same fit, whatever the stops.
Outcome find_edge(benchmark::State& state, const std::string& steps) {
  SimThread sim;
  Outcome outcome;
  for (auto _ : state) {
    outcome = run(sim, steps);
    state.SetIterationTime(static_cast<double>(outcome.scans) / 40);
  }
  state.counters["stops"] = static_cast<double>(outcome.captures);
  state.counters["edge_deg"] = outcome.edge_rad * fit::deg_per_rad;
  state.counters["u_deg"] = outcome.edge_u_rad * fit::deg_per_rad;
  return outcome;
}

/// To see that it runs (scripts/bench --quick), a sweep close to the edge is enough.
const bool quick = std::getenv("RIG_BENCH_QUICK") != nullptr;
const std::string sweep_over_edge =
    std::string("  - sweep: {") +
    (quick ? "start_deg: -8.4, stop_deg: -7.9" : "start_deg: -11, stop_deg: -5") +
    ", step_deg: 0.01, samples: 100, beams_deg: [-0.25, 0.25]}\n";

/// The last sweep over the edge, which takes the longest of all here.
std::optional<Outcome> swept;

void edge_ours(benchmark::State& state) {
  const Outcome found = find_edge(state,
                                  "  - find-edge: {target: board, beam_deg: 0, search_deg: 3, samples: 100, "
                                  "step_deg: 0.01, spread: 1}\n");
  if (!swept) {
    SimThread sim;
    swept = run(sim, sweep_over_edge);
  }
  const double apart_deg = std::abs(found.edge_rad - swept->edge_rad) * fit::deg_per_rad;
  if (!(apart_deg < edge_step_deg))
    state.SkipWithError(("the sweep has another answer: " + std::to_string(apart_deg)).c_str());
  state.counters["apart_deg"] = apart_deg;
  if (!quick) state.counters["goal"] = 20;
}

void edge_sweep(benchmark::State& state) { swept = find_edge(state, sweep_over_edge); }

// --- scans from the simulator's socket into the session, whole field of view with intensity
// ---------------------

constexpr int many = 20000;

void throughput_ours(benchmark::State& state) {
  SimThread sim;
  for (auto _ : state) {
    const Outcome outcome = run(sim, "  - capture: {samples: " + std::to_string(many) + "}\n");
    if (outcome.scans != many) state.SkipWithError("scans are missing");
    state.SetIterationTime(outcome.capturing_s);
    state.counters["rig_cpu_us"] = 1e6 * outcome.rig_cpu_s / many;
    state.counters["simulator_cpu_us"] = 1e6 * outcome.simulator_cpu_s / many;
  }
  state.SetItemsProcessed(state.iterations() * many);
  state.counters["items_per_second at least"] = 20000;
  state.counters["goal_slowest"] = 0.5;
}

lidar::ScanData some_scan(std::vector<std::uint32_t>& range, std::vector<std::uint32_t>& intensity) {
  range.assign(1081, 1400);
  intensity.assign(1081, 2000);
  lidar::ScanData data;
  data.range_mm = range;
  data.intensity = intensity;
  return data;
}

/// The same bytes through loopback, from a thread that only sends to one that only receives.
void throughput_of_loopback(benchmark::State& state) {
  std::vector<std::uint32_t> range, intensity;
  std::string block;
  constexpr int scans_in_block = 10;
  for (int i = 0; i < scans_in_block; ++i)
    append_scan_response(block, "ME0000108001000;r1", "99", lidar::ScanCommand(),
                         some_scan(range, intensity));
  asio::io_context io;
  asio::ip::tcp::acceptor acceptor(io, {asio::ip::address_v4::loopback(), 0});
  for (auto _ : state) {
    std::thread source([&] {
      asio::ip::tcp::socket socket = acceptor.accept();
      for (int i = 0; i < many; i += scans_in_block) asio::write(socket, asio::buffer(block));
    });
    asio::ip::tcp::socket socket(io);
    socket.connect(acceptor.local_endpoint());
    std::vector<char> buffer(64 * 1024);
    for (std::size_t left = block.size() * many / scans_in_block; left > 0;)
      left -= socket.read_some(asio::buffer(buffer.data(), std::min(left, buffer.size())));
    source.join();
  }
  state.SetItemsProcessed(state.iterations() * many);
}

/// The same bytes into a table of SQLite's, one transaction, as safe on the disk as a capture's.
void throughput_of_sqlite(benchmark::State& state) {
  const std::string file =
      (std::filesystem::temp_directory_path() / ("bench-sqlite-" + std::to_string(getpid()) + ".db"))
          .string();
  std::vector<std::uint16_t> range(1081, 1400), intensity(1081, 2000);
  for (auto _ : state) {
    state.PauseTiming();
    for (const char* ending : {"", "-wal", "-shm"}) std::filesystem::remove(file + ending);
    SQLite::Database database(file, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    database.exec("PRAGMA page_size = 32768; PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL");
    database.exec("CREATE TABLE scan(seq INTEGER PRIMARY KEY, range BLOB, intensity BLOB)");
    state.ResumeTiming();
    database.exec("BEGIN");
    SQLite::Statement insert(database, "INSERT INTO scan VALUES(?, ?, ?)");
    for (int i = 0; i < many; ++i) {
      insert.reset();
      insert.bind(1, i);
      insert.bindNoCopy(2, range.data(), static_cast<int>(2 * range.size()));
      insert.bindNoCopy(3, intensity.data(), static_cast<int>(2 * intensity.size()));
      insert.exec();
    }
    insert.reset();
    database.exec("COMMIT");
  }
  for (const char* ending : {"", "-wal", "-shm"}) std::filesystem::remove(file + ending);
  state.SetItemsProcessed(state.iterations() * many);
}

BENCHMARK(procedure_ours)
    ->Name("time of a procedure/ours")
    ->UseManualTime()
    ->Iterations(1)
    ->Unit(benchmark::kSecond);
BENCHMARK(procedure_limit)
    ->Name("time of a procedure/limit:moves and scans")
    ->UseManualTime()
    ->Iterations(1)
    ->Unit(benchmark::kSecond);
BENCHMARK(edge_ours)
    ->Name("edge search to 0.01 deg/ours")
    ->UseManualTime()
    ->Iterations(1)
    ->Unit(benchmark::kSecond);
BENCHMARK(edge_sweep)
    ->Name("edge search to 0.01 deg/rival:sweeping every 0.01 deg")
    ->UseManualTime()
    ->Iterations(1)
    ->Unit(benchmark::kSecond);
BENCHMARK(throughput_ours)
    ->Name("simulator to session, full ME scans/ours")
    ->UseManualTime()
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);
BENCHMARK(throughput_of_loopback)
    ->Name("simulator to session, full ME scans/limit:loopback")
    ->UseRealTime()
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);
BENCHMARK(throughput_of_sqlite)
    ->Name("simulator to session, full ME scans/limit:sqlite")
    ->UseRealTime()
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
