// SPDX-License-Identifier: MIT
#include <rapidcheck.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <sstream>

#include "lidar/scip_frame.hpp"
#include "lidar/scip_reply.hpp"
#include "lidar/scip_request.hpp"
#include "lidar/scip_text.hpp"

using namespace lidar::scip;

namespace {

std::string example_scan(int steps = 1081) {
  std::vector<std::uint32_t> range(static_cast<std::size_t>(steps)), intensity(range.size());
  std::iota(range.begin(), range.end(), 1000);
  std::iota(intensity.begin(), intensity.end(), 200);
  std::string out;
  append_scan_reply(out, scan_request("ME", 0, steps - 1, 1, 0, 0, "7").text(), "99", 123456, range,
                    intensity, 3);
  return out;
}

std::string read_log(const std::string& name) {
  std::ifstream in(std::string(RIG_SOURCE_DIR) + "/../shared/real/scip-logs/" + name, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

}  // namespace

TEST_CASE("checksums agree with those that real sensors send") {
  CHECK(checksum("00") == 'P');
  CHECK(checksum("99") == 'b');
  CHECK(checksum("02") == 'R');
  CHECK(checksum("0L") == 'l');
  CHECK(checksum("MODL:UTM-30LX(Hokuyo Automatic Co.,Ltd.)") == 'U');
}

TEST_CASE("values survive encoding in as many letters as they need") {
  CHECK(encode(5432, 3) == "1Dh");  // 5432 = 000001 010100 111000
  rc::check("three letters hold 18 bits",
            [](std::uint32_t value) { RC_ASSERT(decode(encode(value, 3)) == (value & 0x3ffff)); });
  rc::check("eleven letters hold 64 bits",
            [](std::uint64_t value) { RC_ASSERT(decode(encode(value, 11)) == value); });
}

TEST_CASE("a full ME scan has the size of a real one and decodes to what was sent") {
  std::string bytes = example_scan();
  CHECK(bytes.size() == 6717 + 2);  // two more for the tag ";7"
  FrameReader reader;
  reader.feed(bytes);
  const auto frame = reader.next();
  REQUIRE(frame.has_value());
  REQUIRE(frame->has_value());
  CHECK((*frame)->tag() == "7");
  RawScan scan;
  REQUIRE(decode_scan(**frame, scan).has_value());
  CHECK(scan.stamp.value == 123456);
  REQUIRE(scan.range.size() == 1081);
  CHECK(scan.range[1080] == 2080);
  CHECK(scan.intensity[1080] == 1280);
}

TEST_CASE("a frame comes out whole wherever the network cuts it") {
  const std::string bytes = status_reply("QT", "00") + example_scan(9) + status_reply("RS", "00");
  for (std::size_t cut = 0; cut <= bytes.size(); ++cut) {
    FrameReader reader;
    std::vector<std::string> echoes;
    for (const std::string& piece : {bytes.substr(0, cut), bytes.substr(cut)}) {
      reader.feed(piece);
      for (auto frame = reader.next(); frame && *frame; frame = reader.next())
        echoes.emplace_back((*frame)->command());
    }
    REQUIRE(echoes == std::vector<std::string>{"QT", "ME", "RS"});
  }
}

TEST_CASE("a bad frame costs one frame, not the connection") {
  std::string bad = example_scan(9);
  bad[bad.size() - 6] ^= 1;
  FrameReader reader;
  reader.feed(std::string("\xff\xfe garbage\n\n") + bad + status_reply("QT", "00"));
  CHECK(reader.next().error() == FrameError::missing_status);
  CHECK(reader.next().error() == FrameError::bad_checksum);
  const auto good = reader.next();
  REQUIRE(good.has_value());
  CHECK((*good)->echo == "QT");
}

TEST_CASE("a stream without end cannot exhaust memory, and the next message is found") {
  FrameReader reader;
  int errors = 0;
  const std::string noise(10000, 'x');
  for (int i = 0; i < 1000; ++i) {
    reader.feed(noise);
    errors += !reader.next().has_value();
    REQUIRE(reader.buffered() < 2 * FrameReader::max_frame_bytes);
  }
  CHECK(errors == 1);
  reader.feed("\n\n" + status_reply("QT", "00"));
  auto frame = reader.next();
  REQUIRE(frame.has_value());
  REQUIRE(frame->has_value());
  CHECK((*frame)->echo == "QT");
}

TEST_CASE("a flipped bit in a scan is never taken for a measurement") {
  const std::string bytes = example_scan(40);
  const std::size_t data = bytes.find('\n', bytes.find('\n') + 1) + 1;
  rc::check("one flipped bit", [&] {
    std::string flipped = bytes;
    const auto at = *rc::gen::inRange<std::size_t>(data, bytes.size() - 2);
    flipped[at] = static_cast<char>(flipped[at] ^ (1 << *rc::gen::inRange(0, 8)));
    FrameReader reader;
    reader.feed(flipped + "\n\n");
    for (auto frame = reader.next(); !frame || *frame; frame = reader.next()) {
      RawScan scan;
      const bool refused = !frame || !decode_scan(**frame, scan);
      RC_ASSERT(refused);
    }
  });
}

TEST_CASE("requests round-trip, and wrong ones get the sensor's status") {
  const auto request = parse_request("ME0000108001000;abc");
  REQUIRE(request.has_value());
  CHECK(request->last_step == 1080);
  CHECK(request->text() == "ME0000108001000;abc");
  CHECK(value_count(scan_request("GD", 0, 1080, 4)) == 271);
  CHECK(parse_request("MD").error() == "0C");
  CHECK(parse_request("MD00001080010000").error() == "0D");
  CHECK(parse_request("MD000x1080010000").error() == "0D");
  CHECK(parse_request("GD00x0108001").error() == "01");
  CHECK(parse_request("XX").error() == "0E");
  CHECK(parse_request("VV;12345678901234567").error() == "0G");
  CHECK(parse_request("TM1;x")->parameters == "1");
  CHECK(parse_request("%ST")->command == "%ST");
  CHECK(parse_request("").error() == "0E");
}

TEST_CASE("statuses of letters are refusals, whatever the command") {
  for (const char* status : {"0A", "0L", "0M", "0F"}) {
    CHECK(!succeeded("BM", status));
    CHECK(describe_status("BM", status).find(status) == 0);
  }
  CHECK(succeeded("BM", "02"));
  CHECK(!succeeded("BM", "01"));
  CHECK(succeeded("ME", "99"));
  CHECK(!succeeded("ME", "04"));
}

TEST_CASE("further echoes of a step are told apart from the first") {
  std::string payload = encode(1000, 3) + encode(10, 3) + "&" + encode(2000, 3) + encode(20, 3) +
                        encode(1500, 3) + encode(15, 3);
  std::string bytes = "HE0000000101\n00P\n";
  append_line(bytes, encode(77, 4));
  append_block(bytes, payload);
  FrameReader reader;
  reader.feed(bytes + "\n");
  const auto frame = reader.next();
  REQUIRE(frame.has_value());
  RawScan scan;
  REQUIRE(decode_scan(**frame, scan).has_value());
  CHECK(scan.range == std::vector<std::uint32_t>{1000, 1500});
  REQUIRE(scan.further.size() == 1);
  CHECK(scan.further[0].range == 2000);
  CHECK(scan.further[0].index == 0);
}

TEST_CASE("byte logs of real sensors decode whole") {
  if (!std::filesystem::exists(std::string(RIG_SOURCE_DIR) + "/../shared/real/scip-logs")) {
    WARN("skipped: ../shared/real/scip-logs is not here");
    return;
  }
  int scans = 0;
  for (const char* name : {"real_utm_30lx.r.txt", "real_uxm_30lx_e.r.txt", "real_urg_04lx.r.txt"}) {
    INFO(name);
    FrameReader reader;
    reader.feed(read_log(name));
    int frames = 0;
    while (true) {
      const auto frame = reader.next();
      REQUIRE(frame.has_value());
      if (!*frame) break;
      ++frames;
      const auto request = parse_request((*frame)->echo);
      if (request && request->scans() && !(*frame)->lines.empty()) {
        RawScan scan;
        INFO((*frame)->echo);
        REQUIRE(decode_scan(**frame, scan).has_value());
        ++scans;
      }
    }
    CHECK(frames > 5);
    CHECK(reader.buffered() <= 1);
  }
  CHECK(scans >= 3);
}
