// SPDX-License-Identifier: MIT
#include "rig/archive/fleet.hpp"

#include <cstdio>
#include <filesystem>

#include "fit/numeric/number_format.hpp"
#include "rig/commands/archive_options.hpp"
#include "rig/commands/json_output.hpp"
#include "rig/json_fields.hpp"
#include "rig/report/pdf.hpp"

namespace rig::commands {
namespace {

using nlohmann::json;

class Fleet : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command =
        root.add_subcommand("fleet",
                            "All lidars of an archive: which error mechanisms they show, which drift, which "
                            "unknown shapes they share, which sessions belong to another lidar");
    archive_.declare(*command, true);
    command->add_option("-o,--output", output_, "Page to write: FILE.html or FILE.pdf");
    json_.declare(*command, "the fleet", "fleet");
    return command;
  }

  int run() override {
    check_outputs({{output_, "fleet.html", false, "fleet", true}, json_.output()});
    const std::vector<SessionRecord> sessions = archive_.sessions();
    const json fleet = fleet_of(sessions);
    if (!json_.wanted()) print(fleet);
    json_.write(fleet);
    if (output_.empty()) return 0;
    write_page(output_, fleet_html(fleet));
    std::fprintf(stderr, "page: %s\n", std::filesystem::absolute(output_).c_str());
    return 0;
  }

 private:
  static void print(const json& fleet) {
    std::fprintf(stderr, "%zu sessions\n", fleet.at("sessions").get<std::size_t>());
    for (const json& m : fleet.at("mechanisms"))
      std::fprintf(stderr, "  %-28s %zu sessions of %zu lidars\n", text_of(m, "mechanism").c_str(),
                   m.at("sessions").get<std::size_t>(), m.at("lidars").get<std::size_t>());
    for (const json& u : fleet.at("unknown"))
      std::fprintf(stderr, "  unknown: %s: %zu sessions of %zu lidars\n", text_of(u, "describes").c_str(),
                   u.at("sessions").size(), u.at("lidars").get<std::size_t>());
    for (const json& d : fleet.at("drifts"))
      std::fprintf(
          stderr, "  drift: %s, %s, %s\n", text_of(d, "serial").c_str(), text_of(d, "label").c_str(),
          fit::format_measurement(number_of(d, "per_year"), number_of(d, "U"), text_of(d, "unit") + " a year")
              .c_str());
    for (const json& c : fleet.at("common_drifts"))
      std::fprintf(stderr, "  all %s drift in %s by %s a year: check the bench\n",
                   text_of(c, "model").c_str(), text_of(c, "quantity").c_str(),
                   fit::format_measurement(number_of(c, "per_year"), number_of(c, "U"), "").c_str());
    for (const json& s : fleet.at("strange"))
      std::fprintf(stderr, "  suspicious: %s names %s, but its results match %s\n",
                   text_of(s, "session").c_str(), text_of(s, "serial").c_str(),
                   text_of(s, "looks_like").empty() ? "no known lidar" : text_of(s, "looks_like").c_str());
  }

  std::string output_;
  ArchiveOption archive_;
  JsonOutput json_;
};

}  // namespace

std::unique_ptr<Command> make_fleet() { return std::make_unique<Fleet>(); }

}  // namespace rig::commands
