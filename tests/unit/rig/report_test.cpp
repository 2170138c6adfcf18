// SPDX-License-Identifier: MIT
#include "rig/report/report.hpp"

#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"
#include "rig/live/session_state.hpp"
#include "rig/report/certificate.hpp"
#include "rig/report/coordinate_in_words.hpp"
#include "rig/session/step_in_words.hpp"
#include "tests/support/test_folder.hpp"

namespace report_test {
namespace {

std::string make_session(const TestFolder& folder) {
  const std::string file = folder / "small.rig";
  std::filesystem::remove(file);
  rig::SessionStore store(file, rig::SessionStore::Mode::create);
  store.set("bench",
            R"({"schema":"bench/1","targets":[{"name":"board","from_mm":[1400,-200],"to_mm":[1400,200]}],
                          "certificate":{"laboratory":"Bench <3>"}})");
  store.set("lidar", R"({"PROD":"UST-10LX","SERI":"H0001","FIRM":"1.0"})");
  store.set("created_utc", "2026-05-04T10:00:00Z");
  fit::CaptureInfo capture;
  capture.first_step = 500;
  capture.last_step = 580;
  const auto id = store.begin_capture(capture);
  const std::vector<std::uint16_t> ranges(81, 1400);
  fit::ScanView scan;
  scan.range_mm = ranges;
  store.add_scan(id, scan);
  store.commit_capture(id);
  store.add_result("centre", R"j({"schema":"result/1","kind":"centre","method":"Triangle method.",
    "values":[{"name":"centre x","value":-1.6342,"u":0.0617,"unit":"mm","k":2}],
    "budget":[{"source":"range noise","kind":"A","u":0.05,"unit":"mm"}],
    "tables":[{"title":"Pairs","columns":["pair","x (mm)"],"rows":[["1-2",-3.63]]}],
    "undetermined":["yaw of the mount"]})j");
  store.add_result("limits", R"({"schema":"limits/1","rule":"guard band w = U",
    "checks":[{"name":"centre x","value":-1.6,"U":0.12,"unit":"mm","min":-2,"max":2,"verdict":"pass"}]})");
  store.add_event(1000, "warning", "2 scans lost");
  return file;
}

}  // namespace

TEST_CASE(
    "the certificate states results with expanded uncertainty, verdict, budget and what was not determined") {
  const TestFolder folder;
  const std::string session = make_session(folder), page = folder / "c.html";
  rig::write_report(session, rig::check_output({page}));
  const std::string html = file_text(page);
  for (const char* expected :
       {"-1.63 mm", "0.12 mm", "PASS", "guard band w = U", "range noise", "yaw of the mount", "2 scans lost",
        "H0001", "Bench &lt;3&gt;", "Triangle method.", "-3.63", "SHA-256", "</svg>"})
    CHECK_THAT(html, Catch::Contains(expected));
  CHECK(html.find("{{") == std::string::npos);
  CHECK(html.find("http://") == html.find("http://www.w3.org"));
}

TEST_CASE("the certificate names its references, when it was issued, and the unit of every figure") {
  const TestFolder folder;
  const std::string session = make_session(folder), page = folder / "c.html";
  {
    rig::SessionStore store(session, rig::SessionStore::Mode::append);
    store.set("bench", R"({"schema":"bench/1","targets":[{"name":"board","from_mm":[1400,-200],
      "to_mm":[1400,200],"u_mm":0.6,"u_deg":0.1}],"certificate":{"traceability":"gauge block 7, PTB"}})");
    store.add_result("wall", R"j({"schema":"result/1","kind":"wall","use":["Turn it by the angle."],
      "tables":[{"title":"Normals","columns":[{"name":"angle","unit":"deg","decimals":2}],"rows":[[-0.001]]}]})j");
  }
  rig::write_report(session, rig::check_output({page}));
  const std::string html = file_text(page);
  for (const char* expected :
       {"<h2>References</h2>", "1400.0 mm", "1.2 mm", "0.20 deg", "gauge block 7, PTB",
        "measured 2026-05-04 10:00 UTC", "issued 20", "0.12 mm</td><td class=\"n\">-2 to 2 mm",
        "How to use it:</strong> Turn it by the angle."})
    CHECK_THAT(html, Catch::Contains(expected));
  CHECK_THAT(html, !Catch::Contains("-0.00<"));
}

