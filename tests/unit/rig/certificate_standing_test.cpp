// SPDX-License-Identifier: MIT
// What may be certified, under which number, and as a Digital Calibration Certificate.
#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>

#include "rig/report/report.hpp"
#include "rig/session/session_store.hpp"
#include "rig/session/standing.hpp"
#include "tests/support/programs.hpp"
#include "tests/support/test_folder.hpp"

namespace certificate_standing_test {
namespace {

using Catch::Contains;

constexpr const char* whole_statement =
    R"("certificate":{"laboratory":"Lab & Co","address":"Street 1, 38116 Braunschweig",
  "country":"DE","customer":"Robots Ltd","traceability":"gauge 7","authorised_by":"A. Person","received":"2026-05-01",
  "environment":{"temperature_c":23.1,"humidity_percent":"45"},
  "equipment":[{"name":"rail","serial":"R7","certificate":"PTB-1","due":"2027-01-01"}]})";

constexpr const char* result = R"j({"schema":"result/1","kind":"centre","method":"Triangle method.",
  "values":[{"name":"centre_x_mm","label":"Centre, x","value":-1.6342,"u":0.0617,"U":0.1234,"unit":"mm","k":2}],
  "budget":[{"quantity":"centre_x_mm","label":"Centre, x","source":"range noise","kind":"A","distribution":"normal","u":0.0617,
             "input_u":0.05,"input_unit":"mm","sensitivity":1.23,"nu":40,"unit":"mm"},
            {"quantity":"centre_x_mm","label":"Centre, x","source":"edge","kind":"A","distribution":"normal","u":0.0045,
             "input_u":0.002,"input_unit":"deg","sensitivity":2.25,"nu":40,"unit":"mm"},
            {"quantity":"centre_x_mm","label":"Centre, x","source":"combined","kind":"combined","u":0.0617,"unit":"mm","nu":40,"k":2,"U":0.1234}]})j";

/// A session that may be certified.
std::string certified(const TestFolder& folder, const std::string& name = "good.rig") {
  const std::string file = folder / name;
  rig::SessionStore store(file, rig::SessionStore::Mode::create);
  store.set("bench", std::string(R"({"schema":"bench/1",)") + whole_statement + "}");
  store.set("lidar", R"({"PROD":"UST-10LX","SERI":"H0001","FIRM":"1.0"})");
  store.set("created_utc", "2026-05-04T10:00:00Z");
  store.set("ended", "done");
  store.set("procedure",
            "procedure: centre\nversion: 3\nvariables: {samples: 10000, beam_deg: 40}\nsteps: [home]\n");
  store.set("procedure_name", "Rotation centre");
  store.set_progress("scene", R"([{"target":"board"}])");
  store.set_progress("prompt 1", R"({"set":{"illuminance_lux":310.0}})");
  store.set("variables", R"({"samples": 100.0, "beam_deg": 40.0})");
  store.add_result("centre", result);
  return file;
}

std::string page_of(const TestFolder& folder, const std::string& session) {
  rig::write_report(session, rig::check_output({folder / "page.html"}));
  return file_text(folder / "page.html");
}

void with(const std::string& session, const std::function<void(rig::SessionStore&)>& change) {
  rig::SessionStore store(session, rig::SessionStore::Mode::append);
  change(store);
}

}  // namespace

TEST_CASE("a sensitivity has the quantity's unit by the input's, and none where both are the same") {
  const TestFolder folder;
  const std::string page = page_of(folder, certified(folder));
  CHECK(page.find(">2.25 mm/deg<") != std::string::npos);
  CHECK(page.find(">1.23<") != std::string::npos);
}

