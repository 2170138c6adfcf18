// SPDX-License-Identifier: MIT
#include <cstdio>
#include <filesystem>

#include "rig/command.hpp"
#include "rig/errors.hpp"
#include "rig/output_place.hpp"
#include "rig/whole_file.hpp"

namespace rig {
extern const char* const starter_bench;
extern const char* const starter_procedure;
}  // namespace rig

namespace rig::commands {
namespace {

class New : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* make = root.add_subcommand("new", "Writes a commented file to start from: a procedure or a bench");
    make->add_option("what", what_, "procedure or bench")
        ->required()
        ->check(CLI::IsMember({"procedure", "bench"}));
    make->add_option("file", file_,
                     "File to write; default: new.yaml or new.bench.json; '-': standard output");
    return make;
  }

  int run() override {
    const bool bench = what_ == "bench";
    const char* text = bench ? starter_bench : starter_procedure;
    if (file_.empty()) file_ = bench ? "new.bench.json" : "new.yaml";
    if (file_ == "-") {
      std::fputs(text, stdout);
      return 0;
    }
    check_outputs({{file_, bench ? "new.bench.json" : "new.yaml"}});
    std::error_code ignored;
    if (std::filesystem::exists(file_, ignored))
      throw UsageError(file_ + " exists already and is not overwritten. Choose another name.");
    write_file_atomically(file_, text);
    std::fprintf(stderr, "%s is written. Next: edit it, then\n  rig run %s --dry-run\n", file_.c_str(),
                 bench ? ("PROCEDURE --bench " + file_).c_str() : (file_ + " --bench BENCH").c_str());
    return 0;
  }

 private:
  std::string what_, file_;
};

}  // namespace

std::unique_ptr<Command> make_new() { return std::make_unique<New>(); }

}  // namespace rig::commands
