// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include "fit/bench/bench.hpp"
#include "rig/stage/stage_factory.hpp"

namespace rig {

/// Reads a bench file; throws UsageError naming file, line and column.
[[nodiscard]] fit::Bench read_bench_file(const std::string& path);
[[nodiscard]] fit::Bench read_bench_text(const std::string& text, const std::string& name);

/// What the bench file knows of the stage.
[[nodiscard]] StageOptions bench_stage_options(const fit::Bench& bench);

}  // namespace rig
