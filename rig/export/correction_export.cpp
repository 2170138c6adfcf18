// SPDX-License-Identifier: MIT
#include "rig/export/correction_export.hpp"

#include <cmath>
#include <cstdio>

#include "fit/number_format.hpp"
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
  write_file_atomically(output, text_of(read_for_export(source)));
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

std::string zero_of(const CorrectionTerm& term) {
  return real(term.zero_at ? family_of(term).value(term.coefficients, *term.zero_at) : 0);
}

}  // namespace rig
