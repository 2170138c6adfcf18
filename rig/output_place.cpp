// SPDX-License-Identifier: MIT
#include "rig/output_place.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"

namespace rig {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view sqlite_magic("SQLite format 3\0", 16);
constexpr std::size_t application_id_at = 68;  // https://www.sqlite.org/fileformat.html, 1.3

bool has_the_mark(const std::string& path) {
  std::error_code ignored;
  if (!fs::is_regular_file(path, ignored)) return false;  // Opening a pipe would wait for a writer.
  std::array<char, application_id_at + 4> head{};
  std::ifstream file(path, std::ios::binary);
  if (!file.read(head.data(), head.size())) return false;
  if (std::string_view(head.data(), sqlite_magic.size()) != sqlite_magic) return false;
  std::uint32_t id = 0;
  for (std::size_t i = 0; i < 4; ++i) id = id << 8 | static_cast<std::uint8_t>(head[application_id_at + i]);
  return id == session_application_id;
}

const std::string part_ending = ".part";

/// How pages begin that say what they are.
constexpr std::string_view page_mark = "<meta name=\"generator\" content=\"rig ";

/// The name in "NAME/1", a JSON document's own key `schema`; empty if it is none or has none. Nothing below
/// that is kept.
std::string schema_of(std::istream& file) {
  using nlohmann::json;
  using Event = json::parse_event_t;
  const auto outermost = [](int depth, Event event, json&) {
    return depth == 0 || (event != Event::object_start && event != Event::array_start);
  };
  const json document = json::parse(file, outermost, false, true);
  if (!document.is_object() || !document.contains("schema") || !document["schema"].is_string()) return "";
  const std::string schema = document["schema"];
  return schema.substr(0, schema.find('/'));
}

std::string folder_of(const std::string& path) {
  const fs::path parent = fs::path(path).parent_path();
  std::error_code ignored;
  return parent.empty() || parent == "." ? fs::current_path(ignored).string() : parent.string();
}

bool same_file(const std::string& a, const std::string& b) {
  std::error_code ignored;
  if (fs::equivalent(a, b, ignored)) return true;
  const fs::path one = fs::weakly_canonical(a, ignored), other = fs::weakly_canonical(b, ignored);
  return !one.empty() && one == other;
}

[[noreturn]] void refuse(const std::string& path, const std::string& why) {
  throw UsageError("cannot write " + path + ": " + why);
}

/// Whoever named a folder meant a file in it.
void refuse_folder(const Output& output) {
  std::error_code ignored;
  const bool named_like_one = output.path.ends_with('/');
  if (!named_like_one && !fs::is_directory(output.path, ignored)) return;
  refuse(output.path, "it is a folder. Give the name of a file, such as " +
                          (fs::path(output.path) / output.example).string() + ".");
}

/// By the rights that opening it would be judged by.
bool may_be_written(const std::string& path) {
  return ::faccessat(AT_FDCWD, path.c_str(), W_OK, AT_EACCESS) == 0;
}

/// Makes the part that will be written, and takes it away again: the disk itself is asked, not its
/// permissions.
void try_place(const std::string& path) {
  if (is_no_plain_file(path)) {
    if (!may_be_written(path)) refuse(path, why_not_written(path, errno));
    return;
  }
  std::error_code ignored;
  if (fs::exists(path, ignored) && !may_be_written(path) && errno == EACCES)
    refuse(path, "it exists already and is write-protected. Give the output another name.");
  const std::string part = part_of(end_of_link(path));
  const int fd = ::open(part.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0666);
  if (fd < 0) refuse(path, why_not_written(path, errno));
  ::close(fd);
  ::unlink(part.c_str());
}

}  // namespace

std::string kind_of_file(const std::string& path) {
  constexpr std::size_t head_bytes = 4096, enough = 24;
  std::error_code ignored;
  if (!fs::is_regular_file(path, ignored)) return "";
  std::ifstream file(path, std::ios::binary);
  std::string head(head_bytes, '\0');
  file.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(file.gcount()));
  if (head.starts_with("<?xml")) head.erase(0, std::min(head.size(), head.find("?>") + 2));
  head.erase(0, head.find_first_not_of(" \t\r\n"));
  if (head.starts_with('{') || head.starts_with('/')) {  // Bench files may begin with a comment.
    file.clear();
    file.seekg(0);
    if (const std::string schema = schema_of(file); !schema.empty()) return schema;
  }
  if (const auto at = head.find(page_mark); at != std::string::npos) {
    const auto from = at + page_mark.size();
    return head.substr(from, head.find('"', from) - from);
  }
  return head.substr(0, std::min(enough, head.find_first_of("\r\n")));
}

