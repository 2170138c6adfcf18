// SPDX-License-Identifier: MIT
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "rig/command.hpp"
#include "rig/errors.hpp"

namespace rig::commands {
std::vector<std::unique_ptr<Command>> all();
}

namespace {

/// Words of files and devices stand in messages: control characters in them must not reach the terminal.
void tell(const std::exception& error) {
  std::string words = error.what();
  for (char& c : words)
    if ((static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\t') || c == 0x7F) c = '?';
  std::fprintf(stderr, "rig: %s\n", words.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Calibration rig controller: runs procedures on a lidar and a rotary stage, fits, explains, reports."};
  app.set_version_flag("--version", "rig " RIG_VERSION);
  app.require_subcommand(1);
  app.footer("Exit status: 0 done; 1 the measurement or fit failed; 2 wrong usage or an unreadable file; "
             "3 a device failed or was lost.");
  auto commands = rig::commands::all();
  std::vector<CLI::App*> declared;
  for (const auto& command : commands) declared.push_back(command->declare(app));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    for (std::size_t i = 0; i < commands.size(); ++i)
      if (declared[i]->parsed()) return commands[i]->run();
  } catch (const rig::UsageError& error) {
    tell(error);
    return 2;
  } catch (const rig::DeviceError& error) {
    tell(error);
    return 3;
  } catch (const std::exception& error) {
    tell(error);
    return 1;
  }
  return 0;
}
