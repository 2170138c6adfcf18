// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <string>

namespace rig {

/// Writes the certificate of `session_file` to `output`: `.html`, `.pdf` (through WeasyPrint) or `.json`.
/// The file appears whole or not at all. Throws UsageError (unknown ending, unwritable place, a recording
/// there, no WeasyPrint) and MeasurementError (WeasyPrint not done within `longest_pdf`, and stopped).
void write_report(const std::string& session_file, const std::string& output,
                  std::chrono::milliseconds longest_pdf = std::chrono::minutes(5));

}  // namespace rig
