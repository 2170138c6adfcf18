// SPDX-License-Identifier: MIT
#include "rig/export/correction_export.hpp"

namespace rig::exporters {
namespace {

class Ros2Parameters : public Exporter {
 public:
  std::string format() const override { return "ros2-parameters"; }
  std::string describes() const override { return "a range correction as a ROS 2 parameter file"; }
  bool accepts_files() const override { return true; }
  void write(const ExportSource& source, const std::string& output) const override {
    write_text(output, ros2_parameters(read_for_export(source)));
  }
};

}  // namespace

std::unique_ptr<Exporter> make_ros2_parameters() { return std::make_unique<Ros2Parameters>(); }

}  // namespace rig::exporters
