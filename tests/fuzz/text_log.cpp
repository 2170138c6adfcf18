// SPDX-License-Identifier: MIT
// Logs and tables as text: read as far as they go, or refused with one of our errors. The first byte chooses
// the format, the rest is the file.
#include <unistd.h>

#include <cstdint>
#include <fstream>
#include <string>

#include "rig/errors.hpp"
#include "rig/import/importer.hpp"

namespace {

class Nowhere : public rig::ImportSink {
 public:
  void scan(const rig::ImportedScan& scan) override {
    for (const auto range : scan.range_mm) seen_ += range;
    for (const auto value : scan.intensity) seen_ += value;
  }
  void pose(std::int64_t, const std::string&, const std::string&, const fit::TrackPose&) override {}
  void imu(std::int64_t, const std::string&, double, double) override {}
  void transform(const rig::ImportedTransform&) override {}
  void property(const std::string&, const std::string&) override {}
  void note(const std::string&) override {}
  bool wants_more() const override { return true; }

 private:
  std::uint64_t seen_ = 0;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 2) return 0;
  static const char* const endings[] = {".ubh", ".csv", ".log"};
  const std::string path = "/tmp/fuzz-text-" + std::to_string(getpid()) + endings[data[0] % 3];
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(data + 1), static_cast<std::streamsize>(size - 1));
  rig::ImportOptions options;
  if (data[0] & 128) options.first_deg = -10, options.step_deg = 0.5;
  try {
    Nowhere sink;
    rig::importer_for(path)->read(path, options, sink);
  } catch (const rig::UsageError&) {
  } catch (const rig::MeasurementError&) {
  }
  unlink(path.c_str());
  return 0;
}
