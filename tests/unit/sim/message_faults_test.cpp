// SPDX-License-Identifier: MIT
// What each fault makes of a message, seen by the driver's own decoder.
#include "sim/message_faults.hpp"

#include <catch2/catch.hpp>

#include "lidar/frame_reader.hpp"
#include "lidar/reply.hpp"
#include "tests/support/lidar_bench.hpp"

namespace message_faults_test {
namespace {

constexpr std::string_view asked = "ME0000108001000;r7";

struct Bed {
  Bed() : device(lidar_bench::device()) {
    (void)device.handle(asked, 1);
    device.append_next_scan(scan);
  }
  std::string after(std::string_view name, std::string message, double amount = 1) {
    for (const sim::MessageFault& fault : sim::message_faults())
      if (fault.name == name) {
        REQUIRE(sim::concerns(fault.of, message));
        fault.change(message, {amount, "VV\n00P\n\n", random});
        return message;
      }
    FAIL("there is no fault " << name);
    return "";
  }
  static auto decoded(const std::string& message) {
    lidar::FrameReader reader;
    reader.feed(message);
    const auto frame = reader.next();
    REQUIRE(frame.has_value());
    REQUIRE(frame->has_value());
    return lidar::decode_scan((*frame)->body, lidar::parse_request(asked)->scan);
  }
  sim::UstDevice device;
  sim::Random random{3};
  std::string scan;
};

}  // namespace

TEST_CASE("every fault of messages changes the message that it waits for") {
  Bed bed;
  const std::string parameters = bed.device.handle("PP", 1);
  for (const sim::MessageFault& fault : sim::message_faults()) {
    INFO(fault.name);
    std::string message = fault.of == sim::MessageFault::Of::scan ? bed.scan : parameters;
    const std::string before = message;
    fault.change(message, {fault.usual, "VV\n00P\n\n", bed.random});
    CHECK(message != before);
  }
  CHECK_FALSE(sim::concerns(sim::MessageFault::Of::scan, parameters));
  CHECK_FALSE(sim::concerns(sim::MessageFault::Of::parameters, bed.scan));
}

TEST_CASE(
    "a scan with too few values or a short line is reported by its count or its lines, not by its sums") {
  Bed bed;
  CHECK(Bed::decoded(bed.after("short-scan", bed.scan)).error() == lidar::DataError::wrong_count);
  const auto error = Bed::decoded(bed.after("short-line", bed.scan)).error();
  CHECK((error == lidar::DataError::bad_line_length || error == lidar::DataError::wrong_count));
}

TEST_CASE("a repeated scan, an old stamp and a wrong count are sound in themselves") {
  Bed bed;
  const auto good = Bed::decoded(bed.scan);
  CHECK(bed.after("repeat-scan", bed.scan, 2) == bed.scan + bed.scan + bed.scan);
  const auto old = Bed::decoded(bed.after("old-stamp", bed.scan, 7));
  REQUIRE(old);
  CHECK(((good->stamp - old->stamp) & 0xFFFFFF) == 7);
  CHECK(old->range_mm == good->range_mm);
  const std::string counted = bed.after("count", bed.scan);
  CHECK(counted.substr(0, 13) == bed.scan.substr(0, 13));
  CHECK(counted.substr(13, 2) != "00");
  CHECK(Bed::decoded(counted));
}

TEST_CASE("an answer inside a scan leaves both to be found") {
  Bed bed;
  const std::string message = bed.after("insert", bed.scan);
  CHECK(message.find("II\n00P\n") != std::string::npos);
  CHECK(message.size() > bed.scan.size());
}

TEST_CASE("the line of PP that is missing is the one that was named") {
  Bed bed;
  const std::string parameters = bed.device.handle("PP", 1);
  CHECK(bed.after("missing-parameter", parameters, 6).find("AMAX") == std::string::npos);
  CHECK(bed.after("missing-parameter", parameters, 1).find("MODL") == std::string::npos);
  CHECK(bed.after("missing-parameter", parameters, 99) == parameters);
}

}  // namespace message_faults_test
