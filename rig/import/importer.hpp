// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "fit/recording.hpp"

namespace rig {

/// One scan of a foreign recording, borrowed. Times are absolute, in whatever epoch the file uses.
struct ImportedScan {
  std::int64_t stamp_ns = 0;
  std::string source;  ///< The topic or device it came from.
  std::string frame;   ///< The lidar's frame, to find its place on the robot; may be empty.
  fit::ScanGeometry geometry;
  std::span<const std::uint16_t> range_mm;   ///< 0 = no echo.
  std::span<const std::uint16_t> intensity;  ///< Empty when there is none.
};

/// Where one part of a robot sits on another: p_parent = R(qw, qx, qy, qz) p_child + (x, y, z).
struct ImportedTransform {
  std::string parent, child;
  double x_mm = 0, y_mm = 0, z_mm = 0;
  double qw = 1, qx = 0, qy = 0, qz = 0;
};

/// Takes what an importer reads, in the order of the file.
class ImportSink {
 public:
  virtual ~ImportSink() = default;
  virtual void scan(const ImportedScan& scan) = 0;
  /// A pose or wheel angles; its host_us is not used. `source` tells several kinds of odometry apart, `frame`
  /// is the part of the robot that is tracked.
  virtual void pose(std::int64_t stamp_ns, const std::string& source, const std::string& frame,
                    const fit::TrackPose& pose) = 0;
  /// Heading from an inertial unit, and its rate.
  virtual void imu(std::int64_t stamp_ns, const std::string& source, double yaw_rad, double rate_rad_s) = 0;
  virtual void transform(const ImportedTransform& transform) = 0;
  /// What the lidar says of itself ("model", "serial" ...).
  virtual void property(const std::string& key, const std::string& value) = 0;
  /// A sentence for the operator: something was damaged, left out or assumed.
  virtual void note(const std::string& text) = 0;
  /// A sentence on what cannot be, with what to do: a reason to refuse the file.
  virtual void doubt(const std::string& text) { note(text); }
  /// False when the sink has seen enough; importers then stop early.
  [[nodiscard]] virtual bool wants_more() const = 0;
};

/// What the operator chooses where a recording holds several of a kind; empty: the first found.
struct ImportOptions {
  std::string scan_topic, odometry_topic, left_wheel, right_wheel;
  /// How the beams lie, for tables that do not say it (CSV).
  std::optional<double> first_deg, step_deg, scan_hz;
  std::vector<std::string> columns;    ///< What a table's columns hold, in place of its header.
  std::optional<double> ticks_a_turn;  ///< Counts of an encoder in one turn of its wheel.
};

/// One file format of other tools. Each lives in its own file rig/import/formats/NAME.cpp, which defines
/// `std::unique_ptr<rig::Importer> rig::importers::make_NAME()`.
class Importer {
 public:
  virtual ~Importer() = default;
  /// For messages: "MCAP bag".
  [[nodiscard]] virtual std::string name() const = 0;
  /// Whether `path` (a file with these first bytes, or a folder, then without bytes) is of this format.
  [[nodiscard]] virtual bool recognises(const std::string& path,
                                        std::span<const std::uint8_t> first_bytes) const = 0;
  /// Whether it makes anything of ImportOptions::columns.
  [[nodiscard]] virtual bool takes_columns() const { return false; }
  /// Reads it front to back in bounded memory. Throws UsageError when nothing of it can be read; damage
  /// further on is a note, and what is whole is kept.
  virtual void read(const std::string& path, const ImportOptions& options, ImportSink& sink) const = 0;
};

namespace importers {
std::vector<std::unique_ptr<Importer>> all();
}

/// The importer for a file or folder. Throws UsageError naming what can be read, or which command reads it.
[[nodiscard]] std::unique_ptr<Importer> importer_for(const std::string& path,
                                                     const ImportOptions& options = {});

}  // namespace rig
