// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "rig/archive/control_chart.hpp"
#include "rig/archive/session_record.hpp"

namespace rig {

/// One calibration of one quantity of one lidar.
struct HistoryPoint {
  const SessionRecord* session = nullptr;
  const ArchivedValue* value = nullptr;
  double years = 0;          ///< Since the archive's first session with a date.
  bool is_adjusted = false;  ///< As left: what was before it is another item.
};

/// The calibrations of one quantity of one lidar, by date.
struct QuantityHistory {
  std::string serial, model, quantity, label, unit;
  std::vector<HistoryPoint> points;
  /// Where the points since the last adjustment begin.
  [[nodiscard]] std::size_t since_adjustment() const;
};

/// All histories that sessions tell of, by serial number and quantity. Sessions without serial number or date
/// have none, nor have values without a stated uncertainty. The records must outlive them.
[[nodiscard]] std::vector<QuantityHistory> histories_of(std::span<const SessionRecord> archive);

/// How well every quantity repeats, by model and quantity ("UST-10LX/range.offset_mm"), from all lidars of an
/// archive: successive calibrations without an adjustment in between.
[[nodiscard]] std::map<std::string, Repeatability> repeatabilities_of(
    std::span<const QuantityHistory> histories);
[[nodiscard]] const Repeatability* repeatability_in(const std::map<std::string, Repeatability>& all,
                                                    const QuantityHistory& history);

/// A repeatability with fewer differences than these is not the archive's word.
inline constexpr std::size_t enough_differences = 12;

/// The drift since the last adjustment, by the archive's repeatability where that is known.
[[nodiscard]] Drift drift_of(const QuantityHistory& history,
                             const std::map<std::string, Repeatability>& archive);

/// `history/1` (docs/operate/laboratory.md): everything that `rig history` says of one lidar. Throws
/// UsageError: the archive has no such lidar.
[[nodiscard]] nlohmann::json history_of(std::span<const SessionRecord> archive, const std::string& serial);

/// The calibration before one of the same lidar, for its certificate: `previous/1`, or null if there is none
/// with a quantity in common.
[[nodiscard]] nlohmann::json previous_calibration(std::span<const SessionRecord> archive,
                                                  const SessionRecord& session);

/// The page of a history.
[[nodiscard]] std::string history_html(const nlohmann::json& history);

}  // namespace rig
