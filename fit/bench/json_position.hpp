// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace fit {

/// Where in a text something stands, counted from 1.
struct TextPosition {
  int line = 1, column = 1;

  /// "name:line:column: ", as compilers begin what they say.
  [[nodiscard]] std::string in(const std::string& name) const;
};

/// Line and column of the value at `pointer` ("/targets/0/u_mm", RFC 6901 without escapes) in JSON text with
/// comments that is known to be well-formed; of the nearest enclosing value when there is no such member. For
/// error messages.
[[nodiscard]] TextPosition position_of(std::string_view text, std::string_view pointer);

/// Line and column of a byte offset.
[[nodiscard]] TextPosition position_at(std::string_view text, std::size_t offset);

/// What `text` says, `//` and `/* */` comments apart. Throws std::invalid_argument: "name:line:column:
/// `remedy`" where it is not JSON, "name: ..." where a number is too large for any quantity.
[[nodiscard]] nlohmann::json parse_json(const std::string& text, const std::string& name,
                                        const std::string& remedy);

/// JSON takes the last of them in silence. For text that is known to be well-formed; throws
/// std::invalid_argument with the place of the second.
void refuse_keys_given_twice(const std::string& text, const std::string& name);

/// The candidate most like `word` (edit distance), or "" when none is near enough to be a misspelling of it.
template <class Range>
[[nodiscard]] std::string nearest_word(std::string_view word, const Range& candidates);
/// How a sentence about a word that nobody knows ends: "; did you mean 'WORD'?", or "." where none was meant.
[[nodiscard]] std::string ending_with_guess(const std::string& meant);
[[nodiscard]] std::size_t edit_distance(std::string_view a, std::string_view b);

template <class Range>
std::string nearest_word(std::string_view word, const Range& candidates) {
  std::string best;
  std::size_t best_distance = word.size() / 3 + 2;
  for (const auto& candidate : candidates) {
    const std::size_t distance = edit_distance(word, candidate);
    if (distance < best_distance) {
      best_distance = distance;
      best = std::string(candidate);
    }
  }
  return best;
}

}  // namespace fit
