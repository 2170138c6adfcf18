// SPDX-License-Identifier: MIT
#include "rig/import/table_columns.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <optional>
#include <stdexcept>

#include "fit/numeric/angle.hpp"
#include "rig/text_lines.hpp"

namespace rig {
namespace {

using Holds = TableColumn::Holds;

enum class Dimension { time, length, angle };
struct Unit {
  std::string_view name;
  Dimension dimension;
  double scale;
};
constexpr std::array<Unit, 13> units{{{"ns", Dimension::time, 1},
                                      {"us", Dimension::time, 1e3},
                                      {"ms", Dimension::time, 1e6},
                                      {"sec", Dimension::time, 1e9},
                                      {"s", Dimension::time, 1e9},
                                      {"mm", Dimension::length, 1},
                                      {"cm", Dimension::length, 10},
                                      {"m", Dimension::length, 1000},
                                      {"ft", Dimension::length, 304.8},
                                      {"feet", Dimension::length, 304.8},
                                      {"rad", Dimension::angle, 1},
                                      {"deg", Dimension::angle, fit::rad_per_deg},
                                      {"degrees", Dimension::angle, fit::rad_per_deg}}};

std::string plain(std::string_view name) {
  std::string out;
  for (const char c : trimmed(name)) {
    const auto letter = static_cast<unsigned char>(c);
    if (c == '(' || c == '[' || c == ' ')
      out += '_';
    else if (c != ')' && c != ']' && c != '%' && c != '#')
      out += static_cast<char>(std::tolower(letter));
  }
  while (out.find("__") != std::string::npos) out.erase(out.find("__"), 1);
  while (out.starts_with('_')) out.erase(0, 1);
  while (out.ends_with('_')) out.pop_back();
  return out;
}

/// Takes the unit from the end of the name.
const Unit* take_unit(std::string& base) {
  for (const Unit& unit : units) {
    if (base.size() <= unit.name.size() + 1 || !base.ends_with(unit.name)) continue;
    if (base[base.size() - unit.name.size() - 1] != '_') continue;
    base.resize(base.size() - unit.name.size() - 1);
    return &unit;
  }
  return nullptr;
}

/// Takes a number from the end of the name: "ranges12", "step_12".
bool take_number(std::string& base) {
  const std::size_t before = base.size();
  while (!base.empty() && std::isdigit(static_cast<unsigned char>(base.back()))) base.pop_back();
  const bool taken = base.size() < before;
  if (taken && base.ends_with('_')) base.pop_back();
  return taken;
}

bool is_one_of(std::string_view word, std::initializer_list<std::string_view> words) {
  return std::ranges::find(words, word) != words.end();
}

bool has_word(std::string_view name, std::string_view word) {
  for (const std::string_view piece : split(name, '_'))
    if (piece == word) return true;
  return false;
}

/// A wheel: "left_ticks", "ticks_right", "encoder_l", "left_wheel_rad", "delta_left" ...
bool is_wheel(TableColumn& column, const std::string& base) {
  const bool left = base.starts_with("left") || base.ends_with("left") || has_word(base, "left") ||
                    has_word(base, "l"),
             right = base.starts_with("right") || base.ends_with("right") || has_word(base, "right") ||
                     has_word(base, "r");
  if (left == right || base == "r" || base == "l") return false;
  column.holds = left ? Holds::left_wheel : Holds::right_wheel;
  column.increment = base.starts_with("dleft") || base.starts_with("dright");
  for (const char* word : {"d", "delta", "increment", "inc"})
    column.increment = column.increment || has_word(base, word);
  return true;
}

Holds kind_of(const std::string& base, bool numbered) {
  if (base == "t" || base.starts_with("time") || base.starts_with("stamp") || base.starts_with("host") ||
      base.starts_with("device"))
    return base == "time_increment" ? Holds::beam_time : Holds::time;
  if (is_one_of(base, {"seq", "scan", "scan_id", "scan_seq", "scan_number"})) return Holds::scan;
  if (base == "capture") return Holds::capture;
  if (is_one_of(base, {"angle_min", "first", "first_angle"})) return Holds::first_angle;
  if (is_one_of(base, {"angle_increment", "angle_step"})) return Holds::angle_step;
  if (base == "scan_time") return Holds::scan_time;
  if (is_one_of(base, {"angle_max", "range_min", "range_max", "index", "frame_id", "secs", "nsecs"}))
    return Holds::number;
  if (is_one_of(base, {"angle", "azimuth", "bearing", "beam_angle"})) return Holds::angle;
  if (is_one_of(base, {"range", "ranges", "distance", "distances", "dist", "r"}) ||
      (numbered && base == "step"))
    return Holds::range;
  if (is_one_of(base,
                {"intensity", "intensities", "level", "remission", "quality", "reflectivity", "amplitude"}))
    return Holds::intensity;
  if (is_one_of(base, {"x", "point_x", "pose_x", "px"})) return Holds::x;
  if (is_one_of(base, {"y", "point_y", "pose_y", "py"})) return Holds::y;
  if (is_one_of(base, {"heading", "yaw"})) return Holds::heading;
  if (base == "theta") return Holds::turn;
  return Holds::unknown;
}

std::optional<Dimension> dimension_of(Holds holds) {
  switch (holds) {
    case Holds::time:
    case Holds::scan_time:
    case Holds::beam_time:
      return Dimension::time;
    case Holds::range:
    case Holds::x:
    case Holds::y:
      return Dimension::length;
    case Holds::angle:
    case Holds::heading:
    case Holds::turn:
    case Holds::first_angle:
    case Holds::angle_step:
    case Holds::left_wheel:
    case Holds::right_wheel:
      return Dimension::angle;
    default:
      return std::nullopt;
  }
}

}  // namespace

TableColumn column_of(std::string_view name) {
  TableColumn column;
  column.name = std::string(trimmed(name));
  if (column.name == "-") {
    column.holds = Holds::nothing;
    return column;
  }
  std::string base = plain(name);
  // As `rostopic echo -p` writes: every value in metres, radians and, of times, nanoseconds.
  const bool of_ros = base.starts_with("field.") || name.starts_with("%time");
  if (const auto dot = base.rfind('.'); dot != std::string::npos && base.starts_with("field."))
    base.erase(0, dot + 1);
  const Unit* unit = take_unit(base);
  column.preferred = base.starts_with("host") || base == "stamp";
  if (!is_wheel(column, base)) {
    column.numbered = take_number(base);
    column.holds = kind_of(base, column.numbered);
    if (base == "beam") column.holds = unit ? Holds::angle : Holds::number;
  } else {
    column.ticks = !unit;
  }
  const auto dimension = dimension_of(column.holds);
  if (unit && dimension == unit->dimension) {
    column.scale = unit->scale;
    column.unit_known = true;
  } else if (unit) {
    column.holds = Holds::unknown;  // a speed, a length of something else
  } else if (of_ros && dimension) {
    column.scale = dimension == Dimension::length ? 1000 : 1;
    if (column.holds == Holds::scan_time || column.holds == Holds::beam_time) column.scale = 1e9;
    column.unit_known = true;
  }
  return column;
}

std::vector<TableColumn> columns_of(const std::vector<std::string>& names, std::size_t cells) {
  std::vector<TableColumn> columns;
  for (std::size_t i = 0; i < names.size(); ++i) {
    std::string name(trimmed(names[i]));
    std::size_t count = 1;
    if (const auto star = name.find('*'); star != std::string::npos) {
      const std::string times = name.substr(star + 1);
      name.resize(star);
      const std::size_t others = names.size() - i - 1 + columns.size();
      count = cells > others ? cells - others : 0;
      const auto [end, error] = std::from_chars(times.data(), times.data() + times.size(), count);
      const bool number = error == std::errc() && end == times.data() + times.size();
      if ((!times.empty() && !number) || count > 100'000)
        throw std::invalid_argument("--columns: '" + names[i] + "' is not understood: NAME*3 means three");
    }
    TableColumn column = column_of(name);
    if (column.holds == Holds::unknown)
      throw std::invalid_argument(
          "--columns: '" + name +
          "' is not a column that rig knows. The columns are: time, scan, angle, range, intensity, x, y, "
          "heading, "
          "left, "
          "right, left_ticks, right_ticks (and, of those since the row before, left_increment_ticks ...), "
          "'-' "
          "for one to pass over; units at the end: _s _ms _us _ns, _m _cm _mm _ft, _rad _deg");
    if (count > 1) column.numbered = true;
    columns.insert(columns.end(), count, column);
  }
  return columns;
}

}  // namespace rig
