// SPDX-License-Identifier: MIT
#include <algorithm>

#include "rig/export/correction_export.hpp"

namespace rig::exporters {
namespace {

using fit::Correction;
using fit::CorrectionTerm;

void cpp_term(std::string& out, const CorrectionTerm& term, const std::string& name) {
  const std::string array = name + "_coefficients", count = std::to_string(term.coefficients.size());
  out += "// " + family_of(term).title + ": " + family_of(term).equation + "\n";
  out += "static const double " + array + "[" + count + "] = {" + list(term.coefficients) + "};\n\n";
  out += "inline double " + name + "_term(double x) {\n  using namespace std;\n";
  out +=
      "  return " + with_array(term, family_of(term).equation, array) + " - (" + zero_of(term) + ");\n}\n\n";
  out += "inline void " + name + "_derivatives(double x, double* d) {\n  using namespace std;\n  (void)x;\n";
  for (std::size_t i = 0; i < term.coefficients.size(); ++i)
    out +=
        "  d[" + std::to_string(i) + "] = " + with_array(term, family_of(term).derivatives[i], array) + ";\n";
  out += "}\n\n";
}

/// Adds a term's derivatives to the gradient, counted from where the term is 0.
std::string cpp_gradient(const CorrectionTerm& term, const std::string& name, std::size_t first) {
  const std::string count = std::to_string(term.coefficients.size()), at = std::to_string(first);
  std::string out = "  " + name + "_derivatives(x, gradient + " + at + ");\n";
  if (term.zero_at)
    out += "  {\n    double zero[" + count + "];\n    " + name + "_derivatives(" + real(*term.zero_at) +
           ", zero);\n" + "    for (int i = 0; i < " + count + "; ++i) gradient[" + at +
           " + i] -= zero[i];\n  }\n";
  return out;
}

std::string cpp_factor(const Correction& c) {
  std::string out = "static const double covariance_factor[" + std::to_string(c.factor.rows()) + "][" +
                    std::to_string(std::max<Eigen::Index>(1, c.factor.cols())) + "] = {\n";
  for (Eigen::Index i = 0; i < c.factor.rows(); ++i) {
    std::vector<double> row;
    for (Eigen::Index j = 0; j < c.factor.cols(); ++j) row.push_back(c.factor(i, j));
    if (row.empty()) row.push_back(0);
    out += "    {" + list(row) + "},\n";
  }
  return out + "};\n\n";
}

std::string cpp_correct(const Correction& c) {
  const std::string rows = std::to_string(c.factor.rows()),
                    columns = std::to_string(std::max<Eigen::Index>(1, c.factor.cols()));
  std::string out =
      "struct Corrected {\n"
      "  double range_mm;         ///< Corrected.\n"
      "  double u_mm;             ///< Standard uncertainty of the correction; a single range has its own "
      "noise in addition.\n"
      "  bool range_outside;      ///< Not calibrated at this distance: the error at the border was "
      "subtracted.\n"
      "  bool intensity_outside;  ///< The same for the echo's intensity.\n"
      "  bool inside() const { return !range_outside && !intensity_outside; }\n};\n\n"
      "inline double hold(double x, double from, double to) { return x >= from ? (x <= to ? x : to) : from; "
      "}\n\n"
      "/// Millimetres and counts in. Lidars without intensity pass 0 where it is not used.\n"
      "inline Corrected correct(double measured_mm, double intensity) {\n"
      "  Corrected out = {measured_mm, 0, false, false};\n"
      "  double gradient[" +
      rows + "] = {1}, error = " + real(c.zero_mm.value) + ", x = 0;\n";
  std::size_t first = 1;
  if (c.intensity) {
    out += "  x = hold(intensity, " + real(c.intensity->from) + ", " + real(c.intensity->to) + ");\n" +
           "  out.intensity_outside = !(intensity >= " + real(c.intensity->lowest()) +
           " && intensity <= " + real(c.intensity->highest()) + ");\n  error += intensity_term(x);\n" +
           cpp_gradient(*c.intensity, "intensity", first);
    first += c.intensity->coefficients.size();
  } else {
    out += "  (void)intensity;\n";
  }
  if (c.range)
    out += "  x = hold(measured_mm - error, " + real(c.range->from) + ", " + real(c.range->to) + ");\n" +
           "  out.range_outside = !(measured_mm - error >= " + real(c.range->lowest()) +
           " && measured_mm - error <= " + real(c.range->highest()) + ");\n" +
           cpp_gradient(*c.range, "distance", first) + "  error += distance_term(x);\n";
  else
    out += "  (void)x;\n";
  out += "  double variance = " + real(c.common_u_mm) + " * " + real(c.common_u_mm) +
         ";\n  for (int j = 0; j < " + columns + "; ++j) {\n    double part = 0;\n    for (int i = 0; i < " +
         rows +
         "; ++i) part += gradient[i] * covariance_factor[i][j];\n    variance += part * part;\n  }\n"
         "  out.range_mm = measured_mm - error;\n  out.u_mm = std::sqrt(variance);\n";
  if (!c.measured.empty() && !c.range)
    out += "  out.range_outside = !(out.range_mm >= " +
           real(c.measured.front().range_mm * (1 - Correction::measured_distances)) +
           " && out.range_mm <= " + real(c.measured.back().range_mm * (1 + Correction::measured_distances)) +
           ");\n";
  if (!c.measured.empty() && !c.intensity)
    out += "  out.intensity_outside = !surface_measured(out.range_mm, intensity);\n";
  out += "  return out;\n}\n\n";
  return out;
}

/// The same as in C with uncertainty.
std::string cpp_header(const CorrectionExport& what) {
  const Correction& c = what.correction;
  std::string out = headline(c, "// ") +
                    "\n#ifndef LIDAR_RANGE_CORRECTION_HPP\n#define LIDAR_RANGE_CORRECTION_HPP\n\n#include "
                    "<cmath>\n\nnamespace lidar_range {\n\n";
  out += measured_code(c, "");
  if (c.intensity) cpp_term(out, *c.intensity, "intensity");
  if (c.range) cpp_term(out, *c.range, "distance");
  out += "// Covariance of zero and coefficients = covariance_factor * its transpose.\n" + cpp_factor(c) +
         cpp_correct(c);
  out += std::string("// Rotation centre in the lidar's frame, mm") +
         (what.centre ? "" : ": not calibrated in this session; rig export --centre takes it from another") +
         ".\n";
  out += "static const double centre_mm[2] = {" + real(what.centre_or_origin().x()) + ", " +
         real(what.centre_or_origin().y()) + "};\n\n";
  out +=
      "struct Point {\n  double x_mm, y_mm;\n};\n\n"
      "/// Where a corrected range lies in the map, for a lidar at `mount` on a robot that turns about "
      "`centre`: the centre is a\n"
      "/// vector of the lidar's frame and turns with it (Zhao et al., equations 13 and 17, corrected). "
      "Radians.\n"
      "inline Point to_map(double corrected_mm, double beam_rad, Point mount, Point centre, Point robot, "
      "double heading_rad) {\n"
      "  const double x = corrected_mm * std::cos(beam_rad) + mount.x_mm - centre.x_mm;\n"
      "  const double y = corrected_mm * std::sin(beam_rad) + mount.y_mm - centre.y_mm;\n"
      "  const double c = std::cos(heading_rad), s = std::sin(heading_rad);\n"
      "  const Point out = {c * x - s * y + robot.x_mm, s * x + c * y + robot.y_mm};\n  return out;\n}\n\n"
      "}  // namespace lidar_range\n\n#endif\n";
  return out;
}

class CppHeader : public CorrectionFormat {
 public:
  bool takes_centre() const override { return true; }
  std::string format() const override { return "cpp-header"; }
  std::string describes() const override {
    return "a range correction as a C++11 header without dependencies, with uncertainty";
  }

 private:
  std::string text_of(const CorrectionExport& what) const override { return cpp_header(what); }
};

}  // namespace

std::unique_ptr<Exporter> make_cpp_header() { return std::make_unique<CppHeader>(); }

}  // namespace rig::exporters
