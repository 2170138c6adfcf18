// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <string>

namespace rig {

/// Has `write` write a part beside `path`, which takes its place when it is whole: a reader never sees half
/// of it. If that fails, nothing is left of it. Throws what `write` throws, and UsageError if `path` cannot
/// be written, is not a regular file, or is a recording (output_place.hpp).
void write_beside(const std::string& path, const std::function<void(const std::string& part)>& write);

/// Writes `text` to `path` so that a reader never sees half of it; into a device or a pipe as it comes.
/// Throws UsageError as above.
void write_file_atomically(const std::string& path, const std::string& text);

}  // namespace rig
