// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

#include "rig/import/importer.hpp"

/// Takes anything that an importer reads, and looks at what it is given.
class NowhereSink : public rig::ImportSink {
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
