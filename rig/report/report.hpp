// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <string>

#include "rig/output_place.hpp"

namespace rig {

/// Writes the certificate of `session_file` to `place`: `.html`, `.pdf` (through WeasyPrint) or `.json`.
/// The file appears whole or not at all. Throws UsageError (unknown ending, no WeasyPrint) and
/// MeasurementError (WeasyPrint not done within `longest_pdf`, and stopped).
void write_report(const std::string& session_file, const OutputPlace& place,
                  std::chrono::milliseconds longest_pdf = std::chrono::minutes(5));

}  // namespace rig
