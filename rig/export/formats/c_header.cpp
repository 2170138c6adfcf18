// SPDX-License-Identifier: MIT
#include "rig/export/correction_export.hpp"

namespace rig::exporters {
namespace {

using fit::Correction;
using fit::CorrectionTerm;

void c_term(std::string& out, const CorrectionTerm& term, const std::string& name) {
  const std::string array = "lidar_range_" + name + "_coefficients";
  out += "/* " + family_of(term).title + ": " + family_of(term).equation + " */\n";
  out += "static const double " + array + "[" + std::to_string(term.coefficients.size()) + "] = {" +
         list(term.coefficients) + "};\n\n";
  out += "static inline double lidar_range_" + name + "_term(double x) {\n";
  out +=
      "  return " + with_array(term, family_of(term).equation, array) + " - (" + zero_of(term) + ");\n}\n\n";
}

/// Error, correction, state flags, equations 13/17 of source A (docs/reference/correction.md).
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
  out += measured_code(c, "lidar_range_");
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
           ");\n  if (!(intensity >= " + real(c.intensity->lowest()) +
           " && intensity <= " + real(c.intensity->highest()) +
           ")) state |= LIDAR_RANGE_OUTSIDE_INTENSITY;\n" + "  error += lidar_range_intensity_term(x);\n";
  } else {
    out += "  (void)intensity;\n";
  }
  if (c.range)
    out += "  x = lidar_range_hold(measured_mm - error, " + real(c.range->from) + ", " + real(c.range->to) +
           ");\n  if (!(measured_mm - error >= " + real(c.range->lowest()) +
           " && measured_mm - error <= " + real(c.range->highest()) +
           ")) state |= LIDAR_RANGE_OUTSIDE_DISTANCE;\n"
           "  error += lidar_range_distance_term(x);\n";
  else
    out += "  (void)x;\n";
  out += "  *corrected_mm = measured_mm - error;\n";
  if (!c.measured.empty() && !c.range)
    out += "  if (!(*corrected_mm >= " +
           real(c.measured.front().range_mm * (1 - Correction::measured_distances)) +
           " && *corrected_mm <= " + real(c.measured.back().range_mm * (1 + Correction::measured_distances)) +
           ")) state |= LIDAR_RANGE_OUTSIDE_DISTANCE;\n";
  if (!c.measured.empty() && !c.intensity)
    out +=
        "  if (!lidar_range_surface_measured(*corrected_mm, intensity)) state |= "
        "LIDAR_RANGE_OUTSIDE_INTENSITY;\n";
  out += "  return state;\n}\n\n";
  out += std::string("/* Rotation centre in the lidar's frame, mm") +
         (what.centre ? "" : ": not calibrated in this session; rig export --centre takes it from another") +
         ". */\n";
  out += "static const double lidar_range_centre_mm[2] = {" + real(what.centre_or_origin().x()) + ", " +
         real(what.centre_or_origin().y()) + "};\n\n";
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

class CHeader : public CorrectionFormat {
 public:
  bool takes_centre() const override { return true; }
  std::string format() const override { return "c-header"; }
  std::string describes() const override { return "a range correction as a C99 header without dependencies"; }

 private:
  std::string text_of(const CorrectionExport& what) const override { return c_header(what); }
};

}  // namespace

std::unique_ptr<Exporter> make_c_header() { return std::make_unique<CHeader>(); }

}  // namespace rig::exporters
