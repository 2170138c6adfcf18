// SPDX-License-Identifier: MIT
// A ROS 2 node that corrects the ranges of a lidar: /scan in, /scan_corrected out, the correction from the
// parameters that `rig export --format ros2-parameters` writes.
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <rclcpp/rclcpp.hpp>
#include <sensor_msgs/msg/laser_scan.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "range_correction_filter/range_correction.hpp"

namespace range_correction_filter {

class RangeCorrectionFilter : public rclcpp::Node {
 public:
  using LaserScan = sensor_msgs::msg::LaserScan;

  explicit RangeCorrectionFilter(const rclcpp::NodeOptions& options = rclcpp::NodeOptions())
      : Node("range_correction_filter",
             rclcpp::NodeOptions(options).automatically_declare_parameters_from_overrides(true)) {
    correction_.zero_mm = parameter<double>("zero_mm");
    correction_.use_intensity = parameter<bool>("use_intensity");
    correction_.use_distance = parameter<bool>("use_distance");
    if (correction_.use_intensity) correction_.intensity = term("intensity");
    if (correction_.use_distance) correction_.distance = term("distance");
    // What lies outside the calibrated region is corrected by the error at its border, or made NaN.
    drop_outside_ = get_parameter_or<bool>("drop_outside", false);
    publisher_ = create_publisher<LaserScan>("scan_corrected", rclcpp::SensorDataQoS());
    subscription_ = create_subscription<LaserScan>(
        "scan", rclcpp::SensorDataQoS(),
        [this](const LaserScan::ConstSharedPtr scan) { publisher_->publish(corrected(*scan)); });
  }

  LaserScan corrected(const LaserScan& scan) {
    LaserScan out = scan;
    if (correction_.use_intensity && scan.intensities.size() != scan.ranges.size()) {
      RCLCPP_WARN_ONCE(
          get_logger(),
          "The correction needs intensities and the scans carry none: they pass unchanged. Switch the "
          "driver's intensities on.");
      return out;
    }
    for (std::size_t i = 0; i < out.ranges.size(); ++i) {
      const float range_m = scan.ranges[i];
      if (!std::isfinite(range_m) || range_m <= 0) continue;  // no echo (REP 117)
      const double counts = correction_.use_intensity ? static_cast<double>(scan.intensities[i]) : 0.0;
      const auto result = correction_.apply(1000.0 * static_cast<double>(range_m), counts);
      out.ranges[i] = result.outside && drop_outside_ ? std::numeric_limits<float>::quiet_NaN()
                                                      : static_cast<float>(result.range_mm / 1000.0);
    }
    return out;
  }

 private:
  template <class T>
  T parameter(const std::string& name) {
    T value{};
    if (!get_parameter("range_correction." + name, value))
      throw std::runtime_error("parameter range_correction." + name +
                               " is missing: start the node with --params-file FILE, a file that rig export "
                               "--format ros2-parameters wrote");
    return value;
  }

  Term term(const std::string& name) {
    const Equation equation(parameter<std::string>(name + ".equation"),
                            parameter<std::vector<std::string>>(name + ".names"),
                            parameter<std::vector<double>>(name + ".coefficients"));
    Term out(equation, parameter<double>(name + ".from"), parameter<double>(name + ".to"),
             parameter<bool>(name + ".has_zero"), parameter<double>(name + ".zero_at"));
    out.sample_from = parameter<double>(name + ".sample_from");
    out.sample_to = parameter<double>(name + ".sample_to");
    return out;
  }

  RangeCorrection correction_;
  bool drop_outside_ = false;
  rclcpp::Publisher<LaserScan>::SharedPtr publisher_;
  rclcpp::Subscription<LaserScan>::SharedPtr subscription_;
};

}  // namespace range_correction_filter

#ifndef RANGE_CORRECTION_FILTER_WITHOUT_MAIN
int main(int argc, char** argv) {
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<range_correction_filter::RangeCorrectionFilter>());
  rclcpp::shutdown();
  return 0;
}
#endif
