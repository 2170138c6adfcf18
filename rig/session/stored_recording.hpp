// SPDX-License-Identifier: MIT
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "fit/recording.hpp"

namespace rig {

/// Every column of every capture, in order.
inline constexpr const char* select_captures =
    "SELECT id, step, started_us, stage_deg, stage_readback_deg, approach, target, target_shift_mm, "
    "reflectance,"
    " temperature_c, since_power_on_s, stage_rate_deg_s, first_step, last_step, cluster FROM capture ORDER "
    "BY id";

/// Blobs are little-endian whatever the machine.
void swap_if_big_endian(std::vector<std::uint16_t>& values);

/// The committed captures, in order. Throws UsageError for what no capture can be.
[[nodiscard]] std::vector<fit::CaptureInfo> read_captures(SQLite::Database& database,
                                                          const std::string& path);

/// The recording in a session for analysis; shares the database, which must outlive it. Captures are those
/// committed when it is made. Throws UsageError for what no recording can be, and what guarded() throws.
[[nodiscard]] std::unique_ptr<fit::Recording> make_stored_recording(SQLite::Database& database,
                                                                    std::string path, fit::Bench bench);

/// Walks the scans of one committed capture. Throws MeasurementError if there is none.
void walk_scans(SQLite::Database& database, const std::string& path, std::int64_t capture,
                const std::function<void(const fit::ScanView&)>& visit);

}  // namespace rig
