// SPDX-License-Identifier: MIT
#include "rig/procedure/procedure_value.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <functional>

#include "fit/bench/json_position.hpp"

namespace rig {
namespace {

constexpr int deepest_expression = 50;

bool is_name_start(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// Recursive descent over one expression. `look_up` gives the value of a name at an offset.
class Parser {
 public:
  using LookUp = std::function<Value(const std::string& name, std::size_t offset)>;

  Parser(const std::string& text, LookUp look_up) : text_(text), look_up_(std::move(look_up)) {}

  Value whole() {
    const Value value = sum();
    skip_blanks();
    if (at_ < text_.size()) fail("'" + text_.substr(at_, 1) + "' is not expected here");
    return value;
  }

 private:
  [[noreturn]] void fail(const std::string& what) const { throw ExpressionError(what, at_); }

  void skip_blanks() {
    while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\t')) ++at_;
  }

  bool take(char wanted) {
    skip_blanks();
    if (at_ >= text_.size() || text_[at_] != wanted) return false;
    ++at_;
    return true;
  }

  template <class F>
  Value combine(const Value& left, const Value& right, F operation) {
    if (std::holds_alternative<Unknown>(left) || std::holds_alternative<Unknown>(right)) return Unknown{};
    const auto *a = std::get_if<double>(&left), *b = std::get_if<double>(&right);
    if (!a || !b) fail("only numbers can be used in calculations");
    const double result = operation(*a, *b);
    if (!std::isfinite(result)) fail("the result is not a finite number (division by zero?)");
    return result;
  }

  Value sum() {
    Value value = product();
    for (;;) {
      if (take('+'))
        value = combine(value, product(), std::plus<>());
      else if (take('-'))
        value = combine(value, product(), std::minus<>());
      else
        return value;
    }
  }

  Value product() {
    Value value = factor();
    for (;;) {
      if (take('*'))
        value = combine(value, factor(), std::multiplies<>());
      else if (take('/'))
        value = combine(value, factor(), std::divides<>());
      else
        return value;
    }
  }

  Value factor() {
    if (++depth_ > deepest_expression) fail("the expression is nested too deeply");
    const Value value = factor_inside();
    --depth_;
    return value;
  }

  Value factor_inside() {
    if (take('-')) return combine(0.0, factor(), std::minus<>());
    if (take('(')) {
      const Value value = sum();
      if (!take(')')) fail("')' is missing");
      return value;
    }
    skip_blanks();
    if (at_ >= text_.size()) fail("the expression ends where a number or a name was expected");
    if (is_digit(text_[at_]) || text_[at_] == '.') return number();
    if (is_name_start(text_[at_])) return name_or_function();
    fail("'" + text_.substr(at_, 1) + "' is not expected here");
  }

  Value number() {
    double value = 0;
    const char* first = text_.data() + at_;
    const auto [end, error] = std::from_chars(first, text_.data() + text_.size(), value);
    if (error != std::errc() || !std::isfinite(value)) fail("this is not a number");
    at_ += static_cast<std::size_t>(end - first);
    return value;
  }

  Value name_or_function() {
    const std::size_t start = at_;
    while (at_ < text_.size() && (is_name_start(text_[at_]) || is_digit(text_[at_]))) ++at_;
    const std::string name = text_.substr(start, at_ - start);
    if (take('(')) return function(name, start);
    return look_up_(name, start);
  }

  Value function(const std::string& name, std::size_t start) {
    const Value first = sum();
    if (name == "abs" || name == "round") {
      if (!take(')')) fail("')' is missing");
      return combine(first, 0.0,
                     [&](double a, double) { return name == "abs" ? std::abs(a) : std::round(a); });
    }
    if (name != "min" && name != "max")
      throw ExpressionError("there is no function '" + name + "' (there are abs, min, max, round)", start);
    if (!take(',')) fail("',' is missing");
    const Value second = sum();
    if (!take(')')) fail("')' is missing");
    return combine(first, second,
                   [&](double a, double b) { return name == "min" ? std::min(a, b) : std::max(a, b); });
  }

  const std::string& text_;
  LookUp look_up_;
  std::size_t at_ = 0;
  int depth_ = 0;
};

/// Calls `plain` and `expression` for the pieces of `text` in order.
template <class Plain, class Expression>
void for_each_piece(const std::string& text, Plain plain, Expression expression) {
  std::size_t at = 0;
  for (;;) {
    const std::size_t start = text.find("${", at);
    plain(text.substr(at, start == std::string::npos ? start : start - at));
    if (start == std::string::npos) return;
    const std::size_t end = text.find('}', start);
    if (end == std::string::npos) throw ExpressionError("'}' is missing", start);
    try {
      expression(text.substr(start + 2, end - start - 2));
    } catch (const ExpressionError& error) {
      throw ExpressionError(error.what(), start + 2 + error.offset);
    }
    at = end + 1;
  }
}

}  // namespace

Value evaluate_expression(const std::string& expression, const Variables& variables) {
  return Parser(expression,
                [&](const std::string& name, std::size_t offset) -> Value {
                  const auto found = variables.find(name);
                  if (found != variables.end()) return found->second;
                  std::vector<std::string> names;
                  for (const auto& [known, value] : variables) names.push_back(known);
                  const std::string meant = did_you_mean(name, names);
                  throw ExpressionError("there is no variable '" + name + "' here" +
                                            (meant.empty() ? "" : "; did you mean '" + meant + "'?"),
                                        offset);
                })
      .whole();
}

Value evaluate_text(const std::string& text, const Variables& variables) {
  std::vector<Value> values;
  std::string joined;
  bool plain_seen = false, unknown = false;
  for_each_piece(
      text,
      [&](const std::string& plain) {
        plain_seen |= !plain.empty();
        joined += plain;
      },
      [&](const std::string& expression) {
        values.push_back(evaluate_expression(expression, variables));
        unknown |= std::holds_alternative<Unknown>(values.back());
        joined += to_text(values.back());
      });
  if (values.size() == 1 && !plain_seen) return values[0];
  if (unknown) return Unknown{};
  return values.empty() ? value_of_text(text) : Value(joined);
}

bool has_expression(const std::string& text) { return text.find("${") != std::string::npos; }

std::vector<std::string> names_used(const std::string& text) {
  std::vector<std::string> names;
  for_each_piece(
      text, [](const std::string&) {},
      [&](const std::string& expression) {
        Parser(expression, [&](const std::string& name, std::size_t) -> Value {
          names.push_back(name);
          return Unknown{};
        }).whole();
      });
  return names;
}

std::string to_text(const Value& value) {
  if (const auto* text = std::get_if<std::string>(&value)) return *text;
  if (const auto* flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
  if (const auto* number = std::get_if<double>(&value)) {
    // Twelve digits: 0.1 + 0.2 reads 0.3.
    char digits[40];
    std::snprintf(digits, sizeof digits, "%.12g", *number == 0 ? 0.0 : *number);  // No "-0".
    return digits;
  }
  return "?";
}

std::string rounded_text(double value, int decimals) {
  const double scale = std::pow(10, decimals);
  return to_text(std::round(value * scale) / scale);
}

Value value_of_text(const std::string& text) {
  if (text == "true") return true;
  if (text == "false") return false;
  double number = 0;
  const char* first = text.data() + (text.size() > 1 && text[0] == '+' ? 1 : 0);
  const auto [end, error] = std::from_chars(first, text.data() + text.size(), number);
  if (error == std::errc() && end == text.data() + text.size() && std::isfinite(number)) return number;
  return text;
}

std::string did_you_mean(const std::string& word, const std::vector<std::string>& candidates) {
  constexpr std::size_t longest_word = 64;
  return word.size() > longest_word ? "" : fit::nearest_word(word, candidates);
}

}  // namespace rig
