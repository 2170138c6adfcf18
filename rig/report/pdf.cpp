// SPDX-License-Identifier: MIT
#include "rig/report/pdf.hpp"

#include <cstdio>
#include <filesystem>

#include "rig/errors.hpp"
#include "rig/report/child_program.hpp"
#include "rig/whole_file.hpp"

namespace rig {

void write_pdf(const std::string& html, const std::string& output, std::chrono::milliseconds longest) {
  write_beside(output, [&](const std::string& part) {
    const std::string page = part + ".html";
    struct Removal {
      const std::string& file;
      ~Removal() { std::remove(file.c_str()); }
    } const at_the_end{page};
    write_text(page, html);
    const auto printing =
        run_child({"weasyprint", "-q", "--pdf-variant", "pdf/a-3b", page, part}, longest).end;
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

void write_page(const std::string& path, const std::string& html) {
  path.ends_with(".pdf") ? write_pdf(html, path) : write_file_atomically(path, html);
}

}  // namespace rig
