// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "fit/bench/bench.hpp"
#include "rig/investigate/state.hpp"

namespace rig::investigate {

/// An explanation without its curves and its bench, and with `suspects`: how probable each answer is.
[[nodiscard]] nlohmann::json without_pictures(const nlohmann::json& explanation);

/// It in one line.
[[nodiscard]] std::string conclusions_in_words(const nlohmann::json& explanation);

/// What is known of an investigation, at its end or on the way (`dossier/2`, docs/operate/investigate.md).
[[nodiscard]] nlohmann::json dossier_document(const State& state, const fit::Bench& bench);

/// Of a dossier, what the live page shows: rounds with their suspects, what is claimed, what comes next.
[[nodiscard]] nlohmann::json for_live_page(const nlohmann::json& dossier);

}  // namespace rig::investigate
