// SPDX-License-Identifier: MIT
#include <stdlib.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>

#include "rig/command.hpp"
#include "rig/errors.hpp"
#include "rig/export/exporter.hpp"

namespace rig::commands {
namespace {

class TemporaryFolder {
 public:
  TemporaryFolder() {
    path_ = (std::filesystem::temp_directory_path() / "rig-export-XXXXXX").string();
    if (!::mkdtemp(path_.data()))
      throw MeasurementError("cannot make a temporary folder in " +
                             std::filesystem::temp_directory_path().string() +
                             ": is its disk full? The variable TMPDIR can name another folder.");
  }
  ~TemporaryFolder() { empty(); }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  [[nodiscard]] const std::string& path() const { return path_; }
  /// What is open stays readable.
  void empty() const {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }

 private:
  std::string path_;
};

class Export : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command = root.add_subcommand("export", "Writes a session or a result in another tool's format");
    std::string formats;
    for (const auto& exporter : all_exporters())
      formats += "\n  " + exporter->format() + ": " + exporter->describes();
    command->add_option("session", source_, "Session file (*.rig), or a correction (*.json)")->required();
    command->add_option("--format", format_, "See below")->required();
    command->add_option("-o,--output", output_, "File to write, or '-' for standard output")->required();
    command->add_flag("--any-lidar", any_lidar_, "Also a correction for a lidar other than the session's");
    command->add_option("--centre", centre_,
                        "Session whose rotation centre is included in c-header, cpp-header and "
                        "ros2-parameters; default: the session's own");
    command->footer("Formats:" + formats);
    return command;
  }

  int run() override {
    if (output_ == "-") return print();
    write(check_output({output_}, inputs()));
    std::fprintf(stderr, "exported: %s\n", std::filesystem::absolute(output_).c_str());
    return 0;
  }

 private:
  [[nodiscard]] std::vector<std::string> inputs() const {
    std::vector<std::string> files = {source_};
    if (!centre_.empty()) files.push_back(centre_);
    return files;
  }

  void write(const OutputPlace& output) const {
    std::unique_ptr<SessionStore> session, centre;
    if (is_session_file(source_)) session = std::make_unique<SessionStore>(source_, SessionStore::Mode::read);
    if (!centre_.empty()) centre = std::make_unique<SessionStore>(centre_, SessionStore::Mode::read);
    for (const std::string& note :
         run_export(format_, {source_, session.get(), any_lidar_, centre.get()}, output))
      std::fprintf(stderr, "rig: %s\n", note.c_str());
  }

  /// Some formats go back in their file while they write it: it is made first, without a name that could stay
  /// behind, and then copied.
  int print() const {
    const TemporaryFolder folder;
    const std::string path = folder.path() + "/export";
    write(check_output({path}, inputs()));
    std::ifstream made(path, std::ios::binary);
    folder.empty();
    std::array<char, 1 << 16> piece{};
    while (made.read(piece.data(), piece.size()), made.gcount() > 0) {
      const auto size = static_cast<std::size_t>(made.gcount());
      if (std::fwrite(piece.data(), 1, size, stdout) != size) break;
    }
    if (std::fflush(stdout) != 0 || std::ferror(stdout))
      throw MeasurementError("cannot write to standard output: is the disk full, or has its reader ended?");
    return 0;
  }

  std::string source_, format_, output_, centre_;
  bool any_lidar_ = false;
};

}  // namespace

std::unique_ptr<Command> make_export() { return std::make_unique<Export>(); }

}  // namespace rig::commands
