// SPDX-License-Identifier: MIT
#include <CLI/CLI.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "sim/engine_factory.hpp"
#include "sim/faults.hpp"
#include "sim/operator_port.hpp"
#include "sim/pty_port.hpp"
#include "sim/scip_server.hpp"
#include "sim/stage_bench.hpp"
#include "sim/ust_device.hpp"
#include "sim/world.hpp"

namespace {

struct Options {
  sim::EngineChoice choice;
  std::string conceal_file, speed = "real", listen = "127.0.0.1", stage_link, stage_language;
  std::vector<std::string> faults, fault_files;
  std::uint16_t lidar_port = 10940, operator_port = 0;
  double clock_ppm = 50, scan_period_ms = 25;
};

double speed_factor(const std::string& text) {
  if (text == "real") return 1;
  if (text == "max") return sim::SimClock::max_speed;
  std::size_t used = 0;
  double factor = 0;
  try {
    factor = std::stod(text, &used);
  } catch (const std::exception&) {
    used = 0;
  }
  if (used != text.size() || !(factor > 0) || factor > 1e6)
    throw std::invalid_argument("--speed takes real, max or a factor such as 10, not '" + text + "'");
  return factor;
}

/// Writes what the operator of a world would know.
int conceal(const Options& options) {
  std::ofstream out(options.conceal_file);
  out << sim::compile_world(sim::load_world(options.choice.world_file)) << '\n';
  if (!out.flush()) throw std::runtime_error("cannot write " + options.conceal_file);
  return 0;
}

/// What the driver must know and the bench file may not say.
std::string stage_url(const std::string& path, const Options& options, bool at_max_speed) {
  std::string url = "serial:" + path;
  if (at_max_speed) url += "?settle_s=0";
  if (!options.stage_language.empty())
    url += (at_max_speed ? "&" : "?") + ("language=" + options.stage_language);
  return url;
}

sim::UstIdentity identity_of(const fit::LidarGeometry& lidar, const Options& options) {
  sim::UstIdentity identity;
  identity.model = lidar.model;
  if (!lidar.serial.empty()) identity.serial = lidar.serial;
  identity.clock_ppm = options.clock_ppm;
  identity.scan_period_s = options.scan_period_ms / 1e3;
  return identity;
}

/// The one line on standard output: where everything is served.
void announce(const Options& options, std::uint16_t lidar_port, const std::string& stage_path,
              std::uint16_t operator_port, bool at_maximum_speed) {
  const nlohmann::ordered_json ready = {
      {"lidar_port", lidar_port},
      {"lidar", "tcp://" + options.listen + ":" + std::to_string(lidar_port)},
      {"stage_port", stage_path},
      {"stage", stage_url(stage_path, options, at_maximum_speed)},
      {"operator_port", operator_port},
      {"operator", options.listen + ":" + std::to_string(operator_port)}};
  std::printf("%s\n", ready.dump().c_str());
  std::fflush(stdout);
}

int serve(const Options& options) {
  const sim::SimulatedBench simulated = sim::make_simulated_bench(options.choice);
  const fit::Bench& scene = simulated.scene;
  const std::shared_ptr<sim::Engine> engine = simulated.engine;
  boost::asio::io_context io(1);
  sim::SimClock clock(speed_factor(options.speed));
  const auto stage = sim::make_stage_device(sim::stage_device_options(scene, options.stage_language));
  const sim::StageFrame frame = sim::stage_frame(scene, options.stage_language);
  const auto stage_at = [&stage, frame](double time_s) {
    return frame.on_bench(stage->mechanics().truth(time_s));
  };
  sim::UstDevice device(scene.lidar, identity_of(scene.lidar, options), engine, stage_at);
  sim::ScipServer::Options server_options;
  server_options.address = options.listen;
  server_options.port = options.lidar_port;
  sim::ScipServer server(io.get_executor(), server_options, clock, device);
  sim::PtyPort::Options port_options;
  port_options.link = options.stage_link;
  sim::PtyPort port(io.get_executor(), *stage, clock, port_options);
  const std::string stage_path = options.stage_link.empty() ? port.path() : options.stage_link;
  sim::FaultInjector::Bench faulty;
  faulty.server = &server;
  faulty.lidar = &device;
  faulty.port = &port;
  faulty.stage = stage.get();
  sim::FaultInjector faults(io.get_executor(), clock, faulty, options.choice.seed);
  faults.observe([](const sim::FaultEvent& event) {
    std::fprintf(stderr, "rig-sim: fault at %.3f s: %s\n", event.time_s, event.text.c_str());
  });
  for (const std::string& fault : options.faults) faults.add(fault);
  for (const std::string& file : options.fault_files) faults.add_file(file);
  sim::OperatorPort::Options operator_options;
  operator_options.address = options.listen;
  operator_options.port = options.operator_port;
  for (const fit::Target& target : scene.targets) operator_options.targets.push_back(target.name);
  sim::OperatorPort::Bench at_the_bench;
  at_the_bench.place = [&](const sim::SceneState& placed) { engine->set_scene(placed); };
  at_the_bench.switch_on = [&](double since_s) {
    device.reboot(clock.now_s() - since_s);
    server.reset_connection();
    engine->switched_on(clock.now_s() - since_s);
  };
  at_the_bench.fault = [&](const std::string& fault) { faults.add(fault); };
  at_the_bench.state = [&] {
    return nlohmann::json{{"time_s", clock.now_s()},
                          {"stage_deg", stage_at(clock.now_s()).angle_rad * fit::deg_per_rad},
                          {"scans", device.scans_made()},
                          {"faults", faults.count()}};
  };
  sim::OperatorPort operator_port(io.get_executor(), operator_options, std::move(at_the_bench));
  announce(options, server.port(), stage_path, operator_port.port(), clock.is_max());
  boost::asio::signal_set signals(io, SIGINT, SIGTERM);
  signals.async_wait([&](const boost::system::error_code&, int) {
    server.stop();
    io.stop();
  });
  io.run();
  return 0;
}

void declare(CLI::App& app, Options& options) {
  app.set_version_flag("--version", "rig-sim " RIG_VERSION);
  app.add_option("--bench", options.choice.bench_file, "Bench file: the scene, the lidar, the stage");
  app.add_option("--truth", options.choice.truth_file,
                 "Bench file of what is really there, when the operator's is not exact");
  app.add_option(
      "--world", options.choice.world_file,
      "World file: causes from which the causal engine makes the measurements (docs/develop/worlds.md)");
  app.add_option("--conceal", options.conceal_file,
                 "Write the bench file that the operator of the --world would have, and end");
  app.add_option(
         "--engine", options.choice.engine,
         "simple, model (mechanisms known to the bench), causal, or auto: whichever the files ask for")
      ->check(CLI::IsMember({"auto", "simple", "model", "causal"}))
      ->capture_default_str();
  app.add_option("--lidar-port", options.lidar_port, "TCP port of the lidar; 0 picks a free one")
      ->capture_default_str();
  app.add_option("--operator-port", options.operator_port,
                 "TCP port where prompts of a procedure change the bench; 0 picks a free one")
      ->capture_default_str();
  app.add_option("--stage-link", options.stage_link, "Where to link the stage's pseudo-terminal");
  app.add_option("--stage-language", options.stage_language,
                 "What the stage speaks: zaber, shot, gsc, falcon; default: as the bench file says");
  app.add_option(
         "--fault", options.faults,
         "What goes wrong: \"at=12.5s lidar reset\", \"every=60s stage delay s=0.4\", \"random rate=0.02 "
         "stage\"; may be repeated")
      ->allow_extra_args(false);
  app.add_option("--faults", options.fault_files, "File of such lines")->allow_extra_args(false);
  app.add_flag_callback(
      "--list-faults",
      [] {
        std::fputs(sim::FaultInjector::catalogue().c_str(), stdout);
        throw CLI::Success();
      },
      "Lists the faults there are");
  app.add_option("--speed", options.speed, "real, max, or a factor")->capture_default_str();
  app.add_option("--seed", options.choice.seed, "The same seed gives the same measurements")
      ->capture_default_str();
  app.add_flag("--repeatable", options.choice.repeatable,
               "Noise depends on the stage's place and the scan's number in its stream alone: a resumed run "
               "measures what an undisturbed one does");
  app.add_option("--listen", options.listen, "Address of the lidar")->capture_default_str();
  app.add_option("--clock-ppm", options.clock_ppm, "How much the lidar's clock is fast")
      ->capture_default_str();
  app.add_option("--scan-period-ms", options.scan_period_ms, "One turn of the lidar's motor")
      ->capture_default_str();
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Simulated calibration bench: a scanning lidar on TCP and a rotary stage on a pseudo-terminal."};
  Options options;
  declare(app, options);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // Help and version.
    std::fprintf(stderr, "rig-sim: %s. `rig-sim --help` says what it takes.\n", error.what());
    return 2;
  }
  try {
    return options.conceal_file.empty() ? serve(options) : conceal(options);
  } catch (const std::invalid_argument& error) {
    std::fprintf(stderr, "rig-sim: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "rig-sim: %s\n", error.what());
    return 3;
  }
}
