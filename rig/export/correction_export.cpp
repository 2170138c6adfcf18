// SPDX-License-Identifier: MIT
#include "rig/export/correction_export.hpp"

#include <cmath>
#include <cstdio>

#include "fit/numeric/number_format.hpp"
#include "rig/fitting/correction_source.hpp"
#include "rig/whole_file.hpp"

namespace rig {

using fit::Correction;
using fit::CorrectionTerm;

fit::Correction correction_of(const ExportSource& source) {
  return source.session ? load_correction(source.path, *source.session) : load_correction(source.path);
}

CorrectionExport read_for_export(const ExportSource& source) {
  CorrectionExport out;
  out.correction = correction_of(source);
  if (source.centre) {
    out.centre = load_centre(source.centre->path(), *source.centre);
  } else if (source.session) {
    out.centre = centre_of(*source.session);
  }
  return out;
}

void CorrectionFormat::write(const ExportSource& source, const std::string& output) const {
  write_text(output, text_of(read_for_export(source)));
}

std::string real(double value) {
  std::string digits = fit::format_exactly(value);
  if (digits.find_first_of(".n") == std::string::npos) {
    const auto exponent = digits.find('e');
    digits.insert(exponent == std::string::npos ? digits.size() : exponent, ".0");
  }
  return digits;
}

std::string list(const std::vector<double>& values, const char* between) {
  std::string out;
  for (const double value : values) out += (out.empty() ? "" : between) + real(value);
  return out;
}

namespace {

/// Text from elsewhere inside a comment: it must not end it.
std::string in_comment(std::string text) {
  for (char& c : text)
    if (c == '/' || c == '\n' || c == '\r' || c == '\\') c = ' ';
  return text;
}

std::string rounded(double value) { return fit::format_value(value, 0); }

/// A pair of figures by which a reader sees that the correction arrived whole and with the right sign.
std::string example(const Correction& c) {
  const double middle_mm = c.range ? (c.range->from + c.range->to) / 2 : c.reference_mm;
  const double measured_mm = middle_mm > 0 ? std::round(middle_mm) : 1000;
  const double counts = c.intensity ? std::round((c.intensity->from + c.intensity->to) / 2) : 0;
  char text[160];
  std::snprintf(text, sizeof text, "To check: %.0f mm measured%s become %.3f mm.", measured_mm,
                c.intensity ? (" with " + rounded(counts) + " counts").c_str() : "",
                c.apply(measured_mm, counts).range_mm);
  return text;
}

}  // namespace

std::string headline(const Correction& c, const char* begin) {
  const std::string next = std::string("\n") + begin;
  std::string out = begin;
  out += "Range correction for " + in_comment(c.lidar_model.empty() ? "a lidar" : c.lidar_model) +
         ", serial number " + in_comment(c.lidar_serial.empty() ? "unknown" : c.lidar_serial) +
         ", measured " + in_comment(c.created_utc.empty() ? "at an unknown time" : c.created_utc) +
         ", procedure " + in_comment(c.procedure.empty() ? "unknown" : c.procedure) + ".";
  for (const std::string& hash : c.session_sha256) out += next + "Session SHA-256 " + in_comment(hash);
  if (c.range)
    out += next + "Calibrated from " + rounded(c.range->from) + " to " + rounded(c.range->to) + " mm" +
           (c.intensity ? "," : ".");
  if (c.intensity)
    out += next + (c.range ? "and from " : "Calibrated from ") + rounded(c.intensity->from) + " to " +
           rounded(c.intensity->to) + " counts of intensity.";
  if (c.validity.beam_deg)
    out += next + "Measured with the beams from " + fit::format_value(c.validity.beam_deg->from, 0.01) +
           " to " + fit::format_value(c.validity.beam_deg->to, 0.01) +
           " deg; that it holds for others is assumed (rig fit validation tests it).";
  for (const std::string& note : c.notes) out += next + "Warning: " + in_comment(note);
  out += next + "The error is positive where the lidar measures too far: corrected = measured - error.";
  out += next + example(c);
  out += next + "Written by " + in_comment(c.software) + "; do not edit: calibrate again.";
  return out;
}

const fit::Family& family_of(const CorrectionTerm& term) { return *fit::find_family(term.family); }

std::string with_array(const CorrectionTerm& term, const std::string& expression, const std::string& array) {
  return fit::substitute(expression, family_of(term).coefficients,
                         [&](std::size_t i) { return array + "[" + std::to_string(i) + "]"; });
}

std::string measured_code(const Correction& c, const std::string& prefix) {
  if (c.measured.empty() || c.intensity) return "";
  std::vector<double> mm, from, to;
  for (const Correction::Measured& m : c.measured)
    mm.push_back(m.range_mm), from.push_back(m.from * (1 - Correction::measured_counts)),
        to.push_back(m.to * (1 + Correction::measured_counts));
  const std::string n = std::to_string(mm.size());
  const auto array = [&](const char* name, const std::vector<double>& values) {
    return "static const double " + prefix + name + "[" + n + "] = {" + list(values) + "};\n";
  };
  return "/* The distances of the calibration, and which counts were near those of a surface measured there. "
         "*/\n" +
         array("measured_mm", mm) + array("measured_from", from) + array("measured_to", to) +
         "\nstatic inline int " + prefix +
         "surface_measured(double mm, double counts) {\n"
         "  int i = 1;\n  double share = 0;\n"
         "  if (mm <= " +
         prefix + "measured_mm[0] || " + n + " == 1)\n    return counts >= " + prefix +
         "measured_from[0] && counts <= " + prefix +
         "measured_to[0];\n"
         "  while (i < " +
         n + " - 1 && " + prefix +
         "measured_mm[i] < mm) ++i;\n"
         "  share = (mm - " +
         prefix + "measured_mm[i - 1]) / (" + prefix + "measured_mm[i] - " + prefix +
         "measured_mm[i - 1]);\n  if (share > 1) share = 1;\n"
         "  return counts >= " +
         prefix + "measured_from[i - 1] + share * (" + prefix + "measured_from[i] - " + prefix +
         "measured_from[i - 1]) &&\n         counts <= " + prefix + "measured_to[i - 1] + share * (" +
         prefix + "measured_to[i] - " + prefix + "measured_to[i - 1]);\n}\n\n";
}

std::string zero_of(const CorrectionTerm& term) {
  return real(term.zero_at ? family_of(term).value(term.coefficients, *term.zero_at) : 0);
}

}  // namespace rig
