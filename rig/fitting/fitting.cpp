// SPDX-License-Identifier: MIT
#include "rig/fitting/fitting.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "fit/bench/json_position.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/errors.hpp"
#include "rig/json_fields.hpp"
#include "rig/session/standing.hpp"
#include "rig/text_lines.hpp"

namespace rig {

namespace fittings {
std::vector<std::unique_ptr<Fitting>> all();
}

namespace {

std::string kinds_in_words() {
  std::string out;
  for (const auto& fitting : all_fittings()) out += (out.empty() ? "" : ", ") + fitting->kind();
  return out;
}

void refuse_clusters(const std::string& kind, const std::vector<FitSource>& sources) {
  for (const FitSource& source : sources) {
    if (!source.session) continue;
    for (const fit::CaptureInfo& capture : source.session->captures())
      if (capture.cluster > 1)
        throw UsageError(source.path + ", capture " + std::to_string(capture.id) + " ('" + capture.step +
                         "') was recorded in clusters of " + std::to_string(capture.cluster) +
                         " steps: the lidar sent the nearest range of each, which is too short for the "
                         "calibration '" +
                         kind + "', which is made for single beams. Record it with 'cluster: 1'");
  }
}

/// Whether a calibration that states the value `name` may give `value`.
bool stands_for(const std::string& name, const std::string& value) {
  const auto star = name.find('*');
  if (star == std::string::npos) return name == value;
  const std::string before = name.substr(0, star), after = name.substr(star + 1);
  if (value.size() <= before.size() + after.size() || !value.starts_with(before) || !value.ends_with(after))
    return false;
  return value.substr(star, value.size() - before.size() - after.size()).find_first_not_of("0123456789") ==
         std::string::npos;
}

std::string padded(const std::string& text, std::size_t width) {
  return text + std::string(width > text.size() ? width - text.size() : 0, ' ');
}

/// The result is kept in the first session only: its certificate must tell what else it was made from.
void name_sessions(nlohmann::json& result, const std::vector<FitSource>& sources) {
  std::string names;
  result["recordings"] = nlohmann::json::array();
  for (const FitSource& source : sources) {
    const std::string file = std::filesystem::path(source.path).filename().string();
    names += (names.empty() ? "" : "; ") + file;
    nlohmann::json recording = {{"file", file}};
    if (source.session) {
      const std::string hash = source.session->content_hash();
      names += ", SHA-256 " + hash;
      recording["sha256"] = hash;
      recording["captures"] = source.session->recording()->captures().size();
    }
    result["recordings"].push_back(std::move(recording));
  }
  result["notes"].push_back("Made from " + std::to_string(sources.size()) + " recordings together: " + names +
                            ".");
}

}  // namespace

const Fitting& fitting_of(const std::string& kind) {
  for (const auto& fitting : all_fittings())
    if (fitting->kind() == kind) return *fitting;
  std::vector<std::string> kinds;
  for (const auto& fitting : all_fittings()) kinds.push_back(fitting->kind());
  throw UsageError("there is no calibration '" + kind + "'" +
                   fit::ending_with_guess(fit::nearest_word(kind, kinds)) +
                   " There are: " + kinds_in_words());
}

void check_fit(const std::string& kind, const nlohmann::json& options) {
  const Fitting& fitting = fitting_of(kind);
  fitting.check_files(FitOptions(kind, fitting.options(), options));
}

std::string doubt_about_fit(const std::string& kind, const nlohmann::json& options) {
  const Fitting& fitting = fitting_of(kind);
  return fitting.doubt_about(FitOptions(kind, fitting.options(), options));
}

void check_value(const std::string& kind, const std::string& value) {
  const std::vector<std::string> names = fitting_of(kind).values();
  if (std::ranges::any_of(names, [&](const std::string& name) { return stands_for(name, value); })) return;
  throw UsageError("the calibration '" + kind + "' gives no value '" + value + "'" +
                   fit::ending_with_guess(fit::nearest_word(value, names)) + " There are: " + listed(names));
}

const std::vector<std::unique_ptr<Fitting>>& all_fittings() {
  static const std::vector<std::unique_ptr<Fitting>> fittings = fittings::all();
  return fittings;
}

nlohmann::json run_fit(const std::string& kind, const std::vector<FitSource>& sources,
                       const nlohmann::json& options) {
  const Fitting& fitting = fitting_of(kind);
  const FitOptions checked(kind, fitting.options(), options);
  for (const FitSource& source : sources)
    if (!source.session && !fitting.accepts_files())
      throw UsageError(source.path + " is not a session file (*.rig), which the calibration '" + kind +
                       "' needs: make one with 'rig run' or 'rig import'");
  if (sources.empty()) throw UsageError("the calibration '" + kind + "' needs at least one session");
  if (!fitting.accepts_clusters()) refuse_clusters(kind, sources);
  nlohmann::json result = fitting.run(sources, checked);
  if (sources.size() > 1) name_sessions(result, sources);
  return result;
}

std::string to_text(const nlohmann::json& result) {
  std::ostringstream out;
  out << result.value("kind", "result") << "\n";
  for (const std::string& doubt : doubts_of(result)) out << "  DOUBTFUL: " << doubt << "\n";
  std::size_t width = 10;
  for (const auto& value : result.value("values", nlohmann::json::array()))
    width = std::max(width, value.value("label", value.value("name", "")).size() + 2);
  for (const auto& value : result.value("values", nlohmann::json::array())) {
    const double expanded = expanded_of(value, 0);
    out << "  " << padded(value.value("label", value.value("name", "")), width)
        << fit::format_value(number_of(value, "value"), expanded);
    if (std::isfinite(number_of(value, "value"))) out << ' ' << value.value("unit", "");
    if (expanded > 0)
      out << "   U = " << fit::format_uncertainty(expanded) << ' ' << value.value("unit", "")
          << " (k = " << fit::format_value(value.value("k", 2.0), 0) << ")";
    out << "\n";
  }
  for (const auto& note : result.value("notes", nlohmann::json::array()))
    out << "  note: " << note.get<std::string>() << "\n";
  for (const auto& what : result.value("undetermined", nlohmann::json::array()))
    out << "  not determined: " << what.get<std::string>() << "\n";
  return out.str();
}

}  // namespace rig
