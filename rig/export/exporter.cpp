// SPDX-License-Identifier: MIT
#include "rig/export/exporter.hpp"

#include "fit/bench/json_position.hpp"
#include "rig/errors.hpp"
#include "rig/export/correction_export.hpp"
#include "rig/session/lidar_identity.hpp"
#include "rig/session/standing.hpp"
#include "rig/whole_file.hpp"

namespace rig {

namespace exporters {
std::vector<std::unique_ptr<Exporter>> all();
}

const std::vector<std::unique_ptr<Exporter>>& all_exporters() {
  static const std::vector<std::unique_ptr<Exporter>> all = exporters::all();
  return all;
}

namespace {

const Exporter& exporter_of(const std::string& format) {
  std::vector<std::string> names;
  std::string list;
  for (const auto& exporter : all_exporters()) {
    if (exporter->format() == format) return *exporter;
    names.push_back(exporter->format());
    list += (list.empty() ? "" : ", ") + names.back();
  }
  throw UsageError("there is no export format '" + format + "'" +
                   fit::ending_with_guess(fit::nearest_word(format, names)) + " There are: " + list);
}

/// A session may hold a correction that was made from another lidar's recordings; so may the rotation centre
/// be another's.
std::vector<std::string> check_lidar(const fit::Correction& correction, const SessionStore& session,
                                     bool any_lidar) {
  const LidarMatch match = match_lidar(correction.lidar_model, correction.lidar_serial, lidar_of(session));
  if (match.another && !any_lidar)
    throw UsageError(session.path() + ": " + match.says +
                     ". Calibrate that one, or give --any-lidar to use it all the same.");
  if (match.says.empty()) return {};
  return {session.path() + ": " + match.says + "."};
}

}  // namespace

std::vector<std::string> run_export(const std::string& format, const ExportSource& source,
                                    const OutputPlace& output) {
  const Exporter& exporter = exporter_of(format);
  if (!source.session && !exporter.accepts_files())
    throw UsageError(source.path + " is not a session file (*.rig), which the format '" + format + "' needs");
  std::vector<std::string> notes;
  if (source.centre && !exporter.takes_centre())
    throw UsageError("the format '" + format + "' has no place for a rotation centre: leave --centre out");
  if (exporter.of_correction() && (source.session || source.centre)) {
    const fit::Correction correction = correction_of(source);
    for (const SessionStore* session : {source.session, source.centre}) {
      if (!session) continue;
      for (std::string& note : check_lidar(correction, *session, source.any_lidar))
        notes.push_back(std::move(note));
    }
  }
  if (source.session && !source.session->latest_results().empty())
    for (const std::string& reason : standing_of(*source.session).reasons)
      notes.push_back(source.path + ": report, not a certificate: " + reason);
  write_beside(output.path(), [&](const std::string& part) { exporter.write(source, part); });
  return notes;
}

}  // namespace rig