TEST_CASE("what is complete and consistent is a certificate, with what ISO/IEC 17025 asks for") {
  const TestFolder folder;
  const std::string html = page_of(folder, certified(folder));
  for (const char* expected :
       {"<h1>Calibration certificate</h1>", "Street 1", "Robots Ltd", "2026-05-01",
        "Rotation centre, version 3, SHA-256 ", "samples = 100 (procedure: 10000)", "23.1 \u00b0C", "45 %",
        "310 lx", "PTB-1", "2027-01-01", "as found and as left are the same",
        "shall not be reproduced except in full", "Authorised by: A. Person",
        "Signature:", "combined; U = 0.12 mm with k = 2.00", "End of certificate RIG-20260504-"})
    CHECK_THAT(html, Contains(expected));
  CHECK_THAT(html,
             !Contains("beam_deg = ") && !Contains("SIMULATED") && !Contains("a report, not a certificate"));
}

TEST_CASE("what cannot be certified is a report that says why on top") {
  const TestFolder folder;
  const std::string session = certified(folder);
  std::string expected;
  SECTION("a value that is not finite") {
    with(session, [](auto& store) {
      store.add_result(
          "wall",
          R"({"values":[{"name":"front_mm","label":"Front wall","value":null,"u":null,"U":null,"unit":"mm"}]})");
    });
    expected = "has no finite value or uncertainty.";
  }
  SECTION("captures against the bench file") {
    with(session, [](auto& store) {
      store.add_result("wall", R"({"values":[],"contradictions":["The board is elsewhere."]})");
    });
    expected = "The board is elsewhere.";
  }
  SECTION("two methods far apart") {
    with(session, [](auto& store) {
      store.add_result(
          "wall",
          R"({"values":[],"comparisons":[{"agree":false,"far_apart":true,"says":"Radius: 1 and 2"}]})");
    });
    expected = "Two methods do not agree. Radius: 1 and 2.";
  }
  SECTION("no serial number") {
    with(session, [](auto& store) { store.set("lidar", R"({"PROD":"UST-10LX"})"); });
    expected = "The lidar is not identified";
  }
  SECTION("a laboratory that says nothing of itself") {
    with(session, [](auto& store) {
      store.set("bench", R"({"schema":"bench/1","certificate":{"laboratory":"Lab"}})");
    });
    expected = "does not state: its address, customer, traceability of the references, who authorises it";
  }
  SECTION("references whose calibration had run out") {
    with(session, [](auto& store) {
      std::string bench = store.get("bench").value();
      store.set("bench", bench.replace(bench.find("2027-01-01"), 10, "2026-01-01"));
    });
    expected =
        "The calibration of &apos;rail&apos; was due on 2026-01-01, before the measurement on 2026-05-04";
  }
  SECTION("an item that was received after it was measured") {
    with(session, [](auto& store) {
      std::string bench = store.get("bench").value();
      store.set("bench", bench.replace(bench.find("2026-05-01"), 10, "2031-05-01"));
    });
    expected = "was received on 2031-05-01, after it was measured on 2026-05-04";
  }
  SECTION("ranges that were corrected") {
    with(session, [](auto& store) { store.set("correction", "{}"); });
    expected = "what is reported is what the correction leaves";
  }
  SECTION("an unfinished procedure") {
    with(session, [](auto& store) { store.set("ended", "stopped by the operator"); });
    expected = "ended before its last step: stopped by the operator";
  }
  SECTION("a run that was killed, or still runs") {
    with(session, [](auto& store) {
      store.set("ended", "");
      store.set("steps", R"([{"key":"1","text":"home"},{"key":"2","text":"capture"}])");
      store.set_progress("1", "{}");
    });
    expected = "ended before its last step: it was killed, or still runs; 1 of 2 steps are done";
  }
  const std::string html = page_of(folder, session);
  CHECK_THAT(html, Contains("<h1>Report</h1>") && Contains("This is a report, not a certificate:") &&
                       Contains(expected));
  CHECK_FALSE(rig::standing_of(rig::SessionStore(session, rig::SessionStore::Mode::read)).certifies());
}

