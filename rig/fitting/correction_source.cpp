// SPDX-License-Identifier: MIT
#include "rig/fitting/correction_source.hpp"

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "rig/errors.hpp"
#include "rig/json_fields.hpp"
#include "rig/session/standing.hpp"

namespace rig {

fit::Correction load_correction(const std::string& path, const SessionStore& session) {
  const auto result = session.latest_result("range");
  const auto document = nlohmann::json::parse(result.value_or("null"), nullptr, false);
  if (!document.is_object() || !document.contains("data") || !document.at("data").is_object() ||
      !document.at("data").contains("correction") || !document.at("data").at("correction").is_object())
    throw MeasurementError(
        path + " holds no range correction: run 'rig fit range " + path +
        "' first, on captures at three distances or more, or of four surfaces at one distance");
  try {
    fit::Correction correction = fit::parse_correction(document.at("data").at("correction").dump(), path);
    const Standing standing = standing_of(session);
    std::string reasons;
    for (const std::string& reason : standing.reasons) reasons += " " + reason;
    if (!standing.certifies()) correction.notes.push_back("From a report, not from a certificate:" + reasons);
    return correction;
  } catch (const std::invalid_argument& error) {
    throw UsageError(error.what());
  }
}

fit::Correction load_correction(const std::string& path) {
  if (is_session_file(path)) {
    const SessionStore session(path, SessionStore::Mode::read);
    return load_correction(path, session);
  }
  std::ifstream in(path, std::ios::binary);
  if (!in) throw UsageError("cannot read " + path + ": no such file, or no permission");
  std::stringstream text;
  text << in.rdbuf();
  try {
    return fit::parse_correction(text.str(), path);
  } catch (const std::invalid_argument& error) {
    throw UsageError(error.what());
  }
}

std::optional<Eigen::Vector2d> centre_of(const SessionStore& session) {
  const auto result = nlohmann::json::parse(session.latest_result("centre").value_or("null"), nullptr, false);
  Eigen::Vector2d centre(NAN, NAN);
  for (const auto& value : list_of(result, "values")) {
    const std::string name = text_of(value, "name");
    if (name == "centre_x_mm") centre.x() = number_of(value, "value");
    if (name == "centre_y_mm") centre.y() = number_of(value, "value");
  }
  return centre.allFinite() ? std::optional(centre) : std::nullopt;
}

Eigen::Vector2d load_centre(const std::string& path, const SessionStore& session) {
  if (const auto centre = centre_of(session)) return *centre;
  throw MeasurementError(path + " holds no rotation centre: run 'rig fit centre " + path +
                         "' first, on captures of one edge from several stage angles");
}

}  // namespace rig
