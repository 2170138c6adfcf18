// SPDX-License-Identifier: MIT
// Concealed physics as world files for the causal engine of sim/. What an effect does to this session is not
// written down anywhere: the engine runs without noise, with and without the cause, and the difference is
// what the oracle is given.
#include <algorithm>
#include <map>
#include <stdexcept>

#include "concealed.hpp"
#include "worlds/cause.hpp"

namespace challenge {
namespace {

const std::vector<Kind>& kinds() {
  static const std::vector<Kind> all = [] {
    std::vector<Kind> list;
    for (const auto& part : {kinds_of_ranges(), kinds_of_angles(), kinds_of_stage(), kinds_of_targets(),
                             kinds_of_noise(), kinds_of_light(), kinds_outside_the_catalogue()})
      list.insert(list.end(), part.begin(), part.end());
    return list;
  }();
  return all;
}

json world_of(const Session& session, const Causes& causes) {
  json world = plain_world(session);
  std::map<std::string, std::string> owner;
  for (const auto& cause : causes) {
    const json flat = dynamic_cast<const WorldCause&>(*cause).keys().flatten();
    for (const auto& [key, value] : flat.items()) {
      const auto [place, fresh] = owner.emplace(key, cause->id);
      if (!fresh)
        throw std::runtime_error(cause->id + " and " + place->second + " both set " + key.substr(1));
    }
    world = dynamic_cast<const WorldCause&>(*cause).add_to(world);
  }
  return world;
}

class WorldRecorder : public Recorder {
 public:
  WorldRecorder(const Session& session, const Causes& causes)
      : session_(session), world_(world_of(session, causes)) {}

  void scan(std::size_t index, int seq, Random& random, std::vector<std::uint16_t>& range,
            std::vector<std::uint16_t>& intensity) override {
    if (!bench_)
      bench_ =
          std::make_unique<Bench>(session_, world_, static_cast<std::uint64_t>(random.integer(1, 1 << 30)));
    bench_->scan(index, seq);
    const Capture& capture = session_.captures[index];
    range.clear();
    intensity.clear();
    for (int step = capture.first_step; step <= capture.last_step; ++step) {
      const std::uint32_t value = bench_->range(step);
      range.push_back(value <= 4 || value >= 65000 ? std::uint16_t{0} : static_cast<std::uint16_t>(value));
      intensity.push_back(static_cast<std::uint16_t>(std::min(65535U, bench_->intensity(step))));
    }
  }

 private:
  const Session& session_;
  json world_;
  std::unique_ptr<Bench> bench_;
};

}  // namespace

std::shared_ptr<Cause> make_concealed(const std::string& id) {
  const auto found = std::ranges::find(kinds(), id, &Kind::id);
  if (found == kinds().end()) throw std::invalid_argument("unknown kind '" + id + "'; --list shows them");
  return std::make_shared<WorldCause>(*found);
}

const std::vector<std::pair<std::string, std::vector<std::string>>>& concealed_scenes() {
  static const auto list = [] {
    std::vector<std::pair<std::string, std::vector<std::string>>> names;
    for (const Kind& kind : kinds()) names.emplace_back(kind.id, kind.scenes);
    return names;
  }();
  return list;
}

/// The stage comes to the first capture from below.
void prepare(Session& session) {
  if (!session.captures.empty() && session.captures[0].approach == 0) session.captures[0].approach = 1;
}

/// The device's own law (docs/develop/worlds.md), within what an operator knows of it.
void draw_claim(Session& session, Random& random) {
  session.claimed_gain = 900 * (1 + session.u_gain * random.normal());
  session.claimed_power = session.radiometer.exponent + session.u_power * random.normal();
  session.claimed_full = 2800;
  session.claimed_overlap_mm = 80;
  session.counts_noise = random.uniform(0.01, 0.05);
}

std::unique_ptr<Recorder> make_recorder(const Session& session, const Causes& causes) {
  return std::make_unique<WorldRecorder>(session, causes);
}

std::string world_file(const Session& session, const Causes& causes) {
  json world = world_of(session, causes);
  // Who serves it has the whole lidar that the session's bench describes, not only the steps that were used.
  world["bench"]["lidar"]["steps"] = session.steps;
  world["bench"]["lidar"]["front_step"] = session.front_step;
  return world.dump(1);
}

}  // namespace challenge
