// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace rig {

using FitValue = std::variant<double, bool, std::string>;

/// One option of a calibration: what it is called, what it takes and what a person needs to know. From these
/// come the checks before a run, the values a calibration works with, and the help.
struct FitOption {
  enum class Type { number, integer, text, flag, choice };
  std::string name;
  Type type = Type::number;
  std::string unit = {};
  std::optional<double> min = {}, max = {};  ///< Both ends are allowed.
  std::vector<std::string> choices = {};     ///< Of a choice.
  std::optional<FitValue> otherwise = {};    ///< Without it; none: `about` says what holds then.
  std::string about = {};                    ///< One line.
};

/// The options that a calibration was given, by what it declares. An option of the value null counts as
/// absent: it is not known yet.
class FitOptions {
 public:
  /// `given`: an object, or null for none. Throws UsageError for an option that `kind` does not declare, or a
  /// value of another type or outside its range, with what was expected and what to do.
  FitOptions(const std::string& kind, std::vector<FitOption> declared, const nlohmann::json& given);

  /// Whether it was given.
  [[nodiscard]] bool has(const std::string& name) const;
  // What was given, else the declared default. Throws std::logic_error for an option that is not declared so.
  [[nodiscard]] double number(const std::string& name) const;
  [[nodiscard]] int integer(const std::string& name) const;
  [[nodiscard]] bool flag(const std::string& name) const;
  /// Of a text or a choice; empty if neither was given nor declared.
  [[nodiscard]] std::string text(const std::string& name) const;
  // For options whose default the calibration works out itself.
  [[nodiscard]] std::optional<double> maybe_number(const std::string& name) const;
  [[nodiscard]] std::optional<bool> maybe_flag(const std::string& name) const;

 private:
  struct Held {
    FitOption option;
    std::optional<FitValue> given;
  };
  [[nodiscard]] const Held& held(const std::string& name) const;
  template <class T>
  [[nodiscard]] T value(const std::string& name) const;
  template <class T>
  [[nodiscard]] std::optional<T> maybe(const std::string& name) const;

  std::vector<Held> held_;
};

/// What an option takes, in words: "a number from 0 to 10 deg", "one of robust, paper".
[[nodiscard]] std::string expectation(const FitOption& option);

/// Name, what it takes, meaning and default, in two lines for a terminal.
[[nodiscard]] std::string help_text(const FitOption& option);

}  // namespace rig