TEST_CASE("two pages are for the reader, whatever the annexes hold") {
  if (std::system("command -v weasyprint >/dev/null 2>&1 && command -v pdftotext >/dev/null 2>&1") != 0) {
    WARN("skipped: WeasyPrint or pdftotext is not installed");
    return;
  }
  const TestFolder folder;
  const std::string session = certified(folder), pdf = folder / "page.pdf", text = folder / "pages.txt";
  with(session, [](auto& store) {
    // As many values as a right-angled corner has, and a limit for some.
    nlohmann::json wall = {{"schema", "result/1"}, {"kind", "wall"}, {"values", nlohmann::json::array()}};
    for (int i = 0; i < 12; ++i)
      wall["values"].push_back(
          {{"name", "value_" + std::to_string(i) + "_mm"},
           {"label", "A quantity whose name is as long as the longest are, number " + std::to_string(i)},
           {"value", 1500.0 + i},
           {"u", 0.1},
           {"U", 0.2},
           {"k", 2},
           {"unit", "mm"}});
    store.add_result("wall", wall.dump());
    nlohmann::json limits = {
        {"schema", "limits/1"}, {"rule", "simple acceptance"}, {"checks", nlohmann::json::array()}};
    for (int i = 0; i < 3; ++i)
      limits["checks"].push_back(
          {{"name", "Limit"}, {"value", 1}, {"U", 0.1}, {"unit", "mm"}, {"max", 2}, {"verdict", "pass"}});
    store.add_result("limits", limits.dump());
  });
  rig::write_report(session, rig::check_output({pdf}));
  const auto pages = [&](const std::string& which) {
    REQUIRE(std::system(("pdftotext " + which + " " + pdf + " " + text).c_str()) == 0);
    return file_text(text);
  };
  CHECK_THAT(pages("-l 2"), Contains("Signature:") && !Contains("Annex: results in detail"));
  CHECK_THAT(pages("-f 3 -l 3"), Contains("Annex: results in detail"));
}

TEST_CASE("a simulated device is named on every page") {
  const TestFolder folder;
  const std::string session = certified(folder);
  with(session, [](auto& store) {
    store.set("lidar",
              R"({"VEND":"rig-sim: simulated, not a device of Hokuyo","PROD":"UST-10LX","SERI":"H0001"})");
  });
  CHECK_THAT(page_of(folder, session), Contains("<h1>Report of a simulated calibration</h1>") &&
                                           Contains("@top-center { content:\"SIMULATED") &&
                                           Contains("<div class=\"mark\">SIMULATED"));
}

TEST_CASE(
    "a new fit is an amendment with a number of its own, and no certificate is overwritten by another") {
  const TestFolder folder;
  const std::string session = certified(folder), page = folder / "centre.html";
  const auto issue = [&](const std::string& of) {
    const rig::IssuedReport issued = rig::issue_report(of, page);
    with(of, [&](auto& store) { store.set("certificates", issued.certificates); });
    return issued.file;
  };
  CHECK(issue(session) == page);
  const std::string first = file_text(page);
  CHECK(issue(session) == page);  // The same again.
  std::filesystem::copy_file(session, folder / "renamed.rig");
  CHECK(issue(folder / "renamed.rig") == page);
  with(session, [](auto& store) {
    std::string other = result;
    other.replace(other.find("-1.6342"), 7, "-1.7342");
    store.add_result("centre", other);
  });
  const std::string amended = issue(session);
  CHECK_THAT(amended, Contains("centre-RIG-20260504-") && Contains("-A1.html"));
  CHECK_THAT(file_text(amended),
             Contains("<h1>Calibration certificate, amendment 1</h1>") && Contains("replaces RIG-20260504-"));
  CHECK(file_text(page).find("-1.63 mm") != std::string::npos);
  const std::string second = certified(folder, "second.rig");
  with(second, [](auto& store) {
    store.set("bench", std::string(R"({"schema":"bench/1","lidar":{"steps":1000},)") + whole_statement + "}");
  });
  const std::string beside = issue(second);
  CHECK(beside != page);
  CHECK_THAT(file_text(page), Contains("Calibration certificate"));
  CHECK(folder.names().count("centre.html") == 1);
}

