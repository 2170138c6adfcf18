// SPDX-License-Identifier: MIT
#include "lidar/reply.hpp"

#include <rapidcheck.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "lidar/encoding.hpp"
#include "lidar/response.hpp"
#include "lidar/scan_receiver.hpp"
#include "lidar/status.hpp"

namespace reply_test {

using namespace lidar;

namespace {

std::string lines_of(const std::vector<std::string>& lines) {
  std::string body;
  for (const std::string& line : lines) append_checked_line(body, line);
  return body;
}

ScanCommand command_of(bool continuous, ScanFormat format, int values) {
  ScanCommand command;
  command.continuous = continuous;
  command.format = format;
  command.last_step = values - 1;
  return command;
}

std::string scan_bytes(const ScanCommand& command, const RawScan& scan) {
  std::string bytes;
  append_scan_response(bytes, build_line(Request(command)), command.continuous ? "99" : "00", command,
                       {scan.stamp, scan.range_mm, scan.intensity, scan.echoes});
  return bytes;
}

tl::expected<RawScan, DataError> decode_whole(const ScanCommand& command, std::string_view bytes) {
  FrameReader reader;
  reader.feed(bytes);
  const auto frame = reader.next();
  if (!frame || !*frame) return tl::unexpected<DataError>(DataError::bad_line_length);
  return decode_scan((**frame).body, command);
}

std::filesystem::path log_folder() {
  return std::filesystem::path(RIG_SOURCE_DIR) / "../shared/real/scip-logs";
}

/// The one-pass receiver takes a real stream's scan as well, with the same numbers.
void check_one_pass(const Frame& frame, const ScanCommand& command, const RawScan& raw) {
  const std::string bytes = std::string(frame.echo) + "\n99b\n" + std::string(frame.body) + "\n\n";
  for (const Kernel kernel : {Kernel::portable, Kernel::avx2, Kernel::avx512}) {
    if (!available(kernel)) continue;
    Scan scan;
    const auto stamp = ScanReceiver(command, "", 0, 65534, kernel).take(bytes, scan);
    REQUIRE(stamp);
    CHECK(*stamp == raw.stamp);
    CHECK(std::equal(scan.range_mm.begin(), scan.range_mm.end(), raw.range_mm.begin(), raw.range_mm.end()));
    CHECK(
        std::equal(scan.intensity.begin(), scan.intensity.end(), raw.intensity.begin(), raw.intensity.end()));
  }
}

/// Decodes one answer of a real log; gives the number of values when it is a scan.
std::size_t check_real_frame(const Frame& frame) {
  INFO(frame.echo);
  const auto request = parse_request(frame.echo);
  REQUIRE(request.has_value());
  const StatusKind kind = kind_of(frame.status, *request);
  const bool refused = request->command == Command::motor_speed;  // These three sensors refuse CR.
  CHECK(
      (refused || kind == StatusKind::done || kind == StatusKind::already || kind == StatusKind::scan_data));
  switch (request->command) {
    case Command::version:
    case Command::parameters:
    case Command::information: {
      const auto values = decode_key_values(frame.body);
      REQUIRE(values.has_value());
      CHECK(values->size() >= 5);
      if (request->command == Command::information) CHECK(decode_information_time(value_of(*values, "TIME")));
      return 0;
    }
    case Command::time_read:
      CHECK(decode_time(frame.body));
      return 0;
    case Command::scan: {
      if (frame.body.empty()) return 0;
      const auto scan = decode_scan(frame.body, request->scan);
      REQUIRE(scan.has_value());
      if (ScanReceiver::can_take(request->scan)) check_one_pass(frame, request->scan, *scan);
      return scan->range_mm.size();
    }
    default:
      CHECK(frame.body.empty());
      return 0;
  }
}

std::string slurp(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

}  // namespace

TEST_CASE("the byte logs of real sensors decode whole") {
  if (!std::filesystem::exists(log_folder())) {
    WARN("skipped: no recordings of real sensors at " << log_folder().string());
    return;
  }
  const std::vector<std::pair<std::string, std::size_t>> logs{
      {"real_urg_04lx.r.txt", 682}, {"real_utm_30lx.r.txt", 1081}, {"real_uxm_30lx_e.r.txt", 761}};
  for (const auto& [name, values] : logs) {
    INFO(name);
    FrameReader reader;
    reader.feed(slurp(log_folder() / name));
    int frames = 0;
    std::size_t scan_values = 0;
    for (;;) {
      const auto frame = reader.next();
      REQUIRE(frame.has_value());
      if (!*frame) break;
      ++frames;
      scan_values += check_real_frame(**frame);
    }
    CHECK(frames >= 10);
    CHECK(reader.pending() == 0);
    CHECK(scan_values == values);
  }
}

TEST_CASE("keys and values are read whichever part of the line the sum is over") {
  const std::string comment_out =
      std::string("SBPS:19200[bps]<-Default;") + checksum("SBPS:19200[bps]") + "\n";
  const std::string with_semicolon = std::string("MODL:UST-10LX;") + checksum("MODL:UST-10LX;") + "\n";
  const std::string without = std::string("DMIN:20;") + checksum("DMIN:20") + "\n";
  const auto values = decode_key_values(comment_out + with_semicolon + without);
  REQUIRE(values.has_value());
  CHECK(value_of(*values, "SBPS") == "19200[bps]<-Default");
  CHECK(value_of(*values, "MODL") == "UST-10LX");
  CHECK(value_of(*values, "DMIN") == "20");
  CHECK(value_of(*values, "NONE").empty());
}

TEST_CASE("damaged lines of keys and values are refused") {
  CHECK(decode_key_values("DMIN:20;5\n").error() == DataError::bad_checksum);
  CHECK(decode_key_values("DMIN20;5\n").error() == DataError::bad_key_value);
  CHECK(decode_key_values("\n").error() == DataError::bad_key_value);
  CHECK(decode_key_values(std::string("DM\x01N:20;") + checksum("DM\x01N:20")).error() ==
        DataError::bad_character);
}

TEST_CASE("II's time is read as six hexadecimal digits and as four characters") {
  CHECK(decode_information_time("4991D0") == 0x4991D0);
  CHECK(decode_information_time("<Sfk") == decode_value("<Sfk"));
  CHECK_FALSE(decode_information_time("xyz"));
  CHECK_FALSE(decode_information_time("GG91D0"));
}

TEST_CASE("statuses with letters are never success") {
  for (const char* status : {"0A", "0B", "0C", "0D", "0E", "0F", "0G", "0H", "0I", "0L", "0M"}) {
    for (const Command command :
         {Command::version, Command::laser_on, Command::scan, Command::time_enter, Command::quit}) {
      INFO(status);
      const StatusKind kind = kind_of(status, command);
      if (command == Command::scan && std::string_view(status) == "0M") continue;  // It goes on by itself.
      CHECK((kind == StatusKind::refused || kind == StatusKind::hardware_fault));
      CHECK_FALSE(meaning_of(status, command).empty());
    }
  }
  CHECK(kind_of("99", Command::scan) == StatusKind::scan_data);
  CHECK(kind_of("0M", Command::scan) == StatusKind::checking);
  CHECK(kind_of("02", Command::laser_on) == StatusKind::already);
  CHECK(kind_of("02", Command::scan) == StatusKind::refused);
  CHECK(kind_of("55", Command::scan) == StatusKind::hardware_fault);
  CHECK(kind_of("30", Command::scan) == StatusKind::checking);
  CHECK(kind_of("98", Command::scan) == StatusKind::resumed);
  CHECK(kind_of("01", Command::reboot) == StatusKind::repeat_to_confirm);
  CHECK(kind_of("zz", Command::scan) == StatusKind::unknown);
}

TEST_CASE("a scan written by hand decodes") {
  // Stamp 0x2Fh ms; ranges 1234 and 5432 with intensities 7 and 64.
  const std::string body = lines_of({"000T",
                                     "0CB"
                                     "007"
                                     "1Dh"
                                     "010"});
  ScanCommand command;
  command.first_step = 10, command.last_step = 11;
  const auto scan = decode_scan(body, command);
  REQUIRE(scan.has_value());
  CHECK(scan->stamp == 36);
  CHECK(scan->range_mm == std::vector<std::uint32_t>{1234, 5432});
  CHECK(scan->intensity == std::vector<std::uint32_t>{7, 64});
}

TEST_CASE("a full ME scan has the length that real sensors send") {
  RawScan scan;
  scan.range_mm.assign(1081, 1234), scan.intensity.assign(1081, 2000);
  ScanCommand command;
  CHECK(scan_bytes(command, scan).size() == 6717);
  scan.intensity.clear();
  command.format = ScanFormat::distance3;
  CHECK(scan_bytes(command, scan).size() == 3372);
  command.continuous = false;
  CHECK(scan_bytes(command, scan).size() == 3369);
}

TEST_CASE("every scan format survives the wire, wherever it is cut") {
  CHECK(rc::check([] {
    ScanCommand command = command_of(
        *rc::gen::arbitrary<bool>(),
        *rc::gen::element(ScanFormat::distance2, ScanFormat::distance3, ScanFormat::distance_intensity),
        *rc::gen::inRange(1, 200));
    command.multi_echo = command.format != ScanFormat::distance2 && *rc::gen::arbitrary<bool>();
    RawScan scan;
    scan.stamp = *rc::gen::inRange<std::uint64_t>(0, 1 << 24);
    const std::uint32_t largest = command.format == ScanFormat::distance2 ? 4095 : 262143;
    for (int step = 0; step < command.values(); ++step) {
      const int echoes = command.multi_echo ? *rc::gen::inRange(1, 4) : 1;
      if (command.multi_echo) scan.echoes.push_back(static_cast<std::uint8_t>(echoes));
      for (int echo = 0; echo < echoes; ++echo) {
        scan.range_mm.push_back(*rc::gen::inRange<std::uint32_t>(0, largest + 1));
        if (command.format == ScanFormat::distance_intensity) {
          scan.intensity.push_back(*rc::gen::inRange<std::uint32_t>(0, 262144));
        }
      }
    }
    const auto read = decode_whole(command, scan_bytes(command, scan));
    RC_ASSERT(read.has_value());
    RC_ASSERT(read->stamp == scan.stamp);
    RC_ASSERT(read->range_mm == scan.range_mm);
    RC_ASSERT(read->intensity == scan.intensity);
    RC_ASSERT(read->echoes == scan.echoes);
  }));
}

TEST_CASE("one flipped bit in a scan's data is never taken for a value") {
  CHECK(rc::check([] {
    ScanCommand command = command_of(
        true, *rc::gen::element(ScanFormat::distance2, ScanFormat::distance3, ScanFormat::distance_intensity),
        *rc::gen::inRange(1, 60));
    command.multi_echo = command.format != ScanFormat::distance2 && *rc::gen::arbitrary<bool>();
    RawScan scan;
    for (int step = 0; step < command.values(); ++step) {
      const int echoes = command.multi_echo ? *rc::gen::inRange(1, 4) : 1;
      if (command.multi_echo) scan.echoes.push_back(static_cast<std::uint8_t>(echoes));
      for (int echo = 0; echo < echoes; ++echo) {
        scan.range_mm.push_back(*rc::gen::inRange<std::uint32_t>(0, 4096));
        if (command.format == ScanFormat::distance_intensity) {
          scan.intensity.push_back(*rc::gen::inRange<std::uint32_t>(0, 262144));
        }
      }
    }
    std::string bytes = scan_bytes(command, scan);
    const std::size_t data_begin = 15 + 1 + 4;  // Behind echo and status: stamp and data.
    const std::size_t at = *rc::gen::inRange(data_begin, bytes.size() - 2);
    bytes[at] = static_cast<char>(bytes[at] ^ 1 << *rc::gen::inRange(0, 8));
    const auto read = decode_whole(command, bytes);
    if (read) {
      // Only an LF turned into another sum may be survived, and never with other values.
      RC_ASSERT(read->stamp == scan.stamp);
      RC_ASSERT(read->range_mm == scan.range_mm);
      RC_ASSERT(read->intensity == scan.intensity);
    }
  }));
}

TEST_CASE("a scan with too few or too many values, or with a short line inside, is refused") {
  ScanCommand command = command_of(true, ScanFormat::distance3, 2);
  CHECK(decode_scan(lines_of({"0000", "001"}), command).error() == DataError::wrong_count);
  CHECK(decode_scan(lines_of({"0000", "001002003"}), command).error() == DataError::wrong_count);
  CHECK(decode_scan(lines_of({"0000", "0010"}), command).error() == DataError::wrong_count);
  CHECK(decode_scan(lines_of({"0000", "001", "002"}), command).error() == DataError::bad_line_length);
  CHECK(decode_scan(lines_of({"00000", "001002"}), command).error() == DataError::bad_stamp);
  CHECK(decode_scan("", command).error() == DataError::bad_line_length);
  CHECK(decode_scan("0000P\n\n", command).error() == DataError::bad_checksum);
}

TEST_CASE("clusters keep the smallest range that is no code, with its intensity") {
  std::vector<std::uint32_t> range{4, 500, 400, 65533, 65533, 65533, 300}, intensity{1, 2, 3, 4, 5, 6, 7};
  merge_clusters(3, 20, 30000, range, intensity);
  CHECK(range == std::vector<std::uint32_t>{400, 65533, 300});
  CHECK(intensity == std::vector<std::uint32_t>{3, 4, 7});
}

}  // namespace reply_test
