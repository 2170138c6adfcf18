// SPDX-License-Identifier: MIT
#include "rig/runner/bench_file.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "fit/known_mechanisms.hpp"
#include "rig/errors.hpp"
#include "rig/output_place.hpp"
#include "rig/procedure/procedure_value.hpp"

namespace rig {
namespace {

constexpr std::size_t largest_file_bytes = 16'000'000;
constexpr double nearest_scene_mm = 20;  // Below the least range of every lidar that the sources name.

/// A bench in metres reads as one in millimetres whose targets all stand on the stage's axis.
void demand_millimetres(const fit::Bench& bench, const std::string& name) {
  double farthest_mm = 0;
  for (const fit::Target& target : bench.targets)
    farthest_mm = std::max({farthest_mm, target.from_mm.norm(), target.to_mm.norm()});
  if (bench.targets.empty() || farthest_mm >= nearest_scene_mm) return;
  throw UsageError(
      name + ": all targets lie within " + rounded_text(farthest_mm, 1) +
      " mm of the stage's axis, where no lidar measures. Lengths are in millimetres; were metres meant?");
}

using Parse = fit::Bench (*)(const std::string& text, const std::string& name);

fit::Bench understood(Parse parse, const std::string& text, const std::string& name) {
  try {
    return parse(text, name);
  } catch (const std::invalid_argument& error) {
    throw UsageError(error.what());
  }
}

}  // namespace

fit::Bench read_bench_file(const std::string& path) {
  if (std::filesystem::is_directory(path))
    throw UsageError(path + " is a folder, not a bench file. Give a file in it.");
  if (is_recording(path))
    throw UsageError(path + " is a session, not a bench file. The bench it was recorded with is in it: " +
                     "`rig export SESSION --format json -o -` shows it.");
  std::ifstream in(path, std::ios::binary);
  if (!in) throw UsageError("cannot read the bench file " + path + ": check the name and the permission.");
  std::string text(largest_file_bytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (text.size() > largest_file_bytes)
    throw UsageError(path +
                     " is larger than 16 MB, which no bench file is. Check that it is the right file.");
  fit::Bench bench = understood(fit::parse_bench_file, text, path);
  demand_millimetres(bench, path);
  try {
    fit::demand_catalogued(bench);
  } catch (const std::invalid_argument& error) {
    throw UsageError(path + ": " + error.what());
  }
  return bench;
}

fit::Bench read_bench_text(const std::string& text, const std::string& name) {
  return understood(fit::parse_bench, text, name);
}

StageOptions bench_stage_options(const fit::Bench& bench) {
  return stage_options(bench.document.json().value("stage", nlohmann::json::object()));
}

}  // namespace rig
