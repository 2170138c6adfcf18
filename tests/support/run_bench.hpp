// SPDX-License-Identifier: MIT
#pragma once
// Tests of `rig run`: a small bench, both devices simulated by a program of their own.

#include <cstdlib>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "rig/session/session_store.hpp"
#include "tests/support/programs.hpp"

namespace run_bench {

inline const std::string procedures = RIG_SOURCE_DIR "/procedures/";

/// A board that the rig sees at 1.4 m with a wall behind it; small enough for a run of a second.
inline constexpr const char* small_bench = R"({
  "schema": "bench/1",
  "lidar": {"model": "UST-10LX", "mount": {"x_mm": {"value": 0, "u": 15}, "y_mm": {"value": 0, "u": 15}}},
  "stage": {"language": "zaber", "model": "X-RSW60A", "limits_deg": [-170, 170], "speed_deg_s": 20},
  "targets": [
    {"name": "board", "from_mm": [1400, -200], "to_mm": [1400, 200], "reflectance": 0.85},
    {"name": "background", "from_mm": [2200, -900], "to_mm": [2200, 900], "reflectance": 0.6}],
  "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": 5}}]
})";

/// A simulated bench in a folder of its own, and `rig run` on it.
struct Bench {
  explicit Bench(std::vector<std::string> sim_options = {}, const std::string& truth = small_bench) {
    write("bench.json", small_bench);
    write("truth.json", truth);
    sim = std::make_unique<SimProgram>(folder, folder / "truth.json", std::move(sim_options));
  }

  void write(const std::string& name, const std::string& text) const { std::ofstream(folder / name) << text; }

  std::vector<std::string> command(const std::string& procedure, std::vector<std::string> more = {}) const {
    std::vector<std::string> words = {RIG_BIN_DIR "/rig",
                                      "run",
                                      procedure,
                                      "--lidar",
                                      lidar.empty() ? sim->lidar() : lidar,
                                      "--stage",
                                      sim->stage(),
                                      "--bench",
                                      folder / "bench.json",
                                      "--operator",
                                      sim->person(),
                                      "--out",
                                      folder / "out.rig"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  /// Writes the steps as a procedure and runs it to its end.
  int run(const std::string& steps, std::vector<std::string> more = {}) {
    write("p.yaml", "procedure: test\nsteps:\n" + steps);
    Program rig(command(folder / "p.yaml", std::move(more)), folder, before);
    const int status = rig.exit_status();
    said = rig.errors();
    return status;
  }

  TestFolder folder;
  std::unique_ptr<SimProgram> sim;
  std::string lidar, said;
  std::function<void()> before = [] {};
};

/// Everything that a calibration depends on, capture by capture.
inline std::vector<std::string> measured(const std::string& file) {
  const rig::SessionStore session(file, rig::SessionStore::Mode::read);
  const auto recording = session.recording();
  std::vector<std::string> all;
  for (std::size_t i = 0; i < recording->captures().size(); ++i) {
    const auto& info = recording->captures()[i];
    std::string text = info.step + " " + std::to_string(info.stage_rad) + " " + std::to_string(info.approach);
    recording->for_each_scan(i, [&](const fit::ScanView& scan) {
      for (const auto range : scan.range_mm) text += " " + std::to_string(range);
      for (const auto level : scan.intensity) text += " " + std::to_string(level);
    });
    all.push_back(std::to_string(std::hash<std::string>{}(text)) + " " + text.substr(0, 60));
  }
  return all;
}

}  // namespace run_bench
