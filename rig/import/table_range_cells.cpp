// SPDX-License-Identifier: MIT
#include "rig/import/table_range_cells.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>

#include "fit/numeric/number_format.hpp"
#include "rig/text_lines.hpp"

namespace rig::table_rows {
namespace {

/// Lidars that see nothing along nine of ten beams are rare (an open field); a wrong unit loses more.
constexpr double most_dropped_share = 0.9;
/// A word here and there is damage or a code; of a tenth of the ranges it must be known what it means.
constexpr double most_words_share = 0.1;
/// Nothing is measured in a room that reaches no farther than a hand; metres named millimetres do (65 m).
constexpr double least_largest_mm = 100;

bool is_no_echo(std::string_view text) {
  constexpr std::array<std::string_view, 10> words{"nan",  "-nan",     "inf",  "+inf", "-inf",
                                                   "null", "infinity", "none", "na",   "n/a"};
  std::string lower(text);
  std::ranges::transform(lower, lower.begin(), [](unsigned char c) { return std::tolower(c); });
  return lower == "-" || std::ranges::find(words, lower) != words.end();
}

}  // namespace

std::uint16_t RangeCells::range(std::string_view cell, const TableColumn& column, std::uint64_t line) {
  const std::string_view text = trimmed(cell);
  scale_ = column.scale;
  const auto value = number_in(text);
  if (!value) {
    if (text.empty() || is_no_echo(text)) return 0;
    ++given_;
    if (words_++ == 0) first_word_ = {std::string(text), line};
    look_for_thousands(text, line);
    return 0;
  }
  look_for_thousands(text, line);
  const std::uint64_t before = out_of_reach_;
  const std::uint16_t mm = range(*value * column.scale);
  if (before == 0 && out_of_reach_ == 1) first_out_of_reach_ = {std::string(text), line};
  return mm;
}

std::uint16_t RangeCells::range(std::optional<double> mm) {
  if (!mm || *mm == 0) return 0;
  ++given_;
  largest_mm_ = std::max(largest_mm_, *mm);
  const std::uint16_t range = range_of(mm);
  if (range == 0) ++out_of_reach_;
  return range;
}

/// Thousands separators: "3,001" beside "978" and never "1204". A decimal sign gives other shapes as well:
/// "0,978", "12,5", "978,25".
void RangeCells::look_for_thousands(std::string_view text, std::uint64_t line) {
  const auto digits = [](std::string_view piece) {
    return !piece.empty() && std::ranges::all_of(piece, [](unsigned char c) { return std::isdigit(c) != 0; });
  };
  const std::size_t sign = text.find_first_of(".,'");
  if (sign == text.npos) {
    if (!digits(text) || text == "0") return;
    if (text.size() > 3) ++ungrouped_;
    if (text.size() != 3) return;
    if (short_whole_++ == 0) first_short_ = {std::string(text), line};
    several_short_ = several_short_ || text != first_short_.text;
    return;
  }
  const std::string_view whole = text.substr(0, sign), rest = text.substr(sign + 1);
  if (whole.size() > 2 || !digits(whole) || whole.front() == '0' || rest.size() != 3 || !digits(rest))
    ++ungrouped_;
  else if (grouped_++ == 0)
    first_grouped_ = {std::string(text), line};
}

void RangeCells::report(ImportSink& sink, bool decimal_comma) const {
  const auto quoted = [&](const Cell& cell) {
    std::string text = cell.text;
    if (decimal_comma) std::ranges::replace(text, '.', ',');
    return "'" + text + "' (line " + std::to_string(cell.line) + ")";
  };
  if (given_ == 0) return;
  // In millimetres "3,001" is out of reach, in metres "978" is, where it is no code for "no echo".
  if (grouped_ > 0 && ungrouped_ == 0 && short_whole_ > 0 &&
      (scale_ == 1 || (scale_ == 1000 && several_short_))) {
    sink.doubt("Its ranges hold " + quoted(first_grouped_) + " and " + quoted(first_short_) +
               ": these are likely thousands separators, not decimal signs. Write the numbers without "
               "separators (3001), and name the unit with --columns, e.g. --columns time_s,range_mm*360.");
    return;
  }
  const std::uint64_t dropped = words_ + out_of_reach_;
  if (static_cast<double>(dropped) >= most_dropped_share * static_cast<double>(given_)) {
    const Cell& first = words_ > 0 ? first_word_ : first_out_of_reach_;
    sink.doubt(fit::format_fixed(100 * static_cast<double>(dropped) / static_cast<double>(given_), 1) +
               " % of its ranges that are not empty (" + std::to_string(dropped) + " of " +
               std::to_string(given_) + ") are no numbers or lie beyond a lidar's reach (20 mm to 65 m)" +
               (first.line > 0 ? ", as " + quoted(first) : "") +
               ": the unit or the columns are others. Name them with --columns (range_m, x_mm ...).");
    return;
  }
  if (largest_mm_ <= least_largest_mm)
    sink.doubt("Its largest range is " + fit::format_fixed(largest_mm_, 1) +
               " mm, which is no room to measure: the unit is likely another. Name it with --columns "
               "(range_m, x_m ...).");
  if (words_ == 0) return;
  const std::string said = std::to_string(words_) + " of " + std::to_string(given_) +
                           " ranges that are not empty are no numbers and read as no echo; the first is " +
                           quoted(first_word_) + ".";
  if (static_cast<double>(words_) > most_words_share * static_cast<double>(given_))
    sink.doubt(said + " Write them as numbers, or leave the cells of beams without an echo empty.");
  else
    sink.note(said);
}

}  // namespace rig::table_rows
