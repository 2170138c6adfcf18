// SPDX-License-Identifier: MIT
#include "rig/export/correction_export.hpp"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "fit/family.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/correction_source.hpp"

namespace rig {
namespace {

using fit::Correction;
using fit::CorrectionTerm;

/// All digits, and recognisable as a real number in C, C++ and YAML.
std::string real(double value) {
  char out[40];
  std::snprintf(out, sizeof out, "%.17g", value);
  std::string digits = out;
  if (digits.find_first_of(".n") == std::string::npos) {
    const auto exponent = digits.find('e');
    digits.insert(exponent == std::string::npos ? digits.size() : exponent, ".0");
  }
  return digits;
}

std::string list(const std::vector<double>& values, const char* between = ", ") {
  std::string out;
  for (const double value : values) out += (out.empty() ? "" : between) + real(value);
  return out;
}

/// Text from elsewhere inside a comment: it must not end it.
std::string in_comment(std::string text) {
  for (char& c : text)
    if (c == '/' || c == '\n' || c == '\r' || c == '\\') c = ' ';
  return text;
}

std::string headline(const Correction& c, const char* begin) {
  const std::string next = std::string("\n") + begin;
  std::string out = begin;
  out += "Range correction for " + in_comment(c.lidar_model.empty() ? "a lidar" : c.lidar_model) +
         ", serial number " + in_comment(c.lidar_serial.empty() ? "unknown" : c.lidar_serial) +
         ", measured " + in_comment(c.created_utc.empty() ? "at an unknown time" : c.created_utc) +
         ", procedure " + in_comment(c.procedure.empty() ? "unknown" : c.procedure) + ".";
  for (const std::string& hash : c.session_sha256) out += next + "Session SHA-256 " + in_comment(hash);
  if (c.range)
    out += next + "Calibrated from " + real(c.range->from) + " to " + real(c.range->to) + " mm" +
           (c.intensity ? "," : ".");
  if (c.intensity)
    out += next + (c.range ? "and from " : "Calibrated from ") + real(c.intensity->from) + " to " +
           real(c.intensity->to) + " counts of intensity.";
  out += next + "Written by " + in_comment(c.software) + "; do not edit: calibrate again.";
  return out;
}

const fit::Family& family_of(const CorrectionTerm& term) { return *fit::find_family(term.family); }

/// The equation or a derivative with its coefficients taken from the array `name`.
std::string with_array(const CorrectionTerm& term, const std::string& expression, const std::string& array) {
  return fit::substitute(expression, family_of(term).coefficients,
                         [&](std::size_t i) { return array + "[" + std::to_string(i) + "]"; });
}

std::string zero_of(const CorrectionTerm& term) {
  return real(term.zero_at ? family_of(term).value(term.coefficients, *term.zero_at) : 0);
}

void c_term(std::string& out, const CorrectionTerm& term, const std::string& name) {
  const std::string array = "lidar_range_" + name + "_coefficients";
  out += "/* " + family_of(term).title + ": " + family_of(term).equation + " */\n";
  out += "static const double " + array + "[" + std::to_string(term.coefficients.size()) + "] = {" +
         list(term.coefficients) + "};\n\n";
  out += "static inline double lidar_range_" + name + "_term(double x) {\n";
  out +=
      "  return " + with_array(term, family_of(term).equation, array) + " - (" + zero_of(term) + ");\n}\n\n";
}

}  // namespace

CorrectionExport read_for_export(const ExportSource& source) {
  CorrectionExport out;
  if (!source.session) {
    out.correction = load_correction(source.path);
    return out;
  }
  out.correction = load_correction(source.path, *source.session);
  const auto centre =
      nlohmann::json::parse(source.session->latest_result("centre").value_or("null"), nullptr, false);
  if (!centre.is_object()) return out;
  for (const auto& value : centre.value("values", nlohmann::json::array())) {
    if (!value.is_object() || !value.contains("value") || !value.at("value").is_number()) continue;
    if (value.value("name", "") == "centre_x_mm")
      out.centre.x_mm = value.at("value").get<double>(), out.centre.calibrated = true;
    if (value.value("name", "") == "centre_y_mm") out.centre.y_mm = value.at("value").get<double>();
  }
  return out;
}

std::string c_header(const CorrectionExport& what) {
  const Correction& c = what.correction;
  std::string out = headline(c, "/* ");
  // One comment a line.
  for (std::size_t at = out.find('\n'); at != std::string::npos; at = out.find('\n', at + 4))
    out.insert(at, " */");
  out += " */\n#ifndef LIDAR_RANGE_CORRECTION_H\n#define LIDAR_RANGE_CORRECTION_H\n\n#include <math.h>\n\n";
  out +=
      "/* What lidar_range_correct() returns, added up. Outside, the error at the border is subtracted. */\n"
      "enum {\n  LIDAR_RANGE_INSIDE = 0,\n  LIDAR_RANGE_OUTSIDE_DISTANCE = 1,\n  "
      "LIDAR_RANGE_OUTSIDE_INTENSITY = 2\n};\n\n";
  if (c.intensity) c_term(out, *c.intensity, "intensity");
  if (c.range) c_term(out, *c.range, "distance");
  out +=
      "static inline double lidar_range_hold(double x, double from, double to) {\n"
      "  return x >= from ? (x <= to ? x : to) : from;\n}\n\n";
  out +=
      "/* Millimetres and counts in, corrected millimetres out. Lidars without intensity pass 0 where it is "
      "not used. */\n"
      "static inline int lidar_range_correct(double measured_mm, double intensity, double* corrected_mm) {\n"
      "  double error = " +
      real(c.zero_mm.value) + ", x = 0;\n  int state = LIDAR_RANGE_INSIDE;\n";
  if (c.intensity) {
    const std::string bounds = real(c.intensity->from) + ", " + real(c.intensity->to);
    out += "  x = lidar_range_hold(intensity, " + bounds +
           ");\n  if (x != intensity) state |= LIDAR_RANGE_OUTSIDE_INTENSITY;\n" +
           "  error += lidar_range_intensity_term(x);\n";
  } else {
    out += "  (void)intensity;\n";
  }
  if (c.range)
    out += "  x = lidar_range_hold(measured_mm - error, " + real(c.range->from) + ", " + real(c.range->to) +
           ");\n  if (x != measured_mm - error) state |= LIDAR_RANGE_OUTSIDE_DISTANCE;\n"
           "  error += lidar_range_distance_term(x);\n";
  else
    out += "  (void)x;\n";
  out += "  *corrected_mm = measured_mm - error;\n  return state;\n}\n\n";
  out += std::string("/* Rotation centre in the lidar's frame, mm") +
         (what.centre.calibrated ? "" : ": not calibrated in this session") + ". */\n";
  out += "static const double lidar_range_centre_mm[2] = {" + real(what.centre.x_mm) + ", " +
         real(what.centre.y_mm) + "};\n\n";
  out +=
      "/* Where a corrected range lies in the map, for a lidar at mount_mm on a robot that turns about "
      "centre_mm: the centre is\n"
      " * a vector of the lidar's frame and turns with it (Zhao et al., equations 13 and 17, corrected). "
      "Radians. */\n"
      "static inline void lidar_range_to_map(double corrected_mm, double beam_rad, const double "
      "mount_mm[2],\n"
      "                                      const double centre_mm[2], double robot_x_mm, double "
      "robot_y_mm,\n"
      "                                      double heading_rad, double map_mm[2]) {\n"
      "  const double x = corrected_mm * cos(beam_rad) + mount_mm[0] - centre_mm[0];\n"
      "  const double y = corrected_mm * sin(beam_rad) + mount_mm[1] - centre_mm[1];\n"
      "  map_mm[0] = cos(heading_rad) * x - sin(heading_rad) * y + robot_x_mm;\n"
      "  map_mm[1] = sin(heading_rad) * x + cos(heading_rad) * y + robot_y_mm;\n}\n\n#endif\n";
  return out;
}

namespace {

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
      "noise besides.\n"
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
           "  out.intensity_outside = x != intensity;\n  error += intensity_term(x);\n" +
           cpp_gradient(*c.intensity, "intensity", first);
    first += c.intensity->coefficients.size();
  } else {
    out += "  (void)intensity;\n";
  }
  if (c.range)
    out += "  x = hold(measured_mm - error, " + real(c.range->from) + ", " + real(c.range->to) + ");\n" +
           "  out.range_outside = x != measured_mm - error;\n" + cpp_gradient(*c.range, "distance", first) +
           "  error += distance_term(x);\n";
  else
    out += "  (void)x;\n";
  out += "  double variance = " + real(c.common_u_mm) + " * " + real(c.common_u_mm) +
         ";\n  for (int j = 0; j < " + columns + "; ++j) {\n    double part = 0;\n    for (int i = 0; i < " +
         rows +
         "; ++i) part += gradient[i] * covariance_factor[i][j];\n    variance += part * part;\n  }\n"
         "  out.range_mm = measured_mm - error;\n  out.u_mm = std::sqrt(variance);\n  return out;\n}\n\n";
  return out;
}

}  // namespace

