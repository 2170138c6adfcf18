// SPDX-License-Identifier: MIT
#include "rig/archive/archive_folder.hpp"

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <thread>
#include <unordered_map>

#include "rig/errors.hpp"
#include "rig/session/session_file.hpp"
#include "rig/session/utc.hpp"

namespace rig {
namespace {

namespace fs = std::filesystem;
using What = ArchiveFinding::What;

constexpr std::size_t largest_explanation_bytes = 64'000'000;

/// A session that was read, or why it was not.
struct ReadSession {
  SessionRecord record;
  std::string problem;
  bool unfinished = false;
};

ReadSession read_one(const std::string& folder, const std::string& path) {
  ReadSession out;
  try {
    if (!is_clean(path)) throw UsageError("its name is not UTF-8, or too long: rename it");
    const std::string file = folder + "/" + path;
    const bool is_written = is_being_written(file);
    if (is_written || has_data(file + "-wal") || has_data(file + "-journal")) {
      out.unfinished = true;
      out.problem = is_written ? "it is being written" : "its run was killed: continue with rig resume";
      return out;
    }
    out.record = read_session_record(folder, path);
    if (out.record.captures == 0) {
      out.unfinished = true;
      out.problem = "it holds no captures";
    }
  } catch (const std::exception& error) {
    out.problem = error.what();
  }
  return out;
}

/// The files, read by a few threads, in their order.
template <class Result>
std::vector<Result> read_all(const std::vector<std::string>& paths, int threads,
                             const std::function<Result(const std::string&)>& read) {
  std::vector<Result> results(paths.size());
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i; (i = next++) < paths.size();) results[i] = read(paths[i]);
  };
  std::vector<std::jthread> others;
  for (int i = 1; i < std::min<int>(threads, static_cast<int>(paths.size())); ++i) others.emplace_back(work);
  work();
  others.clear();
  return results;
}

