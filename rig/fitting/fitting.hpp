// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "rig/fitting/fit_option.hpp"
#include "rig/session/session_store.hpp"

namespace rig {

/// What a calibration is made from: a session, or a file of another kind for a calibration that accepts it.
struct FitSource {
  std::string path;
  const SessionStore* session = nullptr;  ///< Null when `path` is not a session file.
};

/// One calibration: `rig fit KIND SESSION...` and the `fit` step of procedures. Each lives in its own file
/// rig/fitting/kinds/NAME.cpp, which defines `std::unique_ptr<rig::Fitting> rig::fittings::make_NAME()`.
class Fitting {
 public:
  virtual ~Fitting() = default;
  [[nodiscard]] virtual std::string kind() const = 0;
  /// One line for --help.
  [[nodiscard]] virtual std::string describes() const = 0;
  /// The names of all values that its results may have, for limits; '*' stands for a whole number.
  [[nodiscard]] virtual std::vector<std::string> values() const = 0;
  /// Every option it knows; run() is given no other.
  [[nodiscard]] virtual std::vector<FitOption> options() const { return {}; }
  /// What a person should know of these options before hours of captures; empty if nothing.
  [[nodiscard]] virtual std::string doubt_about(const FitOptions& /*options*/) const { return ""; }
  /// Throws UsageError where a file that an option names is not there, or does not hold what the option asks
  /// for.
  virtual void check_files(const FitOptions& /*options*/) const {}
  /// True if files that are not sessions are welcome too.
  [[nodiscard]] virtual bool accepts_files() const { return false; }
  /// True if it does not matter that of a cluster of steps the lidar sends the nearest range, which is
  /// shorter than single beams' by about the noise.
  [[nodiscard]] virtual bool accepts_clusters() const { return false; }
  /// The result document (`result/1`, docs/reference/result.md). Throws MeasurementError when the data do not
  /// allow one.
  [[nodiscard]] virtual nlohmann::json run(const std::vector<FitSource>& sources,
                                           const FitOptions& options) const = 0;
};

/// Every calibration there is, in the order of their file names.
[[nodiscard]] const std::vector<std::unique_ptr<Fitting>>& all_fittings();

/// The calibration of that kind. Throws UsageError, with what there is, for an unknown one.
[[nodiscard]] const Fitting& fitting_of(const std::string& kind);

/// Throws the UsageError of run_fit() without running anything, also for files that options name. Options of
/// the value null are not known yet.
void check_fit(const std::string& kind, const nlohmann::json& options);

/// Fitting::doubt_about(). Throws as check_fit().
[[nodiscard]] std::string doubt_about_fit(const std::string& kind, const nlohmann::json& options);

/// Throws UsageError for an unknown kind, and for a value that no result of the kind has.
void check_value(const std::string& kind, const std::string& value);

/// Runs the calibration of that kind with options (an object, or null). Throws UsageError for an unknown kind
/// and for what FitOptions refuses.
[[nodiscard]] nlohmann::json run_fit(const std::string& kind, const std::vector<FitSource>& sources,
                                     const nlohmann::json& options);

/// The result as a table for a terminal.
[[nodiscard]] std::string to_text(const nlohmann::json& result);

}  // namespace rig
