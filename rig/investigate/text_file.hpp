// SPDX-License-Identifier: MIT
#pragma once

#include <fstream>
#include <iterator>
#include <string>

#include "rig/errors.hpp"

namespace rig::investigate {

/// All of a file. Throws UsageError when it cannot be read.
[[nodiscard]] inline std::string text_of_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::string text((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  if (!in.good() && !in.eof()) throw UsageError("cannot read " + path + ".");
  return text;
}

}  // namespace rig::investigate
