// SPDX-License-Identifier: MIT
#include "lidar/identity.hpp"

#include <charconv>
#include <cstdio>
#include <optional>

namespace lidar {
namespace {

std::optional<int> number_of(const KeyValues& values, std::string_view key) {
  const std::string text = value_of(values, key);
  int number = 0;
  const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (failed != std::errc{} || end == text.data()) return std::nullopt;
  return number;
}

/// A JSON string: quotes, backslashes and everything below a space escaped; bytes above 0x7E replaced.
std::string in_quotes(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (c < 0x20 || c > 0x7E) {
      char code[8];
      std::snprintf(code, sizeof code, "\\u%04x", static_cast<unsigned char>(c));
      out += code;
    } else {
      out += c;
    }
  }
  return out + '"';
}

std::string object(const KeyValues& values) {
  std::string out = "{";
  for (const auto& [key, value] : values)
    out += (out.size() > 1 ? ", " : "") + in_quotes(key) + ": " + in_quotes(value);
  return out + "}";
}

std::string as_json(const Identity& identity) {
  return "{\"model\": " + in_quotes(identity.model) + ", \"serial\": " + in_quotes(identity.serial) +
         ", \"firmware\": " + in_quotes(identity.firmware) + ", \"VV\": " + object(identity.version) +
         ", \"PP\": " + object(identity.parameters) + ", \"II\": " + object(identity.information) + "}";
}

}  // namespace

tl::expected<Identity, std::string> make_identity(std::string_view version, std::string_view parameters,
                                                  std::string_view information) {
  const auto vv = decode_key_values(version), pp = decode_key_values(parameters),
             ii = decode_key_values(information);
  const auto unreadable = [](const char* what, DataError why) {
    return tl::unexpected<std::string>(std::string("its answer to ") + what +
                                       " is damaged: " + std::string(to_string(why)));
  };
  if (!vv) return unreadable("VV", vv.error());
  if (!pp) return unreadable("PP", pp.error());
  if (!ii) return unreadable("II", ii.error());
  Identity out;
  out.version = *vv;
  out.parameters = *pp;
  out.information = *ii;
  out.model = value_of(*pp, "MODL");
  if (out.model.empty()) out.model = value_of(*vv, "PROD");
  out.firmware = value_of(*vv, "FIRM");
  out.serial = value_of(*vv, "SERI");
  out.min_step = number_of(*pp, "AMIN").value_or(out.min_step);
  out.max_step = number_of(*pp, "AMAX").value_or(out.max_step);
  out.front_step = number_of(*pp, "AFRT").value_or(out.front_step);
  out.steps_per_turn = number_of(*pp, "ARES").value_or(out.steps_per_turn);
  out.min_range_mm = number_of(*pp, "DMIN").value_or(out.min_range_mm);
  out.max_range_mm = number_of(*pp, "DMAX").value_or(out.max_range_mm);
  std::string missing;
  for (const char* key : {"AMIN", "AMAX", "AFRT", "ARES"})
    if (!number_of(*pp, key)) missing += (missing.empty() ? "" : ", ") + std::string(key);
  if (!missing.empty())
    return tl::unexpected<std::string>("its answer to PP does not give " + missing +
                                       ", so the directions of its beams are unknown");
  const int turns_a_minute = number_of(*pp, "SCAN").value_or(2400);
  if (out.min_step < 0 || out.max_step < out.min_step || out.max_step > 9999 || out.steps_per_turn < 1 ||
      turns_a_minute < 1)
    return tl::unexpected<std::string>(
        "its answer to PP contains impossible numbers (AMIN, AMAX, ARES or SCAN)");
  out.scan_period_s = 60.0 / turns_a_minute;
  out.json = as_json(out);
  return out;
}

}  // namespace lidar
