// SPDX-License-Identifier: MIT
// As much of ROS 2's rclcpp as docs/examples/range_correction_filter uses, so that its source is compiled and
// run where there is no ROS: parameters are given, and what is published is kept.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#define RCLCPP_WARN_ONCE(logger, ...) (logger).warn(__VA_ARGS__)

namespace rclcpp {

using Value = std::variant<bool, double, std::string, std::vector<std::string>, std::vector<double>>;

struct NodeOptions {
  NodeOptions& automatically_declare_parameters_from_overrides(bool yes) {
    declared = yes;
    return *this;
  }
  bool declared = false;
  std::map<std::string, Value> overrides;
};

struct SensorDataQoS {};

struct Logger {
  int* warnings;
  template <class... Words>
  void warn(const Words&...) const {
    ++*warnings;
  }
};

template <class Message>
struct Publisher {
  using SharedPtr = std::shared_ptr<Publisher>;
  void publish(const Message& message) { published.push_back(message); }
  std::vector<Message> published;
};

template <class Message>
struct Subscription {
  using SharedPtr = std::shared_ptr<Subscription>;
  std::function<void(std::shared_ptr<const Message>)> call;
};

class Node {
 public:
  Node(const std::string&, const NodeOptions& options) : options_(options) {}
  template <class T>
  bool get_parameter(const std::string& name, T& value) const {
    const auto found = options_.overrides.find(name);
    if (!options_.declared || found == options_.overrides.end()) return false;
    value = std::get<T>(found->second);
    return true;
  }
  template <class T>
  T get_parameter_or(const std::string& name, const T& otherwise) const {
    T value = otherwise;
    get_parameter(name, value);
    return value;
  }
  template <class Message>
  std::shared_ptr<Publisher<Message>> create_publisher(const std::string& topic, SensorDataQoS) {
    auto made = std::make_shared<Publisher<Message>>();
    publishers[topic] = made;
    return made;
  }
  template <class Message, class Callback>
  std::shared_ptr<Subscription<Message>> create_subscription(const std::string& topic, SensorDataQoS,
                                                             Callback callback) {
    auto made = std::make_shared<Subscription<Message>>();
    made->call = callback;
    subscriptions[topic] = made;
    return made;
  }
  Logger get_logger() { return {&warnings}; }

  std::map<std::string, std::shared_ptr<void>> publishers, subscriptions;
  int warnings = 0;

 private:
  NodeOptions options_;
};

}  // namespace rclcpp