TEST_CASE("a traceability that the bench file leaves empty is not stated") {
  const TestFolder folder;
  const std::string session = make_session(folder), page = folder / "c.html";
  for (const char* stated : {R"({"traceability":""})", "{}"}) {
    {
      rig::SessionStore store(session, rig::SessionStore::Mode::append);
      store.set("bench", R"({"schema":"bench/1","targets":[{"name":"board","from_mm":[1400,-200],
        "to_mm":[1400,200]}],"certificate":)" +
                             std::string(stated) + "}");
    }
    rig::write_report(session, rig::check_output({page}));
    CHECK_THAT(file_text(page), Catch::Contains("Metrological traceability: not stated."));
  }
}

TEST_CASE("long tables stand in an annex, compact, and in front where they are") {
  const TestFolder folder;
  const std::string session = make_session(folder), page = folder / "c.html";
  nlohmann::json rows = nlohmann::json::array();
  for (int i = 1; i <= 97; ++i) rows.push_back({"step 3.2, " + std::to_string(100 * i) + " mm", 0.25});
  {
    rig::SessionStore store(session, rig::SessionStore::Mode::append);
    store.add_result(
        "range", nlohmann::json({{"schema", "result/1"},
                                 {"kind", "range"},
                                 {"tables",
                                  {{{"title", "Errors"}, {"columns", {"capture", "error"}}, {"rows", rows}},
                                   {{"title", "Short"}, {"columns", {"a"}}, {"rows", {{1}}}}}}})
                     .dump());
  }
  rig::write_report(session, rig::check_output({page}));
  const std::string html = file_text(page);
  const std::size_t annex = html.find("<h2>Annex: tables</h2>"), notes = html.find("<footer>");
  REQUIRE(annex != std::string::npos);
  CHECK(notes < annex);
  CHECK(html.find("Annex, table T1 (97 rows): Errors.") < annex);
  CHECK(html.find("Table T1. Range calibration: Errors") > annex);
  CHECK(html.find("step 3.2, 9700 mm") > annex);
  CHECK(html.find(">Short<") < annex);
  CHECK(html.find("End of report") > html.find("step 3.2, 9700 mm"));
  CHECK(html.find("End of report") == html.rfind("End of report"));
}

