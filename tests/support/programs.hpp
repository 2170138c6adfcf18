// SPDX-License-Identifier: MIT
#pragma once

#include <poll.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <boost/asio/ip/tcp.hpp>
#include <chrono>
#include <csignal>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/support/test_folder.hpp"

/// A program that runs beside the test: its standard output line by line, its standard error whole. Killed at
/// the end.
class Program {
 public:
  using Clock = std::chrono::steady_clock;

  /// `before` runs in the child before the program does (limits, user).
  Program(
      const std::vector<std::string>& arguments, const TestFolder& folder,
      const std::function<void()>& before = [] {}) {
    static int number = 0;
    errors_ = folder / ("errors-" + std::to_string(++number));
    int out[2], in[2];
    if (::pipe(out) != 0 || ::pipe(in) != 0) throw std::runtime_error("no pipe for the test");
    pid_ = ::fork();
    if (pid_ == 0) {
      ::dup2(in[0], 0);
      ::dup2(out[1], 1);
      std::freopen(errors_.c_str(), "w", stderr);
      for (const int fd : {in[0], in[1], out[0], out[1]}) ::close(fd);
      if (::chdir(folder.path().c_str()) != 0) ::_exit(126);
      before();
      std::vector<char*> words;
      for (const std::string& word : arguments) words.push_back(const_cast<char*>(word.c_str()));
      words.push_back(nullptr);
      ::execv(words[0], words.data());
      ::_exit(127);
    }
    ::close(out[1]);
    ::close(in[0]);
    output_ = out[0];
    input_ = in[1];
    ended_ = static_cast<int>(::syscall(SYS_pidfd_open, pid_, 0));
  }
  ~Program() {
    signal(SIGKILL);
    (void)status();
    for (const int fd : {output_, input_, ended_})
      if (fd >= 0) ::close(fd);
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  void signal(int number) const {
    if (!status_) ::kill(pid_, number);
  }
  void type(const std::string& text) const {
    if (::write(input_, text.data(), text.size()) != static_cast<ssize_t>(text.size()))
      throw std::runtime_error("the program does not read");
  }
  void end_input() {
    ::close(input_);
    input_ = -1;
  }

  /// The next line of its standard output; nothing when it ended or none came in time.
  std::optional<std::string> line(std::chrono::milliseconds longest = std::chrono::seconds(20)) {
    const auto until = Clock::now() + longest;
    while (true) {
      if (const auto end = text_.find('\n'); end != std::string::npos) {
        std::string result = text_.substr(0, end);
        text_.erase(0, end + 1);
        return result;
      }
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now()).count();
      pollfd waiting{output_, POLLIN, 0};
      if (left <= 0 || ::poll(&waiting, 1, static_cast<int>(left)) <= 0) return std::nullopt;
      char bytes[4096];
      const ssize_t got = ::read(output_, bytes, sizeof bytes);
      if (got <= 0) return std::nullopt;
      text_.append(bytes, static_cast<std::size_t>(got));
    }
  }

  /// True if it ended by itself within that time.
  bool ends_within(std::chrono::milliseconds longest) {
    const auto until = Clock::now() + longest;
    while (true) {
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now()).count();
      if (left <= 0) return false;
      pollfd waiting[2] = {{ended_, POLLIN, 0}, {output_, POLLIN, 0}};
      ::poll(waiting, 2, static_cast<int>(left));
      if (waiting[0].revents != 0) return true;
      if ((waiting[1].revents & POLLIN) == 0) continue;
      char bytes[4096];
      if (const ssize_t got = ::read(output_, bytes, sizeof bytes); got > 0)
        text_.append(bytes, static_cast<std::size_t>(got));
    }
  }

  /// Its exit status; -N when signal N ended it. Throws when it does not end in time: nothing may hang.
  int exit_status(std::chrono::milliseconds longest = std::chrono::seconds(60)) {
    if (!status_ && !ends_within(longest)) {
      signal(SIGKILL);
      throw std::runtime_error("the program hangs; it said: " + errors());
    }
    return status();
  }
  [[nodiscard]] std::string errors() const { return file_text(errors_); }
  [[nodiscard]] pid_t pid() const { return pid_; }

 private:
  int status() {
    if (status_) return *status_;
    int raw = 0;
    ::waitpid(pid_, &raw, 0);
    status_ = WIFEXITED(raw) ? WEXITSTATUS(raw) : -WTERMSIG(raw);
    return *status_;
  }

  pid_t pid_ = 0;
  int output_ = -1, input_ = -1, ended_ = -1;
  std::string errors_, text_;
  std::optional<int> status_;
};

/// `rig-sim` in a process of its own, ready.
class SimProgram {
 public:
  SimProgram(const TestFolder& folder, const std::string& bench, std::vector<std::string> more = {})
      : program_(command(folder, bench, std::move(more)), folder) {
    const auto line = program_.line();
    if (!line) throw std::runtime_error("rig-sim is not ready: " + program_.errors());
    ready_ = nlohmann::json::parse(*line);
  }
  [[nodiscard]] std::string lidar() const { return ready_["lidar"]; }
  [[nodiscard]] std::string stage() const { return ready_["stage"]; }
  [[nodiscard]] std::string person() const { return ready_["operator"]; }
  [[nodiscard]] std::uint16_t lidar_port() const { return ready_["lidar_port"]; }
  [[nodiscard]] std::string errors() const { return program_.errors(); }
  /// Speaks to the bench's operator port (docs/develop/simulator.md).
  [[nodiscard]] nlohmann::json ask(const nlohmann::json& what) const {
    boost::asio::ip::tcp::iostream line("127.0.0.1", std::to_string(ready_["operator_port"].get<int>()));
    line << what.dump() << "\n" << std::flush;
    std::string answer;
    std::getline(line, answer);
    return nlohmann::json::parse(answer);
  }

 private:
  static std::vector<std::string> command(const TestFolder& folder, const std::string& bench,
                                          std::vector<std::string> more) {
    std::vector<std::string> words = {RIG_BIN_DIR "/rig-sim", "--bench",       bench, "--lidar-port", "0",
                                      "--stage-link",         folder / "stage"};
    const bool speed_given = std::find(more.begin(), more.end(), "--speed") != more.end();
    if (!speed_given) words.insert(words.end(), {"--speed", "max"});
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }

  Program program_;
  nlohmann::json ready_;
};
