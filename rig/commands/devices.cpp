// SPDX-License-Identifier: MIT
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <cstdio>

#include "lidar/client.hpp"
#include "rig/commands/json_output.hpp"
#include "rig/runner/device_lock.hpp"
#include "rig/runner/endpoint.hpp"
#include "rig/runner/lidar_doubts.hpp"
#include "rig/stage/serial_link.hpp"
#include "rig/stage/stage_factory.hpp"

namespace rig::commands {
namespace {

namespace asio = boost::asio;
using nlohmann::json;

constexpr const char* factory_address = "192.168.0.10:10940";  // As a UST-10LX leaves the factory.

class Devices : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* devices =
        root.add_subcommand("devices", "Finds stages and lidars; sends queries only, nothing moves");
    devices->add_option(
        "--lidar", lidars_,
        std::string("Address to ask, tcp://HOST[:PORT]; may be repeated; default: ") + factory_address);
    devices->add_option("--stage", stages_, "Another port to ask, serial:PATH[?baud=RATE]; may be repeated");
    devices->add_flag("--no-probe", no_probe_, "List the serial ports and query none");
    json_.declare(*devices, "what was found", "devices");
    return devices;
  }

  int run() override {
    check_outputs({json_.output()});
    asio::io_context io(1);
    std::exception_ptr failure;
    auto searching = search();
    asio::co_spawn(io, std::move(searching), [&](std::exception_ptr why) { failure = why; });
    io.run();
    if (failure) std::rethrow_exception(failure);
    json_.write(found_);
    if (asked_in_vain_) throw DeviceError("not every requested device answers; see above.");
    return 0;
  }

 private:
  asio::awaitable<void> search() {
    std::fputs("Serial ports:\n", stderr);
    std::vector<SerialPortInfo> ports = list_serial_ports();
    if (ports.empty() && stages_.empty())
      std::fputs("  none; is the stage's USB cable plugged in?\n", stderr);
    for (const SerialPortInfo& port : ports) {
      co_await ask_port(port, port.path, false);
    }
    for (const std::string& url : stages_) {
      SerialPortInfo port;
      port.path = url.substr(url.starts_with("serial:") ? 7 : 0);
      port.path = port.path.substr(0, port.path.find('?'));
      co_await ask_port(port, url, true);
    }
    std::fputs("Lidars:\n", stderr);
    const bool wanted = !lidars_.empty();
    if (!wanted) lidars_.emplace_back(factory_address);
    for (const std::string& address : lidars_) {
      co_await ask_lidar(address, wanted);
    }
  }

  asio::awaitable<void> ask_port(SerialPortInfo port, std::string url, bool wanted) {
    json entry = {{"path", port.path}, {"description", port.description}};
    std::string line = "  " + port.path;
    if (!port.description.empty()) line += "  " + port.description;
    if (!port.usb_id.empty()) {
      line += "  (USB " + port.usb_id + (port.usb_product.empty() ? "" : " " + port.usb_product) +
              (port.usb_serial.empty() ? "" : ", serial " + port.usb_serial) + ")";
      entry["usb"] = {{"id", port.usb_id}, {"product", port.usb_product}, {"serial", port.usb_serial}};
    }
    std::string answer;
    if (!no_probe_) {
      try {
        auto probing = probe_stage(co_await asio::this_coro::executor, url);
        const StageProbe found = co_await std::move(probing);
        if (const auto& stage = found.identity) {
          answer = "stage: " + stage->language + " " + stage->model +
                   (stage->serial.empty() ? "" : ", serial " + stage->serial);
          entry["stage"] = {{"language", stage->language},
                            {"model", stage->model},
                            {"serial", stage->serial},
                            {"firmware", stage->firmware},
                            {"units_per_deg", stage->units_per_deg},
                            {"url", url.starts_with("serial:") ? url : "serial:" + url}};
        } else {
          // Most ports hold no stage: only one that was asked for, or that says something, needs a remedy.
          answer = wanted || !found.heard.empty() ? found.why_nobody() : "no stage answers";
          if (!found.heard.empty())
            entry["heard"] = {{"bytes", shown_bytes(found.heard)}, {"baud", found.baud}};
          asked_in_vain_ |= wanted;
        }
      } catch (const DeviceError& error) {
        answer = error.what();
        entry["error"] = answer;
        asked_in_vain_ |= wanted;
      }
    }
    std::fprintf(stderr, "%s\n%s", line.c_str(), answer.empty() ? "" : ("      " + answer + "\n").c_str());
    found_["ports"].push_back(entry);
  }

  asio::awaitable<void> ask_lidar(std::string text, bool wanted) {
    const Endpoint address = parse_endpoint(text, "--lidar", 10940);
    json entry = {{"address", "tcp://" + address.host + ":" + std::to_string(address.port)}};
    std::string answer;
    try {
      DeviceLocks locks("rig devices");
      locks.lock("lidar", address.host + ":" + std::to_string(address.port));
      lidar::Client client(co_await asio::this_coro::executor, address.host, address.port);
      const lidar::Identity who = co_await client.connect();
      answer = who.model + ", serial " + who.serial + ", firmware " + who.firmware;
      entry["lidar"] = json::parse(who.json);
      const std::string state = entry["lidar"]["II"].value("STAT", "");
      if (!state.empty() && !says_it_is_well(state)) answer += "; it reports a fault: " + state;
    } catch (const lidar::LidarError& error) {
      answer = error.what();
      entry["error"] = answer;
      asked_in_vain_ |= wanted;
    } catch (const DeviceError& error) {  // A run has it, which asking would disturb.
      answer = error.what();
      entry["error"] = answer;
      asked_in_vain_ |= wanted;
    }
    std::fprintf(stderr, "  tcp://%s:%d\n      %s\n", address.host.c_str(), address.port, answer.c_str());
    found_["lidars"].push_back(entry);
  }

  std::vector<std::string> lidars_, stages_;
  JsonOutput json_;
  bool no_probe_ = false, asked_in_vain_ = false;
  json found_ = {{"schema", "devices/1"}, {"ports", json::array()}, {"lidars", json::array()}};
};

}  // namespace

std::unique_ptr<Command> make_devices() { return std::make_unique<Devices>(); }

}  // namespace rig::commands
