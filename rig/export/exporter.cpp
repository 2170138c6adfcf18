// SPDX-License-Identifier: MIT
#include "rig/export/exporter.hpp"

#include "fit/json_position.hpp"
#include "rig/errors.hpp"
#include "rig/output_place.hpp"
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
  const std::string meant = fit::nearest_word(format, names);
  throw UsageError("there is no export format '" + format + "'" +
                   (meant.empty() ? "" : "; did you mean '" + meant + "'?") + " There are: " + list);
}

}  // namespace

void run_export(const std::string& format, const ExportSource& source, const std::string& output) {
  const Exporter& exporter = exporter_of(format);
  if (!source.session && !exporter.accepts_files())
    throw UsageError(source.path + " is not a session file (*.rig), which the format '" + format + "' needs");
  check_outputs({{output}}, {source.path});
  write_beside(output, [&](const std::string& part) { exporter.write(source, part); });
}

}  // namespace rig
