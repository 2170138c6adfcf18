// SPDX-License-Identifier: MIT
#include "rig/runner/scip_source.hpp"

#include <nlohmann/json.hpp>

#include "lidar/client.hpp"
#include "rig/errors.hpp"

namespace rig {
namespace {

using nlohmann::json;

class ScipSource final : public LidarSource {
 public:
  ScipSource(boost::asio::any_io_executor executor, const Endpoint& address)
      : client_(std::move(executor), address.host, address.port),
        address_(address.host + ":" + std::to_string(address.port)) {}

  awaitable<json> connect() override {
    auto connecting = identify();
    const lidar::Identity identity = co_await as_device_error(std::move(connecting));
    co_await synchronise();
    co_return json::parse(identity.json);
  }

  awaitable<void> synchronise() override {
    try {
      co_await client_.synchronise();
    } catch (const lidar::LidarError& error) {
      // A lidar without time adjustment is dated by when its scans arrive; one that went away is lost.
      if (!client_.connected()) throw DeviceError(error.what());
    }
  }

  awaitable<void> start(LidarStream stream) override {
    bool unknown = false;
    try {
      co_await start_once(stream, stream.intensity && sends_intensities_);
    } catch (const lidar::LidarError& error) {
      // A lidar that does not know ME measures distances all the same.
      unknown =
          error.kind() == lidar::LidarError::Kind::unknown_command && stream.intensity && sends_intensities_;
      if (error.kind() == lidar::LidarError::Kind::wrong_use) throw UsageError(error.what());
      if (!unknown) throw DeviceError(error.what());
    }
    if (!unknown) co_return;
    sends_intensities_ = false;
    auto starting = start_once(stream, false);
    co_await as_device_error(std::move(starting));
  }
  bool sends_intensities() const override { return sends_intensities_; }

  awaitable<lidar::Scan> next() override {
    auto reading = client_.next();
    co_return co_await as_device_error(std::move(reading));
  }

  void reuse(lidar::Scan scan) override { client_.reuse(std::move(scan)); }

  awaitable<void> stop() override {
    auto stopping = client_.stop();
    co_await as_device_error(std::move(stopping));
  }

  std::uint64_t lost() const override { return client_.statistics().lost; }
  std::uint64_t rejected() const override { return client_.statistics().bad; }
  json statistics() const override {
    const lidar::Statistics counted = client_.statistics();
    return {{"scans", counted.scans},
            {"lost", counted.lost},
            {"damaged", counted.bad},
            {"repeated", counted.repeated},
            {"stale", counted.stale},
            {"reconnections", counted.reconnects},
            {"attempts_in_vain", counted.failed_connects}};
  }
  std::string address() const override { return address_; }
  int clock_restarts() const override { return client_.clock().resets; }
  bool own_time() const override { return !client_.clock().follows_host; }

 private:
  awaitable<void> start_once(LidarStream stream, bool with_intensity) {
    lidar::StreamRequest request(stream.first_step, stream.last_step, stream.cluster, stream.skip,
                                 with_intensity);
    return client_.start(request);
  }

  awaitable<lidar::Identity> identify() {
    if (!known_) {
      lidar::Identity identity = co_await client_.connect();
      known_ = true;
      co_return identity;
    }
    co_return co_await client_.reconnect();
  }

  template <class T>
  static awaitable<T> as_device_error(awaitable<T> work) {
    try {
      co_return co_await std::move(work);
    } catch (const lidar::LidarError& error) {
      if (error.kind() == lidar::LidarError::Kind::cannot_connect) throw LidarAbsent(error.what());
      // It is there and was asked for what it does not have: connecting again changes nothing.
      if (error.kind() == lidar::LidarError::Kind::wrong_use) throw UsageError(error.what());
      throw DeviceError(error.what());
    }
  }

  lidar::Client client_;
  std::string address_;
  bool known_ = false, sends_intensities_ = true;
};

}  // namespace

std::unique_ptr<LidarSource> make_scip_source(boost::asio::any_io_executor executor,
                                              const Endpoint& address) {
  return std::make_unique<ScipSource>(std::move(executor), address);
}

}  // namespace rig
