// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "world.hpp"

namespace challenge {

/// A cause by its name: where it shows, and who makes it.
struct Entry {
  std::string coordinate;
  std::vector<std::string> scenes;
  std::shared_ptr<Cause> (*make)();
};

template <typename T>
std::shared_ptr<Cause> make() {
  return std::make_shared<T>();
}

/// Acts on one target, which is drawn.
struct OnOneTarget : Cause {
  int wall = 0;
  std::string name;
  void draw(Session& session, Random& random) override {
    wall = random.integer(0, static_cast<int>(session.walls.size()) - 1);
    name = session.walls[static_cast<std::size_t>(wall)].name;
  }
};

using Entries = std::vector<std::pair<std::string, Entry>>;
// Causes of the catalogue's mechanisms, in its order.
[[nodiscard]] const Entries& causes_of_range();
[[nodiscard]] const Entries& causes_of_geometry();
[[nodiscard]] const Entries& causes_of_noise();
/// Effects outside the catalogue; their names begin with "unknown-".
[[nodiscard]] const Entries& outside_the_catalogue();

}  // namespace challenge
