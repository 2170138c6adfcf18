// SPDX-License-Identifier: MIT
// One full ME scan from memory: framing, checksums, 1081 ranges and intensities.
#include <benchmark/benchmark.h>

#include <cstdlib>
#include <cstring>
#include <random>

#include "lidar/frame_reader.hpp"
#include "lidar/reply.hpp"
#include "lidar/response.hpp"
#include "lidar/scan_receiver.hpp"

namespace {

constexpr int beams = 1081, scans = 64;

const std::string& stream() {
  static const std::string bytes = [] {
    std::minstd_rand random(1);
    std::vector<std::uint32_t> range(beams), intensity(beams);
    lidar::ScanData data;
    std::string out;
    for (int i = 0; i < scans; ++i) {
      for (auto& value : range) value = random() % 20 == 0 ? 65533 : 21 + random() % 29000;
      for (auto& value : intensity) value = random() % 16000;
      data.stamp = static_cast<std::uint64_t>(25 * i);
      data.range_mm = range;
      data.intensity = intensity;
      lidar::append_scan_response(out, "ME0000108001000;r7", "99", lidar::ScanCommand(), data);
    }
    return out;
  }();
  return bytes;
}

/// How public drivers receive: line by line into a buffer, each line's sum byte by byte, the values digit by
/// digit.
class PlainReceiver {
 public:
  explicit PlainReceiver(const std::string& bytes) : at_(bytes.data()), end_(at_ + bytes.size()) {}

  /// Number of values of the next scan; 0 at the end or at a fault.
  int receive(long* range, long* intensity, long& stamp) {
    char line[80];
    if (read_line(line, sizeof line) <= 0) return 0;
    if (std::strncmp(line, "ME0000108001", 12) != 0) return 0;
    int n = read_line(line, sizeof line);
    if (n != 3 || line[2] != sum_of(line, 2) || std::strncmp(line, "99", 2) != 0) return 0;
    n = read_line(line, sizeof line);
    if (n != 5 || line[4] != sum_of(line, 4)) return 0;
    stamp = decode(line, 4);
    int values = 0, kept = 0;
    char waiting[80];
    while ((n = read_line(line, sizeof line)) > 0) {
      if (line[n - 1] != sum_of(line, n - 1)) return 0;
      std::memcpy(waiting + kept, line, static_cast<std::size_t>(n - 1));
      kept += n - 1;
      const char* p = waiting;
      for (; kept >= 6 && values < beams; kept -= 6, p += 6, ++values) {
        range[values] = decode(p, 3);
        intensity[values] = decode(p + 3, 3);
      }
      std::memmove(waiting, p, static_cast<std::size_t>(kept));
    }
    return values;
  }

 private:
  int read_line(char* line, int room) {
    int n = 0;
    while (at_ < end_ && *at_ != '\n' && n < room - 1) line[n++] = *at_++;
    if (at_ == end_) return -1;
    ++at_;
    line[n] = '\0';
    return n;
  }
  static char sum_of(const char* line, int n) {
    unsigned sum = 0;
    for (int i = 0; i < n; ++i) sum += static_cast<unsigned char>(line[i]);
    return static_cast<char>((sum & 0x3F) + 0x30);
  }
  static long decode(const char* p, int n) {
    long value = 0;
    for (int i = 0; i < n; ++i) value = (value << 6) | ((p[i] - 0x30) & 0x3F);
    return value;
  }

  const char *at_, *end_;
};

void receive_by(benchmark::State& state, lidar::Kernel kernel) {
  if (!available(kernel)) return state.SkipWithError("this processor does not have it");
  const lidar::ScanReceiver receiver(lidar::ScanCommand(), "r7", 20, 30000, kernel);
  lidar::Scan scan;
  std::int64_t received = 0;
  for (auto _ : state) {
    std::string_view bytes = stream();
    while (const auto stamp = receiver.take(bytes, scan)) {
      benchmark::DoNotOptimize(*stamp);
      benchmark::DoNotOptimize(scan.range_mm.data());
      bytes.remove_prefix(receiver.message_bytes());
      ++received;
    }
    if (!bytes.empty()) return state.SkipWithError("a scan was not taken");
  }
  state.SetItemsProcessed(received);
}

void receive_ours(benchmark::State& state) {
  receive_by(state, lidar::fastest_kernel());
  state.counters["goal_rival"] = 8;
}

void receive_plainly(benchmark::State& state) {
  static long range[beams], intensity[beams];
  long stamp = 0;
  std::int64_t received = 0;
  for (auto _ : state) {
    PlainReceiver receiver(stream());
    int count = 0;
    while (receiver.receive(range, intensity, stamp) == beams) {
      benchmark::DoNotOptimize(range);
      benchmark::DoNotOptimize(intensity);
      ++count;
    }
    if (count != scans) return state.SkipWithError("a scan was not received");
    received += count;
  }
  state.SetItemsProcessed(received);
}

/// What takes over when a message is not as expected: any command, any fault.
void receive_anything(benchmark::State& state) {
  lidar::FrameReader reader;
  std::int64_t received = 0;
  const lidar::ScanCommand command;
  for (auto _ : state) {
    reader.feed(stream());
    for (auto frame = reader.next(); frame && *frame; frame = reader.next()) {
      const auto scan = lidar::decode_scan((*frame)->body, command);
      if (!scan) return state.SkipWithError("a scan was not received");
      benchmark::DoNotOptimize(scan->range_mm.data());
      ++received;
    }
  }
  state.SetItemsProcessed(received);
}

/// The simulator's side of it.
void encode(benchmark::State& state) {
  std::vector<std::uint32_t> range(beams), intensity(beams);
  for (std::size_t i = 0; i < beams; ++i)
    range[i] = static_cast<std::uint32_t>(1000 + 7 * i), intensity[i] = static_cast<std::uint32_t>(3 * i);
  lidar::ScanData data;
  data.range_mm = range;
  data.intensity = intensity;
  std::string out;
  for (auto _ : state) {
    out.clear();
    lidar::append_scan_response(out, "ME0000108001000;r7", "99", lidar::ScanCommand(), data);
    benchmark::DoNotOptimize(out.data());
  }
  state.SetItemsProcessed(state.iterations());
}

void move_bytes(benchmark::State& state) {
  std::vector<char> to(stream().size());
  for (auto _ : state) {
    std::memcpy(to.data(), stream().data(), to.size());
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * scans);
}

}  // namespace

BENCHMARK(receive_ours)->Name("receive an ME scan from memory/ours");
BENCHMARK(receive_plainly)->Name("receive an ME scan from memory/rival:plain");
BENCHMARK(move_bytes)->Name("receive an ME scan from memory/limit:memcpy");
BENCHMARK_CAPTURE(receive_by, portable, lidar::Kernel::portable)->Name("receive an ME scan: portable kernel");
BENCHMARK_CAPTURE(receive_by, avx2, lidar::Kernel::avx2)->Name("receive an ME scan: AVX2 kernel");
BENCHMARK_CAPTURE(receive_by, avx512, lidar::Kernel::avx512)->Name("receive an ME scan: AVX-512 kernel");
BENCHMARK(encode)->Name("encode an ME scan");
BENCHMARK(receive_anything)->Name("receive an ME scan: the long way");
BENCHMARK_MAIN();