TEST_CASE("steps and coordinates are written in words for those who read a certificate") {
  CHECK(rig::step_in_words("capture 3.2[distance_mm=500]") == "step 3.2, 500 mm");
  CHECK(rig::step_in_words("find-edge 3.1[beam_deg=-115.5]") == "find-edge, step 3.1, beam -115.5 deg");
  CHECK(rig::step_in_words("capture 3.2[distance_mm=200][reflectance=0.5][surface=white paper][time 2]") ==
        "step 3.2, 200 mm, reflectance 0.5, white paper, time 2");
  CHECK(rig::step_in_words("capture 4") == "step 4");
  CHECK(rig::step_in_words("find-edge 3.1[beam_deg=92] (short)") ==
        "find-edge, step 3.1, beam 92 deg (short)");
  CHECK(rig::step_in_words("") == "");
  for (const char* foreign : {"lidar_calibration_0.5m", "capture", "capture 3.2[", "[beam_deg=2]"})
    CHECK(rig::step_in_words(foreign) == foreign);
  std::string endless = "capture 3";
  for (int i = 0; i < 300'000; ++i) endless += "[a=1]";
  CHECK(rig::step_in_words(endless) == endless);
  CHECK(rig::coordinate_in_words("beam_deg").with_unit() == "beam angle (deg)");
  CHECK(rig::coordinate_in_words("approach").with_unit() == "sign of the last move");
  CHECK(rig::coordinate_in_words("new_one").with_unit() == "new_one");
}

TEST_CASE("a session without results certifies nothing, and a run that was stopped is called so") {
  const TestFolder folder;
  const std::string file = folder / "stopped.rig", page = folder / "c.html";
  {
    rig::SessionStore store(file, rig::SessionStore::Mode::create);
    store.set("bench", R"({"schema":"bench/1"})");
    store.set("ended", "stopped by the operator");
  }
  rig::write_report(file, rig::check_output({page}));
  for (const char* expected :
       {"<h1>Record of a measurement", "No result:", "Not finished:", "stopped by the operator"})
    CHECK_THAT(file_text(page), Catch::Contains(expected));
  const std::string whole = make_session(folder);
  rig::write_report(whole, rig::check_output({page}));
  for (const char* unexpected : {"No result:", "Not finished:"})
    CHECK_THAT(file_text(page), !Catch::Contains(unexpected));
}

TEST_CASE("the certificate names the lidar that was there, and what the bench file calls it beside it") {
  const TestFolder folder;
  const std::string session = make_session(folder), page = folder / "c.html";
  {
    rig::SessionStore store(session, rig::SessionStore::Mode::append);
    store.set("bench", R"x({"schema":"bench/1","certificate":{"item":"UST-10LX (simulated)"}})x");
    store.set("lidar", R"({"PP":{"MODL":"UTM-30LX"},"VV":{"PROD":"UTM-30LX","SERI":"00903971"}})");
  }
  const auto rows = rig::make_certificate(rig::SessionStore(session, rig::SessionStore::Mode::read), session)
                        .at("identification");
  const auto row = [&](const std::string& name) {
    for (const auto& each : rows)
      if (each.at("name") == name) return each.at("text").get<std::string>();
    return std::string("absent");
  };
  CHECK(row("Item calibrated") == "UTM-30LX");
  CHECK(row("Serial number") == "00903971");
  CHECK(row("Item as the bench file calls it") == "UST-10LX (simulated)");
}

TEST_CASE("the same certificate comes as data") {
  const TestFolder folder;
  const std::string session = make_session(folder), file = folder / "c.json";
  rig::write_report(session, rig::check_output({file}));
  const auto certificate = nlohmann::json::parse(file_text(file));
  CHECK(certificate.at("schema") == "certificate/1");
  CHECK(certificate.at("results").at(0).at("result").at("values").at(0).at("value") == -1.6342);
}

TEST_CASE("a certificate that cannot be written says why and leaves nothing behind") {
  const TestFolder folder;
  const std::string session = make_session(folder);
  CHECK_THROWS_AS(rig::write_report(session, rig::check_output({folder / "c.docx"})), rig::UsageError);
  CHECK_THROWS_AS(rig::write_report(session, rig::check_output({folder / "none/c.html"})), rig::UsageError);
  CHECK(!std::filesystem::exists(folder / "c.docx"));
}

TEST_CASE("results without an uncertainty, or without words, are shown by those who watch a session") {
  const TestFolder folder;
  const std::string file = make_session(folder);
  {
    rig::SessionStore store(file, rig::SessionStore::Mode::append);
    store.add_result("deskew", R"({"schema":"result/1","kind":"deskew","values":[
      {"name":"scans","label":null,"value":320,"u":null,"U":null,"unit":null}]})");
  }
  const nlohmann::json state = rig::state_of(rig::SessionStore(file, rig::SessionStore::Mode::read));
  REQUIRE(state.at("results").size() == 3);
  CHECK(state.at("results").at(1).at("text") ==
        "-1.60 ± 0.12 mm");  // A limit, as an earlier version wrote it.
  CHECK(state.at("results").at(1).at("verdict") == "pass");
  const nlohmann::json& shown = state.at("results").at(2);
  CHECK(shown.at("name") == "scans");
  CHECK(shown.at("text").get<std::string>().starts_with("320"));
}