void refuse_other_kind(const std::string& path, const std::string& kind) {
  const std::string there = kind_of_file(path);
  if (there.empty() || there == kind) return;
  const bool is_word = std::ranges::all_of(there, [](char c) { return (c >= 'a' && c <= 'z') || c == '-'; });
  refuse(path, "what is there" + (is_word ? " (" + there + ")" : "") +
                   " is of another kind than this output, and only its like is replaced. Give the output "
                   "another name, or remove that file first.");
}

bool is_recording(const std::string& path) {
  if (has_the_mark(path)) return true;
  for (const std::string_view beside : {"-wal", "-shm", "-journal"})
    if (path.ends_with(beside) && has_the_mark(path.substr(0, path.size() - beside.size()))) return true;
  return false;
}

bool is_no_plain_file(const std::string& path) {
  std::error_code ignored;
  const fs::file_status status = fs::status(path, ignored);
  return fs::exists(status) && !fs::is_regular_file(status);
}

std::string end_of_link(const std::string& path) {
  std::error_code ignored;
  const fs::path real = fs::is_symlink(path, ignored) ? fs::weakly_canonical(path, ignored) : fs::path(path);
  return real.empty() ? path : real.string();
}

std::string part_of(const std::string& path) { return path + part_ending + std::to_string(::getpid()); }

std::string whole_of_part(const std::string& part) {
  const auto at = part.rfind(part_ending);
  if (at == std::string::npos) return "";
  const std::string number = part.substr(at + part_ending.size());
  const bool made_here = !number.empty() && number.find_first_not_of("0123456789") == std::string::npos;
  return made_here ? part.substr(0, at) : "";
}

std::string why_not_written(const std::string& path, int error) {
  const std::string folder = folder_of(path);
  std::error_code ignored;
  switch (error) {
    case ENOENT:
      if (fs::exists(folder, ignored)) return "cannot make a file in " + folder + ". Choose another folder.";
      return "there is no folder " + folder + ". Make it first, or choose another.";
    case ENOTDIR:
      return folder + " is not a folder. Choose another place.";
    case EACCES:
    case EPERM:
      return "writing there is not permitted. Choose another folder, or correct the permissions of " +
             folder + ".";
    case EROFS:
      return "the disk is read-only. Choose a folder on another one.";
    case ENOSPC:
    case EDQUOT:
      return "the disk is full. Free some space, or choose a folder on another one.";
    case ENAMETOOLONG:
      return "the name is too long. Choose a shorter one.";
    case ELOOP:
      return "its links form a loop. Choose another name.";
    default:
      return std::string(std::strerror(error)) + ". Choose another folder.";
  }
}

void refuse_recording(const std::string& path) {
  if (!is_recording(path)) return;
  const std::string real = end_of_link(path);
  refuse(path, (real == path ? "it is" : "it leads to " + real + ",") +
                   std::string(" a recording (a session file), and no output replaces one. Give the output "
                               "another name."));
}

void demand_plain_file(const std::string& path) {
  if (is_no_plain_file(path)) refuse(path, "it is not a regular file. Give the name of a file.");
}

OutputPlace check_output(const Output& output, const std::vector<std::string>& inputs) {
  return check_outputs({output}, inputs).front();
}

std::vector<OutputPlace> check_outputs(const std::vector<Output>& outputs,
                                       const std::vector<std::string>& inputs) {
  std::vector<OutputPlace> places;
  std::vector<std::string> others;
  for (const Output& output : outputs) {
    const std::string& path = output.path;
    places.push_back(OutputPlace(path));
    if (path == "-" && !output.or_standard_output)
      throw UsageError("'-' is standard output, which cannot take this. Give the name of a file, such as " +
                       output.example + ".");
    if (path.empty() || path == "-") continue;
    refuse_folder(output);
    for (const std::string& input : inputs)
      if (same_file(path, input))
        refuse(path, (path == input ? "it is" : "it is the same file as " + input + ",") +
                         std::string(" what this command reads. Give the output another name."));
    refuse_recording(path);
    const bool is_pdf = output.is_page && path.ends_with(".pdf");
    if (output.is_page && !is_pdf && !path.ends_with(".html") && !is_no_plain_file(path))
      refuse(path, "this is written as .html or .pdf. Give a name with one of these endings, such as " +
                       output.example + ".");
    if (!output.kind.empty() && !is_pdf) refuse_other_kind(path, output.kind);
    for (const std::string& other : others)
      if (!is_no_plain_file(path) && same_file(path, other))
        refuse(path, "it is to receive " +
                         (path == other ? "two outputs" : "what goes to " + other + " too") +
                         ". Give each its own name.");
    try_place(path);
    others.push_back(path);
  }
  return places;
}

}  // namespace rig
