// SPDX-License-Identifier: MIT
#include <nlohmann/json.hpp>

#include "rig/export/correction_export.hpp"

namespace rig::exporters {
namespace {

using fit::Correction;
using fit::CorrectionTerm;

/// A parameter file for any ROS 2 node.
std::string ros2_parameters(const CorrectionExport& what) {
  const Correction& c = what.correction;
  const auto quoted = [](const std::string& text) { return nlohmann::json(text).dump(-1, ' ', true); };
  std::string out = headline(c, "# ") +
                    "\n# error = zero_mm + intensity(I) + distance(measured_mm - zero_mm - intensity(I)); "
                    "each term counts from its value at\n" +
                    "# zero_at (when has_zero); corrected = measured - error. Outside from .. to the "
                    "border's value holds.\n" +
                    "/**:\n  ros__parameters:\n    range_correction:\n      schema: \"correction/1\"\n";
  out += "      lidar_model: " + quoted(c.lidar_model) + "\n      lidar_serial: " + quoted(c.lidar_serial) +
         "\n      measured_utc: " + quoted(c.created_utc) + "\n      zero_mm: " + real(c.zero_mm.value) +
         "\n      common_u_mm: " + real(c.common_u_mm) + "\n";
  const auto term = [&](const std::optional<CorrectionTerm>& t, const char* name) {
    out += std::string("      use_") + name + ": " + (t ? "true" : "false") + "\n";
    if (!t) return;
    std::string names;
    for (const std::string& coefficient : family_of(*t).coefficients)
      names += (names.empty() ? "" : ", ") + quoted(coefficient);
    out += std::string("      ") + name + ":\n        family: " + quoted(t->family) +
           "\n        equation: " + quoted(family_of(*t).equation) + "\n        names: [" + names +
           "]\n        coefficients: [" + list(t->coefficients) + "]\n        from: " + real(t->from) +
           "\n        to: " + real(t->to) + "\n        sample_from: " + real(t->lowest()) +
           "\n        sample_to: " + real(t->highest()) +
           "\n        has_zero: " + (t->zero_at ? "true" : "false") +
           "\n        zero_at: " + real(t->zero_at.value_or(0)) + "\n";
  };
  term(c.intensity, "intensity");
  term(c.range, "distance");
  if (!c.measured.empty()) {
    std::vector<double> mm, from, to;
    for (const Correction::Measured& m : c.measured)
      mm.push_back(m.range_mm), from.push_back(m.from), to.push_back(m.to);
    out += "      measured_range_mm: [" + list(mm) + "]\n      measured_intensity_from: [" + list(from) +
           "]\n      measured_intensity_to: [" + list(to) + "]\n";
  }
  if (!c.notes.empty()) {
    std::string warnings;
    for (const std::string& note : c.notes) warnings += (warnings.empty() ? "" : ", ") + quoted(note);
    out += "      warnings: [" + warnings + "]\n";
  }
  std::vector<double> flat;
  for (Eigen::Index i = 0; i < c.factor.rows(); ++i)
    for (Eigen::Index j = 0; j < c.factor.cols(); ++j) flat.push_back(c.factor(i, j));
  out +=
      "      # Covariance = F F', F row by row; its rows: zero_mm, coefficients of intensity, of distance.\n";
  out += "      covariance_factor_columns: " + std::to_string(c.factor.cols()) +
         "\n      covariance_factor: [" + list(flat) + "]\n";
  out += "      centre_calibrated: " + std::string(what.centre ? "true" : "false") + "\n      centre_mm: [" +
         real(what.centre_or_origin().x()) + ", " + real(what.centre_or_origin().y()) + "]\n";
  return out;
}

class Ros2Parameters : public CorrectionFormat {
 public:
  bool takes_centre() const override { return true; }
  std::string format() const override { return "ros2-parameters"; }
  std::string describes() const override { return "a range correction as a ROS 2 parameter file"; }

 private:
  std::string text_of(const CorrectionExport& what) const override { return ros2_parameters(what); }
};

}  // namespace

std::unique_ptr<Exporter> make_ros2_parameters() { return std::make_unique<Ros2Parameters>(); }

}  // namespace rig::exporters
