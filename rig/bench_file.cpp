// SPDX-License-Identifier: MIT
#include "rig/bench_file.hpp"

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "rig/errors.hpp"

namespace rig {

fit::Bench read_bench_file(const std::string& path) {
  std::ifstream in(path);
  std::stringstream text;
  text << in.rdbuf();
  if (!in) throw UsageError("cannot read the bench file " + path + ": check the name and the permission.");
  return read_bench_text(text.str(), path);
}

fit::Bench read_bench_text(const std::string& text, const std::string& name) {
  try {
    return fit::parse_bench(text, name);
  } catch (const std::invalid_argument& error) {
    throw UsageError(error.what());
  }
}

StageOptions bench_stage_options(const fit::Bench& bench) {
  const auto document = nlohmann::json::parse(bench.document, nullptr, false, true);
  if (!document.is_object()) return StageOptions();
  return stage_options(document.value("stage", nlohmann::json::object()));
}

}  // namespace rig
