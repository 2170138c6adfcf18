// SPDX-License-Identifier: MIT
#include "fit/bench/json_position.hpp"

#include <algorithm>
#include <cctype>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>
#include <stdexcept>
#include <vector>

#include "fit/numeric/utf8.hpp"

namespace fit {
namespace {

/// Walks well-formed JSON text down one path.
class Locator {
 public:
  explicit Locator(std::string_view text) : text_(text) {}

  std::size_t find(std::string_view pointer) {
    skip_space();
    std::size_t found = at_;
    while (!pointer.empty()) {
      pointer.remove_prefix(1);
      const std::string_view step = pointer.substr(0, pointer.find('/'));
      pointer.remove_prefix(step.size());
      if (!enter(step)) break;
      found = at_;
    }
    return found;
  }

  /// Of the first key that its object has already; npos where there is none.
  std::size_t find_second_of_its_name() {
    std::vector<std::set<std::string_view>> open;
    for (skip_space(); !ended(); skip_space()) {
      const std::size_t start = at_;
      const char c = here();
      if (c == '"') {
        const std::string_view name = take_string();
        skip_space();
        if (here() == ':' && !open.back().insert(name).second) return start;
        continue;
      }
      if (c == '{' || c == '[') open.emplace_back();
      if (c == '}' || c == ']') open.pop_back();
      ++at_;
    }
    return std::string_view::npos;
  }

 private:
  [[nodiscard]] bool ended() const { return at_ >= text_.size(); }
  [[nodiscard]] char here() const { return ended() ? '\0' : text_[at_]; }

  void skip_space() {
    while (!ended()) {
      if (std::isspace(static_cast<unsigned char>(here())))
        ++at_;
      else if (text_.substr(at_, 2) == "//")
        at_ = std::min(text_.find('\n', at_), text_.size());
      else if (text_.substr(at_, 2) == "/*")
        at_ = std::min(text_.find("*/", at_ + 2), text_.size() - 2) + 2;
      else
        return;
    }
  }

  std::string_view take_string() {
    const std::size_t start = ++at_;
    while (!ended() && here() != '"') at_ += here() == '\\' ? 2 : 1;
    const std::string_view taken = text_.substr(start, std::min(at_, text_.size()) - start);
    ++at_;
    return taken;
  }

  void skip_value() {
    skip_space();
    if (here() == '"') {
      take_string();
      return;
    }
    int depth = 0;
    while (!ended()) {
      const char c = here();
      if (c == '"') {
        take_string();
        continue;
      }
      if (c == '/') {
        const std::size_t before = at_;
        skip_space();
        if (at_ != before) continue;
      }
      if (c == '{' || c == '[') ++depth;
      if (c == '}' || c == ']') {
        if (depth == 0) return;
        if (--depth == 0) {
          ++at_;
          return;
        }
      }
      if (c == ',' && depth == 0) return;
      ++at_;
    }
  }

  /// From the start of an object or array to the value of one member; false if there is none.
  bool enter(std::string_view step) {
    const char open = here();
    if (open != '{' && open != '[') return false;
    ++at_;
    for (std::size_t index = 0;; ++index) {
      skip_space();
      if (ended() || here() == '}' || here() == ']') return false;
      std::string_view name;
      if (open == '{') {
        if (here() != '"') return false;
        name = take_string();
        skip_space();
        ++at_;  // the colon
        skip_space();
      }
      if (open == '{' ? name == step : std::to_string(index) == step) return true;
      skip_value();
      skip_space();
      if (here() == ',') ++at_;
    }
  }

  std::string_view text_;
  std::size_t at_ = 0;
};

}  // namespace

std::string TextPosition::in(const std::string& name) const {
  return name + ":" + std::to_string(line) + ":" + std::to_string(column) + ": ";
}

TextPosition position_at(std::string_view text, std::size_t offset) {
  const std::string_view before = text.substr(0, offset);
  const std::size_t line_start = before.rfind('\n');
  return {static_cast<int>(std::ranges::count(before, '\n')) + 1,
          static_cast<int>(before.size() - (line_start == std::string_view::npos ? 0 : line_start + 1)) + 1};
}

TextPosition position_of(std::string_view text, std::string_view pointer) {
  return position_at(text, Locator(text).find(pointer));
}

nlohmann::json parse_json(const std::string& text, const std::string& name, const std::string& remedy) {
  try {
    return nlohmann::json::parse(text, nullptr, true, true);
  } catch (const nlohmann::json::parse_error& error) {
    if (text.find_first_not_of(" \t\r\n") == std::string::npos)
      throw std::invalid_argument(name + " is empty");
    if (const std::size_t foreign = first_beyond_utf8(text); foreign != std::string::npos)
      throw std::invalid_argument(position_at(text, foreign).in(name) + utf8_remedy);
    const TextPosition at = position_at(text, error.byte > 0 ? error.byte - 1 : 0);
    throw std::invalid_argument(at.in(name) + remedy);
  } catch (const nlohmann::json::exception&) {
    throw std::invalid_argument(name + ": holds a number that is too large for any quantity");
  }
}

void refuse_keys_given_twice(const std::string& text, const std::string& name) {
  if (const std::size_t twice = Locator(text).find_second_of_its_name(); twice != std::string_view::npos)
    throw std::invalid_argument(position_at(text, twice).in(name) + "this key is given twice; remove one");
}

std::string ending_with_guess(const std::string& meant) {
  return meant.empty() ? "." : "; did you mean '" + meant + "'?";
}

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0]++;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t substituted = diagonal + (a[i] != b[j]);
      diagonal = row[j + 1];
      row[j + 1] = std::min({substituted, row[j] + 1, diagonal + 1});
    }
  }
  return row.back();
}

}  // namespace fit
