// SPDX-License-Identifier: MIT
#include <cstdio>
#include <filesystem>
#include <memory>

#include "rig/commands/json_output.hpp"
#include "rig/report/compare_report.hpp"
#include "rig/report/pdf.hpp"
#include "rig/runner/bench_file.hpp"
#include "rig/session/session_store.hpp"

namespace rig::commands {
namespace {

/// Sessions read as recordings, kept open as long as they are needed.
class Sessions {
 public:
  explicit Sessions(const std::vector<std::string>& paths) {
    for (const std::string& path : paths) {
      stores_.push_back(std::make_unique<SessionStore>(path, SessionStore::Mode::read));
      recordings_.push_back(stores_.back()->recording());
      list.push_back(recordings_.back().get());
    }
  }
  std::vector<const fit::Recording*> list;

 private:
  std::vector<std::unique_ptr<SessionStore>> stores_;
  std::vector<std::unique_ptr<fit::Recording>> recordings_;
};

class Compare : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command = root.add_subcommand(
        "compare", "Compares noise, intensity and edges of two devices: a recorded one and its twin");
    command->add_option("recorded", recorded_, "Session files (*.rig) of the first device")->required();
    command->add_option("--with", other_, "Session files of the second device")->required();
    command->add_option("-o,--output", output_, "Page to write: FILE.html or FILE.pdf");
    json_.declare(*command, "the distances", "comparison");
    command->add_option("--beams", beams_, "Beams that count for noise and intensity, degrees: FROM TO")
        ->expected(2);
    command->add_option("--names", names_, "Names of the two devices")->expected(2)->capture_default_str();
    return command;
  }

  int run() override {
    if (output_.empty() && !json_.wanted()) throw UsageError("name the output: -o PAGE.html, or --json FILE");
    std::vector<std::string> inputs = recorded_;
    inputs.insert(inputs.end(), other_.begin(), other_.end());
    check_outputs({{output_, "comparison.html", false, "comparison", true}, json_.output()}, inputs);
    const Comparison comparison{compared(names_[0], recorded_), compared(names_[1], other_)};
    if (comparison.recorded.all.scans == 0 || comparison.other.all.scans == 0)
      throw MeasurementError("there is nothing to compare: one side holds no scans");
    const nlohmann::json document = comparison_json(comparison);
    for (const auto& s : document.at("statistics"))
      std::fprintf(stderr, "%-28s %s\n", s.at("statistic").get<std::string>().c_str(),
                   s.at("verdict").get<std::string>().c_str());
    json_.write(document);
    if (!output_.empty()) {
      write_page(output_, comparison_html(comparison));
      std::fprintf(stderr, "page: %s\n", std::filesystem::absolute(output_).c_str());
    }
    return 0;
  }

 private:
  [[nodiscard]] ComparedDevice compared(const std::string& name,
                                        const std::vector<std::string>& files) const {
    const Sessions sessions(files);
    fit::StatisticsOptions options;
    if (beams_.size() == 2) {
      options.from_rad = beams_[0] * fit::rad_per_deg;
      options.to_rad = beams_[1] * fit::rad_per_deg;
    }
    const auto half = [&](int which) {
      options.half = which;
      return fit::recording_statistics(sessions.list, options);
    };
    return {name, files, half(0), half(1), half(2)};
  }

  std::vector<std::string> recorded_, other_, names_{"recorded", "simulated"};
  std::string output_;
  JsonOutput json_;
  std::vector<double> beams_;
};

}  // namespace

std::unique_ptr<Command> make_compare() { return std::make_unique<Compare>(); }

}  // namespace rig::commands
