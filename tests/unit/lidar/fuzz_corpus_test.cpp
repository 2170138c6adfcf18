// SPDX-License-Identifier: MIT
// Seeds of the SCIP fuzz targets: `build/tests/test_lidar "[.corpus]"` writes them anew.
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>

#include "lidar/response.hpp"

namespace fuzz_corpus_test {

using lidar::ScanCommand;

namespace {

void write(const std::string& target, const std::string& name, char first, const std::string& bytes) {
  const std::filesystem::path folder = std::filesystem::path(RIG_SOURCE_DIR) / "tests/fuzz/corpus" / target;
  std::filesystem::create_directories(folder);
  std::ofstream(folder / name, std::ios::binary) << first << bytes;
}

std::string scan(const ScanCommand& command, const std::string& status, const std::string& text = "r1") {
  std::vector<std::uint32_t> range, intensity;
  std::vector<std::uint8_t> echoes;
  for (int i = 0; i < command.values(); ++i) {
    echoes.push_back(static_cast<std::uint8_t>(command.multi_echo ? 1 + i % 3 : 1));
    for (int e = 0; e < echoes.back(); ++e) {
      range.push_back(static_cast<std::uint32_t>(i % 9 == 0 ? 65533 : 100 + 37 * i));
      intensity.push_back(static_cast<std::uint32_t>(500 + i));
    }
  }
  lidar::ScanData data;
  data.stamp = 0xFFFFF0;
  data.range_mm = range;
  data.intensity = intensity;
  if (command.multi_echo) data.echoes = echoes;
  std::string out;
  append_scan_response(out, build_line(lidar::Request(command, text)), status, command, data);
  return out;
}

}  // namespace

TEST_CASE("seeds of the fuzz targets", "[.corpus]") {
  using KeyValues = std::vector<std::pair<std::string, std::string>>;
  const std::string version = lidar::build_key_value_response(
      "VV;r1", "00", KeyValues{{"PROD", "UST-10LX"}, {"FIRM", "2.23.0000"}, {"SERI", "H1"}});
  const std::string parameters = lidar::build_key_value_response(
      "PP;r2", "00",
      KeyValues{{"MODL", "UST-10LX"}, {"DMIN", "20"}, {"DMAX", "30000"}, {"AMAX", "1080"}, {"SCAN", "2400"}});
  write("scip_reply", "identity", 4, version + parameters);
  write("scip_reply", "time", 0,
        lidar::build_status_response("TM0;r3", "00") + lidar::build_time_response("TM1;r4", 0xABCDEF) +
            lidar::build_time_response("%TM1;r5", 123456789, true) +
            lidar::build_text_response("%ST;r6", "00", "004"));
  ScanCommand command;
  command.last_step = 40;
  for (const bool continuous : {false, true})
    for (const bool multi_echo : {false, true})
      for (const auto format : {lidar::ScanFormat::distance2, lidar::ScanFormat::distance3,
                                lidar::ScanFormat::distance_intensity}) {
        if (multi_echo && format == lidar::ScanFormat::distance2) continue;
        command.continuous = continuous;
        command.multi_echo = multi_echo;
        command.format = format;
        const std::string name = build_line(lidar::Request(command)).substr(0, 2);
        write("scip_reply", name, 2, scan(command, continuous ? "99" : "00"));
      }
  write("scip_reply", "refused", 1,
        lidar::build_status_response("ME0000108001000;r1", "0L") + "garbage\n\n" +
            lidar::build_status_response("QT", "00"));

  write("scip_request", "session", 60,
        "\nQT\nTM2\nVV;r1\nPP;r2\nII;r3\nTM0\nTM1;r4\nTM2\nBM\nGD0000010001\nME0000010001000;r9\n%ST\nQT\n");
  write("scip_request", "stream", 3, "MD0010009003203\r\nMS0000010000000\rQT\nRB\nRB\n");
  write(
      "scip_request", "refused", 9,
      "ME01000000010;x\nGD\nHD0000010001\n%MD0000010001000\nCR05\nHS1\nSS019200\nDB03\nSCIP2.0\n$IP000\nTM9\n"
      "VV;a string that is far too long\n");

  for (const bool pairs : {true, false})
    for (const int last : {3, 31, 63, 100, 127}) {
      ScanCommand small;
      small.format = pairs ? lidar::ScanFormat::distance_intensity : lidar::ScanFormat::distance3;
      small.last_step = last;
      const std::string bytes = scan(small, "99");
      write("scip_receiver", (pairs ? "pairs" : "ranges") + std::to_string(last),
            static_cast<char>(2 * last + (pairs ? 0 : 1)), bytes.substr(bytes.find('\n') + 1));
    }
}

}  // namespace fuzz_corpus_test
