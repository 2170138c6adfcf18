// SPDX-License-Identifier: MIT
#include <cstdio>
#include <fstream>
#include <sstream>

#include "rig/command.hpp"
#include "rig/errors.hpp"
#include "rig/import/import_session.hpp"

namespace rig::commands {
namespace {

class Import : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command =
        root.add_subcommand("import", "Reads other tools' recordings into a session, one capture a file");
    command->add_option("files", request_.files, "Recordings: " + formats())->required();
    command->add_option("-o,--output", output_, "Session file to write (*.rig)")->required();
    command->add_option("--bench", bench_, "Bench file; without it one is made from the recording");
    command->add_option("--target", request_.target, "Name of the target the captures are about")
        ->capture_default_str();
    command
        ->add_option(
            "--true-mm", request_.true_mm,
            "True distance of the target in each file, in mm: 500,1000,...; default: from the file names")
        ->delimiter(',');
    command->add_option("--true-u-mm", request_.true_u_mm, "Standard uncertainty of these distances")
        ->capture_default_str()
        ->check(CLI::PositiveNumber);
    command->add_option("--target-width-mm", request_.target_width_mm, "Width of the target")
        ->capture_default_str()
        ->check(CLI::PositiveNumber);
    auto& options = request_.options;
    command->add_option("--topic", options.scan_topic,
                        "Topic of the scans; default: the first with LaserScan");
    command->add_option("--odometry-topic", options.odometry_topic,
                        "Topic of the odometry; default: the first");
    command->add_option("--wheel-left", options.left_wheel, "Joint of the left wheel; default: named 'left'");
    command->add_option("--wheel-right", options.right_wheel,
                        "Joint of the right wheel; default: named 'right'");
    command->add_option("--first-deg", options.first_deg,
                        "Direction of the first beam, for CSV tables that do not say it (UST-10LX: -135)");
    command->add_option("--step-deg", options.step_deg, "Angle from beam to beam, likewise (UST-10LX: 0.25)");
    command
        ->add_option("--scan-hz", options.scan_hz,
                     "Rotation rate of the lidar (turns per second), where the recording does not state it "
                     "or states it wrongly")
        ->check(CLI::PositiveNumber);
    command
        ->add_option("--columns", options.columns,
                     "What a table's columns hold, in place of its header: time_s,range_m*360 or "
                     "scan,angle_deg,range_mm or scan,x_m,y_m or time_s,left_ticks,right_ticks; '-' skips "
                     "one, NAME*3 means three, NAME* for the rest (docs/operate/import.md)")
        ->delimiter(',');
    command
        ->add_option("--ticks-a-turn", options.ticks_a_turn,
                     "Counts of a wheel's encoder in one turn of the wheel, gear included")
        ->check(CLI::PositiveNumber);
    command->add_flag("--accept-doubts", request_.accept_doubts,
                      "Import also what is not plausible (units, rate, distance), and note it");
    return command;
  }

  int run() override {
    std::vector<std::string> inputs = request_.files;
    inputs.push_back(bench_);
    request_.output = check_output({output_, "recording.rig"}, inputs);
    if (!bench_.empty()) request_.bench = contents(bench_);
    ImportReport report;
    try {
      report = import_session(request_);
    } catch (const std::invalid_argument& error) {
      throw UsageError(error.what());
    }
    for (const auto& note : report.notes) std::fprintf(stderr, "rig: %s\n", note.c_str());
    std::fprintf(stderr, "import: %llu scans in %llu captures and %llu poses -> %s\n",
                 static_cast<unsigned long long>(report.scans),
                 static_cast<unsigned long long>(report.captures),
                 static_cast<unsigned long long>(report.poses), output_.c_str());
    return 0;
  }

 private:
  static std::string formats() {
    std::string list;
    for (const auto& importer : importers::all()) list += (list.empty() ? "" : "; ") + importer->name();
    return list;
  }
  static std::string contents(const std::string& path) {
    std::ifstream in(path);
    if (!in) throw UsageError(path + " cannot be opened. Check the name and the permissions.");
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
  }

  ImportRequest request_;
  std::string output_, bench_;
};

}  // namespace

std::unique_ptr<Command> make_import() { return std::make_unique<Import>(); }

}  // namespace rig::commands
