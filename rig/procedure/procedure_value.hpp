// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

namespace rig {

/// A value that only the run itself will give (an operator's answer, a found edge).
struct Unknown {
  friend bool operator==(const Unknown&, const Unknown&) = default;
};

/// What a procedure's variable can hold.
using Value = std::variant<Unknown, double, bool, std::string>;
using Variables = std::map<std::string, Value>;

/// Why an expression cannot be read or evaluated; `offset` counts characters from the start of the text.
class ExpressionError : public std::runtime_error {
 public:
  ExpressionError(const std::string& what, std::size_t offset_) : std::runtime_error(what), offset(offset_) {}
  std::size_t offset;
};

/// Evaluates what stands between `${` and `}`: numbers, names, + - * /, parentheses, unary minus, and the
/// functions abs, min, max, round. Anything computed from an Unknown is Unknown.
Value evaluate_expression(const std::string& expression, const Variables& variables);

/// Replaces every `${...}` in `text`. A text that is one expression and nothing else keeps its type;
/// otherwise the result is text, or Unknown if any part is.
Value evaluate_text(const std::string& text, const Variables& variables);

[[nodiscard]] bool has_expression(const std::string& text);
/// The names that `text`'s expressions use, for checks before anything runs. Throws ExpressionError.
[[nodiscard]] std::vector<std::string> names_used(const std::string& text);

/// Plain text of a value: numbers as a person writes them ("0.3", "200"), "?" for Unknown.
[[nodiscard]] std::string to_text(const Value& value);
/// A measured number without digits that mean nothing: at most so many decimals, no zeros at their end, and
/// no "-0".
[[nodiscard]] std::string rounded_text(double value, int decimals);
/// The other way: a number if it reads as one, true or false, else text.
[[nodiscard]] Value value_of_text(const std::string& text);

/// The candidate nearest to `word` if it is near enough to be what was meant, else empty.
[[nodiscard]] std::string did_you_mean(const std::string& word, const std::vector<std::string>& candidates);

}  // namespace rig
