// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "rig/session/session_store.hpp"

namespace rig {

/// The calibration certificate of a session as data (`certificate/1`, docs/report.md).
[[nodiscard]] nlohmann::json make_certificate(const SessionStore& session, const std::string& session_file);

/// The certificate as one HTML page that needs nothing else and prints well.
[[nodiscard]] std::string to_html(const nlohmann::json& certificate);

/// Writes the certificate of `session_file` to `output`: `.html`, `.pdf` (through WeasyPrint) or `.json`.
/// The file appears whole or not at all. Throws UsageError (unknown ending, unwritable place, a recording
/// there, no WeasyPrint) and MeasurementError (WeasyPrint not done within `longest_pdf`, and stopped).
void write_report(const std::string& session_file, const std::string& output,
                  std::chrono::milliseconds longest_pdf = std::chrono::minutes(5));

}  // namespace rig
