// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "fit/range/correction.hpp"
#include "fit/range/family.hpp"
#include "rig/export/exporter.hpp"

namespace rig {

/// What the correction formats are made from: a correction file, or a session with a range calibration.
struct CorrectionExport {
  fit::Correction correction;
  std::optional<Eigen::Vector2d> centre;  ///< Of rotation, mm in the lidar's frame, if a session knows it.
  [[nodiscard]] Eigen::Vector2d centre_or_origin() const { return centre.value_or(Eigen::Vector2d(0, 0)); }
};
[[nodiscard]] fit::Correction correction_of(const ExportSource& source);
[[nodiscard]] CorrectionExport read_for_export(const ExportSource& source);

/// A format of `rig export` that is a text made from a correction; its file in rig/export/formats makes it.
class CorrectionFormat : public Exporter {
 public:
  bool accepts_files() const final { return true; }
  bool of_correction() const final { return true; }
  void write(const ExportSource& source, const std::string& output) const final;

 private:
  [[nodiscard]] virtual std::string text_of(const CorrectionExport& what) const = 0;
};

// What their texts have in common.

/// All digits, and recognisable as a real number in C, C++ and YAML.
[[nodiscard]] std::string real(double value);
[[nodiscard]] std::string list(const std::vector<double>& values, const char* between = ", ");
/// What was calibrated, when, and from what, as comments: each line begins with `begin`.
[[nodiscard]] std::string headline(const fit::Correction& correction, const char* begin);
[[nodiscard]] const fit::Family& family_of(const fit::CorrectionTerm& term);
/// The equation or a derivative with its coefficients taken from the array `name`.
[[nodiscard]] std::string with_array(const fit::CorrectionTerm& term, const std::string& expression,
                                     const std::string& array);
/// C of the function PREFIXsurface_measured(mm, counts) and its tables, for Correction::surface_measured();
/// empty where nothing was stated, or the correction has a term of intensity instead.
[[nodiscard]] std::string measured_code(const fit::Correction& correction, const std::string& prefix);
/// The term's value where it counts from.
[[nodiscard]] std::string zero_of(const fit::CorrectionTerm& term);

}  // namespace rig
