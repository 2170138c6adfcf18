// SPDX-License-Identifier: MIT
// Two benches of one computer side by side: each run has its devices for itself, and one page shows both.
#include <stdlib.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>
#include <regex>

#include "tests/support/programs.hpp"
#include "tests/support/test_folder.hpp"

namespace several_benches_test {
namespace {

using Catch::Contains;
using nlohmann::json;
namespace asio = boost::asio;
namespace http = boost::beast::http;

constexpr const char* procedure_text =
    "procedure: look\ntitle: A look\nsteps:\n  - home\n  - prompt: {title: Place the board, text: At "
    "1.4 m}\n"
    "  - capture: {samples: 20, beams_deg: [-5, 5]}\n";
const std::string bench = std::string(RIG_SOURCE_DIR) + "/procedures/demo.bench.json";

std::vector<std::string> run_words(const TestFolder& folder, const std::string& lidar,
                                   const std::string& stage, const std::string& out) {
  return {RIG_BIN_DIR "/rig",
          "run",
          folder / "look.yaml",
          "--bench",
          bench,
          "--lidar",
          lidar,
          "--stage",
          stage,
          "--out",
          out};
}

http::response<http::string_body> get(std::uint16_t port, const std::string& target,
                                      const std::string& host) {
  asio::io_context client;
  boost::beast::tcp_stream stream(client);
  stream.expires_after(std::chrono::seconds(20));
  stream.connect(asio::ip::tcp::endpoint(asio::ip::address_v4::loopback(), port));
  http::request<http::empty_body> request(http::verb::get, target, 11);
  request.set(http::field::host, host);
  http::write(stream, request);
  boost::beast::flat_buffer buffer;
  http::response<http::string_body> response;
  http::read(stream, buffer, response);
  return response;
}

/// The state of the page, once it is so; asked until then, as the page asks every second.
json state_when(Program& watch, std::uint16_t port, const std::function<bool(const json&)>& is_so) {
  json state;
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (std::chrono::steady_clock::now() < until) {
    state = json::parse(get(port, "/state", "127.0.0.1").body());
    if (is_so(state) || watch.ends_within(std::chrono::milliseconds(100))) break;
  }
  return state;
}

}  // namespace

TEST_CASE(
    "a lidar that one run has is refused to the next before it is disturbed; another bench runs; one page "
    "shows who is needed") {
  const TestFolder folder;
  ::setenv("RIG_LOCKS", (folder / "locks").c_str(), 1);
  folder.write("look.yaml", std::string_view(procedure_text));
  std::filesystem::create_directory(folder / "one");
  std::filesystem::create_directory(folder / "two");
  const TestFolder place_one, place_two;
  SimProgram one(place_one, bench), two(place_two, bench);
  Program first(run_words(folder, one.lidar(), one.stage(), folder / "one/a.rig"), folder);
  Program watch({RIG_BIN_DIR "/rig", "watch", folder.path(), "--live", "0"}, folder);
  std::smatch found;
  std::string said;
  for (int i = 0; i < 200 && !std::regex_search(said = watch.errors(), found,
                             std::regex(R"(http://127\.0\.0\.1:(\d+)/)"));
       ++i)
    if (watch.ends_within(std::chrono::milliseconds(50))) break;
  REQUIRE(found.size() == 2);
  const auto port = static_cast<std::uint16_t>(std::stoi(found[1].str()));

  const json waiting = state_when(watch, port, [](const json& s) { return s.value("needed", 0) == 1; });
  INFO(waiting.dump(1) << first.errors());
  REQUIRE(waiting.at("needed") == 1);
  CHECK(waiting.at("benches").at(0).at("session") == "one/a.rig");
  CHECK(waiting.at("benches").at(0).at("needs").at("title") == "Place the board");
  CHECK(get(port, "/state", "evil.example").result() == http::status::forbidden);
  CHECK_THAT(get(port, "/", "127.0.0.1").body(), Contains("rig: benches"));

  Program intruder(run_words(folder, one.lidar(), two.stage(), folder / "two/b.rig"), folder);
  CHECK(intruder.exit_status() == 3);
  CHECK_THAT(intruder.errors(), Contains("in use by another program (session " + (folder / "one/a.rig")));
  CHECK_FALSE(std::filesystem::exists(folder / "two/b.rig"));
  Program beside(run_words(folder, two.lidar(), two.stage(), folder / "two/c.rig"), folder);
  beside.type("\n");
  CHECK(beside.exit_status() == 0);
  first.type("\n");
  INFO(first.errors());
  CHECK(first.exit_status() == 0);
  const json after = state_when(watch, port, [](const json& s) { return s.value("running", 1) == 0; });
  CHECK(after.at("needed") == 0);
  CHECK(after.at("benches").size() == 2);
  for (const json& b : after.at("benches")) CHECK(b.at("phase") == "done");
  ::unsetenv("RIG_LOCKS");
}

}  // namespace several_benches_test
