// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace fit {

/// Length of the character of UTF-8 (RFC 3629) that begins at `at`; 0: none does.
[[nodiscard]] std::size_t utf8_length(std::string_view text, std::size_t at);

/// Offset of the first byte that belongs to no character of UTF-8; npos: all do.
[[nodiscard]] std::size_t first_beyond_utf8(std::string_view text);

/// The text with each such byte as '?': for what devices say, which JSON must be able to hold.
[[nodiscard]] std::string as_utf8(std::string_view text);

/// What a person does about a text that is not UTF-8.
extern const char* const utf8_remedy;

}  // namespace fit
