// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "rig/session/session_store.hpp"

/// A finished calibration session, as far as an archive reads it: one capture and the results given.
struct Calibration {
  struct Value {
    std::string name;
    double value = 0, u = 0;
    std::string unit = "mm";
  };
  std::string serial = "H0001", model = "UST-10LX", measured_utc = "2026-01-04T10:00:00Z", kind = "range",
              item_state;
  std::vector<Value> values;
  nlohmann::json limits = nullptr, explanation = nullptr;
  std::uint16_t range_mm = 1000;  ///< What it measured: sessions that differ in nothing are copies.

  /// Writes it to `path`, with the folders on the way.
  void write(const std::string& path) const {
    std::filesystem::create_directories(std::filesystem::path(path).parent_path());
    rig::SessionStore store(path, rig::SessionStore::Mode::create);
    nlohmann::json bench = {{"schema", "bench/1"}, {"name", "bench A"}};
    if (!item_state.empty()) bench["certificate"] = {{"item_state", item_state}};
    store.set("bench", bench.dump());
    store.set("lidar", nlohmann::json{{"PROD", model}, {"SERI", serial}, {"FIRM", "1.0"}}.dump());
    store.set("created_utc", measured_utc);
    store.set("procedure", "procedure: ladder\nsteps: [home]\n");
    store.set("procedure_name", "Range ladder");
    store.set("kind", "ladder");
    store.set("ended", "done");
    fit::CaptureInfo info;
    info.step = "look";
    info.last_step = 1;
    const auto capture = store.begin_capture(info);
    const std::vector<std::uint16_t> ranges = {range_mm, static_cast<std::uint16_t>(serial.back())};
    fit::ScanView scan;
    scan.range_mm = ranges;
    scan.host_us = static_cast<std::int64_t>(std::hash<std::string>()(measured_utc + serial) % 1'000'000'000);
    store.add_scan(capture, scan);
    store.commit_capture(capture);
    nlohmann::json result = {{"schema", "result/1"}, {"kind", kind}, {"values", nlohmann::json::array()}};
    for (const Value& v : values)
      result["values"].push_back({{"name", v.name},
                                  {"label", "Label of " + v.name},
                                  {"value", v.value},
                                  {"u", v.u},
                                  {"U", 2 * v.u},
                                  {"k", 2},
                                  {"unit", v.unit}});
    store.add_result(kind, result.dump());
    if (!limits.is_null()) store.add_result("limits", limits.dump());
    if (!explanation.is_null()) store.add_result("explanation", explanation.dump());
  }
};
