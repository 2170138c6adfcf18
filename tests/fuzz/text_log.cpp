// SPDX-License-Identifier: MIT
// Logs and tables as text: read as far as they go, or refused with one of our errors. The first byte chooses
// the format, the rest is the file.
#include <unistd.h>

#include <cstdint>
#include <fstream>
#include <string>

#include "rig/errors.hpp"
#include "rig/import/importer.hpp"
#include "tests/support/nowhere_sink.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 2) return 0;
  static const char* const endings[] = {".ubh", ".csv", ".log", ".dat"};
  const std::string path = "/tmp/fuzz-text-" + std::to_string(getpid()) + endings[data[0] % 4];
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(data + 1), static_cast<std::streamsize>(size - 1));
  rig::ImportOptions options;
  options.ticks_a_turn = 100;
  if (data[0] & 128) options.first_deg = -10, options.step_deg = 0.5;
  try {
    NowhereSink sink;
    rig::importer_for(path)->read(path, options, sink);
  } catch (const rig::UsageError&) {
  } catch (const rig::MeasurementError&) {
  }
  unlink(path.c_str());
  return 0;
}
