// SPDX-License-Identifier: MIT
#pragma once

#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>

#include "rig/command.hpp"
#include "rig/errors.hpp"
#include "rig/output_place.hpp"
#include "rig/whole_file.hpp"

namespace rig::commands {

/// The option `--json FILE|-` of a command. With '-' the document goes to standard output, where nothing else
/// may go then: what is meant for people goes to standard error in every command.
class JsonOutput {
 public:
  /// `what` stands in the help: "Write WHAT to FILE, ..."; `kind`: its schema, without the version.
  void declare(CLI::App& command, const std::string& what, const std::string& kind) {
    kind_ = kind;
    command.add_option("--json", path_, "Write " + what + " as JSON to FILE, or '-' for standard output");
  }
  [[nodiscard]] bool wanted() const { return !path_.empty(); }
  [[nodiscard]] bool to_standard_output() const { return path_ == "-"; }
  /// For check_outputs(), before anything is computed.
  [[nodiscard]] Output output() const { return {path_, "result.json", true, kind_}; }

  /// Writes the document if it is wanted. Throws UsageError or MeasurementError.
  void write(const nlohmann::json& document) const {
    if (!wanted()) return;
    const std::string text = document.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
    if (path_ != "-") return write_file_atomically(path_, text);
    if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size() || std::fflush(stdout) != 0)
      throw MeasurementError("cannot write to standard output: is the disk full, or has its reader ended?");
  }

 private:
  std::string path_, kind_;
};

}  // namespace rig::commands
