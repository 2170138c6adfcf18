// SPDX-License-Identifier: MIT
#include "sim/pty_port.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <deque>
#include <filesystem>
#include <system_error>
#include <utility>

namespace sim {

namespace asio = boost::asio;
namespace fs = std::filesystem;

namespace {

/// Unsolicited lines and the end of a motion are looked for this often.
constexpr auto poll_interval = std::chrono::milliseconds(10);
/// A client that never reads must not fill the memory.
constexpr std::size_t most_unsent_bytes = 1 << 20;
/// At maximum speed each poll of a moving stage brings it by this part of the remaining time nearer to rest,
/// or by the least step. It arrives exactly, so that the time of arrival does not depend on the number of
/// polls. Once the motor stands, the next poll finds the table settled.
constexpr double pause_within_line_s = 0.02;
constexpr double part_per_poll = 0.3, least_step_s = 0.02;

[[noreturn]] void refuse(const std::string& what) {
  throw std::system_error(errno, std::generic_category(), what);
}

speed_t termios_speed(int baud) {
  switch (baud) {
    case 9600:
      return B9600;
    case 19200:
      return B19200;
    case 38400:
      return B38400;
    case 57600:
      return B57600;
    default:
      return B115200;
  }
}

class Descriptor {
 public:
  Descriptor() = default;
  explicit Descriptor(int fd) : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  [[nodiscard]] int get() const { return fd_; }
  int release() { return std::exchange(fd_, -1); }

 private:
  int fd_ = -1;
};

/// A lock of its own kind: the rig takes another one of the port that it has opened (flock).
bool lock(int fd, int command, struct flock& lock) {
  lock.l_type = F_WRLCK;
  lock.l_whence = SEEK_SET;
  return ::fcntl(fd, command, &lock) == 0;
}

/// Whether the link was made before what it leads to: its own pseudo-terminal is gone, and another program
/// has been given the number.
bool is_left_over(const std::string& link) {
  struct stat own {
  }, led_to{};
  if (::lstat(link.c_str(), &own) != 0 || ::stat(link.c_str(), &led_to) != 0) return true;
  return std::pair(led_to.st_ctim.tv_sec, led_to.st_ctim.tv_nsec) >
         std::pair(own.st_mtim.tv_sec, own.st_mtim.tv_nsec);
}

/// Whether a simulator holds the pseudo-terminal there. One that was killed holds nothing any more, and
/// something else may have got its number.
bool is_held(const std::string& path) {
  const Descriptor fd(::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  struct flock held {};
  return fd.get() >= 0 && lock(fd.get(), F_OFD_GETLK, held) && held.l_type != F_UNLCK;
}

}  // namespace

struct PtyPort::Impl : std::enable_shared_from_this<PtyPort::Impl> {
  Impl(const asio::any_io_executor& executor, StageDevice& device_, SimClock& clock_, const Options& options_)
      : device(device_), clock(clock_), options(options_), master(executor), ticker(executor) {}

  void open();
  void close();
  void make_link();
  void remove_link();
  void read();
  void take(std::string bytes);
  void send(const std::string& bytes);
  void deliver(const std::string& bytes, double delay_s);
  void flush();
  void wait_for_tick();
  /// A client, or the device itself, looks at the stage: at maximum speed this is what lets time pass.
  void observe();
  [[nodiscard]] bool baud_agrees();
  /// Does `then` at once or after the delay, unless the port was closed in between.
  void after(double delay_s, std::function<void()> then);

