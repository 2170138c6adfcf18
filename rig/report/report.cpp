// SPDX-License-Identifier: MIT
#include "rig/report/report.hpp"

#include <filesystem>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"
#include "rig/report/certificate.hpp"
#include "rig/report/certificate_page.hpp"
#include "rig/report/child_program.hpp"
#include "rig/whole_file.hpp"

namespace rig {
namespace {

using json = nlohmann::json;

void write_pdf(const std::string& html, const std::string& output, std::chrono::milliseconds longest) {
  write_beside(output, [&](const std::string& part) {
    const std::string page = part + ".html";
    write_file_atomically(page, html);
    const auto printing = run_child({"weasyprint", "-q", page, part}, longest).end;
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

}  // namespace

void write_report(const std::string& session_file, const OutputPlace& place,
                  std::chrono::milliseconds longest_pdf) {
  const std::string& output = place.path();
  const std::string ending = std::filesystem::path(output).extension().string();
  if (ending != ".html" && ending != ".pdf" && ending != ".json")
    throw UsageError("rig report writes .html, .pdf or .json, not '" + output +
                     "': give -o a name with one of these endings");
  const SessionStore session(session_file, SessionStore::Mode::read);
  const json certificate = make_certificate(session, session_file);
  if (ending == ".json")
    return write_file_atomically(output,
                                 certificate.dump(1, ' ', false, json::error_handler_t::replace) + "\n");
  const std::string html = to_html(certificate);
  if (ending == ".html") return write_file_atomically(output, html);
  write_pdf(html, output, longest_pdf);
}

}  // namespace rig
