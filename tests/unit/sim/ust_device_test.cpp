// SPDX-License-Identifier: MIT
#include "sim/ust_device.hpp"

#include <algorithm>
#include <catch2/catch.hpp>

#include "lidar/reply.hpp"
#include "sim/simple_engine.hpp"

namespace ust_device_test {
namespace {

struct Bed {
  Bed(sim::UstIdentity identity = {}, double sigma_mm = 0) {
    const auto bench = fit::parse_bench(R"j({"schema": "bench/1",
      "targets": [{"name": "wall", "from_mm": [1400, -9000], "to_mm": [1400, 9000]}]})j");
    sim::SimpleOptions options;
    options.sigma_mm = sigma_mm;
    device = std::make_unique<sim::UstDevice>(bench.lidar, identity,
                                              std::make_shared<sim::SimpleEngine>(bench, options, 1),
                                              [](double) { return sim::StageMoment{}; });
  }
  std::string status(const std::string& line, double now_s = 1) {
    reader.feed(device->handle(line, now_s));
    const auto frame = reader.next();
    if (!frame || !*frame) return "silent";
    return std::string((*frame)->status);
  }
  lidar::RawScan next_scan() {
    std::string bytes;
    device->append_next_scan(bytes);
    reader.feed(bytes);
    const auto frame = reader.next();
    REQUIRE(frame.has_value());
    REQUIRE(frame->has_value());
    echo = (*frame)->echo;
    const auto request = lidar::parse_request(echo);
    REQUIRE(request.has_value());
    const auto scan = lidar::decode_scan((*frame)->body, request->scan);
    REQUIRE(scan.has_value());
    return *scan;
  }
  /// One scan asked for singly.
  lidar::RawScan single(const std::string& line, double now_s) {
    reader.feed(device->handle(line, device->answers_at_s(line, now_s)));
    const auto frame = reader.next();
    REQUIRE((frame && *frame));
    const auto scan = lidar::decode_scan((*frame)->body, lidar::parse_request(line)->scan);
    REQUIRE(scan.has_value());
    return *scan;
  }
  std::unique_ptr<sim::UstDevice> device;
  lidar::FrameReader reader;
  std::string echo;
};

}  // namespace

TEST_CASE("the simulated lidar answers with the statuses of the UST family") {
  Bed bed;
  CHECK(bed.status("VV") == "00");
  CHECK(bed.status("PP") == "00");
  CHECK(bed.status("II") == "00");
  CHECK(bed.status("GD0000108001") == "10");  // laser off
  CHECK(bed.status("BM") == "00");
  CHECK(bed.status("BM") == "02");
  CHECK(bed.status("GD0000108001") == "00");
  CHECK(bed.status("GD0000108101") == "04");
  CHECK(bed.status("GD0010000901") == "05");
  CHECK(bed.status("MD0000108101000") == "04");
  CHECK(bed.status("HD0000108001") == "silent");
  CHECK(bed.status("") == "silent");
  CHECK(bed.status("NONSENSE") == "0E");
  CHECK(bed.status("SS115200") == "0F");
}

TEST_CASE("a scan asked for singly is the latest that is finished: the same stamp, the same values") {
  Bed bed({}, 20);
  CHECK(bed.status("BM", 1.003) == "00");
  const auto first = bed.single("GE0000108001", 1.003);
  CHECK(first.stamp >= 1003);  // It was begun with the laser on.
  CHECK(first.stamp < 1050);
  const auto again = bed.single("GE0000108001", 1.045), part = bed.single("GD0500060001", 1.046);
  CHECK(again.stamp == first.stamp);
  CHECK(again.range_mm == first.range_mm);
  CHECK(again.intensity == first.intensity);
  CHECK(part.stamp == first.stamp);
  CHECK(std::equal(part.range_mm.begin(), part.range_mm.end(), first.range_mm.begin() + 500));
  const auto later = bed.single("GE0000108001", 2.0);
  CHECK(later.stamp > 1950);
  CHECK(later.stamp < 2000);
  CHECK(later.range_mm != first.range_mm);
}

TEST_CASE("BM while it streams finds the laser on; %SL ends the stream") {
  Bed bed;
  CHECK(bed.status("MD0000108001000") == "00");
  CHECK(bed.status("BM") == "02");
  CHECK(bed.device->streaming());
  CHECK(bed.status("%SL") == "00");
  CHECK_FALSE(bed.device->streaming());
  CHECK(bed.status("GD0000108001") == "10");
  CHECK(bed.status("BM") == "00");
}

TEST_CASE("SCSP is a number, or in words as older generations write it") {
  Bed bed;
  CHECK_THAT(bed.device->handle("II", 1), Catch::Contains("SCSP:2400;"));
  bed.device->set_habit(sim::UstHabit::speed_in_words, true);
  CHECK_THAT(bed.device->handle("II", 1),
             Catch::Contains("SCSP:Initial(2400[rpm])<-Default setting by user;"));
}

TEST_CASE("a stream counts down in its echo and ends with the laser off") {
  Bed bed;
  CHECK(bed.status("ME0530055001002;x") == "00");
  bed.next_scan();
  CHECK(bed.echo == "ME0530055001001;x");
  REQUIRE(bed.device->streaming());
  bed.next_scan();
  CHECK(bed.echo == "ME0530055001000;x");
  CHECK(!bed.device->streaming());
  CHECK(bed.status("GD0000108001") == "10");
}

TEST_CASE("clusters give the least of their steps and skipped scans take their time") {
  Bed bed;
  CHECK(bed.status("MD0000108004100") == "00");
  const auto first = bed.next_scan(), second = bed.next_scan();
  CHECK(first.range_mm.size() == 271);
  CHECK(first.range_mm[135] == 1400);
  CHECK(second.stamp - first.stamp == Approx(50).margin(1));
}

TEST_CASE("time adjustment refuses measurements and TM1 tells the device's time") {
  Bed bed;
  CHECK(bed.status("TM0") == "00");
  CHECK(bed.status("ME0000108001000") == "10");
  CHECK(bed.status("PP") == "10");
  bed.reader.feed(bed.device->handle("TM1;a", 100.0));
  const auto frame = bed.reader.next();
  CHECK(*lidar::decode_time((*frame)->body) == Approx(100.0 * (1 + 50e-6) * 1000).margin(1));
  CHECK(bed.status("TM2") == "00");
  CHECK(bed.status("TM2") == "03");
}

TEST_CASE("the 24-bit timer wraps, and a reset sets it to zero") {
  sim::UstIdentity identity;
  identity.clock_start_ms = 0xffffff - 500;
  identity.clock_ppm = 0;
  Bed bed(identity);
  bed.reader.feed(bed.device->handle("TM1", 1.0));
  const auto frame = bed.reader.next();
  CHECK(*lidar::decode_time((*frame)->body) < 1000);
  CHECK(bed.status("RS", 5.0) == "00");
  bed.reader.feed(bed.device->handle("TM1", 5.25));
  const auto after = bed.reader.next();
  CHECK(*lidar::decode_time((*after)->body) == 250);
}

TEST_CASE("two RB within a second reboot, one does not") {
  Bed bed;
  CHECK(bed.status("RB", 1.0) == "01");
  CHECK(bed.status("RB", 3.0) == "01");
  CHECK(!bed.device->take_reboot_request());
  CHECK(bed.status("RB", 3.5) == "00");
  CHECK(bed.device->take_reboot_request());
}

}  // namespace ust_device_test
