// SPDX-License-Identifier: MIT
#include "rig/session/session_dates.hpp"

#include <algorithm>
#include <cctype>
#include <charconv>

namespace rig {

SessionDates dates_of(const SessionStore& session) {
  const std::string created = session.get("created_utc").value_or("");
  if (session.get("kind") != "import") return {created, "", ""};
  const std::string utc = session.get("recorded_utc").value_or("");
  return {utc, utc.empty() ? session.get("recorded_local").value_or("") : "", created};
}

std::optional<std::int64_t> epoch_unix_us(const SessionStore& session) {
  const std::string text = session.get("epoch_unix_us").value_or("");
  std::int64_t unix_us = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), unix_us);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return unix_us;
}

std::string date_in(const std::string& text) {
  constexpr std::size_t length = 10;
  const std::string date = text.substr(0, length);
  const bool is_date = date.size() == length && date[4] == '-' && date[7] == '-' &&
                       std::ranges::count_if(date, [](unsigned char c) { return std::isdigit(c) != 0; }) == 8;
  return is_date ? date : "";
}

std::string SessionDates::measured() const {
  if (imported_utc.empty()) return measured_utc;
  if (!measured_utc.empty()) return measured_utc + " by the clock of the recording";
  return measured_local.empty() ? "" : measured_local + " by the local time of the recording computer";
}

}  // namespace rig
