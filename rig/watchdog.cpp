// SPDX-License-Identifier: MIT
#include "rig/watchdog.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/io_context.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>

#include "lidar/client.hpp"
#include "rig/errors.hpp"

namespace rig {
namespace {

namespace asio = boost::asio;
using asio::awaitable;
using std::chrono::steady_clock;

constexpr auto longest_rescue = std::chrono::seconds(10);
constexpr auto longest_wait = std::chrono::seconds(12);

awaitable<void> stop_stage(std::string url, StageOptions options) {
  try {
    auto opening = open_stage(co_await asio::this_coro::executor, url, options);
    const auto stage = co_await std::move(opening);
    auto stopping = stage->stop();
    co_await std::move(stopping);
    std::fputs("rig: the run died; its watchdog stopped the stage.\n", stderr);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "rig: the run died and its watchdog could not stop the stage: %s\n", error.what());
  }
}

awaitable<void> silence_lidar(Endpoint address) {
  try {
    lidar::Client client(co_await asio::this_coro::executor, address.host, address.port);
    auto connecting = client.connect();  // Ends what an earlier client left running.
    co_await std::move(connecting);
  } catch (const std::exception&) {
    // A lidar that nobody listens to switches its laser off by itself when the connection breaks.
  }
}

void make_safe(const Endpoint& lidar, const std::string& stage_url, const StageOptions& stage) {
  asio::io_context io(1);
  int left = 2;
  const auto done = [&](const std::exception_ptr&) {
    if (--left == 0) io.stop();
  };
  auto stopping = stop_stage(stage_url, stage);
  asio::co_spawn(io, std::move(stopping), done);
  auto silencing = silence_lidar(lidar);
  asio::co_spawn(io, std::move(silencing), done);
  io.run_for(longest_rescue);
}

/// A process that ended and was not yet waited for does not live.
bool lives(int process) {
  if (process <= 0 || ::kill(process, 0) != 0) return false;
  std::ifstream status("/proc/" + std::to_string(process) + "/stat");
  std::string text;
  std::getline(status, text);
  const auto name_end = text.rfind(')');
  return name_end == std::string::npos || name_end + 2 >= text.size() || text[name_end + 2] != 'Z';
}

/// Who wrote into the lock's file; 0: nobody.
int owner_of(int lock) {
  char text[32] = {};
  return ::pread(lock, text, sizeof text - 1, 0) > 0 ? std::atoi(text) : 0;
}

/// One lock for each stage and user; its name comes from the port that a link stands for.
int take_bench(const std::string& stage_url) {
  std::string port = stage_url.substr(0, stage_url.find('?'));
  if (const auto colon = port.find(':'); colon != std::string::npos) port.erase(0, colon + 1);
  std::error_code ignored;
  const auto real = std::filesystem::weakly_canonical(port, ignored).string();
  const std::string file = std::filesystem::temp_directory_path(ignored).string() + "/rig-" +
                           std::to_string(::getuid()) + "-" + std::to_string(std::hash<std::string>{}(real)) +
                           ".lock";
  const int lock = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (lock < 0) return -1;  // Without a folder for it the port's own lock has to do.
  const auto until = steady_clock::now() + longest_wait;
  bool told = false;
  while (::flock(lock, LOCK_EX | LOCK_NB) != 0) {
    if (const int owner = owner_of(lock); lives(owner))
      throw UsageError("another run (process " + std::to_string(owner) + ") uses the stage at " + port +
                       ". Wait for it to finish or stop it.");
    if (steady_clock::now() > until)
      throw UsageError("the watchdog of an earlier run still tries to stop the stage at " + port +
                       ". Check the stage and its port, then run again.");
    if (!std::exchange(told, true)) std::fputs("waiting for the watchdog of a run that died\n", stderr);
    ::usleep(50'000);
  }
  return lock;
}

}  // namespace

Watchdog::Watchdog(const Endpoint& lidar, const std::string& stage_url, const StageOptions& stage)
    : lock_(take_bench(stage_url)) {
  const std::string owner = std::to_string(::getpid());
  if (lock_ >= 0 && (::ftruncate(lock_, 0) != 0 || ::pwrite(lock_, owner.data(), owner.size(), 0) < 0))
    std::fputs("rig: the lock of the stage cannot be written; two runs would not notice each other.\n",
               stderr);
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) return;
  process_ = ::fork();
  if (process_ != 0) {
    ::close(ends[0]);
    farewell_ = ends[1];
    return;
  }
  ::setsid();  // What ends the run's terminal or group must not end its watchdog.
  for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGPIPE}) std::signal(number, SIG_IGN);
  ::close(ends[1]);
  ::close(STDIN_FILENO);
  ::close(STDOUT_FILENO);
  char word = 0;
  while (::read(ends[0], &word, 1) < 0 && errno == EINTR) {
  }
  if (word != 'k') make_safe(lidar, stage_url, stage);
  ::_exit(0);
}

Watchdog::~Watchdog() {
  if (farewell_ >= 0) {
    (void)!::write(farewell_, "k", 1);
    ::close(farewell_);
  }
  if (process_ > 0) ::waitpid(process_, nullptr, 0);
  if (lock_ >= 0) ::close(lock_);
}

}  // namespace rig
