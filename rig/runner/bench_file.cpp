// SPDX-License-Identifier: MIT
#include "rig/runner/bench_file.hpp"

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"

namespace rig {
namespace {

constexpr std::size_t largest_file_bytes = 16'000'000;

}  // namespace

fit::Bench read_bench_file(const std::string& path) {
  if (std::filesystem::is_directory(path))
    throw UsageError(path + " is a folder, not a bench file. Give a file in it.");
  std::ifstream in(path, std::ios::binary);
  if (!in) throw UsageError("cannot read the bench file " + path + ": check the name and the permission.");
  std::string text(largest_file_bytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (text.size() > largest_file_bytes)
    throw UsageError(path +
                     " is larger than 16 MB, which no bench file is. Check that it is the right file.");
  return read_bench_text(text, path);
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
