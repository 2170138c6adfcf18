// SPDX-License-Identifier: MIT
// Reducing a capture from the session file to statistics, beside reading the same bytes from the page cache.
#include <benchmark/benchmark.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <vector>

#include "fit/range/beam_statistics.hpp"
#include "rig/session/session_store.hpp"

namespace {

constexpr int scans = 10000, beams = 1081;

const std::string& session_file() {
  static const std::string path = [] {
    const std::string file =
        (std::filesystem::temp_directory_path() / ("bench-reduce-" + std::to_string(getpid()) + ".rig"))
            .string();
    rig::SessionStore store(file, rig::SessionStore::Mode::create);
    store.set("bench", R"({"schema": "bench/1"})");
    fit::CaptureInfo info;
    info.last_step = beams - 1;
    const auto id = store.begin_capture(info);
    std::vector<std::uint16_t> range(beams), intensity(beams, 1000);
    std::uint32_t state = 1;
    for (int i = 0; i < scans; ++i) {
      for (auto& value : range) {
        state = state * 1664525u + 1013904223u;
        value = static_cast<std::uint16_t>(3000 + (state >> 26));
      }
      fit::ScanView scan;
      scan.seq = i;
      scan.device_ms = 25 * i;
      scan.host_us = 25000 * i;
      scan.range_mm = range;
      scan.intensity = intensity;
      store.add_scan(id, scan);
    }
    store.commit_capture(id);
    std::atexit([] { std::filesystem::remove(session_file()); });
    return file;
  }();
  return path;
}

void reduce(benchmark::State& state) {
  const rig::SessionStore store(session_file(), rig::SessionStore::Mode::read);
  const auto recording = store.recording();
  for (auto _ : state) {
    fit::BeamStatistics statistics(beams);
    recording->for_each_scan(0, [&](const fit::ScanView& scan) { statistics.add(scan.range_mm); });
    for (std::size_t k = 0; k < beams; ++k) benchmark::DoNotOptimize(statistics.variance_mm2(k));
    if (statistics.count(beams - 1) != scans) state.SkipWithError("scans are missing");
  }
  state.SetItemsProcessed(state.iterations() * scans);
  state.counters["goal"] = 1.0 / 3;
}

void read_bytes(benchmark::State& state) {
  const std::string& path = session_file();  // made before the clock runs, whoever comes first
  std::vector<char> buffer(1 << 20);
  for (auto _ : state) {
    std::ifstream file(path, std::ios::binary);
    while (file.read(buffer.data(), static_cast<std::streamsize>(buffer.size())) || file.gcount() > 0)
      benchmark::DoNotOptimize(buffer.data());
  }
  state.SetItemsProcessed(state.iterations() * scans);
}

}  // namespace

BENCHMARK(reduce)->Name("reduce a 10,000 x 1081 capture/ours")->Unit(benchmark::kMillisecond);
BENCHMARK(read_bytes)->Name("reduce a 10,000 x 1081 capture/limit:page cache")->Unit(benchmark::kMillisecond);
BENCHMARK_MAIN();
