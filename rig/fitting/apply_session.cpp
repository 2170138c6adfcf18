// SPDX-License-Identifier: MIT
#include "rig/fitting/apply_session.hpp"

#include <SQLiteCpp/SQLiteCpp.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "fit/echo.hpp"
#include "fit/numeric/angle.hpp"
#include "fit/numeric/number_format.hpp"
#include "fit/recording.hpp"
#include "rig/errors.hpp"
#include "rig/session/lidar_identity.hpp"
#include "rig/session/new_session.hpp"
#include "rig/session/session_file.hpp"
#include "rig/session/session_store.hpp"

namespace rig {
namespace {

/// Says how many beams point elsewhere than those that the correction was measured with; empty if none does.
std::string beams_outside(const SessionStore& session, const fit::Correction& correction) {
  if (!correction.validity.beam_deg) return "";
  const auto [from, to] = *correction.validity.beam_deg;
  const auto recording = session.recording();
  long all = 0, outside = 0;
  for (const fit::CaptureInfo& capture : recording->captures()) {
    const std::optional<fit::ScanGeometry> none;
    const fit::BeamAngles angles(recording->bench().lidar, capture, none);
    for (int k = 0; k < capture.beams(); ++k, ++all) {
      const double deg = angles.at_rad(static_cast<std::size_t>(k)) * fit::deg_per_rad;
      outside += deg < from || deg > to;
    }
  }
  if (outside == 0) return "";
  return fit::format_value(100.0 * static_cast<double>(outside) / static_cast<double>(all), 1) +
         " % of the beams point elsewhere than those with which the correction was measured (" +
         fit::format_value(from, 0.01) + " to " + fit::format_value(to, 0.01) +
         " deg): that it holds for them is assumed. `rig fit validation` tests it";
}

/// Refuses what must not be corrected; returns what the operator should know all the same.
std::vector<std::string> check(const ApplyRequest& request) {
  const SessionStore session(request.input, SessionStore::Mode::read);
  if (session.get("correction"))
    throw UsageError(request.input +
                     " is corrected already; apply corrections to the session as it was measured");
  const LidarMatch match =
      match_lidar(request.correction.lidar_model, request.correction.lidar_serial, lidar_of(session));
  if (match.another && !request.any_lidar)
    throw UsageError(match.says + ". Calibrate that one, or give --any-lidar to use it all the same.");
  std::vector<std::string> warnings;
  if (!match.says.empty()) warnings.push_back(match.says + ".");
  for (const std::string& note : request.correction.notes)
    warnings.push_back("the correction warns: " + note);
  if (const std::string beams = beams_outside(session, request.correction); !beams.empty())
    warnings.push_back(beams);
  return warnings;
}

std::vector<std::uint16_t> values_of(const SQLite::Column& column) {
  std::vector<std::uint16_t> out(static_cast<std::size_t>(column.getBytes()) / 2);
  if (!out.empty()) std::memcpy(out.data(), column.getBlob(), 2 * out.size());
  return out;
}

class Applying {
 public:
  Applying(const ApplyRequest& request, const std::string& output) : request_(request), output_(output) {}

  ApplyReport run() {
    copy_session(request_.input, output_);
    const auto opened = open_for_reading(request_.input);
    SQLite::Database& source = *opened;
    SQLite::Database target(output_, SQLite::OPEN_READWRITE, 5000);
    SQLite::Transaction transaction(target);
    SQLite::Statement scans(source,
                            "SELECT capture, seq, range_mm, intensity FROM scan ORDER BY capture, seq");
    SQLite::Statement update(target, "UPDATE scan SET range_mm = ? WHERE capture = ? AND seq = ?");
    while (scans.executeStep()) {
      auto range = values_of(scans.getColumn(2));
      const auto intensity = values_of(scans.getColumn(3));
      if (request_.correction.intensity && intensity.size() != range.size())
        throw MeasurementError(request_.input +
                               " has scans without intensities, which this correction needs: record them, or "
                               "calibrate distance alone");
      correct(range, intensity);
      update.reset();
      update.bind(1, range.data(), static_cast<int>(2 * range.size()));
      update.bind(2, scans.getColumn(0).getInt64());
      update.bind(3, scans.getColumn(1).getInt64());
      update.exec();
      ++report_.scans;
    }
    target.exec("DELETE FROM result");
    target.exec("DELETE FROM session WHERE key = 'certificates'");  // They are of the ranges as measured.
    transaction.commit();
    report_.mean_error_mm = report_.samples ? sum_ / static_cast<double>(report_.samples) : 0;
    return report_;
  }

 private:
  void correct(std::vector<std::uint16_t>& range, const std::vector<std::uint16_t>& intensity) {
    for (std::size_t k = 0; k < range.size(); ++k) {
      if (range[k] == 0 || range[k] >= fit::first_error_code_mm) {
        ++report_.without_echo;
        continue;
      }
      const auto corrected = request_.correction.apply(range[k], k < intensity.size() ? intensity[k] : 0);
      ++report_.samples;
      report_.outside_range += corrected.range_outside;
      report_.outside_intensity += corrected.intensity_outside;
      sum_ += corrected.error_mm;
      const bool drop = request_.drop_outside && !corrected.inside();
      range[k] = drop ? std::uint16_t{0}
                      : static_cast<std::uint16_t>(
                            std::lround(std::clamp(corrected.range_mm, 1.0, fit::first_error_code_mm - 1.0)));
    }
  }

  const ApplyRequest& request_;
  const std::string& output_;
  ApplyReport report_;
  double sum_ = 0;
};

}  // namespace

ApplyReport apply_to_session(const ApplyRequest& request) {
  ApplyReport report;
  make_session(request.output, [&](const std::string& unfinished) {
    auto warnings = check(request);
    report = Applying(request, unfinished).run();
    report.warnings = std::move(warnings);
    SessionStore session(unfinished, SessionStore::Mode::append);
    session.set("correction", fit::to_json_text(request.correction));
    for (const std::string& warning : report.warnings) session.add_event(0, "warning", warning);
    session.add_event(0, "info",
                      "ranges corrected with " + request.correction_name + ": " +
                          std::to_string(report.samples) + " samples, of which " +
                          std::to_string(report.outside_range) + " outside its distances and " +
                          std::to_string(report.outside_intensity) + " outside its intensities");
    session.finish();
  });
  return report;
}

}  // namespace rig
