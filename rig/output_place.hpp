// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace rig {

/// The mark of session files among SQLite's databases: 'RIG1'.
inline constexpr std::uint32_t session_application_id = 0x52494731;

/// Whether a session file lies there, whatever it is called, or one of the files that SQLite keeps beside one
/// while it is written. Links are followed.
[[nodiscard]] bool is_recording(const std::string& path);

/// A device, a pipe, a folder: nothing that may be replaced by a file.
[[nodiscard]] bool is_no_plain_file(const std::string& path);

/// A file that a command is to write in the end; "" is none, "-" is standard output where it may be.
struct Output {
  std::string path;
  std::string example = "result";  ///< What such a file could be called, for those who name a folder.
  bool or_standard_output = false;
  /// What it will hold, as kind_of_file() has it: known before anything is computed. Empty: found at the end.
  std::string kind = {};
  bool is_page = false;  ///< FILE.html or FILE.pdf, as write_page() (report/pdf.hpp) makes it.
};

/// A place that check_outputs() found fit to be written, which is asked once: who takes one relies on that
/// and on the error of its own writing.
class OutputPlace {
 public:
  OutputPlace() = default;  ///< None.
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  explicit OutputPlace(std::string path) : path_(std::move(path)) {}
  friend std::vector<OutputPlace> check_outputs(const std::vector<Output>& outputs,
                                                const std::vector<std::string>& inputs);
  std::string path_;
};

/// The rules of every output, to be asked before anything is computed: it can be written where it is to go;
/// it replaces no recording, no other kind of file, and nothing of what the command reads, by whatever name
/// or link; no two outputs are one file. Nothing is left there. Returns the places in the outputs' order.
/// Throws UsageError, which says what is in the way and what to do.
std::vector<OutputPlace> check_outputs(const std::vector<Output>& outputs,
                                       const std::vector<std::string>& inputs = {});
/// The same for one.
[[nodiscard]] OutputPlace check_output(const Output& output, const std::vector<std::string>& inputs = {});

/// The last moment to refuse it. Throws UsageError.
void refuse_recording(const std::string& path);
/// Refuses a device, a pipe and a folder, which no file may replace. Throws UsageError.
void demand_plain_file(const std::string& path);

/// What a file holds: the schema of a document ("certificate"), what a page of rig's says of itself, else how
/// it begins. Empty if nothing is there that could be lost.
[[nodiscard]] std::string kind_of_file(const std::string& path);
/// An output takes the place of its like only: certificates, benches and procedures stay. Throws UsageError.
void refuse_other_kind(const std::string& path, const std::string& kind);

/// Where a file of that name really lies: the end of a link, so that a file takes the place of another and
/// never of a link to it.
[[nodiscard]] std::string end_of_link(const std::string& path);

/// A name beside `path`, for what is not whole yet.
[[nodiscard]] std::string part_of(const std::string& path);
/// The name that `part` was to get, if part_of() of any program made it; empty if it did not.
[[nodiscard]] std::string whole_of_part(const std::string& part);

/// Why `path` cannot be written, by the system's error number: a sentence and a remedy.
[[nodiscard]] std::string why_not_written(const std::string& path, int error);

}  // namespace rig
