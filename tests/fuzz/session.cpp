// SPDX-License-Identifier: MIT
// A damaged session file is read as far as it goes or refused with one of our errors.
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <string>

#include "rig/errors.hpp"
#include "rig/session/session_store.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::string path = "/tmp/fuzz-session-" + std::to_string(getpid()) + ".rig";
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (!file) return 0;
  std::fwrite(data, 1, size, file);
  std::fclose(file);
  try {
    const rig::SessionStore session(path, rig::SessionStore::Mode::read);
    const auto recording = session.recording();
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < recording->captures().size(); ++i)
      recording->for_each_scan(i, [&](const fit::ScanView& scan) {
        for (const std::uint16_t range : scan.range_mm) sum += range;
      });
    (void)session.latest_results();
    (void)session.content_hash();
  } catch (const std::exception&) {  // any named error will do; crashes and leaks will not
  }
  std::remove(path.c_str());
  return 0;
}
