// SPDX-License-Identifier: MIT
#include "lidar/scan_receiver.hpp"

#include <rapidcheck.h>

#include <catch2/catch.hpp>

#include "lidar/frame_reader.hpp"
#include "lidar/reply.hpp"
#include "lidar/response.hpp"

namespace scan_receiver_test {

using lidar::Kernel;
using lidar::Scan;
using lidar::ScanCommand;
using lidar::ScanReceiver;

namespace {

constexpr int least_mm = 20, most_mm = 30000;

std::vector<Kernel> kernels() {
  std::vector<Kernel> out;
  for (const Kernel kernel : {Kernel::portable, Kernel::avx2, Kernel::avx512})
    if (available(kernel)) out.push_back(kernel);
  return out;
}

ScanCommand any_command() {
  ScanCommand command;
  command.format =
      *rc::gen::arbitrary<bool>() ? lidar::ScanFormat::distance_intensity : lidar::ScanFormat::distance3;
  command.first_step = *rc::gen::inRange(0, 1081);
  command.last_step = *rc::gen::inRange(command.first_step, 1081);
  command.cluster = *rc::gen::inRange(1, 5);
  return command;
}

/// Any values of 18 bits, near the limits more often than elsewhere.
std::vector<std::uint32_t> any_values(int count) {
  const auto near = [](std::uint32_t limit) { return rc::gen::inRange<std::uint32_t>(limit - 2, limit + 3); };
  const auto value =
      rc::gen::oneOf(rc::gen::inRange<std::uint32_t>(0, 1 << 18), near(least_mm), near(most_mm), near(65535),
                     rc::gen::just<std::uint32_t>((1 << 18) - 1), rc::gen::inRange<std::uint32_t>(0, 4));
  return *rc::gen::container<std::vector<std::uint32_t>>(static_cast<std::size_t>(count), value);
}

std::string message(const ScanCommand& command, const std::string& text) {
  const auto range = any_values(command.values()), intensity = any_values(command.values());
  lidar::ScanData data;
  data.stamp = *rc::gen::inRange<std::uint64_t>(0, 1 << 24);
  data.range_mm = range;
  if (command.format == lidar::ScanFormat::distance_intensity) data.intensity = intensity;
  std::string out;
  append_scan_response(out, build_line(lidar::Request(command, text)), "99", command, data);
  return out;
}

/// What FrameReader and decode_scan make of the bytes: the first message, if it is a good scan of this
/// stream.
std::optional<std::pair<std::uint32_t, Scan>> the_long_way(const std::string& bytes,
                                                           const ScanCommand& command,
                                                           const std::string& echo) {
  lidar::FrameReader reader;
  reader.feed(bytes);
  const auto frame = reader.next();
  if (!frame || !*frame || (*frame)->echo != echo || (*frame)->status != "99") return std::nullopt;
  if (bytes.front() == '\n') return std::nullopt;  // it skips empty lines; the receiver does not
  const auto raw = decode_scan((*frame)->body, command);
  if (!raw) return std::nullopt;
  Scan scan;
  for (const auto mm : raw->range_mm)
    scan.range_mm.push_back(mm < least_mm || mm > most_mm ? 0 : static_cast<std::uint16_t>(mm));
  for (const auto value : raw->intensity)
    scan.intensity.push_back(static_cast<std::uint16_t>(std::min(value, 65535u)));
  return std::pair(static_cast<std::uint32_t>(raw->stamp), scan);
}

void check_same(const std::string& bytes, const ScanCommand& command, const std::string& text) {
  const auto expected = the_long_way(bytes, command, build_line(lidar::Request(command, text)));
  for (const Kernel kernel : kernels()) {
    const ScanReceiver receiver(command, text, least_mm, most_mm, kernel);
    Scan scan;
    const auto stamp = receiver.take(bytes, scan);
    RC_ASSERT(stamp.has_value() == expected.has_value());
    if (!stamp) continue;
    RC_ASSERT(*stamp == expected->first);
    RC_ASSERT(scan.range_mm == expected->second.range_mm);
    RC_ASSERT(scan.intensity == expected->second.intensity);
  }
}

}  // namespace

TEST_CASE("every kernel takes a good scan as the portable one and the long way do") {
  INFO("kernels here: " << kernels().size());
  CHECK(rc::check([] {
    const ScanCommand command = any_command();
    const std::string text = *rc::gen::element<std::string>("", "r7", "r999999");
    const std::string bytes = message(command, text);
    RC_ASSERT(ScanReceiver(command, text, least_mm, most_mm).message_bytes() == bytes.size());
    check_same(bytes + "ME00", command, text);
    Scan scan;
    for (const Kernel kernel : kernels())
      RC_ASSERT(ScanReceiver(command, text, least_mm, most_mm, kernel).take(bytes, scan).has_value());
  }));
}

TEST_CASE("no kernel takes a scan that the long way would not, whatever byte is wrong") {
  CHECK(rc::check([] {
    const ScanCommand command = any_command();
    std::string bytes = message(command, "r1");
    const std::size_t first =
        build_line(lidar::Request(command, "r1")).size();  // the echo is stated otherwise
    const int faults = *rc::gen::inRange(1, 4);
    for (int i = 0; i < faults; ++i) {
      const auto at = *rc::gen::inRange(first, bytes.size());
      switch (*rc::gen::inRange(0, 4)) {
        case 0:
          bytes[at] = *rc::gen::arbitrary<char>();
          break;
        case 1:
          bytes[at] = static_cast<char>(bytes[at] ^ (1 << *rc::gen::inRange(0, 8)));
          break;
        case 2:
          bytes.erase(at, static_cast<std::size_t>(*rc::gen::inRange(1, 70)));
          break;
        default:
          bytes.insert(at, 1, *rc::gen::element('\n', '0', 'o', '&'));
      }
      if (bytes.size() <= first) bytes = message(command, "r1");
    }
    check_same(bytes, command, "r1");
  }));
}

TEST_CASE("two wrong bytes that leave the sum right are still found when one is no data character") {
  ScanCommand command;
  command.last_step = 100;
  const std::vector<std::uint32_t> range(101, 1000), intensity(101, 2000);
  lidar::ScanData data;
  data.range_mm = range;
  data.intensity = intensity;
  std::string good;
  append_scan_response(good, "ME0000010001000", "99", command, data);
  for (const Kernel kernel : kernels()) {
    const ScanReceiver receiver(command, "", least_mm, most_mm, kernel);
    Scan scan;
    REQUIRE(receiver.take(good, scan));
    for (std::size_t at = 30; at + 70 < good.size(); ++at) {
      std::string bad = good;
      bad[at] = static_cast<char>(bad[at] ^ 0x80);  // the 6-bit sum does not see it
      REQUIRE_FALSE(receiver.take(bad, scan));
    }
  }
}

TEST_CASE("part of a message is not taken") {
  const ScanCommand command;
  const std::vector<std::uint32_t> values(1081, 1000);
  lidar::ScanData data;
  data.range_mm = data.intensity = values;
  std::string bytes;
  append_scan_response(bytes, "ME0000108001000", "99", command, data);
  CHECK(bytes.size() == 6717);  // as a real UTM-30LX sends it
  const ScanReceiver receiver(command, "", least_mm, most_mm);
  Scan scan;
  CHECK(receiver.take(bytes, scan));
  CHECK_FALSE(receiver.take(std::string_view(bytes).substr(0, bytes.size() - 1), scan));
  CHECK_FALSE(receiver.take("", scan));
  CHECK_FALSE(ScanReceiver().take(bytes, scan));
}

}  // namespace scan_receiver_test
