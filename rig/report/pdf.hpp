// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <string>

namespace rig {

/// Prints a page to `output` as PDF/A-3b, through WeasyPrint; whole or not at all. Throws UsageError (no
/// WeasyPrint, or it failed) and MeasurementError (not done within `longest`, and stopped).
void write_pdf(const std::string& html, const std::string& output,
               std::chrono::milliseconds longest = std::chrono::minutes(5));

/// Writes a page as PDF where the name ends in .pdf, else as it is. Throws as write_pdf() and
/// write_file_atomically() do.
void write_page(const std::string& path, const std::string& html);

}  // namespace rig
