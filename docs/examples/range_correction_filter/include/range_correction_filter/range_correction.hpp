// SPDX-License-Identifier: MIT
// A range correction of `rig export --format ros2-parameters`, without ROS: C++17, standard library alone.
#pragma once

#include <cctype>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace range_correction_filter {

/// An equation in C syntax over x and named coefficients, as the parameter file carries it:
/// "(a + b * x) * exp(-c * x)". Parsed once; throws std::invalid_argument with the place of what it does not
/// understand.
class Equation {
 public:
  Equation() = default;
  Equation(std::string text, const std::vector<std::string>& names, const std::vector<double>& coefficients)
      : text_(std::move(text)) {
    if (names.size() != coefficients.size())
      throw std::invalid_argument("names and coefficients differ in number");
    for (std::size_t i = 0; i < names.size(); ++i) values_[names[i]] = coefficients[i];
    value_ = sum();
    blanks();
    if (at_ < text_.size()) refuse("the end");
  }
  double operator()(double x) const { return value_(x); }

 private:
  using Function = std::function<double(double)>;

  [[noreturn]] void refuse(const char* expected) const {
    throw std::invalid_argument("equation '" + text_ + "', character " + std::to_string(at_ + 1) +
                                ": expected " + expected);
  }
  void blanks() {
    while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_]))) ++at_;
  }
  bool take(char c) {
    blanks();
    if (at_ >= text_.size() || text_[at_] != c) return false;
    ++at_;
    return true;
  }

  Function sum() {
    Function left = product();
    while (true) {
      if (take('+')) {
        left = [left, right = product()](double x) { return left(x) + right(x); };
      } else if (take('-')) {
        left = [left, right = product()](double x) { return left(x) - right(x); };
      } else {
        return left;
      }
    }
  }
  Function product() {
    Function left = factor();
    while (true) {
      if (take('*')) {
        left = [left, right = factor()](double x) { return left(x) * right(x); };
      } else if (take('/')) {
        left = [left, right = factor()](double x) { return left(x) / right(x); };
      } else {
        return left;
      }
    }
  }
  Function factor() {
    if (take('-')) return [of = factor()](double x) { return -of(x); };
    if (take('(')) {
      Function inside = sum();
      if (!take(')')) refuse("')'");
      return inside;
    }
    blanks();
    const char* begin = text_.c_str() + at_;
    if (std::isdigit(static_cast<unsigned char>(*begin)) || *begin == '.') {
      char* end = nullptr;
      const double number = std::strtod(begin, &end);
      at_ += static_cast<std::size_t>(end - begin);
      return [number](double) { return number; };
    }
    return named();
  }
  Function named() {
    const std::size_t begin = at_;
    while (at_ < text_.size() && (std::isalnum(static_cast<unsigned char>(text_[at_])) || text_[at_] == '_'))
      ++at_;
    const std::string name = text_.substr(begin, at_ - begin);
    if (take('(')) return call(name);
    if (name == "x") return [](double x) { return x; };
    const auto found = values_.find(name);
    if (found == values_.end()) refuse("a number, x, a coefficient or a function");
    return [number = found->second](double) { return number; };
  }
  Function call(const std::string& name) {
    const Function first = sum();
    if (name == "pow") {
      if (!take(',')) refuse("','");
      const Function second = sum();
      if (!take(')')) refuse("')'");
      return [first, second](double x) { return std::pow(first(x), second(x)); };
    }
    static const std::map<std::string, double (*)(double)> known{
        {"exp", std::exp}, {"log", std::log}, {"sqrt", std::sqrt}, {"sin", std::sin}, {"cos", std::cos}};
    const auto function = known.find(name);
    if (function == known.end() || !take(')')) refuse("exp, log, sqrt, sin, cos or pow, and ')'");
    return [first, f = function->second](double x) { return f(first(x)); };
  }

  std::string text_;
  std::map<std::string, double> values_;
  std::size_t at_ = 0;
  Function value_;
};

/// One term of the error; it counts from its value at `zero_at` where there is one, and holds its value at
/// the border outside what was calibrated.
struct Term {
  Equation equation;
  double from = 0, to = 0, zero = 0;
  double sample_from = 0, sample_to = 0;  ///< Where single samples belong to what was calibrated.

  Term() = default;
  Term(Equation equation_, double from_, double to_, bool has_zero, double zero_at)
      : equation(std::move(equation_)),
        from(from_),
        to(to_),
        zero(has_zero ? equation(zero_at) : 0),
        sample_from(from_),
        sample_to(to_) {}
  double error(double value, bool& outside) const {
    const double held = value < from ? from : value > to ? to : value;
    outside = outside || value < sample_from || value > sample_to;
    return equation(held) - zero;
  }
};

/// error = zero + intensity term (counts) + distance term (measured - zero - intensity term);
/// corrected = measured - error. Millimetres and counts.
struct RangeCorrection {
  double zero_mm = 0;
  bool use_intensity = false, use_distance = false;
  Term intensity, distance;

  struct Corrected {
    double range_mm = 0;
    bool outside = false;  ///< Of what was calibrated: the error at the border was subtracted.
  };
  Corrected apply(double measured_mm, double counts) const {
    Corrected out;
    double error = zero_mm;
    if (use_intensity) error += intensity.error(counts, out.outside);
    if (use_distance) error += distance.error(measured_mm - error, out.outside);
    out.range_mm = measured_mm - error;
    return out;
  }
};

}  // namespace range_correction_filter
