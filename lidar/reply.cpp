// SPDX-License-Identifier: MIT
#include "lidar/reply.hpp"

#include <algorithm>

#include "lidar/encoding.hpp"

namespace lidar {

namespace {

/// Takes the next line off `body`; the last one may lack its LF.
std::string_view take_line(std::string_view& body) {
  const std::size_t end = body.find('\n');
  const std::string_view line = body.substr(0, end);
  body.remove_prefix(end == std::string_view::npos ? body.size() : end + 1);
  return line;
}

bool is_text(std::string_view line) {
  return std::all_of(line.begin(), line.end(), [](char c) { return c >= 0x20 && c <= 0x7E; });
}

/// A line of data with its sum: gives the data.
tl::expected<std::string_view, DataError> checked(std::string_view line) {
  if (line.size() < 2 || line.size() > line_characters + 1)
    return tl::unexpected<DataError>(DataError::bad_line_length);
  const std::string_view data = line.substr(0, line.size() - 1);
  if (!std::all_of(data.begin(), data.end(), is_data_character))
    return tl::unexpected<DataError>(DataError::bad_character);
  if (checksum(data) != line.back()) return tl::unexpected<DataError>(DataError::bad_checksum);
  return data;
}

bool sum_matches(std::string_view text, char sum) {
  if (checksum(text) == sum || checksum(std::string(text) + ';') == sum) return true;
  const std::size_t comment = text.find("<-");
  return comment != std::string_view::npos && checksum(text.substr(0, comment)) == sum;
}

/// A number of two or three characters; empty when one is no data character.
std::optional<std::uint32_t> short_value(std::string_view characters) {
  std::uint32_t value = 0, outside = 0;
  for (const char c : characters) {
    const std::uint32_t number = static_cast<unsigned char>(c - 0x30);
    outside |= number;
    value = value << 6 | number;
  }
  return outside < 0x40 ? std::optional(value) : std::nullopt;
}

/// Joins the lines of data, each verified.
tl::expected<std::string, DataError> join(std::string_view body) {
  std::string payload;
  payload.reserve(body.size());
  while (!body.empty()) {
    const std::string_view line = take_line(body);
    const auto data = checked(line);
    if (!data) return tl::unexpected<DataError>(data.error());
    if (!body.empty() && data->size() != line_characters)
      return tl::unexpected<DataError>(DataError::bad_line_length);
    payload += *data;
  }
  return payload;
}

}  // namespace

std::string_view to_string(DataError error) {
  switch (error) {
    case DataError::bad_checksum:
      return "a line's checksum is wrong";
    case DataError::bad_character:
      return "an invalid character";
    case DataError::bad_line_length:
      return "a line of the wrong length";
    case DataError::bad_stamp:
      return "no time stamp";
    case DataError::wrong_count:
      return "more or fewer values than requested";
    case DataError::bad_key_value:
      return "a line that is not KEY:value;";
  }
  return "?";
}

tl::expected<KeyValues, DataError> decode_key_values(std::string_view body) {
  KeyValues values;
  while (!body.empty()) {
    const std::string_view line = take_line(body);
    if (!is_text(line)) return tl::unexpected<DataError>(DataError::bad_character);
    const std::size_t colon = line.find(':');
    if (line.size() < 4 || line[line.size() - 2] != ';' || colon == 0 || colon >= line.size() - 2) {
      return tl::unexpected<DataError>(DataError::bad_key_value);
    }
    const std::string_view text = line.substr(0, line.size() - 2);
    if (!sum_matches(text, line.back())) return tl::unexpected<DataError>(DataError::bad_checksum);
    values.emplace_back(text.substr(0, colon), text.substr(colon + 1));
  }
  return values;
}

std::string value_of(const KeyValues& values, std::string_view key) {
  const auto found =
      std::find_if(values.begin(), values.end(), [&](const auto& pair) { return pair.first == key; });
  return found == values.end() ? std::string() : found->second;
}

tl::expected<std::string, DataError> decode_text(std::string_view body) {
  const std::string_view line = take_line(body);
  if (line.size() < 2 || !body.empty()) return tl::unexpected<DataError>(DataError::bad_line_length);
  if (!is_text(line)) return tl::unexpected<DataError>(DataError::bad_character);
  const std::string_view text = line.substr(0, line.size() - 1);
  if (checksum(text) != line.back()) return tl::unexpected<DataError>(DataError::bad_checksum);
  return std::string(text);
}

tl::expected<std::uint64_t, DataError> decode_time(std::string_view body, bool microseconds) {
  const auto data = checked(take_line(body));
  if (!data) return tl::unexpected<DataError>(data.error());
  if (!body.empty() || data->size() != (microseconds ? 11u : 4u))
    return tl::unexpected<DataError>(DataError::bad_stamp);
  const std::optional<std::uint64_t> time = decode_value(*data);
  if (!time) return tl::unexpected<DataError>(DataError::bad_stamp);
  return *time;
}

std::optional<std::uint32_t> decode_information_time(std::string_view value) {
  if (value.size() == 4) {
    const std::optional<std::uint64_t> time = decode_value(value);
    return time ? std::optional(static_cast<std::uint32_t>(*time)) : std::nullopt;
  }
  if (value.size() != 6) return std::nullopt;
  std::uint32_t time = 0;
  for (const char c : value) {
    const bool digit = c >= '0' && c <= '9', upper = c >= 'A' && c <= 'F', lower = c >= 'a' && c <= 'f';
    if (!digit && !upper && !lower) return std::nullopt;
    time = time << 4 | static_cast<std::uint32_t>(digit ? c - '0' : (upper ? c - 'A' : c - 'a') + 10);
  }
  return time;
}

tl::expected<RawScan, DataError> decode_scan(std::string_view body, const ScanCommand& command) {
  const auto stamp = checked(take_line(body));
  if (!stamp) return tl::unexpected<DataError>(stamp.error());
  const std::optional<std::uint64_t> time = decode_value(*stamp);
  if ((stamp->size() != 4 && stamp->size() != 11) || !time)
    return tl::unexpected<DataError>(DataError::bad_stamp);
  RawScan scan;
  scan.stamp = *time;

  // Multi-echo marks further echoes of a step with '&', which is outside the data characters, so its lines
  // are checked with the mark taken as one.
  const bool multi_echo = command.multi_echo;
  std::string payload;
  if (multi_echo) {
    while (!body.empty()) {
      const std::string_view line = take_line(body);
      if (line.size() < 2 || line.size() > line_characters + 1 ||
          (!body.empty() && line.size() != line_characters + 1)) {
        return tl::unexpected<DataError>(DataError::bad_line_length);
      }
      const std::string_view data = line.substr(0, line.size() - 1);
      if (checksum(data) != line.back()) return tl::unexpected<DataError>(DataError::bad_checksum);
      payload += data;
    }
  } else {
    auto joined = join(body);
    if (!joined) return tl::unexpected<DataError>(joined.error());
    payload = std::move(*joined);
  }

  const bool with_intensity = command.format == ScanFormat::distance_intensity;
  const std::size_t characters = command.format == ScanFormat::distance2 ? 2 : 3;
  const std::size_t value_size = characters + (with_intensity ? 3 : 0);
  scan.range_mm.reserve(payload.size() / value_size);
  if (with_intensity) scan.intensity.reserve(payload.size() / value_size);
  std::string_view rest = payload;
  while (!rest.empty()) {
    const bool further = multi_echo && rest.front() == '&';
    if (further) rest.remove_prefix(1);
    if (rest.size() < value_size) return tl::unexpected<DataError>(DataError::wrong_count);
    const auto range = short_value(rest.substr(0, characters));
    const auto intensity = short_value(with_intensity ? rest.substr(3, 3) : std::string_view());
    if (!range || !intensity) return tl::unexpected<DataError>(DataError::bad_character);
    if (multi_echo) {
      if (further && (scan.echoes.empty() || scan.echoes.back() >= 3)) {
        return tl::unexpected<DataError>(DataError::wrong_count);
      }
      if (further)
        ++scan.echoes.back();
      else
        scan.echoes.push_back(1);
    }
    scan.range_mm.push_back(*range);
    if (with_intensity) scan.intensity.push_back(*intensity);
    rest.remove_prefix(value_size);
  }
  const std::size_t steps = multi_echo ? scan.echoes.size() : scan.range_mm.size();
  if (steps != static_cast<std::size_t>(command.values()))
    return tl::unexpected<DataError>(DataError::wrong_count);
  return scan;
}

}  // namespace lidar
