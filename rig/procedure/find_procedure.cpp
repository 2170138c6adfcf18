// SPDX-License-Identifier: MIT
#include <algorithm>
#include <filesystem>

#include "fit/bench/json_position.hpp"
#include "rig/procedure/option_check.hpp"

namespace rig {

std::string find_procedure(const std::string& path_or_name) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  if (fs::is_regular_file(path_or_name, ignored)) return path_or_name;
  std::vector<fs::path> folders = {"procedures"};
  const fs::path program = fs::read_symlink("/proc/self/exe", ignored);
  if (!ignored)  // build/bin/rig in a source tree, or PREFIX/bin/rig
    for (const char* folder : {"procedures", "../procedures", "../../procedures", "../share/rig/procedures"})
      folders.push_back(program.parent_path() / folder);
  std::vector<std::string> names;
  for (const auto& folder : folders) {
    const fs::path candidate = folder / (path_or_name + ".yaml");
    if (path_or_name.find('/') == std::string::npos && fs::is_regular_file(candidate, ignored))
      return candidate.lexically_normal().string();
    for (fs::directory_iterator entry(folder, ignored), end; !ignored && entry != end;
         entry.increment(ignored))
      if (entry->path().extension() == ".yaml") names.push_back(entry->path().stem().string());
  }
  std::ranges::sort(names);
  names.erase(std::unique(names.begin(), names.end()), names.end());
  throw UsageError("there is no procedure '" + path_or_name + "'" +
                   fit::ending_with_guess(did_you_mean(path_or_name, names)) +
                   (names.empty() ? " Ready ones are looked for in ./procedures and beside the program (" +
                                        program.parent_path().string() +
                                        "), and none is there. Give the path of a procedure file."
                                  : " Ready ones: " + listed(names) + "."));
}

}  // namespace rig
