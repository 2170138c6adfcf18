// SPDX-License-Identifier: MIT
#include "rig/stage/serial_link.hpp"

#include <fcntl.h>
#include <libserialport.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/asio/as_tuple.hpp>
#include <boost/asio/experimental/awaitable_operators.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "rig/descriptor.hpp"
#include "rig/errors.hpp"

namespace rig {

namespace asio = boost::asio;
namespace fs = std::filesystem;
using asio::awaitable;
using namespace boost::asio::experimental::awaitable_operators;

namespace {

constexpr std::size_t most_heard = 64, most_shown = 24;
constexpr auto waiting = asio::as_tuple(asio::use_awaitable);

struct Baud {
  int rate;
  speed_t code;
};
constexpr std::array<Baud, 10> bauds{{{1200, B1200},
                                      {2400, B2400},
                                      {4800, B4800},
                                      {9600, B9600},
                                      {19200, B19200},
                                      {38400, B38400},
                                      {57600, B57600},
                                      {115200, B115200},
                                      {230400, B230400},
                                      {460800, B460800}}};

speed_t speed_code(int rate) {
  for (const Baud& baud : bauds)
    if (baud.rate == rate) return baud.code;
  throw StageError("the stage's line cannot run at " + std::to_string(rate) +
                   " baud. Use one of 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800.");
}

/// What a port that cannot be opened means for the stage.
const std::string never_opened = "Nothing was moved.";
const std::string opened_before = "Where the stage stands is not known: if it still turns, switch it off.";

[[noreturn]] void refuse_to_open(const std::string& path, int error, const std::string& meaning) {
  const std::string port = "the stage's port " + path;
  switch (error) {
    case ENOENT:
    case ENODEV:
    case ENXIO:
      throw StageError(port + " is not there. " + meaning +
                       " Check that the stage is switched on and plugged in; "
                       "`rig devices` lists the ports there are.");
    case EACCES:
    case EPERM:
      throw StageError(port + " cannot be opened by this user. " + meaning +
                       " Join the group that owns it "
                       "(sudo usermod -aG dialout $USER) and log in again.");
    case EBUSY:
    case EWOULDBLOCK:
      throw StageBusy(port + " is in use by another program. " + meaning + " End that program (fuser -v " +
                      path + " names it) and try again.");
    case ENOTTY:
    case EISDIR:
      throw StageError(port + " is not a serial port. Give the port of the stage, e.g. /dev/ttyUSB0.");
    default:
      throw StageError(port + " cannot be opened: " + std::strerror(error) + ". " + meaning);
  }
}

struct PortCloser {
  void operator()(sp_port* port) const {
    sp_close(port);
    sp_free_port(port);
  }
};

/// libserialport knows only what the kernel lists under /sys/class/tty, by its real name.
bool is_listed_port(const std::string& real_path) {
  std::error_code failed;
  const std::string name = fs::path(real_path).filename();
  return real_path.starts_with("/dev/") && fs::exists("/sys/class/tty/" + name, failed) &&
         fs::path(real_path).parent_path() == "/dev";
}

/// Sets the port up through libserialport (flow control, modem lines); what it cannot do is left to
/// `set_raw`.
void set_up_listed(const std::string& real_path, int baud, bool hardware_flow_control) {
  sp_port* found = nullptr;
  if (sp_get_port_by_name(real_path.c_str(), &found) != SP_OK) return;
  const std::unique_ptr<sp_port, PortCloser> port(found);
  if (sp_open(port.get(), SP_MODE_READ_WRITE) != SP_OK) return;
  sp_set_baudrate(port.get(), baud);
  sp_set_bits(port.get(), 8);
  sp_set_parity(port.get(), SP_PARITY_NONE);
  sp_set_stopbits(port.get(), 1);
  sp_set_flowcontrol(port.get(), hardware_flow_control ? SP_FLOWCONTROL_RTSCTS : SP_FLOWCONTROL_NONE);
}

/// Raw, 8N1. VMIN = 1: libserialport leaves 0, with which a read of nothing looks like the end of the line.
bool set_raw(int fd, int baud, bool hardware_flow_control) {
  termios settings{};
  if (::tcgetattr(fd, &settings) != 0) return false;
  ::cfmakeraw(&settings);
  settings.c_cflag |= CLOCAL | CREAD;
  settings.c_cflag &= ~static_cast<tcflag_t>(CSTOPB | PARENB | CRTSCTS);
  if (hardware_flow_control) settings.c_cflag |= CRTSCTS;
  settings.c_cc[VMIN] = 1;
  settings.c_cc[VTIME] = 0;
  ::cfsetspeed(&settings, speed_code(baud));
  return ::tcsetattr(fd, TCSANOW, &settings) == 0;
}

int open_port(const std::string& path, int baud, bool hardware_flow_control, const std::string& meaning) {
  std::error_code failed;
  const std::string real_path = fs::canonical(path, failed);
  if (failed) refuse_to_open(path, failed.value(), meaning);
  // Ours first: the lock decides who may change the settings.
  Descriptor fd(::open(real_path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  if (fd.get() < 0) refuse_to_open(path, errno, meaning);
  if (::isatty(fd.get()) == 0) refuse_to_open(path, ENOTTY, meaning);
  if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0) refuse_to_open(path, EBUSY, meaning);
  if (is_listed_port(real_path)) set_up_listed(real_path, baud, hardware_flow_control);
  if (!set_raw(fd.get(), baud, hardware_flow_control)) refuse_to_open(path, errno, meaning);
  // Not on a pseudo-terminal: there it would outlive us for as long as the simulator holds the other end.
  if (is_listed_port(real_path)) ::ioctl(fd.get(), TIOCEXCL);
  ::tcflush(fd.get(), TCIOFLUSH);
  return fd.release();
}

}  // namespace

struct SerialLink::Impl {
  Impl(const asio::any_io_executor& executor, std::string path_, int baud_, bool flow)
      : port(executor), timer(executor), path(std::move(path_)), baud(baud_), hardware_flow_control(flow) {
    open(never_opened);
  }

