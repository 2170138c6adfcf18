// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "fit/numeric/estimate.hpp"
#include "rig/fitting/fitting.hpp"
#include "rig/session/session_store.hpp"

/// The latest result of a kind that a session file holds; an empty object if there is none. Throws for a
/// value that the calibration does not state: a limit on it would be refused.
inline nlohmann::json latest_result(const std::string& file, const std::string& kind) {
  const rig::SessionStore session(file, rig::SessionStore::Mode::read);
  const auto result = nlohmann::json::parse(session.latest_result(kind).value_or("{}"));
  if (result.value("schema", "") == "result/1")
    for (const auto& value : result.at("values")) rig::check_value(kind, value.at("name"));
  return result;
}

/// A value of a result by its name, with its standard uncertainty.
inline fit::Estimate value_of(const nlohmann::json& result, const std::string& name) {
  for (const auto& value : result.at("values"))
    if (value.at("name") == name) return {value.at("value").get<double>(), value.at("u").get<double>()};
  throw std::runtime_error("no value " + name + " in " + result.dump());
}
