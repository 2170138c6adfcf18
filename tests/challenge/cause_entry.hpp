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

using Entries = std::vector<std::pair<std::string, Entry>>;
/// Effects outside the catalogue; their names begin with "unknown-".
[[nodiscard]] const Entries& outside_the_catalogue();

}  // namespace challenge
