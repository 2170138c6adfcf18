// SPDX-License-Identifier: MIT
// Devices of other generations as servers: recorded byte logs of real ones, where they are present, and one
// that answers as an URG-04LX does (first step 44, no intensities).
#include <boost/asio/as_tuple.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read_until.hpp>
#include <boost/asio/streambuf.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/asio/write.hpp>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "lidar/response.hpp"
#include "rig/runner/lidar_doubts.hpp"
#include "rig/runner/scan_gate.hpp"
#include "rig/runner/scip_source.hpp"
#include "tests/support/lidar_bench.hpp"
#include "tests/support/test_folder.hpp"

namespace lidar_logs_test {

namespace asio = boost::asio;
using asio::awaitable;
using asio::ip::tcp;
using Catch::Matchers::Contains;

namespace {

/// What a device answered: by the first letters of the request, everything behind the request's own line.
struct Answers {
  std::map<std::string, std::vector<std::string>> of;
  std::string md, me;  ///< Stamp and values of one scan, with and without intensities; empty: not known.

  void add(const std::string& message) {
    const std::size_t end = message.find('\n');
    const std::string line = message.substr(0, end), rest = message.substr(end + 1);
    const std::string kind = line.substr(0, line.starts_with("TM") ? 3 : 2);
    const std::size_t data = rest.find('\n') + 1;  // Behind the status.
    if (kind == "GD" && rest.starts_with("00P")) md = rest.substr(data);
    if (kind == "ME" && rest.starts_with("99b")) me = rest.substr(data);
    of[kind].push_back(rest);
  }
  /// The answers to one line, in order: the last of its kind again and again.
  std::string to(const std::string& line, std::map<std::string, std::size_t>& asked) const {
    const std::string kind = line.substr(0, line.starts_with("TM") ? 3 : 2);
    if (kind == "QT") return line + "\n00P\n\n";
    if (kind == "MD" || kind == "ME") {
      const std::string& scan = kind == "MD" ? md : me;
      return scan.empty() ? line + "\n0Ee\n\n" : line + "\n00P\n\n" + line + "\n99b\n" + scan;
    }
    const auto known = of.find(kind);
    if (known == of.end()) return line + "\n0Ee\n\n";
    std::size_t& number = asked[kind];
    const std::string& answer = known->second[std::min(number, known->second.size() - 1)];
    ++number;
    return line + "\n" + answer;
  }
};

Answers answers_in(const std::string& log) {
  Answers answers;
  std::size_t begin = 0;
  for (std::size_t end = log.find("\n\n"); end != std::string::npos; end = log.find("\n\n", begin)) {
    answers.add(log.substr(begin, end + 2 - begin));
    begin = end + 2;
  }
  return answers;
}

/// Serves one host after the other with these answers.
struct Server {
  asio::io_context io{1};
  tcp::acceptor acceptor{io, {asio::ip::make_address("127.0.0.1"), 0}};
  Answers answers;
  explicit Server(Answers answers_) : answers(std::move(answers_)) {
    auto serving = serve();
    asio::co_spawn(io, std::move(serving), asio::detached);
  }
  awaitable<void> serve() {
    while (true) {
      auto [failed, socket] = co_await acceptor.async_accept(asio::as_tuple(asio::use_awaitable));
      if (failed) co_return;
      asio::streambuf buffer;
      std::map<std::string, std::size_t> asked;
      while (true) {
        const auto [ended, n] =
            co_await asio::async_read_until(socket, buffer, '\n', asio::as_tuple(asio::use_awaitable));
        if (ended) break;
        const auto from = asio::buffers_begin(buffer.data());
        const std::string line(from, from + static_cast<std::ptrdiff_t>(n - 1));
        buffer.consume(n);
        if (line.empty()) continue;
        const std::string bytes = answers.to(line, asked);
        co_await asio::async_write(socket, asio::buffer(bytes), asio::as_tuple(asio::use_awaitable));
      }
    }
  }
  [[nodiscard]] std::uint16_t port() const { return acceptor.local_endpoint().port(); }
};

struct Seen {
  nlohmann::json identity;
  lidar::Scan scan;
  bool intensities = true;
};

/// Connects as the rig does and takes one scan of all the bench's steps.
Seen look_at(Server& server, const fit::Bench& bench) {
  const auto source = rig::make_scip_source(server.io.get_executor(), {"127.0.0.1", server.port()});
  Seen seen;
  lidar_bench::run(
      server.io,
      [&]() -> awaitable<void> {
        seen.identity = co_await source->connect();
        co_await source->start(rig::whole_scan(bench.lidar));
        seen.scan = co_await source->next();
        co_await source->stop();
      },
      [&] { server.acceptor.close(); });
  seen.intensities = source->sends_intensities();
  return seen;
}

fit::Bench bench_of(const std::string& lidar) {
  return fit::parse_bench(R"({"schema": "bench/1", "lidar": )" + lidar + "}", "b.json");
}

const std::string urg = R"({"model": "URG-04LX", "steps": 726, "first_step": 44, "front_step": 384,
                            "step_deg": 0.3515625, "scan_hz": 10})";

}  // namespace

