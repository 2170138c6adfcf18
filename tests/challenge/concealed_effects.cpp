// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "concealed.hpp"
#include "world.hpp"

namespace challenge {
namespace {

class EffectRecorder : public Recorder {
 public:
  EffectRecorder(const Session& session, const Causes& causes) : world_(session, causes, session.truth) {}
  void scan(std::size_t capture, int seq, Random& random, std::vector<std::uint16_t>& range,
            std::vector<std::uint16_t>& intensity) override {
    world_.scan(capture, seq, random, noise_, range, intensity);
  }

 private:
  World world_;
  World::Noise noise_;
};

}  // namespace

std::shared_ptr<Cause> make_concealed(const std::string& id) { return make_cause(id); }
const std::vector<std::pair<std::string, std::vector<std::string>>>& concealed_scenes() {
  return cause_scenes();
}
void prepare(Session&) {}
/// The nearest law of the kind that benches state: this device's receiver bends in another way.
void draw_claim(Session& session, Random& random) {
  const World world(session, {}, session.truth);
  double best = 1e300, low = 1e9, high = 0;
  for (std::size_t c = 0; c < session.captures.size(); ++c)
    for (int step = session.captures[c].first_step; step <= session.captures[c].last_step; step += 5) {
      const Sight sight = world.look(world.moment(c, 0, step));
      if (sight.wall < 0 || std::abs(sight.incidence) > 80 * degree) continue;
      low = std::min(low, sight.power);
      high = std::max(high, sight.power);
    }
  for (double power = 0.1; power < 1; power += 0.02) {
    for (double full = 500; full < 2e5; full *= 1.15) {
      double sum = 0, squares = 0, count = 0;
      std::vector<double> left;
      for (double p = low; p < 1.01 * high; p *= std::pow(high / low, 0.05)) {
        // Gain and bend work on each other: three rounds of solving for the gain.
        double gain = 1000;
        const double stated = session.radiometer.counts(p);
        for (int i = 0; i < 6; ++i)
          gain = stated * std::hypot(1, gain * std::pow(p, power) / full) / std::pow(p, power);
        left.push_back(std::log(gain));
        sum += left.back();
        count += 1;
      }
      for (const double x : left) squares += std::pow(x - sum / count, 2);
      if (squares >= best) continue;
      best = squares;
      session.claimed_gain = std::exp(sum / count);
      session.claimed_power = power;
      session.claimed_full = full;
    }
  }
  session.claimed_gain *= 1 + session.u_gain * random.normal();
  session.counts_noise = 0.03;
}
std::unique_ptr<Recorder> make_recorder(const Session& session, const Causes& causes) {
  return std::make_unique<EffectRecorder>(session, causes);
}
std::string world_file(const Session&, const Causes&) { return ""; }

}  // namespace challenge