/// An explanation that lies beside a session counts if it is newer than the session's own.
void take_explanation_beside(const std::string& folder, SessionRecord& record) {
  const std::string path = explanation_beside(folder, record.content_sha256);
  std::error_code failed;
  const auto size = fs::file_size(path, failed);
  if (failed || size > largest_explanation_bytes) return;
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  const std::string made_utc =
      utc_text(static_cast<std::time_t>(file_stamp(path).modified_ns / 1'000'000'000));
  if (record.explanation && record.explanation->made_utc > made_utc) return;
  if (auto explanation = explanation_in(text.str(), made_utc)) record.explanation = std::move(explanation);
}

/// What a session is when its results beside it are counted: its stamp in the index changes with them.
std::int64_t stamp_with_results(const std::string& folder, const SessionRecord& record) {
  std::int64_t newest = record.modified_ns;
  const std::string beside = explanation_beside(folder, record.content_sha256);
  std::error_code failed;
  if (fs::exists(beside, failed)) newest = std::max(newest, file_stamp(beside).modified_ns);
  return newest;
}

}  // namespace

const char* name_of(What what) {
  switch (what) {
    case What::good:
      return "good";
    case What::added:
      return "added";
    case What::updated:
      return "updated";
    case What::moved:
      return "moved";
    case What::copied:
      return "copy";
    case What::unfinished:
      return "unfinished";
    case What::unindexed:
      return "not indexed";
    case What::changed:
      return "CHANGED";
    case What::damaged:
      return "DAMAGED";
    case What::missing:
      return "MISSING";
  }
  return "";
}

std::string explanation_beside(const std::string& folder, const std::string& content_sha256) {
  return folder + "/results/explain/" + content_sha256 + ".json";
}

std::vector<std::string> session_files(const std::string& folder) {
  std::error_code failed;
  if (!fs::is_directory(folder, failed))
    throw UsageError(folder + " is not a folder: give the one that holds the archive's sessions (*.rig)");
  std::vector<std::string> found;
  const auto skipping = fs::directory_options::skip_permission_denied;
  for (auto entry = fs::recursive_directory_iterator(folder, skipping, failed); entry != fs::end(entry);
       entry.increment(failed)) {
    const std::string name = entry->path().filename().string();
    if (entry->is_directory(failed)) {
      if (name.starts_with('.') || (name == "results" && entry.depth() == 0))
        entry.disable_recursion_pending();
    } else if (name.ends_with(".rig") && entry->is_regular_file(failed)) {
      found.push_back(entry->path().lexically_relative(folder).generic_string());
    }
  }
  std::ranges::sort(found);
  return found;
}

namespace {

/// What an index knows of a folder.
struct Known {
  std::map<std::string, SessionRecord> by_path;
  std::unordered_map<std::string, std::string> path_of_content;
};

Known known_to(ArchiveIndex& index) {
  Known out;
  for (SessionRecord& known : index.files()) {
    out.path_of_content[known.content_sha256] = known.path;
    out.by_path[known.path] = std::move(known);
  }
  return out;
}

/// Files that the index does not have, or whose size or date changed.
std::vector<std::string> files_to_read(const std::string& folder, const std::vector<std::string>& files,
                                       const Known& index) {
  std::vector<std::string> out;
  for (const std::string& path : files) {
    const auto known = index.by_path.find(path);
    if (known == index.by_path.end()) {
      out.push_back(path);
      continue;
    }
    SessionRecord now = known->second;
    const FileStamp stamp = file_stamp(folder + "/" + path);
    now.modified_ns = stamp.modified_ns;
    if (stamp.bytes != now.bytes || stamp_with_results(folder, now) != known->second.modified_ns)
      out.push_back(path);
  }
  return out;
}

/// Puts one session into the index, or says why not.
ArchiveFinding add_one(const std::string& folder, const std::string& path, ReadSession& read,
                       const std::vector<std::string>& files, const AddOptions& options, Known& indexed,
                       ArchiveIndex& index) {
  SessionRecord& record = read.record;
  const auto known = indexed.by_path.find(path);
  const bool is_known = known != indexed.by_path.end();
  if (!read.problem.empty())
    return {read.unfinished && !is_known ? What::unfinished : What::damaged, path, read.problem};
  const bool same_content = is_known && known->second.content_sha256 == record.content_sha256;
  if (is_known && !same_content && !options.accept_changes)
    return {What::changed, path,
            "the measured data are not those that were added (SHA-256 " +
                known->second.content_sha256.substr(0, 16) + ", now " + record.content_sha256.substr(0, 16) +
                "). Restore the file, or accept it as it is with --accept-changes."};
  What what = same_content ? What::updated : is_known ? What::changed : What::added;
  std::string says = what == What::changed ? "accepted as it is now, by --accept-changes" : "";
  const auto twin = indexed.path_of_content.find(record.content_sha256);
  if (twin != indexed.path_of_content.end() && !same_content) {
    if (std::ranges::binary_search(files, twin->second))
      return {What::copied, path, "the same measurement as " + twin->second + ", which counts"};
    what = What::moved;
    says = "it was " + twin->second;
    indexed.by_path.erase(twin->second);
  }
  take_explanation_beside(folder, record);
  record.modified_ns = stamp_with_results(folder, record);
  index.put(record);
  indexed.path_of_content[record.content_sha256] = path;
  return {what, path, says};
}

}  // namespace

std::vector<ArchiveFinding> add_to_archive(const std::string& folder, ArchiveIndex& index,
                                           const AddOptions& options) {
  const std::vector<std::string> files = session_files(folder);
  Known known = options.rebuild ? Known{} : known_to(index);
  const std::vector<std::string> to_read = files_to_read(folder, files, known);
  std::vector<ReadSession> read = read_all<ReadSession>(
      to_read, options.threads, [&](const std::string& path) { return read_one(folder, path); });

  std::vector<ArchiveFinding> findings;
  ArchiveTransaction transaction(index.database());
  if (options.rebuild) index.forget_all();
  for (std::size_t i = 0; i < read.size(); ++i)
    findings.push_back(add_one(folder, to_read[i], read[i], files, options, known, index));
  for (const auto& [path, record] : known.by_path) {
    if (std::ranges::binary_search(files, path)) continue;
    if (options.forget_missing) index.forget(record.content_sha256);
    findings.push_back({What::missing, path,
                        options.forget_missing ? "removed from the index"
                                               : "it is in the index but not in the folder. Restore it, or "
                                                 "remove it from the index with --forget-missing."});
  }
  transaction.commit();
  std::ranges::stable_sort(findings, {}, &ArchiveFinding::path);
  return findings;
}

std::vector<ArchiveFinding> verify_archive(const std::string& folder, ArchiveIndex& index, int threads) {
  const std::vector<std::string> files = session_files(folder);
  const Known indexed = known_to(index);
  const auto& by_path = indexed.by_path;
  const auto& path_of_content = indexed.path_of_content;
  std::vector<std::string> paths;
  for (const auto& [path, record] : by_path) paths.push_back(path);
  for (const std::string& path : files)
    if (!by_path.contains(path)) paths.push_back(path);
  std::ranges::sort(paths);
  return read_all<ArchiveFinding>(paths, threads, [&](const std::string& path) -> ArchiveFinding {
    const auto known = by_path.find(path);
    if (!std::ranges::binary_search(files, path))
      return {What::missing, path, "it is in the index but not in the folder"};
    try {
      if (known != by_path.end() && file_sha256(folder + "/" + path) == known->second.file_sha256)
        return {What::good, path, ""};
    } catch (const std::exception& error) {
      return {What::damaged, path, error.what()};
    }
    const ReadSession now = read_one(folder, path);
    if (known == by_path.end()) {
      if (!now.problem.empty()) return {now.unfinished ? What::unfinished : What::damaged, path, now.problem};
      const auto twin = path_of_content.find(now.record.content_sha256);
      if (twin == path_of_content.end()) return {What::unindexed, path, "rig archive add adds it"};
      return {What::copied, path, "the same measurement as " + twin->second};
    }
    if (!now.problem.empty()) return {What::damaged, path, now.problem};
    if (now.record.content_sha256 == known->second.content_sha256)
      return {What::updated, path,
              "the measured data are unchanged; results were added since (rig archive add)"};
    return {What::changed, path, "the measured data are not those that were added"};
  });
}

}  // namespace rig
