// SPDX-License-Identifier: MIT
// One row a moment: wheels, poses, or both.
#include <array>

#include "rig/import/table_rows.hpp"
#include "rig/import/wheel_counter.hpp"

namespace rig::table_rows {
namespace {

class LogRows : public Rows {
 public:
  explicit LogRows(const Table& table)
      : Rows(table),
        time_(table, table.find(Holds::time)),
        x_(table.find(Holds::x)),
        y_(table.find(Holds::y)),
        heading_(table.find(Holds::heading) >= 0 ? table.find(Holds::heading) : table.find(Holds::turn)),
        left_(table.find(Holds::left_wheel)),
        right_(table.find(Holds::right_wheel)),
        left_counter_(counter(left_)),
        right_counter_(counter(right_)) {
    if (!time_.present())
      table.ask("it holds wheels or poses without their times.",
                "Name the columns: --columns time_s,left_ticks,right_ticks.");
    for (const int index : {x_, y_})
      if (index >= 0 && !table.column(index).unit_known)
        table.ask("column '" + table.column(index).name + "' does not say its unit.",
                  "Name the columns: --columns time_s,x_m,y_m,heading_rad,left_ticks,right_ticks.");
    if (heading_ >= 0 && !table.column(heading_).unit_known)
      table.ask(
          "column '" + table.column(heading_).name + "' does not say whether it holds degrees or radians.",
          "Name the columns: --columns time_s,x_m,y_m,heading_rad (or heading_deg).");
  }

  void row(const Cells& cells) override {
    const auto stamp = time_.ns(cells);
    const auto x = table_.scaled(cells, x_), y = table_.scaled(cells, y_),
               heading = table_.scaled(cells, heading_);
    const auto left = table_.scaled(cells, left_), right = table_.scaled(cells, right_);
    // Exports of several things in one table leave cells empty, also all of ours.
    if (stamp && std::ranges::all_of(std::array{x_, y_, heading_, left_, right_},
                                     [&](int index) { return is_empty(cells, index); }))
      return;
    const bool wheels = left && right, placed = x && y && (heading || heading_ < 0);
    ++rows_;
    if (!stamp || (!wheels && !placed)) {
      leave_out(stamp ? "neither both wheels nor a pose" : "the time is no number");
      return;
    }
    fit::TrackPose pose;
    if (placed) pose.x_mm = x, pose.y_mm = y, pose.heading_rad = heading;
    if (wheels) {
      pose.wheel_left_rad = left_counter_.angle(*left);
      pose.wheel_right_rad = right_counter_.angle(*right);
    }
    backwards_ += last_ && *stamp <= *last_ ? 1 : 0;
    last_ = stamp;
    table_.sink.pose(static_cast<std::int64_t>(*stamp), wheels ? "wheels" : "poses", "", pose);
  }

  void end() override {
    if (backwards_ > 0)
      table_.sink.note(std::to_string(backwards_) + " rows carry a time that is not after the one before.");
    if (left_counter_.overflows() + right_counter_.overflows() > 0)
      table_.sink.note("The encoders' counts overflowed " +
                       std::to_string(left_counter_.overflows() + right_counter_.overflows()) +
                       " times (16 bits): they were unwrapped.");
    report_left_out(rows_);
  }

 private:
  static bool is_empty(const Cells& cells, int index) {
    return index < 0 || (static_cast<std::size_t>(index) < cells.size() &&
                         trimmed(cells[static_cast<std::size_t>(index)]).empty());
  }
  [[nodiscard]] WheelCounter counter(int index) const {
    if (index < 0) return WheelCounter(1, false);
    const TableColumn& column = table_.column(index);
    if (!column.ticks) return WheelCounter(2 * fit::pi, column.increment);
    if (!table_.options.ticks_a_turn)
      table_.ask(
          "it counts the wheels in ticks and does not say how many make one turn.",
          "Give --ticks-a-turn, the gear included: 64 counts a turn of the motor and a gear of 43.7 are "
          "2796.8; or name columns left_rad,right_rad with --columns.");
    if (*table_.options.ticks_a_turn < 1)
      throw UsageError(
          "--ticks-a-turn " + fit::format_fixed(*table_.options.ticks_a_turn, 3) +
          " is less than one count in a turn of the wheel, which no encoder has. Give the counts "
          "in one turn, the gear included.");
    return WheelCounter(*table_.options.ticks_a_turn, column.increment);
  }

  Times time_;
  int x_, y_, heading_, left_, right_;
  WheelCounter left_counter_, right_counter_;
  std::optional<double> last_;
  std::uint64_t rows_ = 0, backwards_ = 0;
};

}  // namespace

std::unique_ptr<Rows> make_log_rows(const Table& table) { return std::make_unique<LogRows>(table); }

}  // namespace rig::table_rows
