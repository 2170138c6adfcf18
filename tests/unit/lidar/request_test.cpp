// SPDX-License-Identifier: MIT
#include "lidar/request.hpp"

#include <rapidcheck.h>

#include <catch2/catch.hpp>

namespace request_test {

using namespace lidar;

namespace {

RequestError error_of(std::string_view line) {
  const auto request = parse_request(line);
  REQUIRE_FALSE(request.has_value());
  return request.error();
}

}  // namespace

TEST_CASE("requests are written as real hosts write them") {
  ScanCommand scan;
  CHECK(build_request(Request(scan)) == "ME0000108001000\n");
  scan.count = 1, scan.skip = 1;
  CHECK(build_request(Request(scan)) == "ME0000108001101\n");
  scan.continuous = false, scan.format = ScanFormat::distance3, scan.last_step = 760;
  CHECK(build_request(Request(scan)) == "GD0000076001\n");
  CHECK(build_request(Request(Command::time_read, "a7")) == "TM1;a7\n");
  CHECK(build_request(Request(Command::state)) == "%ST\n");
}

TEST_CASE("every command without parameters is read back") {
  for (const char* line : {"VV",
                           "PP",
                           "II",
                           "BM",
                           "QT",
                           "RS",
                           "RT",
                           "RB",
                           "TM0",
                           "TM1",
                           "TM2",
                           "%TM1",
                           "%ST",
                           "%SL",
                           "SCIP2.0",
                           "CR00",
                           "HS0",
                           "SS115200",
                           "DB05",
                           "$IP192168000010255255255000192168000001",
                           "ME0000108001000",
                           "MD0000108001000",
                           "MS0000108000100",
                           "ND0000108001000",
                           "NE0000108001000",
                           "GD0000108001",
                           "GE0000108001",
                           "GS0044072501",
                           "HD0000108001",
                           "HE0000108001",
                           "%ME0000108001000",
                           "%MD0000108001000",
                           "VV;who are you",
                           "QT;"}) {
    INFO(line);
    const auto request = parse_request(line);
    REQUIRE(request.has_value());
    const std::string_view text = line;
    CHECK(build_line(*request) == (text.ends_with(';') ? text.substr(0, text.size() - 1) : text));
  }
}

TEST_CASE("a wrong request is refused with the status that a sensor gives") {
  CHECK(error_of("XX") == RequestError::undefined_command);
  CHECK(error_of("") == RequestError::undefined_command);
  CHECK(error_of("%VV") == RequestError::undefined_command);
  CHECK(error_of("%GD0000108001") == RequestError::undefined_command);
  CHECK(error_of("VVX") == RequestError::too_long);
  CHECK(error_of("MD") == RequestError::too_short);
  CHECK(error_of("MD00001080010000") == RequestError::too_long);
  CHECK(error_of("MDx000108001000") == RequestError::first_not_a_number);
  CHECK(error_of("MD0000x08001000") == RequestError::last_not_a_number);
  CHECK(error_of("MD00001080x1000") == RequestError::cluster_not_a_number);
  CHECK(error_of("MD0000108001x00") == RequestError::skip_not_a_number);
  CHECK(error_of("MD00001080010x0") == RequestError::count_not_a_number);
  CHECK(error_of("MD0500000001000") == RequestError::last_before_first);
  CHECK(error_of("TM7") == RequestError::bad_argument);
  CHECK(error_of("VV;12345678901234567") == RequestError::string_too_long);
  CHECK(error_of("VV;a\x01") == RequestError::bad_string_character);
  CHECK(status_of(RequestError::undefined_command) == "0E");
  CHECK(status_of(RequestError::too_short) == "0C");
}

TEST_CASE("any scan command survives the wire") {
  CHECK(rc::check([] {
    ScanCommand scan;
    scan.continuous = *rc::gen::arbitrary<bool>();
    scan.multi_echo = *rc::gen::arbitrary<bool>();
    scan.format = *rc::gen::element(ScanFormat::distance3, ScanFormat::distance_intensity);
    scan.microseconds = scan.continuous && !scan.multi_echo && *rc::gen::arbitrary<bool>();
    scan.first_step = *rc::gen::inRange(0, 10000);
    scan.last_step = *rc::gen::inRange(scan.first_step, 10000);
    scan.cluster = *rc::gen::inRange(0, 100);
    if (scan.continuous) scan.skip = *rc::gen::inRange(0, 10), scan.count = *rc::gen::inRange(0, 100);
    const Request request(scan, "tag 42");
    const auto read = parse_request(build_line(request));
    RC_ASSERT(read.has_value());
    RC_ASSERT(*read == request);
  }));
}

TEST_CASE("request lines come out whole wherever the network cuts them and whatever ends them") {
  const std::string bytes = "\nVV\r\nQT\rPP\n\nTM1;ab\n";
  for (std::size_t cut = 0; cut <= bytes.size(); ++cut) {
    INFO(cut);
    RequestReader reader;
    std::string seen;
    for (const std::string& piece : {bytes.substr(0, cut), bytes.substr(cut)}) {
      reader.feed(piece);
      for (auto line = reader.next(); line && *line; line = reader.next()) seen += std::string(**line) + '|';
    }
    CHECK(seen == "VV|QT|PP|TM1;ab|");
  }
}

TEST_CASE("an endless request line costs one error and no memory") {
  RequestReader reader;
  int errors = 0;
  for (int i = 0; i < 1000; ++i) {
    reader.feed(std::string(50, 'x'));
    for (auto line = reader.next(); !line || *line; line = reader.next()) ++errors;
  }
  CHECK(errors == 1);
  reader.feed("\nVV\n");
  const auto line = reader.next();
  REQUIRE(line.has_value());
  CHECK(**line == "VV");
}

}  // namespace request_test