  void open(const std::string& meaning) {
    const int fd = open_port(path, baud, hardware_flow_control, meaning);
    port.assign(fd);
    received.clear();
    is_dropping = false;
    has_forgotten_answers = true;
  }

  [[noreturn]] void lost(const std::string& how) {
    boost::system::error_code ignored;
    port.close(ignored);
    throw StageLost(
        "the link to the stage on " + path + " is lost (" + how +
        "). Nothing more can be commanded: if the stage still turns, switch it off. Check its cable and "
        "power.");
  }

  void take_what_came();
  std::optional<std::string> next_line();
  awaitable<bool> ready(asio::posix::stream_descriptor::wait_type what, Clock::time_point deadline);

  asio::posix::stream_descriptor port;
  asio::steady_timer timer;
  std::string path;
  int baud;
  bool hardware_flow_control;
  std::string received;
  std::string heard;         ///< The first bytes since the question.
  bool is_dropping = false;  ///< Within a line that was too long.
  bool has_forgotten_answers = true;
};

/// Readiness and the read itself are kept apart: a wait that loses its race against the timer can lose no
/// bytes.
awaitable<bool> SerialLink::Impl::ready(asio::posix::stream_descriptor::wait_type what,
                                        Clock::time_point deadline) {
  if (!port.is_open()) lost("it was closed");
  timer.expires_at(deadline);
  const auto first = co_await (port.async_wait(what, waiting) || timer.async_wait(waiting));
  co_return first.index() == 0;
}

void SerialLink::Impl::take_what_came() {
  if (!port.is_open()) lost("it was closed");
  std::array<char, 4096> bytes{};
  for (;;) {
    const ssize_t size = ::read(port.native_handle(), bytes.data(), bytes.size());
    if (size > 0) {
      received.append(bytes.data(), static_cast<std::size_t>(size));
      heard.append(bytes.data(), std::min(static_cast<std::size_t>(size), most_heard - heard.size()));
      if (received.size() > 64 * longest_line) return;
    } else if (size < 0 && (errno == EAGAIN || errno == EINTR)) {
      return;
    } else if (received.empty() || size < 0) {
      lost(size == 0 ? "unplugged or switched off" : std::string("unplugged: ") + std::strerror(errno));
    } else {
      return;  // What came before the end is still worth reading.
    }
  }
}

std::optional<std::string> SerialLink::Impl::next_line() {
  for (;;) {
    const std::size_t end = received.find_first_of("\r\n");
    if (end == std::string::npos) {
      if (received.size() > longest_line) {
        received.clear();
        is_dropping = true;
      }
      return std::nullopt;
    }
    std::string line = received.substr(0, end);
    received.erase(0, end + 1);
    if (std::exchange(is_dropping, false) || line.empty() || line.size() > longest_line) continue;
    return line;
  }
}

SerialLink::SerialLink(const asio::any_io_executor& executor, std::string path, int baud,
                       bool hardware_flow_control)
    : impl_(std::make_unique<Impl>(executor, std::move(path), baud, hardware_flow_control)) {}

SerialLink::~SerialLink() = default;

const std::string& SerialLink::path() const { return impl_->path; }

int SerialLink::baud() const { return impl_->baud; }

int SerialLink::descriptor() const { return impl_->port.is_open() ? impl_->port.native_handle() : -1; }

void SerialLink::reopen() {
  boost::system::error_code ignored;
  impl_->port.close(ignored);
  impl_->open(opened_before);
}

awaitable<void> SerialLink::write(std::string bytes, Clock::time_point deadline) {
  std::size_t sent = 0;
  while (sent < bytes.size()) {
    if (!impl_->port.is_open()) impl_->lost("it was closed");
    const ssize_t size = ::write(impl_->port.native_handle(), bytes.data() + sent, bytes.size() - sent);
    if (size > 0) {
      sent += static_cast<std::size_t>(size);
      continue;
    }
    if (size < 0 && errno != EAGAIN && errno != EINTR)
      impl_->lost(std::string("unplugged: ") + std::strerror(errno));
    const bool is_ready = co_await impl_->ready(asio::posix::stream_descriptor::wait_write, deadline);
    if (!is_ready) impl_->lost("it accepts no data: is flow control wired?");
  }
}

void SerialLink::write_now(const std::string& bytes) noexcept {
  if (!impl_->port.is_open()) return;
  // What is not taken now is repeated by the command that waits its turn.
  [[maybe_unused]] const ssize_t size = ::write(impl_->port.native_handle(), bytes.data(), bytes.size());
}

awaitable<std::optional<std::string>> SerialLink::read_line(Clock::time_point deadline) {
  for (bool is_in_time = true;;) {
    if (auto line = impl_->next_line()) co_return line;
    if (!is_in_time) co_return std::nullopt;
    is_in_time = co_await impl_->ready(asio::posix::stream_descriptor::wait_read, deadline);
    impl_->take_what_came();  // Also at the deadline: the bytes may have come while the program was busy.
  }
}

void SerialLink::discard() noexcept {
  impl_->received.clear();
  if (impl_->port.is_open()) ::tcflush(impl_->port.native_handle(), TCIFLUSH);
}

awaitable<void> SerialLink::drain() {
  const auto end = Clock::now() + 5 * silence;
  bool is_noisy = true;
  while (is_noisy && Clock::now() < end) {
    impl_->received.clear();
    is_noisy = co_await impl_->ready(asio::posix::stream_descriptor::wait_read, Clock::now() + silence);
    if (is_noisy) impl_->take_what_came();
  }
  impl_->received.clear();
}

awaitable<SerialLink::Clock::time_point> SerialLink::ask(std::string question, double reply_s) {
  if (std::exchange(impl_->has_forgotten_answers, false)) {
    co_await drain();
  }
  discard();
  const auto due =
      Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(reply_s));
  co_await write(std::move(question), due);
  co_return due;
}

void SerialLink::forget_answers() noexcept { impl_->has_forgotten_answers = true; }

void SerialLink::listen_anew() noexcept { impl_->heard.clear(); }

const std::string& SerialLink::heard() const { return impl_->heard; }

StageLost SerialLink::unanswered(const std::string& question, int attempts, const std::string& check) const {
  const std::string asked = "`" + question + "`, asked " + std::to_string(attempts) + " times";
  const std::string safe = "If it still turns, switch it off. ";
  if (impl_->heard.empty())
    return StageLost("the stage on " + impl_->path + " did not answer " + asked + ". " + safe + check);
  return StageLost(
      "what came from " + impl_->path + " to " + asked + ", is not an answer in the stage's language: " +
      shown_bytes(impl_->heard) + " at " + std::to_string(impl_->baud) + " baud. " + safe +
      "The usual causes are another baud rate (`baud` in the bench file or the stage's address), another "
      "device on this port, and a noisy cable.");
}

std::string shown_bytes(const std::string& bytes) {
  std::string text = "\"";
  for (const char c : bytes.substr(0, most_shown)) {
    std::array<char, 8> escaped{};
    const bool is_plain = c >= ' ' && c <= '~' && c != '"' && c != '\\';
    std::snprintf(escaped.data(), escaped.size(), is_plain ? "%c" : "\\x%02X", static_cast<unsigned char>(c));
    text += c == '\r' ? "\\r" : c == '\n' ? "\\n" : escaped.data();
  }
  return text + (bytes.size() > most_shown ? "...\"" : "\"");
}

}  // namespace rig
