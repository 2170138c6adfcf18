// SPDX-License-Identifier: MIT
// The simulated Falcon under a client that no one here wrote: the INDI driver of Debian's package indi-bin,
// spoken to as indiserver would, in XML over its standard input and output.
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <functional>

#include "tests/support/stage_rig.hpp"

namespace stage_indi_test {
namespace {

const std::string driver_program = "/usr/bin/indi_falcon_rotator";
const std::string of_device = " device='Pegasus Falcon'";

/// INDI's driver as a child process, its settings in a folder that is removed in the end.
class IndiDriver {
 public:
  explicit IndiDriver(boost::asio::io_context& io)
      : home_(std::filesystem::temp_directory_path() / ("indi_" + std::to_string(::getpid()))), out_(io) {
    std::filesystem::create_directories(home_);
    int to_child[2], from_child[2];
    REQUIRE(::pipe2(to_child, O_CLOEXEC) == 0);
    REQUIRE(::pipe2(from_child, O_CLOEXEC) == 0);
    posix_spawn_file_actions_t files;
    ::posix_spawn_file_actions_init(&files);
    ::posix_spawn_file_actions_adddup2(&files, to_child[0], STDIN_FILENO);
    ::posix_spawn_file_actions_adddup2(&files, from_child[1], STDOUT_FILENO);
    ::posix_spawn_file_actions_addopen(&files, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    std::string program = driver_program, home = "HOME=" + home_.string();
    std::array<char*, 2> arguments{program.data(), nullptr}, environment{home.data(), nullptr};
    REQUIRE(::posix_spawn(&child_, program.c_str(), &files, nullptr, arguments.data(), environment.data()) ==
            0);
    ::posix_spawn_file_actions_destroy(&files);
    ::close(to_child[0]);
    ::close(from_child[1]);
    in_ = to_child[1];
    out_.assign(from_child[0]);
    read();
  }
  ~IndiDriver() {
    ::close(in_);
    ::kill(child_, SIGKILL);
    ::waitpid(child_, nullptr, 0);
    std::error_code ignored;
    std::filesystem::remove_all(home_, ignored);
  }

  void send(const std::string& xml) const {
    const std::string line = xml + "\n";
    REQUIRE(::write(in_, line.data(), line.size()) == static_cast<ssize_t>(line.size()));
  }
  void set_switch(const std::string& name, const std::string& choice) const {
    send("<newSwitchVector" + of_device + " name='" + name + "'><oneSwitch name='" + choice +
         "'>On</oneSwitch></newSwitchVector>");
  }
  void set_number(const std::string& name, const std::string& element, const std::string& value) const {
    send("<newNumberVector" + of_device + " name='" + name + "'><oneNumber name='" + element + "'>" + value +
         "</oneNumber></newNumberVector>");
  }
  /// Forgets what the driver has said so far.
  void forget() { said_.clear(); }
  /// The state the driver gave last to a property: "Ok", "Busy", "Alert", "Idle".
  [[nodiscard]] std::string state_of(const std::string& property) const {
    return after_last(property, "state='", "'");
  }
  [[nodiscard]] std::string value_of(const std::string& property, const std::string& element) const {
    return after_last(property, "name='" + element + "'>", "</one");
  }
  [[nodiscard]] bool said(const std::string& words) const { return said_.find(words) != std::string::npos; }

 private:
  [[nodiscard]] std::string after_last(const std::string& property, const std::string& before,
                                       const std::string& end) const {
    std::size_t at = std::string::npos;
    // The last whole answer about the property.
    for (std::size_t closed = said_.rfind("</set"); closed != std::string::npos && at == std::string::npos;
         closed = closed == 0 ? std::string::npos : said_.rfind("</set", closed - 1)) {
      const std::size_t opened = said_.rfind("<set", closed - 1);
      if (opened == std::string::npos) break;
      const std::size_t named = said_.find("name='" + property + "'", opened);
      if (named < closed) at = named;
    }
    if (at == std::string::npos) return "";
    at = said_.find(before, at);
    if (at == std::string::npos) return "";
    at += before.size();
    return said_.substr(at, said_.find(end, at) - at);
  }
  void read() {
    out_.async_read_some(boost::asio::buffer(buffer_),
                         [this](const boost::system::error_code& failed, std::size_t size) {
                           if (failed) return;
                           said_.append(buffer_.data(), size);
                           read();
                         });
  }

  std::filesystem::path home_;
  pid_t child_ = -1;
  int in_ = -1;
  boost::asio::posix::stream_descriptor out_;
  std::array<char, 4096> buffer_{};
  std::string said_;
};

struct FalconUnderIndi : StageRig {
  FalconUnderIndi() : StageRig("falcon", 10), driver(io) { switch_on(); }
  bool wait_until(const std::function<bool()>& holds) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (!holds() && std::chrono::steady_clock::now() < end) io.run_one_for(std::chrono::milliseconds(50));
    return holds();
  }
  void connect() {
    driver.send("<getProperties version='1.7'/>");
    wait_until([&] { return driver.said("DEVICE_PORT"); });
    driver.send("<newTextVector" + of_device + " name='DEVICE_PORT'><oneText name='PORT'>" + port->path() +
                "</oneText></newTextVector>");
    driver.set_switch("CONNECTION", "CONNECT");
    wait_until([&] { return driver.state_of("CONNECTION") == "Ok"; });
  }
  bool rotate(const std::string& deg) {
    driver.forget();
    driver.set_number("ABS_ROTATOR_ANGLE", "ANGLE", deg);
    return wait_until([&] {
      return driver.state_of("ABS_ROTATOR_ANGLE") == "Ok" && !device->mechanics().moving(clock.now_s());
    });
  }

