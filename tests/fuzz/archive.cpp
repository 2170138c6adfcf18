// SPDX-License-Identifier: MIT
// A stranger's session taken into an archive's index: it ends in a record that the pages can show, or in one
// of our errors, and the file stays as it is. The input is a session file, or an explanation that lies beside
// one.
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "rig/archive/archive_index.hpp"
#include "rig/archive/fleet.hpp"
#include "rig/archive/history.hpp"

namespace {

void show(const rig::SessionRecord& record) {
  static rig::ArchiveIndex index(":memory:", true);
  index.put(record);
  const auto sessions = index.sessions();
  if (sessions.size() != 1) __builtin_trap();
  (void)rig::fleet_of(sessions).dump();  // Texts that are no UTF-8 would throw here.
  (void)rig::history_of(sessions, sessions.front().serial).dump();
  index.forget(record.content_sha256);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::string folder = "/tmp", name = "fuzz-archive-" + std::to_string(getpid()) + ".rig";
  const std::string path = folder + "/" + name;
  if (size > 0 && data[0] == '{') {
    if (auto explanation = rig::explanation_in(std::string(reinterpret_cast<const char*>(data), size),
                                               "2026-01-01T00:00:00Z")) {
      rig::SessionRecord record;
      record.path = name, record.content_sha256 = "0", record.serial = "H1",
      record.explanation = std::move(explanation);
      show(record);
    }
    return 0;
  }
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (!file) return 0;
  std::fwrite(data, 1, size, file);
  std::fclose(file);
  try {
    const std::string before = rig::file_sha256(path);
    try {
      show(rig::read_session_record(folder, name));
    } catch (const nlohmann::json::exception&) {
      __builtin_trap();                // What a session says reached a page as it was.
    } catch (const std::exception&) {  // any named error will do; crashes and leaks will not
    }
    if (rig::file_sha256(path) != before) __builtin_trap();
  } catch (const std::exception&) {
  }
  std::remove(path.c_str());
  return 0;
}
