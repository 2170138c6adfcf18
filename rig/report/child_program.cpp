// SPDX-License-Identifier: MIT
#include "rig/report/child_program.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <cstdlib>

#include "rig/descriptor.hpp"

namespace rig {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr int no_such_program = 127;  // As shells have it.
constexpr std::size_t most_output = 64u << 20;
// Where the kernel tells no end of a process (pidfd_open, Linux 5.3), it is asked so often.
constexpr int ask_every_ms = 10;

/// What the child does between fork and exec: calls that are safe there only.
[[noreturn]] void become(char* const* arguments, char* const* environment, int output, pid_t parent) {
  ::setpgid(0, 0);
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != parent) ::_exit(1);  // It ended before that was asked for.
  const int nothing = ::open("/dev/null", O_RDWR);
  ::dup2(nothing, STDIN_FILENO);
  ::dup2(output, STDOUT_FILENO);
  ::dup2(nothing, STDERR_FILENO);
  ::execvpe(arguments[0], arguments, environment);
  ::_exit(no_such_program);
}

pid_t start(const std::vector<std::string>& arguments, int output) {
  std::vector<char*> words;
  for (const std::string& argument : arguments) words.push_back(const_cast<char*>(argument.c_str()));
  words.push_back(nullptr);
  // Not by setenv: other threads may read the environment meanwhile.
  std::string same_dates = "SOURCE_DATE_EPOCH=0";
  std::vector<char*> environment;
  for (char** setting = ::environ; *setting != nullptr; ++setting) environment.push_back(*setting);
  if (std::getenv("SOURCE_DATE_EPOCH") == nullptr) environment.push_back(same_dates.data());
  environment.push_back(nullptr);
  const pid_t parent = ::getpid(), child = ::fork();
  if (child == 0) become(words.data(), environment.data(), output, parent);
  if (child > 0) ::setpgid(child, child);  // Whoever is first: it must hold before the group is killed.
  return child;
}

class Watch {
 public:
  Watch(pid_t child, int output, milliseconds longest)
      : child_(child),
        ended_(static_cast<int>(::syscall(SYS_pidfd_open, child, 0))),
        output_(output),
        until_(Clock::now() + longest) {}

  ChildResult to_its_end() {
    while (!has_ended()) {
      const auto left = std::chrono::ceil<milliseconds>(until_ - Clock::now()).count();
      if (left <= 0) return stopped(ChildResult::End::hung);
      wait(left);
      if (result_.output.size() > most_output) return stopped(ChildResult::End::failed);
    }
    read_what_is_there();
    if (WIFEXITED(status_) && WEXITSTATUS(status_) == 0) result_.end = ChildResult::End::done;
    if (WIFEXITED(status_) && WEXITSTATUS(status_) == no_such_program)
      result_.end = ChildResult::End::missing;
    return std::move(result_);
  }

 private:
  bool has_ended() { return ::waitpid(child_, &status_, WNOHANG) == child_; }

  void wait(long left_ms) {
    std::array<pollfd, 2> of = {{{ended_.get(), POLLIN, 0}, {open_ ? output_ : -1, POLLIN, 0}}};
    const auto longest = static_cast<int>(std::min<long>(left_ms, ended_ ? 60'000 : ask_every_ms));
    if (::poll(of.data(), of.size(), longest) > 0 && of[1].revents != 0) read_once();
  }

  /// False when there is nothing more for now, or for good.
  bool read_once() {
    std::array<char, 65536> bytes{};
    const ssize_t got = ::read(output_, bytes.data(), bytes.size());
    if (got == 0) open_ = false;
    if (got > 0) result_.output.append(bytes.data(), static_cast<std::size_t>(got));
    return got > 0;
  }
  void read_what_is_there() {
    while (result_.output.size() <= most_output && read_once()) {
    }
  }

  ChildResult stopped(ChildResult::End end) {
    ::kill(-child_, SIGKILL);
    ::waitpid(child_, &status_, 0);
    result_.end = end;
    return std::move(result_);
  }

  pid_t child_;
  Descriptor ended_;
  int output_, status_ = 0;
  Clock::time_point until_;
  bool open_ = true;
  ChildResult result_;
};

}  // namespace

ChildResult run_child(const std::vector<std::string>& arguments, milliseconds longest) {
  std::array<int, 2> pipe{};
  if (::pipe2(pipe.data(), O_CLOEXEC) != 0) return {};
  const Descriptor from_child(pipe[0]);
  Descriptor to_us(pipe[1]);
  ::fcntl(from_child.get(), F_SETFL, O_NONBLOCK);
  const pid_t child = start(arguments, to_us.get());
  to_us.close();
  if (child < 0) return {};
  return Watch(child, from_child.get(), longest).to_its_end();
}

std::string hung_in_words(const std::string& program, milliseconds longest) {
  std::array<char, 32> seconds{};
  std::snprintf(seconds.data(), seconds.size(), "%g", static_cast<double>(longest.count()) / 1000);
  return program + " did not finish within " + seconds.data() + " s and was stopped";
}

}  // namespace rig
