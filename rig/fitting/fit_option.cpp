// SPDX-License-Identifier: MIT
#include "rig/fitting/fit_option.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "fit/bench/json_position.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/errors.hpp"
#include "rig/text_lines.hpp"

namespace rig {
namespace {

using nlohmann::json;
using Type = FitOption::Type;

std::string number_text(double value) { return fit::format_value(value, 0); }

std::string default_text(const FitOption& option) {
  if (const auto* number = std::get_if<double>(&*option.otherwise))
    return fit::with_unit(number_text(*number), option.unit);
  if (const auto* flag = std::get_if<bool>(&*option.otherwise)) return *flag ? "true" : "false";
  return std::get<std::string>(*option.otherwise);
}

/// Nothing where the value is of another type, or outside the range.
std::optional<FitValue> value_of(const FitOption& option, const json& value) {
  switch (option.type) {
    case Type::number:
    case Type::integer: {
      if (!value.is_number()) return std::nullopt;
      const double number = value.get<double>();
      if (!std::isfinite(number) || (option.min && number < *option.min) ||
          (option.max && number > *option.max))
        return std::nullopt;
      if (option.type == Type::integer && number != std::floor(number)) return std::nullopt;
      return number;
    }
    case Type::flag:
      if (!value.is_boolean()) return std::nullopt;
      return value.get<bool>();
    case Type::text:  // A target or a file may be called 12.
      if (value.is_number()) return value.dump();
      if (!value.is_string()) return std::nullopt;
      return value.get<std::string>();
    case Type::choice: {
      if (!value.is_string()) return std::nullopt;
      const auto word = value.get<std::string>();
      if (std::ranges::find(option.choices, word) == option.choices.end()) return std::nullopt;
      return word;
    }
  }
  return std::nullopt;
}

[[noreturn]] void refuse_name(const std::string& kind, const std::string& name,
                              const std::vector<FitOption>& declared) {
  std::vector<std::string> known;
  for (const FitOption& option : declared) known.push_back(option.name);
  throw UsageError("the calibration '" + kind + "' has no option '" + name + "'" +
                   fit::ending_with_guess(fit::nearest_word(name, known)) +
                   " It has: " + (known.empty() ? "none" : listed(known)));
}

[[noreturn]] void refuse_value(const std::string& kind, const FitOption& option, const json& value) {
  const std::string meant =
      value.is_string() ? fit::nearest_word(value.get<std::string>(), option.choices) : "";
  throw UsageError("the option '" + option.name + "' of the calibration '" + kind + "' must be " +
                   expectation(option) + ", not " + value.dump() +
                   (meant.empty() ? "; 'rig fit " + kind + " --help' says what it does"
                                  : "; did you mean '" + meant + "'?"));
}

}  // namespace

FitOptions::FitOptions(const std::string& kind, std::vector<FitOption> declared, const json& given) {
  if (!given.is_object() && !given.is_null())
    throw UsageError("the options of the calibration '" + kind + "' must be a map {name: value}, not " +
                     given.dump());
  if (given.is_object())
    for (const auto& [name, value] : given.items())
      if (std::ranges::find(declared, name, &FitOption::name) == declared.end())
        refuse_name(kind, name, declared);
  for (FitOption& option : declared) {
    std::optional<FitValue> value;
    if (given.is_object() && given.contains(option.name) && !given.at(option.name).is_null()) {
      value = value_of(option, given.at(option.name));
      if (!value) refuse_value(kind, option, given.at(option.name));
    }
    held_.push_back({std::move(option), std::move(value)});
  }
}

const FitOptions::Held& FitOptions::held(const std::string& name) const {
  for (const Held& held : held_)
    if (held.option.name == name) return held;
  throw std::logic_error("a calibration asks for the option '" + name + "', which it does not declare");
}

template <class T>
std::optional<T> FitOptions::maybe(const std::string& name) const {
  const Held& at = held(name);
  if (at.given) return std::get<T>(*at.given);
  if (at.option.otherwise) return std::get<T>(*at.option.otherwise);
  return std::nullopt;
}

template <class T>
T FitOptions::value(const std::string& name) const {
  const auto found = maybe<T>(name);
  if (!found) throw std::logic_error("the option '" + name + "' has no default");
  return *found;
}

bool FitOptions::has(const std::string& name) const { return held(name).given.has_value(); }
double FitOptions::number(const std::string& name) const { return value<double>(name); }
int FitOptions::integer(const std::string& name) const { return static_cast<int>(value<double>(name)); }
bool FitOptions::flag(const std::string& name) const { return value<bool>(name); }
std::string FitOptions::text(const std::string& name) const {
  return maybe<std::string>(name).value_or(std::string());
}
std::optional<double> FitOptions::maybe_number(const std::string& name) const { return maybe<double>(name); }
std::optional<bool> FitOptions::maybe_flag(const std::string& name) const { return maybe<bool>(name); }

std::string expectation(const FitOption& option) {
  switch (option.type) {
    case Type::flag:
      return "true or false";
    case Type::text:
      return "a text";
    case Type::choice:
      return "one of " + listed(option.choices);
    case Type::number:
    case Type::integer:
      break;
  }
  std::string out = option.type == Type::integer ? "a whole number" : "a number";
  if (option.min && option.max)
    out += " from " + number_text(*option.min) + " to " + number_text(*option.max);
  else if (option.min)
    out += " of " + number_text(*option.min) + " or more";
  else if (option.max)
    out += " of " + number_text(*option.max) + " or less";
  return fit::with_unit(out, option.unit);
}

std::string help_text(const FitOption& option) {
  return option.name + "=...  " + option.about + "\n      " + expectation(option) +
         (option.otherwise ? "; default " + default_text(option) : "");
}

}  // namespace rig
