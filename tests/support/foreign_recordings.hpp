// SPDX-License-Identifier: MIT
#pragma once

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "tests/support/test_folder.hpp"

/// A made-up drive in other tools' formats, written by tests/support/foreign_recordings.py, which shares no
/// code with the importers; `expected` is what the files say.
class ForeignRecordings {
 public:
  ForeignRecordings() {
    const std::string command =
        "python3 " RIG_SOURCE_DIR "/tests/support/foreign_recordings.py '" + folder_.path() + "'";
    if (std::system(command.c_str()) != 0) throw std::runtime_error("failed: " + command);
    expected = nlohmann::json::parse(std::ifstream(folder_ / "expected.json"));
  }
  [[nodiscard]] std::string file(const std::string& name) const { return folder_ / name; }
  /// The same bytes under another name, cut to `bytes` and with one bit of byte `damaged` changed.
  [[nodiscard]] std::string cut(const std::string& name, std::size_t bytes,
                                std::size_t damaged = std::string::npos) const {
    std::string text = file_text(folder_ / name).substr(0, bytes);
    if (damaged < text.size()) text[damaged] = static_cast<char>(text[damaged] ^ 0x10);
    const std::string path = folder_ / ("cut-" + name);
    std::ofstream(path, std::ios::binary) << text;
    return path;
  }
  [[nodiscard]] const TestFolder& folder() const { return folder_; }

  nlohmann::json expected;

 private:
  TestFolder folder_;
};
