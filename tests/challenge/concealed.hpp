// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "world.hpp"

namespace challenge {

/// What differs between the programs: where concealed physics and its samples come from
/// (concealed_effects.cpp or concealed_worlds.cpp).

/// A concealed cause by its id. Throws std::invalid_argument for an unknown one.
std::shared_ptr<Cause> make_concealed(const std::string& id);
/// Every id, and the scenes in which it can show.
const std::vector<std::pair<std::string, std::vector<std::string>>>& concealed_scenes();
/// Adapts a drawn session before anything is calibrated.
void prepare(Session& session);

/// Records the session, scan by scan in order.
class Recorder {
 public:
  virtual ~Recorder() = default;
  virtual void scan(std::size_t capture, int seq, Random& random, std::vector<std::uint16_t>& range,
                    std::vector<std::uint16_t>& intensity) = 0;
};
std::unique_ptr<Recorder> make_recorder(const Session& session, const Causes& causes);

/// The world file of the session with its causes, or nothing.
std::string world_file(const Session& session, const Causes& causes);

/// Draws what the bench may say about the law of intensity: within its uncertainties of the truth.
void draw_claim(Session& session, Random& random);
/// That law as parameters of `radiometry`: a JSON object.
std::string claimed_law(const Session& session);

}  // namespace challenge
