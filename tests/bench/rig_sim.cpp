// SPDX-License-Identifier: MIT
// Full ME scans (1081 ranges and intensities) per second from `rig-sim --speed max` over TCP to a client that
// only counts them.
#include <arpa/inet.h>
#include <benchmark/benchmark.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

/// A rig-sim of its own, ended with it.
class Simulator {
 public:
  explicit Simulator(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), RIG_SIM);
    for (const char* more : {"--speed", "max", "--lidar-port", "0"}) arguments.emplace_back(more);
    std::array<int, 2> pipe_ends{};
    if (pipe(pipe_ends.data()) != 0) throw std::runtime_error("no pipe");
    child_ = fork();
    if (child_ == 0) {
      dup2(pipe_ends[1], STDOUT_FILENO);
      std::vector<char*> argv;
      for (std::string& argument : arguments) argv.push_back(argument.data());
      argv.push_back(nullptr);
      execv(RIG_SIM, argv.data());
      _exit(127);
    }
    close(pipe_ends[1]);
    std::string line;
    char c = 0;
    while (read(pipe_ends[0], &c, 1) == 1 && c != '\n') line += c;
    close(pipe_ends[0]);
    port_ = nlohmann::json::parse(line).at("lidar_port");
  }
  Simulator(const Simulator&) = delete;
  Simulator& operator=(const Simulator&) = delete;
  ~Simulator() {
    kill(child_, SIGTERM);
    waitpid(child_, nullptr, 0);
  }
  [[nodiscard]] std::uint16_t port() const { return port_; }

 private:
  pid_t child_ = -1;
  std::uint16_t port_ = 0;
};

void stream(benchmark::State& state, const std::vector<std::string>& arguments) {
  const Simulator simulator(arguments);
  const int socket_ = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(simulator.port());
  inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
  sockaddr generic{};
  std::memcpy(&generic, &address, sizeof address);
  if (connect(socket_, &generic, sizeof generic) != 0) throw std::runtime_error("no connection");
  const std::string start = "ME0000108001000\n";
  if (write(socket_, start.data(), start.size()) < 0) throw std::runtime_error("not sent");
  std::vector<char> buffer(1 << 20);
  char before = 0;
  const auto next_messages = [&] {
    const ssize_t got = read(socket_, buffer.data(), buffer.size());
    int ends = 0;
    for (ssize_t i = 0; i < got; ++i) {
      ends += before == '\n' && buffer[static_cast<std::size_t>(i)] == '\n';
      before = buffer[static_cast<std::size_t>(i)];
    }
    return ends;
  };
  next_messages();  // the answer to the command
  std::int64_t scans = 0;
  for (auto unused : state) scans += next_messages();
  state.SetItemsProcessed(scans);
  close(socket_);
}

const std::string worlds = RIG_SOURCE_DIR "/sim/worlds/";

void simple(benchmark::State& state) { stream(state, {"--bench", worlds + "room.bench.json"}); }
void model(benchmark::State& state) {
  stream(state, {"--bench", worlds + "room.bench.json", "--engine", "model"});
}
void causal(benchmark::State& state) { stream(state, {"--world", worlds + "everything-at-once.world.json"}); }

BENCHMARK(simple)->Name("rig-sim/simple")->UseRealTime();
BENCHMARK(model)->Name("rig-sim/model")->UseRealTime();
BENCHMARK(causal)->Name("rig-sim/causal")->UseRealTime();

}  // namespace

BENCHMARK_MAIN();
