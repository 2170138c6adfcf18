// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "fit/numeric/estimate.hpp"

namespace rig {

/// One value of a result, as the archive keeps it.
struct ArchivedValue {
  std::string kind, name, label, unit;    ///< kind.name is the quantity: "centre.centre_x_mm".
  double value = 0, u = 0, expanded = 0;  ///< u: k = 1; expanded: as the certificate has it. 0: not stated.
  [[nodiscard]] std::string quantity() const { return kind + "." + name; }
};

/// A requirement that was set for a quantity.
struct ArchivedLimit {
  std::string quantity, verdict;
  std::optional<double> min, max;
};

struct ArchivedMechanism {
  std::string mechanism;
  double probability = 0;
  std::map<std::string, fit::Estimate> parameters;
};

/// What `rig explain` said of the session.
struct ArchivedExplanation {
  std::string verdict, made_utc;
  std::vector<ArchivedMechanism> mechanisms;
  std::vector<std::string> undecided;  ///< Sets, as "a or b".
  /// Physics without a name; empty: none. The curve is what it does along its coordinate, in mm or deg.
  std::string unknown_coordinate, unknown_observable, unknown_describes, unknown_channel;
  std::optional<double> unknown_from, unknown_to;
  std::vector<double> curve_at, curve;
};

/// What an archive knows of one session: all that `rig archive list`, `rig history` and `rig fleet` read.
struct SessionRecord {
  std::string path;  ///< From the archive's folder.
  std::int64_t bytes = 0, modified_ns = 0;
  std::string file_sha256;     ///< Of the file, byte for byte.
  std::string content_sha256;  ///< Of what was measured (SessionStore::content_hash): the session's identity.
  std::string measured_utc, software, kind, procedure, procedure_sha256, bench, bench_sha256;
  std::string model, serial, firmware, stage, ended;
  std::string item_state;  ///< "as found" or "as left"; empty: not stated, the item was not adjusted.
  bool simulated = false;
  std::int64_t captures = 0, scans = 0;
  std::vector<ArchivedValue> values;
  std::vector<ArchivedLimit> limits;
  std::optional<ArchivedExplanation> explanation;
};

/// Reads a session as an archive does: nothing on the disk changes, and whatever the file holds ends in a
/// record or in an error. `folder` / `path` is the file. Throws UsageError or MeasurementError.
[[nodiscard]] SessionRecord read_session_record(const std::string& folder, const std::string& path);

/// The explanation in a document (`explanation/1`); nothing if it is none.
[[nodiscard]] std::optional<ArchivedExplanation> explanation_in(const std::string& json,
                                                                const std::string& made_utc);

/// Text as an index holds it and a terminal may show it: UTF-8 without control characters, at most 2,000
/// bytes.
[[nodiscard]] std::string clean_text(const std::string& text);
/// Whether it is so already.
[[nodiscard]] bool is_clean(const std::string& text);

/// SHA-256 of a file's bytes, 64 hexadecimal digits. Throws UsageError if it cannot be read.
[[nodiscard]] std::string file_sha256(const std::string& path);

/// Size and time of the last change, by which an archive sees that a file may have changed. Throws
/// UsageError.
struct FileStamp {
  std::int64_t bytes = 0, modified_ns = 0;
  friend bool operator==(const FileStamp&, const FileStamp&) = default;
};
[[nodiscard]] FileStamp file_stamp(const std::string& path);

inline constexpr double seconds_a_year = 31'556'952;  ///< Of the Gregorian calendar, on average.

/// "2026-05-04T10:00:00Z" in seconds since 1970; nothing if it is no such text.
[[nodiscard]] std::optional<double> seconds_of_utc(const std::string& utc);

}  // namespace rig
