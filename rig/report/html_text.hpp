// SPDX-License-Identifier: MIT
#pragma once

#include <string>

namespace rig {

/// Text as it stands between HTML tags.
[[nodiscard]] inline std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else
      out += c;
  }
  return out;
}

}  // namespace rig