  StageDevice& device;
  SimClock& clock;
  Options options;
  asio::posix::stream_descriptor master;
  asio::steady_timer ticker;
  Descriptor slave;  ///< Held open: without any open slave the master ends with EIO.
  std::string path;
  LineFault fault;
  std::array<char, 4096> buffer{};
  std::deque<std::string> unsent;
  std::size_t unsent_bytes = 0;
  bool writing = false;
  std::size_t connection = 0;  ///< Counts plug-ins: what belongs to an earlier one is dropped.
};

void PtyPort::Impl::open() {
  Descriptor fd(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC));
  if (fd.get() < 0) refuse("no pseudo-terminal could be opened for the stage");
  std::array<char, 128> name{};
  if (::grantpt(fd.get()) != 0 || ::unlockpt(fd.get()) != 0 ||
      ::ptsname_r(fd.get(), name.data(), name.size()) != 0)
    refuse("the pseudo-terminal for the stage could not be prepared");
  slave = Descriptor(::open(name.data(), O_RDWR | O_NOCTTY | O_CLOEXEC));
  if (slave.get() < 0) refuse(std::string("cannot open ") + name.data());
  // Raw from the start, or the line discipline echoes the device's own replies back to it.
  termios settings{};
  if (::tcgetattr(slave.get(), &settings) != 0) refuse(std::string("cannot set up ") + name.data());
  ::cfmakeraw(&settings);
  settings.c_cc[VMIN] = 1;
  settings.c_cc[VTIME] = 0;
  ::cfsetspeed(&settings, termios_speed(device.baud()));
  if (::tcsetattr(slave.get(), TCSANOW, &settings) != 0) refuse(std::string("cannot set up ") + name.data());
  struct flock own {};
  lock(slave.get(), F_OFD_SETLK, own);
  path = name.data();
  master.assign(fd.release());
  ++connection;
  make_link();
  read();
  wait_for_tick();
}

void PtyPort::Impl::close() {
  if (path.empty()) return;
  remove_link();
  ++connection;
  boost::system::error_code ignored;
  master.close(ignored);
  slave = Descriptor();
  ticker.cancel();
  path.clear();
  unsent.clear();
  unsent_bytes = 0;
  writing = false;
}

void PtyPort::Impl::make_link() {
  if (options.link.empty()) return;
  const fs::path link(options.link);
  std::error_code failed;
  const fs::file_status there = fs::symlink_status(link, failed);
  if (fs::exists(there) && !fs::is_symlink(there))
    throw std::system_error(
        std::make_error_code(std::errc::file_exists),
        "the stage's link " + options.link + " would replace a file: choose another path");
  if (fs::is_symlink(there) && fs::read_symlink(link, failed) != path && !is_left_over(options.link) &&
      is_held(options.link))
    throw std::system_error(
        std::make_error_code(std::errc::device_or_resource_busy),
        "the stage's link " + options.link +
            " leads to the stage of another simulator that is running: choose another path");
  fs::remove(link, failed);
  fs::create_symlink(path, link, failed);
  if (failed) throw std::system_error(failed, "cannot make the stage's link " + options.link);
}

void PtyPort::Impl::remove_link() {
  std::error_code ignored;
  if (!options.link.empty() && fs::read_symlink(options.link, ignored) == path)
    fs::remove(options.link, ignored);
}

void PtyPort::Impl::observe() {
  const double now_s = clock.now_s();
  const double rest_s = device.mechanics().rest_s();
  if (!device.mechanics().moving(now_s)) return clock.advance_to(rest_s);
  if (rest_s > now_s)
    clock.advance_to(std::min(rest_s, now_s + std::max(least_step_s, part_per_poll * (rest_s - now_s))));
}

bool PtyPort::Impl::baud_agrees() {
  termios settings{};
  return !options.strict_baud || ::tcgetattr(master.native_handle(), &settings) != 0 ||
         ::cfgetospeed(&settings) == termios_speed(device.baud());
}

void PtyPort::Impl::read() {
  master.async_read_some(asio::buffer(buffer),
                         [self = shared_from_this(), mine = connection](
                             const boost::system::error_code& failed, std::size_t size) {
                           if (mine != self->connection || failed) return;
                           self->take(std::string(self->buffer.data(), size));
                           if (mine == self->connection) self->read();
                         });
}

void PtyPort::Impl::after(double delay_s, std::function<void()> then) {
  if (delay_s <= 0) return then();
  auto timer = std::make_shared<asio::steady_timer>(master.get_executor());
  timer->expires_after(
      std::chrono::duration_cast<asio::steady_timer::duration>(std::chrono::duration<double>(delay_s)));
  timer->async_wait([self = shared_from_this(), timer, mine = connection,
                     then = std::move(then)](const boost::system::error_code& failed) {
    if (!failed && mine == self->connection) then();
  });
}

void PtyPort::Impl::take(std::string bytes) {
  Passage passage(std::move(bytes));
  if (fault) passage = fault(Direction::to_device, std::string(passage.bytes));
  if (!baud_agrees())
    for (char& c : passage.bytes) c = static_cast<char>(~c);
  after(passage.delay_s, [this, arrived = passage.bytes] {
    observe();
    send(device.receive(arrived, clock.now_s()));
  });
}

/// Lines leave one by one, so that a fault can pick one.
void PtyPort::Impl::send(const std::string& bytes) {
  std::size_t start = 0;
  while (start < bytes.size()) {
    const std::size_t end = std::min(bytes.find('\n', start), bytes.size() - 1) + 1;
    Passage passage(bytes.substr(start, end - start));
    start = end;
    if (fault) passage = fault(Direction::to_client, std::string(passage.bytes));
    if (!baud_agrees())
      for (char& c : passage.bytes) c = static_cast<char>(~c);
    const std::size_t first = passage.split ? passage.bytes.size() / 2 : passage.bytes.size();
    deliver(passage.bytes.substr(0, first), passage.delay_s);
    deliver(passage.bytes.substr(first), passage.delay_s + pause_within_line_s);
  }
}

void PtyPort::Impl::deliver(const std::string& bytes, double delay_s) {
  if (bytes.empty()) return;
  after(delay_s, [this, bytes] {
    if (unsent_bytes + bytes.size() > most_unsent_bytes) return;
    unsent_bytes += bytes.size();
    unsent.push_back(bytes);
    flush();
  });
}

void PtyPort::Impl::flush() {
  if (writing || unsent.empty()) return;
  writing = true;
  master.async_write_some(asio::buffer(unsent.front()),
                          [self = shared_from_this(), mine = connection](
                              const boost::system::error_code& failed, std::size_t size) {
                            if (mine != self->connection) return;
                            self->writing = false;
                            if (failed) return;
                            self->unsent_bytes -= size;
                            self->unsent.front().erase(0, size);
                            if (self->unsent.front().empty()) self->unsent.pop_front();
                            self->flush();
                          });
}

void PtyPort::Impl::wait_for_tick() {
  ticker.expires_after(poll_interval);
  ticker.async_wait([self = shared_from_this(), mine = connection](const boost::system::error_code& failed) {
    if (failed || mine != self->connection) return;
    self->observe();
    self->send(self->device.poll(self->clock.now_s()));
    if (mine == self->connection) self->wait_for_tick();
  });
}

PtyPort::PtyPort(const asio::any_io_executor& executor, StageDevice& device, SimClock& clock,
                 const Options& options)
    : impl_(std::make_shared<Impl>(executor, device, clock, options)) {
  impl_->open();
}

PtyPort::~PtyPort() {
  impl_->fault = nullptr;
  impl_->close();
}

const std::string& PtyPort::path() const { return impl_->path; }
void PtyPort::set_line_fault(LineFault fault) { impl_->fault = std::move(fault); }
void PtyPort::unplug() { impl_->close(); }

void PtyPort::replug() {
  if (impl_->path.empty()) impl_->open();
}

}  // namespace sim
