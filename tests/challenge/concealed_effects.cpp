// SPDX-License-Identifier: MIT
#include "concealed.hpp"

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
std::unique_ptr<Recorder> make_recorder(const Session& session, const Causes& causes) {
  return std::make_unique<EffectRecorder>(session, causes);
}
std::string world_file(const Session&, const Causes&) { return ""; }

}  // namespace challenge
