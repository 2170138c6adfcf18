// SPDX-License-Identifier: MIT
#include "rig/live/benches_state.hpp"

#include <algorithm>
#include <vector>

#include "rig/errors.hpp"
#include "rig/json_fields.hpp"
#include "rig/session/lidar_identity.hpp"
#include "rig/session/session_file.hpp"
#include "rig/session/session_store.hpp"
#include "rig/session/standing.hpp"

namespace rig {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::size_t most_sessions = 400, most_ended = 20;

json parsed_object(const std::optional<std::string>& text) {
  json value = json::parse(text.value_or("{}"), nullptr, false, true);
  return value.is_object() ? value : json::object();
}

/// What every session says of itself.
json common_of(const SessionStore& session) {
  const LidarIdentity lidar = lidar_of(session);
  const json plan = json::parse(session.get("steps").value_or("[]"), nullptr, false);
  const auto progress = session.progress();
  const auto is_recorded = [&](const json& step) { return progress.contains(text_of(step, "key")); };
  json out = {
      {"procedure", session.get("procedure_name").value_or(session.get("kind").value_or("recording"))},
      {"bench", text_of(parsed_object(session.get("bench")), "name")},
      {"lidar", lidar.name() + (lidar.serial.empty() ? "" : " " + lidar.serial)},
      {"captures", session.count_captures()}};
  if (!plan.is_array() || plan.empty()) return out;
  const auto next = std::ranges::find_if_not(plan, is_recorded);
  out["step"] = {{"n", std::ranges::count_if(plan, is_recorded)},
                 {"of", plan.size()},
                 {"text", next == plan.end() ? "" : text_of(*next, "text")}};
  return out;
}

json running_session(const std::string& file, std::int64_t now_unix_s) {
  const SessionStore session(file, SessionStore::Mode::read);
  json out = common_of(session);
  out["phase"] = "running";
  const json waiting = parsed_object(session.get("waiting"));
  if (const std::string title = text_of(waiting, "title"); !title.empty()) {
    out["phase"] = "needs an operator";
    out["needs"] = {{"title", title}, {"text", text_of(waiting, "text")}};
    if (const double since = number_of(waiting, "since_unix_s"); since > 0)
      out["needs"]["waiting_s"] = std::max<std::int64_t>(0, now_unix_s - static_cast<std::int64_t>(since));
  }
  const json devices = parsed_object(session.get("devices"));
  out["devices"] = text_of(devices, "lidar") + ", " + text_of(devices, "stage");
  if (const std::string page = session.get("live_page").value_or(""); !page.empty()) out["live_page"] = page;
  for (const SessionStore::Event& event : session.events())
    if (event.level != "info") out["warning"] = event.text;
  return out;
}

std::string killed_words(const std::string& file) { return "its run was killed: rig resume " + file; }

/// Who is needed comes first, the longest first; then what stopped, what runs, what ended.
int rank_of(const json& bench) {
  const std::string phase = text_of(bench, "phase");
  return phase == "needs an operator" ? 0 : phase == "stopped" ? 1 : phase == "running" ? 2 : 3;
}

}  // namespace

json BenchesState::ended_session(const fs::path& file) {
  std::error_code ignored;
  const auto modified = fs::last_write_time(file, ignored);
  Ended& known = ended_[file.string()];
  if (!known.says.is_null() && known.modified == modified) return known.says;
  known.modified = modified;
  try {
    const SessionStore session(file.string(), SessionStore::Mode::peek);
    known.says = common_of(session);
    const std::string ended = session.get("ended").value_or("");
    const bool killed = ended.empty() ? !unfinished(session).empty() : ended == ended_but_for_reports;
    known.says["phase"] = killed ? "stopped" : unfinished(session).empty() ? "done" : "ended";
    known.says["says"] = killed ? killed_words(file.string()) : ended;
  } catch (const std::exception& error) {
    known.says = {{"phase", "ended"}, {"says", error.what()}};
  }
  return known.says;
}

json BenchesState::observe(std::int64_t now_unix_s) {
  std::error_code failed;
  if (!fs::is_directory(folder_, failed))
    throw UsageError(folder_ + " is not a folder: give the one into which the benches write");
  std::vector<std::pair<fs::file_time_type, fs::path>> files;
  for (auto entry =
           fs::recursive_directory_iterator(folder_, fs::directory_options::skip_permission_denied, failed);
       entry != fs::end(entry); entry.increment(failed))
    if (entry->path().extension() == ".rig" && entry->is_regular_file(failed))
      files.emplace_back(std::max(entry->last_write_time(failed),
                                  fs::exists(entry->path().string() + "-wal", failed)
                                      ? fs::last_write_time(entry->path().string() + "-wal", failed)
                                      : fs::file_time_type::min()),
                         entry->path());
  std::ranges::sort(files, std::greater{});
  json benches = json::array();
  std::size_t ended = 0;
  for (std::size_t i = 0; i < std::min(files.size(), most_sessions); ++i) {
    const std::string file = files[i].second.string();
    json bench;
    try {
      if (is_being_written(file)) {
        bench = running_session(file, now_unix_s);
      } else if (has_data(file + "-wal")) {
        bench = {{"phase", "stopped"}, {"says", killed_words(file)}};
      } else if (ended++ < most_ended) {
        bench = ended_session(files[i].second);
      } else {
        continue;
      }
    } catch (const std::exception& error) {  // It ended, or began, while it was looked at.
      bench = {{"phase", "running"}, {"says", error.what()}};
    }
    bench["session"] = files[i].second.lexically_relative(folder_).generic_string();
    benches.push_back(std::move(bench));
  }
  std::stable_sort(benches.begin(), benches.end(), [](const json& a, const json& b) {
    const auto waiting = [](const json& bench) {
      return bench.contains("needs") ? number_of(bench["needs"], "waiting_s", 0) : 0;
    };
    return rank_of(a) != rank_of(b) ? rank_of(a) < rank_of(b) : waiting(a) > waiting(b);
  });
  const auto count = [&](const char* phase) {
    return std::count_if(benches.begin(), benches.end(),
                         [&](const json& b) { return text_of(b, "phase") == phase; });
  };
  return {{"schema", "benches/1"},
          {"folder", fs::absolute(folder_).lexically_normal().string()},
          {"benches", benches},
          {"needed", count("needs an operator")},
          {"running", count("running") + count("needs an operator")}};
}

}  // namespace rig
