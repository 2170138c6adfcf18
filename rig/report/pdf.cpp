// SPDX-License-Identifier: MIT
#include "rig/report/pdf.hpp"

#include <filesystem>

#include "rig/errors.hpp"
#include "rig/report/child_program.hpp"
#include "rig/whole_file.hpp"

namespace rig {

void write_pdf(const std::string& html, const std::string& output, std::chrono::milliseconds longest) {
  write_beside(output, [&](const std::string& part) {
    const std::string page = part + ".html";
    write_file_atomically(page, html);
    const auto printing =
        run_child({"weasyprint", "-q", "--pdf-variant", "pdf/a-3b", page, part}, longest).end;
    std::error_code ignored;
    std::filesystem::remove(page, ignored);
    if (printing == ChildResult::End::missing)
      throw UsageError(
          "PDF needs WeasyPrint: install the package 'weasyprint', or write .html and print it from a "
          "browser");
    if (printing == ChildResult::End::hung)
      throw MeasurementError(hung_in_words("WeasyPrint", longest) + ", so " + output +
                             " is not written: write .html and print it from a browser");
    if (printing != ChildResult::End::done || !std::filesystem::exists(part))
      throw UsageError("WeasyPrint could not write " + output + ": write .html and print it from a browser");
  });
}

}  // namespace rig
