// SPDX-License-Identifier: MIT
#include "rig/report/report.hpp"

#include <filesystem>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"
#include "rig/report/certificate.hpp"
#include "rig/report/certificate_page.hpp"
#include "rig/report/dcc.hpp"
#include "rig/report/issue.hpp"
#include "rig/report/pdf.hpp"
#include "rig/whole_file.hpp"

namespace rig {
namespace {

using json = nlohmann::json;

std::string ending_of(const std::string& output) {
  std::string ending = std::filesystem::path(output).extension().string();
  if (ending != ".html" && ending != ".pdf" && ending != ".json" && ending != ".xml")
    throw UsageError("rig report writes .html, .pdf, .json or .dcc.xml, not '" + output +
                     "': give -o a name with one of these endings");
  return ending;
}

void write_certificate(const json& certificate, const std::string& output,
                       std::chrono::milliseconds longest_pdf) {
  const std::string ending = ending_of(output);
  if (ending == ".json")
    return write_file_atomically(output,
                                 certificate.dump(1, ' ', false, json::error_handler_t::replace) + "\n");
  if (ending == ".xml") return write_file_atomically(output, to_dcc(certificate));
  const std::string html = to_html(certificate);
  if (ending == ".html") return write_file_atomically(output, html);
  write_pdf(html, output, longest_pdf);
}

}  // namespace

void write_report(const std::string& session_file, const OutputPlace& place,
                  std::chrono::milliseconds longest_pdf) {
  (void)ending_of(place.path());
  const SessionStore session(session_file, SessionStore::Mode::read);
  write_certificate(make_certificate(session, session_file), place.path(), longest_pdf);
}

IssuedReport issue_report(const std::string& session_file, const std::string& wanted) {
  return issue_report(session_file, wanted, nullptr);
}

IssuedReport issue_report(const std::string& session_file, const std::string& wanted, const json& previous) {
  (void)ending_of(wanted);
  const SessionStore session(session_file, SessionStore::Mode::read);
  const json certificate = make_certificate(session, session_file, previous);
  const std::string file = place_for(session, certificate, wanted);
  const OutputPlace place = check_output({file}, {session_file});
  write_certificate(certificate, place.path(), std::chrono::minutes(5));
  return {place.path(), register_with(session, certificate, place.path())};
}

}  // namespace rig