std::string cpp_header(const CorrectionExport& what) {
  const Correction& c = what.correction;
  std::string out = headline(c, "// ") +
                    "\n#ifndef LIDAR_RANGE_CORRECTION_HPP\n#define LIDAR_RANGE_CORRECTION_HPP\n\n#include "
                    "<cmath>\n\nnamespace lidar_range {\n\n";
  if (c.intensity) cpp_term(out, *c.intensity, "intensity");
  if (c.range) cpp_term(out, *c.range, "distance");
  out += "// Covariance of zero and coefficients = covariance_factor * its transpose.\n" + cpp_factor(c) +
         cpp_correct(c);
  out += std::string("// Rotation centre in the lidar's frame, mm") +
         (what.centre.calibrated ? "" : ": not calibrated in this session") + ".\n";
  out += "static const double centre_mm[2] = {" + real(what.centre.x_mm) + ", " + real(what.centre.y_mm) +
         "};\n\n";
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

std::string csv_table(const Correction& c) {
  std::string out = "range_mm,intensity,corrected_mm,u_mm\n";
  const auto steps = [](const std::optional<CorrectionTerm>& term, int most) {
    std::vector<double> at;
    if (!term) return std::vector<double>{0};
    const int n = term->to > term->from ? most : 0;
    for (int i = 0; i <= n; ++i) at.push_back(n ? term->from + (term->to - term->from) * i / n : term->from);
    return at;
  };
  std::vector<double> ranges = steps(c.range, 200);
  if (!c.range) ranges = {c.reference_mm > 0 ? c.reference_mm : 1000};
  for (const double range : ranges)
    for (const double counts : steps(c.intensity, 100)) {
      // Listed by what the lidar shows: the argument of the range term is what remains after the intensity
      // term.
      const double shown = range + c.zero_mm.value + (c.intensity ? c.intensity->value(counts) : 0);
      out += real(shown) + "," + (c.intensity ? real(counts) : "") + "," +
             real(c.apply(shown, counts).range_mm) + "," + real(c.u(shown, counts)) + "\n";
    }
  return out;
}

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
           "\n        to: " + real(t->to) + "\n        has_zero: " + (t->zero_at ? "true" : "false") +
           "\n        zero_at: " + real(t->zero_at.value_or(0)) + "\n";
  };
  term(c.intensity, "intensity");
  term(c.range, "distance");
  std::vector<double> flat;
  for (Eigen::Index i = 0; i < c.factor.rows(); ++i)
    for (Eigen::Index j = 0; j < c.factor.cols(); ++j) flat.push_back(c.factor(i, j));
  out += "      covariance_factor_columns: " + std::to_string(c.factor.cols()) +
         "\n      covariance_factor: [" + list(flat) + "]\n";
  out += "      centre_calibrated: " + std::string(what.centre.calibrated ? "true" : "false") +
         "\n      centre_mm: [" + real(what.centre.x_mm) + ", " + real(what.centre.y_mm) + "]\n";
  return out;
}

void write_text(const std::string& output, const std::string& text) {
  std::ofstream file(output, std::ios::binary);
  if (!file) throw UsageError("cannot write " + output + ": no such folder, or no permission");
  file << text;
  file.close();
  if (!file) throw MeasurementError("writing " + output + " failed: is the disk full?");
}

}  // namespace rig