TEST_CASE("a lidar of another generation is measured with: first step 44, no intensities") {
  Answers answers;
  const auto key_values = [&](const std::string& kind,
                              const std::vector<std::pair<std::string, std::string>>& values) {
    answers.add(lidar::build_key_value_response(kind, "00", values));
  };
  key_values("VV", {{"PROD", "SOKUIKI Sensor URG-04LX"}, {"FIRM", "3.1"}, {"SERI", "H0706400"}});
  key_values("PP", {{"MODL", "URG-04LX(Hokuyo Automatic Co.,Ltd.)"},
                    {"DMIN", "20"},
                    {"DMAX", "5600"},
                    {"ARES", "1024"},
                    {"AMIN", "44"},
                    {"AMAX", "725"},
                    {"AFRT", "384"},
                    {"SCAN", "600"}});
  key_values("II", {{"LASR", "ON"}, {"STAT", "Sensor works well."}});
  const std::vector<std::uint32_t> ranges(682, 1234);
  lidar::ScanCommand command;
  command.format = lidar::ScanFormat::distance3;
  command.first_step = 44;
  command.last_step = 725;
  lidar::ScanData data;
  data.stamp = 1000;
  data.range_mm = ranges;
  std::string message;
  lidar::append_scan_response(message, "GD0044072501", "00", command, data);
  answers.add(message);
  Server server(answers);
  const fit::Bench bench = bench_of(urg);
  const Seen seen = look_at(server, bench);
  CHECK(rig::doubts_of_lidar(seen.identity, bench).empty());
  CHECK_FALSE(seen.intensities);
  CHECK(seen.scan.first_step == 44);
  REQUIRE(seen.scan.range_mm.size() == 682);
  CHECK(seen.scan.range_mm[681] == 1234);
  CHECK(seen.scan.intensity.empty());
}

TEST_CASE("recorded logs of real lidars, served again, are connected to, dated and measured with") {
  const std::filesystem::path logs = std::filesystem::path(RIG_SOURCE_DIR) / "../shared/real/scip-logs";
  if (!std::filesystem::exists(logs)) {
    WARN("skipped: the recorded byte logs are not here");
    return;
  }
  struct Device {
    std::string file, lidar, serial;
    std::size_t beams;
    std::uint16_t first_mm;
    bool intensities;
  };
  const auto device =
      GENERATE(Device{"real_urg_04lx.r.txt", urg, "H0706400", 682, 392, false},
               Device{"real_utm_30lx.r.txt", R"({"model": "UTM-30LX"})", "00903971", 1081, 45, true},
               Device{"real_uxm_30lx_e.r.txt",
                      R"({"model": "UXM-30LX-E", "steps": 761, "front_step": 380, "scan_hz": 20})",
                      "H0909106", 761, 353, false});
  INFO(device.file);
  Server server(answers_in(file_text((logs / device.file).string())));
  const fit::Bench bench = bench_of(device.lidar);
  const Seen seen = look_at(server, bench);
  for (const rig::LidarDoubt& doubt : rig::doubts_of_lidar(seen.identity, bench))
    FAIL_CHECK(doubt.what + ": " + doubt.says);
  CHECK(seen.identity["serial"] == device.serial);
  CHECK(seen.intensities == device.intensities);
  REQUIRE(seen.scan.range_mm.size() == device.beams);
  CHECK(seen.scan.range_mm[0] == device.first_mm);
  CHECK(seen.scan.intensity.size() == (device.intensities ? device.beams : 0));
  // Taken for another device, each is told apart.
  CHECK_FALSE(rig::doubts_of_lidar(seen.identity, bench_of(R"({"model": "UST-10LX"})")).empty());
}

}  // namespace lidar_logs_test
