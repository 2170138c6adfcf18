// SPDX-License-Identifier: MIT
#include "rig/stage/stage_guard.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <ctime>

namespace rig {

namespace {

constexpr int pipe_place = 3, port_place = 4;
constexpr int repetitions = 3;  ///< The first may be lost behind half a command.
constexpr long pause_ns = 100'000'000;

// The child has been forked from a program that may have threads: it uses nothing but system calls.

void send_stop(const char* bytes, std::size_t size) {
  for (int i = 0; i < repetitions; ++i) {
    [[maybe_unused]] const ssize_t sent = ::write(port_place, bytes, size);
    const timespec pause{0, pause_ns};
    ::nanosleep(&pause, nullptr);
  }
}

[[noreturn]] void watch(int pipe, int port, const char* bytes, std::size_t size, int patience_ms) {
  ::setsid();  // Ctrl-C is for the parent.
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPIPE}) ::signal(signal, SIG_IGN);
  // Nothing else of the parent's may stay open here: sockets would not close, unplugged ports would not end.
  const int high_pipe = ::fcntl(pipe, F_DUPFD, 10), high_port = ::fcntl(port, F_DUPFD, 10);
  ::dup2(high_pipe, pipe_place);
  ::dup2(high_port, port_place);
  ::close_range(port_place + 1, ~0U, 0);
  bool is_moving = false;
  for (;;) {
    pollfd parent{pipe_place, POLLIN, 0};
    const int ready = ::poll(&parent, 1, is_moving ? patience_ms : -1);
    if (ready < 0 && errno == EINTR) continue;
    if (ready == 0) {  // It hangs. Once is enough: it may come back, and then finds the stage standing.
      send_stop(bytes, size);
      is_moving = false;
      continue;
    }
    char word = 0;
    const ssize_t got = ::read(pipe_place, &word, 1);
    if (got < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (got <= 0) {  // It is dead.
      send_stop(bytes, size);
      ::_exit(0);
    }
    if (word == 'q') ::_exit(0);
    is_moving = word == 'm';
  }
}

}  // namespace

StageGuard::StageGuard(int port, const std::string& stop_bytes, double patience_s) {
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, ends) != 0) return;
  const int patience_ms = static_cast<int>(patience_s * 1e3);
  child_ = ::fork();
  if (child_ == 0) {
    ::close(ends[1]);
    watch(ends[0], port, stop_bytes.data(), stop_bytes.size(), patience_ms);
  }
  ::close(ends[0]);
  if (child_ < 0) {
    ::close(ends[1]);
    return;
  }
  pipe_ = ends[1];
}

StageGuard::~StageGuard() {
  if (pipe_ < 0) return;
  report('q');
  ::close(pipe_);
  while (::waitpid(child_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

void StageGuard::report(char what) noexcept {
  if (pipe_ >= 0)
    ::send(pipe_, &what, 1, MSG_NOSIGNAL);  // The child may have been killed: that is no reason to die.
}

}  // namespace rig
