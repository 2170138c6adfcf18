// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <stdexcept>
#include <string>

namespace rig {

/// Thrown by what writes a part (below) when the disk does not take it: what it could not do. It reaches the
/// operator as a MeasurementError with the file's name and a remedy.
struct DiskFailure : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Has what was written to `path` reach the disk. Throws MeasurementError, with the remedy, if it does not.
void sync_file(const std::string& path);

/// A name is on the disk only when its folder is: flushes the folder of `path`.
void sync_folder(const std::string& path);

/// Has `write` write a part beside `path`, which takes its place when it is whole: a reader never sees half
/// of it. If that fails, nothing is left of it. Throws what `write` throws, and UsageError if `path` cannot
/// be written, is not a regular file, or is a recording or another kind of file (output_place.hpp).
void write_beside(const std::string& path, const std::function<void(const std::string& part)>& write);

/// Writes `text` into a part. Throws DiskFailure, or std::system_error if the file cannot be made.
void write_text(const std::string& part, const std::string& text);

/// Writes `text` to `path` so that a reader never sees half of it; into a device or a pipe as it comes.
/// Throws UsageError as above.
void write_file_atomically(const std::string& path, const std::string& text);

}  // namespace rig
