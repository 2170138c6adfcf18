// SPDX-License-Identifier: MIT
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <map>
#include <thread>

#include "rig/archive/archive_folder.hpp"
#include "rig/commands/archive_options.hpp"
#include "rig/commands/json_output.hpp"

namespace rig::commands {
namespace {

using nlohmann::json;
using What = ArchiveFinding::What;

json json_of(const SessionRecord& r) {
  json out = {{"path", r.path},
              {"content_sha256", r.content_sha256},
              {"file_sha256", r.file_sha256},
              {"bytes", r.bytes},
              {"measured_utc", r.measured_utc},
              {"software", r.software},
              {"kind", r.kind},
              {"procedure", r.procedure},
              {"procedure_sha256", r.procedure_sha256},
              {"bench", r.bench},
              {"bench_sha256", r.bench_sha256},
              {"lidar", {{"model", r.model}, {"serial", r.serial}, {"firmware", r.firmware}}},
              {"stage", r.stage},
              {"ended", r.ended},
              {"item_state", r.item_state},
              {"simulated", r.simulated},
              {"captures", r.captures},
              {"scans", r.scans},
              {"values", json::array()},
              {"explanation", nullptr}};
  for (const ArchivedValue& v : r.values)
    out["values"].push_back({{"kind", v.kind},
                             {"name", v.name},
                             {"label", v.label},
                             {"unit", v.unit},
                             {"value", v.value},
                             {"u", v.u},
                             {"U", v.expanded}});
  if (!r.explanation) return out;
  json mechanisms = json::array();
  for (const ArchivedMechanism& m : r.explanation->mechanisms)
    mechanisms.push_back({{"mechanism", m.mechanism}, {"probability", m.probability}});
  out["explanation"] = {{"verdict", r.explanation->verdict},
                        {"made_utc", r.explanation->made_utc},
                        {"mechanisms", mechanisms},
                        {"undecided", r.explanation->undecided},
                        {"unknown", r.explanation->unknown_describes}};
  return out;
}

std::string explained_in_words(const SessionRecord& r) {
  if (!r.explanation) return "-";
  std::string words = r.explanation->verdict;
  for (const ArchivedMechanism& m : r.explanation->mechanisms) words += " " + m.mechanism;
  return words;
}

class Archive : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command = root.add_subcommand("archive",
                                        "An index of many sessions: add indexes them, list shows them, "
                                        "verify finds damaged, changed and missing ones");
    command->add_option("action", action_, "add, list or verify")
        ->required()
        ->check(CLI::IsMember({"add", "list", "verify"}));
    command->add_option("folder", folder_, "Folder with the sessions (*.rig), in subfolders if you like")
        ->required();
    option_.declare_index(*command);
    command->add_flag("--rebuild", adding_.rebuild, "add: rebuild the index from every session");
    command->add_flag("--accept-changes", adding_.accept_changes,
                      "add: accept changed sessions as they are now");
    command->add_flag("--forget-missing", adding_.forget_missing,
                      "add: remove missing sessions from the index");
    command->add_option("--serial", serial_, "list: of this lidar only");
    json_.declare(*command, "what was found", "");
    return command;
  }

  int run() override {
    check_outputs({json_.output()});
    while (folder_.size() > 1 && folder_.ends_with('/')) folder_.pop_back();
    if (action_ == "list") return list();
    const bool adds = action_ == "add";
    (void)session_files(folder_);  // A folder that is not there has no index to be made.
    const auto begun = std::chrono::steady_clock::now();
    const int threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
    ArchiveIndex index(option_.location(folder_), adds);
    adding_.threads = threads;
    const auto findings =
        adds ? add_to_archive(folder_, index, adding_) : verify_archive(folder_, index, threads);
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
    return print(findings, adds ? index.files().size() : findings.size(), seconds);
  }

 private:
  int print(const std::vector<ArchiveFinding>& findings, std::size_t sessions, double seconds) const {
    std::map<What, int> count;
    json list = json::array();
    bool is_bad = false;
    for (const ArchiveFinding& f : findings) {
      ++count[f.what];
      list.push_back({{"path", f.path}, {"what", name_of(f.what)}, {"says", f.says}});
      // What --accept-changes and --forget-missing accepted is no fault any more.
      const bool accepted = (f.what == What::changed && adding_.accept_changes) ||
                            (f.what == What::missing && adding_.forget_missing);
      is_bad |= f.is_fault() && !accepted;
      if (f.what > What::updated)
        std::fprintf(stderr, "%-12s %s%s%s\n", name_of(f.what), clean_text(f.path).c_str(),
                     f.says.empty() ? "" : ": ", f.says.c_str());
    }
    std::string counts;
    for (const auto& [what, n] : count)
      counts += (counts.empty() ? "" : ", ") + std::to_string(n) + " " + name_of(what);
    std::fprintf(stderr, "%zu sessions%s%s (%.1f s)\n", sessions, counts.empty() ? "" : ": ", counts.c_str(),
                 seconds);
    json_.write(
        {{"schema", "archive-findings/1"}, {"sessions", sessions}, {"seconds", seconds}, {"findings", list}});
    if (!is_bad) return 0;
    throw MeasurementError(
        "not every session of the archive is as it was added; the list above says which, and what to do.");
  }

  int list() const {
    json sessions = json::array();
    for (const SessionRecord& r : ArchiveIndex(option_.location(folder_), false).sessions()) {
      if (!serial_.empty() && r.serial != serial_) continue;
      sessions.push_back(json_of(r));
      if (json_.wanted()) continue;
      std::fprintf(stderr, "%-20s %-12s %-12s %-24.24s %-28.28s %s\n",
                   r.measured_utc.empty() ? "unknown date" : r.measured_utc.c_str(),
                   r.serial.empty() ? "no serial" : r.serial.c_str(), r.model.c_str(), r.procedure.c_str(),
                   explained_in_words(r).c_str(), r.path.c_str());
    }
    if (sessions.empty())
      std::fprintf(stderr, "no session%s\n",
                   serial_.empty() ? " in this archive" : (" of the lidar " + serial_).c_str());
    json_.write({{"schema", "archive-list/1"}, {"sessions", sessions}});
    return 0;
  }

  std::string action_, folder_, serial_;
  AddOptions adding_;
  ArchiveOption option_;
  JsonOutput json_;
};

}  // namespace

std::unique_ptr<Command> make_archive() { return std::make_unique<Archive>(); }

}  // namespace rig::commands
