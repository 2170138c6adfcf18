// SPDX-License-Identifier: MIT
// Tables with columns named by the operator: the input's first line is --columns, the rest is the file.
#include <unistd.h>

#include <fstream>
#include <string>

#include "rig/errors.hpp"
#include "rig/import/importer.hpp"
#include "rig/text_lines.hpp"
#include "tests/support/nowhere_sink.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto end = text.find('\n');
  if (end == text.npos || end + 1 >= size) return 0;
  rig::ImportOptions options;
  for (const auto name : rig::split(text.substr(0, end), ',')) options.columns.emplace_back(name);
  options.ticks_a_turn = 100;
  if (end % 2 == 1) options.first_deg = -90, options.step_deg = 5;
  const std::string path = "/tmp/fuzz-table-" + std::to_string(getpid()) + ".txt";
  std::ofstream(path, std::ios::binary)
      .write(text.data() + end + 1, static_cast<std::streamsize>(size - end - 1));
  try {
    NowhereSink sink;
    rig::importer_for(path, options)->read(path, options, sink);
  } catch (const rig::UsageError&) {
  } catch (const rig::MeasurementError&) {
  }
  unlink(path.c_str());
  return 0;
}