TEST_CASE("a certificate on paper replaces no pipe") {
  const TestFolder folder;
  const std::string session = make_session(folder), pipe = folder / "way.pdf";
  REQUIRE(::mkfifo(pipe.c_str(), 0600) == 0);
  CHECK_THROWS_AS(rig::write_report(session, rig::check_output({pipe})), rig::UsageError);
  CHECK(std::filesystem::is_fifo(pipe));
}

TEST_CASE("unknown physics has a section of its own: what, where, how large, and that it is not corrected") {
  const TestFolder folder;
  const std::string session = make_session(folder), page = folder / "c.html";
  rig::write_report(session, rig::check_output({page}));
  CHECK_THAT(file_text(page), !Catch::Contains("Unknown physics"));
  {
    rig::SessionStore store(session, rig::SessionStore::Mode::append);
    store.add_result("explanation", R"({"schema":"explanation/1","verdict":"unknown-physics","mechanisms":[],
      "undecided_between":[],"located":[],"fit":{},
      "empirical_correction":[{"coordinate":"beam_deg","at":[0,10],"range_mm":[-3.2,1.5]}],
      "unknown":{"coordinate":"beam_deg","observable":"range-mean","describes":"the range steps by -3.2 mm",
                 "from":40,"to":95.5}})");
  }
  rig::write_report(session, rig::check_output({page}));
  for (const char* expected : {"<h2>Unknown physics</h2>", "the range steps by -3.2 mm", "mean of the ranges",
                               "along beam angle from 40 to 95.5 deg", "up to 3.2 mm", "does not contain it"})
    CHECK_THAT(file_text(page), Catch::Contains(expected));
  const std::string data = folder / "c.json";
  rig::write_report(session, rig::check_output({data}));
  CHECK(nlohmann::json::parse(file_text(data)).at("unknown_physics").at("rows").size() == 4);
  {  // The last explanation counts.
    rig::SessionStore store(session, rig::SessionStore::Mode::append);
    store.add_result("explanation", R"({"schema":"explanation/1","verdict":"nothing-missing"})");
  }
  rig::write_report(session, rig::check_output({page}));
  CHECK_THAT(file_text(page), !Catch::Contains("Unknown physics"));
}

TEST_CASE("an imported session is dated by its recording, never by its import") {
  const TestFolder folder;
  const std::string session = make_session(folder), page = folder / "c.html", data = folder / "c.json";
  const auto set = [&](const std::string& key, const std::string& value) {
    rig::SessionStore(session, rig::SessionStore::Mode::append).set(key, value);
  };
  set("kind", "import");
  rig::write_report(session, rig::check_output({page}));
  CHECK_THAT(file_text(page),
             Catch::Contains("RIG-undated-") &&
                 Catch::Contains("measured at an unknown time, imported 2026-05-04 10:00 UTC"));
  set("recorded_local", "2018-02-03 04:05:06.700");
  rig::write_report(session, rig::check_output({page}));
  CHECK_THAT(file_text(page), Catch::Contains("RIG-20180203-") &&
                                  Catch::Contains("by the local time of the recording computer"));
  set("recorded_utc", "2019-02-03T04:05:06Z");
  rig::write_report(session, rig::check_output({page}));
  rig::write_report(session, rig::check_output({data}));
  CHECK_THAT(file_text(page),
             Catch::Contains("RIG-20190203-") &&
                 Catch::Contains("measured 2019-02-03 04:05 UTC, imported 2026-05-04 10:00 UTC") &&
                 Catch::Contains("2019-02-03 04:05 UTC by the clock of the recording"));
  const auto certificate = nlohmann::json::parse(file_text(data));
  CHECK(certificate.at("measured_utc") == "2019-02-03T04:05:06Z");
  CHECK(certificate.at("imported_utc") == "2026-05-04T10:00:00Z");
}

}  // namespace report_test
