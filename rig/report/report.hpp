// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "rig/output_place.hpp"

namespace rig {

/// Writes the certificate of `session_file` to `place`: `.html`, `.pdf` (PDF/A-3b, through WeasyPrint),
/// `.json`, or `.xml` (Digital Calibration Certificate). The file appears whole or not at all. Throws
/// UsageError (unknown ending, no WeasyPrint) and MeasurementError (WeasyPrint not done within `longest_pdf`,
/// and stopped).
void write_report(const std::string& session_file, const OutputPlace& place,
                  std::chrono::milliseconds longest_pdf = std::chrono::minutes(5));

struct IssuedReport {
  std::string file;          ///< Where it is: `wanted`, or beside it where another certificate is.
  std::string certificates;  ///< The session's key of that name, for whoever may write the session.
};

/// As write_report(), but never over a certificate of another number. `previous`: the calibration before, or
/// null (make_certificate()).
[[nodiscard]] IssuedReport issue_report(const std::string& session_file, const std::string& wanted,
                                        const nlohmann::json& previous);
[[nodiscard]] IssuedReport issue_report(const std::string& session_file, const std::string& wanted);

}  // namespace rig