  IndiDriver driver;
};

}  // namespace

TEST_CASE("Debian's INDI driver connects to the simulated Falcon, turns it, stops it and sets its angle") {
  if (::access(driver_program.c_str(), X_OK) != 0) {
    WARN("not tested: " + driver_program + " is not there (apt-get install indi-bin)");
    return;
  }
  FalconUnderIndi falcon;
  falcon.connect();
  // The firmware that the device told.
  CHECK(falcon.wait_until([&] { return falcon.driver.said("1.3"); }));

  REQUIRE(falcon.rotate("123.45"));
  CHECK(falcon.true_deg() == Approx(123.45).margin(1e-9));
  CHECK(std::stod(falcon.driver.value_of("ABS_ROTATOR_ANGLE", "ANGLE")) == Approx(123.45).margin(1e-6));

  falcon.driver.set_number("ABS_ROTATOR_ANGLE", "ANGLE", "350");
  CHECK(falcon.wait_until([&] { return falcon.driver.state_of("ABS_ROTATOR_ANGLE") == "Busy"; }));
  falcon.driver.set_switch("ROTATOR_ABORT_MOTION", "ABORT");
  CHECK(falcon.wait_until([&] { return falcon.driver.state_of("ROTATOR_ABORT_MOTION") != ""; }));
  CHECK(falcon.driver.state_of("ROTATOR_ABORT_MOTION") == "Ok");
  CHECK(falcon.wait_until([&] { return !falcon.device->mechanics().moving(falcon.clock.now_s()); }));
  CHECK(falcon.true_deg() < 349);

  falcon.driver.forget();
  falcon.driver.set_number("SYNC_ROTATOR_ANGLE", "ANGLE", "10");
  CHECK(falcon.wait_until([&] { return falcon.driver.state_of("SYNC_ROTATOR_ANGLE") == "Ok"; }));
  REQUIRE(falcon.rotate("10.5"));
  CHECK(falcon.device->mechanics().position_units(falcon.clock.now_s()) == Approx(10.5 * 400));
}

}  // namespace stage_indi_test
