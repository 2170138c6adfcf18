// SPDX-License-Identifier: MIT
#include "rig/archive/history.hpp"

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

class History : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command =
        root.add_subcommand("history",
                            "One lidar over time: its results, control charts, drift, and when to "
                            "calibrate it again");
    command->add_option("serial", serial_, "Serial number of the lidar")->required();
    archive_.declare(*command, true);
    command->add_option("-o,--output", output_, "Page to write: FILE.html or FILE.pdf");
    json_.declare(*command, "the history", "history");
    return command;
  }

  int run() override {
    check_outputs({{output_, serial_ + ".html", false, "history", true}, json_.output()});
    const std::vector<SessionRecord> sessions = archive_.sessions();
    const json history = history_of(sessions, serial_);
    if (!json_.wanted()) print(history);
    json_.write(history);
    if (output_.empty()) return 0;
    write_page(output_, history_html(history));
    std::fprintf(stderr, "page: %s\n", std::filesystem::absolute(output_).c_str());
    return 0;
  }

 private:
  static void print(const json& history) {
    std::fprintf(stderr, "%s %s, %zu sessions (± is the expanded uncertainty, k = 2):\n",
                 text_of(history, "model").c_str(), text_of(history, "serial").c_str(),
                 history.at("sessions").size());
    for (const json& q : history.at("quantities")) {
      const json& newest = q.at("points").back();
      const std::string unit = text_of(q, "unit");
      std::string line = fit::format_measurement(number_of(newest, "value"), number_of(newest, "U"), unit);
      if (newest.contains("e_n") && newest.at("e_n").is_number())
        line += "; E_n " + fit::format_fixed(number_of(newest, "e_n"), 2);
      if (q.at("drift").is_object())
        line += "; " +
                fit::format_measurement(number_of(q.at("drift"), "per_year"), number_of(q.at("drift"), "U"),
                                        unit.empty() ? "a year" : unit + " a year") +
                (q.at("drift").value("significant", false) ? ", a DRIFT" : "");
      if (q.at("chart").is_object())
        for (const json& signal : q.at("chart").at("signals"))
          line += "; " + text_of(signal, "rule").substr(0, text_of(signal, "rule").find(':'));
      std::fprintf(stderr, "  %-44s %s\n", text_of(q, "label").c_str(), line.c_str());
    }
    for (const json& note : history.at("notes"))
      std::fprintf(stderr, "note: %s\n", note.get<std::string>().c_str());
    const json& recommended = history.at("recommended");
    if (recommended.at("months").is_number())
      std::fprintf(stderr, "Calibrate again after %g months, as %s requires.\n",
                   number_of(recommended, "months"), text_of(recommended, "by").c_str());
  }

  std::string serial_, output_;
  ArchiveOption archive_;
  JsonOutput json_;
};

}  // namespace

std::unique_ptr<Command> make_history() { return std::make_unique<History>(); }

}  // namespace rig::commands
