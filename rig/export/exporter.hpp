// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "rig/output_place.hpp"
#include "rig/session/session_store.hpp"

namespace rig {

/// What is exported: a session, or a file of another kind for a format that accepts it (a correction).
struct ExportSource {
  std::string path;
  const SessionStore* session = nullptr;  ///< Null when `path` is not a session file.
  bool any_lidar = false;                 ///< Also a correction that was made for another lidar.
  const SessionStore* centre = nullptr;   ///< Whose rotation centre goes along; null: `session`'s own.
};

/// One format of `rig export`. Each lives in its own file rig/export/formats/NAME.cpp, which defines
/// `std::unique_ptr<rig::Exporter> rig::exporters::make_NAME()`.
class Exporter {
 public:
  virtual ~Exporter() = default;
  [[nodiscard]] virtual std::string format() const = 0;
  /// One line for --help.
  [[nodiscard]] virtual std::string describes() const = 0;
  /// True if files that are not sessions are welcome too.
  [[nodiscard]] virtual bool accepts_files() const { return false; }
  /// True if it is made from a range correction, which belongs to one lidar.
  [[nodiscard]] virtual bool of_correction() const { return false; }
  /// True if a rotation centre has a place in it.
  [[nodiscard]] virtual bool takes_centre() const { return false; }
  /// Writes the whole of `output`, or throws and leaves the caller to remove what there is of it.
  virtual void write(const ExportSource& source, const std::string& output) const = 0;
};

/// Every format there is, in the order of their file names.
[[nodiscard]] const std::vector<std::unique_ptr<Exporter>>& all_exporters();

/// Exports to `output`, which appears whole or not at all; returns sentences for the operator. Throws
/// UsageError for an unknown format (with what there is) and a correction that is not for the session's
/// lidar, and MeasurementError when the source does not hold what the format needs.
std::vector<std::string> run_export(const std::string& format, const ExportSource& source,
                                    const OutputPlace& output);

}  // namespace rig