TEST_CASE("a procedure of any length is read for its version and its variables") {
  const TestFolder folder;
  const std::string session = certified(folder);
  with(session, [](auto& store) {
    const std::string endless(1'000'000, 'x');
    store.set("procedure", "procedure: centre\nabout: " + endless + "\nversion: '" + endless +
                               "'\nvariables: {a: " + endless + ", samples: 10000}\nsteps: [home]\n");
  });
  const std::string page = page_of(folder, session);
  CHECK_THAT(page, Contains("version xxxx") && Contains("samples = 100 (procedure: 10000)"));
}

TEST_CASE("a certificate that goes to a program is registered as any other, unless the session is to stay") {
  const TestFolder folder;
  const std::string session = certified(folder);
  const auto registered = [&] {
    const rig::SessionStore store(session, rig::SessionStore::Mode::read);
    return nlohmann::json::parse(store.get("certificates").value_or("[]"));
  };
  const auto run = [&](std::vector<std::string> options) {
    std::vector<std::string> words = {RIG_BIN_DIR "/rig", "report", session, "--json"};
    words.insert(words.end(), options.begin(), options.end());
    Program report(words, folder);
    std::string output;
    while (const auto line = report.line()) output += *line;
    const int status = report.exit_status();
    INFO(report.errors());
    CHECK(status == 0);
    return output;
  };
  (void)run({"-", "--no-store"});
  CHECK(registered().empty());
  const auto certificate = nlohmann::json::parse(run({"-"}));
  REQUIRE(registered().size() == 1);
  CHECK(registered()[0].at("number") == certificate.at("number"));
  (void)run({folder / "c.json"});
  REQUIRE(registered().size() == 1);
  CHECK(registered()[0].at("files") == nlohmann::json({"standard output", "c.json"}));
}

TEST_CASE("the Digital Calibration Certificate satisfies PTB's schema") {
  const TestFolder folder;
  const std::string session = certified(folder), file = folder / "c.dcc.xml";
  with(session, [](auto& store) {
    store.add_result(
        "limits",
        R"({"rule":"simple acceptance","checks":[{"name":"x","text":"-1.63 mm; allowed","verdict":"pass"}]})");
  });
  rig::write_report(session, rig::check_output({file}));
  const std::string xml = file_text(file);
  for (const char* expected :
       {"schemaVersion=\"3.2.1\"", "Lab &amp; Co", "<si:value>-1.6342</si:value>",
        "<si:unit>\\milli\\metre</si:unit>", "<si:uncertainty>0.1234</si:uncertainty>",
        "<dcc:receiptDate>2026-05-01</dcc:receiptDate>", "<dcc:conformity>pass</dcc:conformity>",
        "<dcc:countryCodeISO3166_1>DE</dcc:countryCodeISO3166_1>"})
    CHECK_THAT(xml, Contains(expected));
  const std::filesystem::path schema =
      std::filesystem::path(RIG_SOURCE_DIR) / ".." / "shared" / "dcc" / "dcc.xsd";
  if (!std::filesystem::exists(schema) || std::system("xmllint --version 2>/dev/null") != 0) {
    WARN("skipped: PTB's schema or xmllint is not here (" << schema.string() << ")");
    return;
  }
  const auto valid = [&] {
    return std::system(
               ("xmllint --nonet --noout --schema " + schema.string() + " " + file + " 2>" + folder / "why")
                   .c_str()) == 0;
  };
  if (!valid()) FAIL(file_text(folder / "why"));
  // Whatever the bench file leaves out, and without any result.
  const std::string bare = folder / "bare.rig";
  {
    rig::SessionStore store(bare, rig::SessionStore::Mode::create);
    store.set("bench", R"({"schema":"bench/1"})");
  }
  rig::write_report(bare, rig::check_output({file}));
  if (!valid()) FAIL(file_text(folder / "why"));
}

}  // namespace certificate_standing_test
