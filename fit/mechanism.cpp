// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "fit/find_by_id.hpp"
#include "fit/numeric/number_format.hpp"

namespace fit::mechanisms {
std::vector<Mechanism> all();
}

namespace fit {

Displacement& Displacement::operator+=(const Displacement& other) {
  out_mm += other.out_mm;
  turn_rad += other.turn_rad;
  aside_mm += other.aside_mm;
  thicker_mm += other.thicker_mm;
  return *this;
}

Effect& Effect::operator+=(const Effect& other) {
  range_mm += other.range_mm;
  beam_rad += other.beam_rad;
  stage_rad += other.stage_rad;
  origin_mm += other.origin_mm;
  variance_mm2 += other.variance_mm2;
  scan_angle_variance_rad2 += other.scan_angle_variance_rad2;
  beam_angle_variance_rad2 += other.beam_angle_variance_rad2;
  scan_range_variance_mm2 += other.scan_range_variance_mm2;
  own_range_variance_mm2 += other.own_range_variance_mm2;
  shared_by_neighbours += other.shared_by_neighbours;
  if (other.ar1_share > ar1_share) {
    ar1_share = other.ar1_share;
    ar1_rho = other.ar1_rho;
  }
  lost = 1 - (1 - lost) * (1 - other.lost);
  stray = 1 - (1 - stray) * (1 - other.stray);
  late = 1 - (1 - late) * (1 - other.late);
  early = 1 - (1 - early) * (1 - other.early);
  footprint_rad = std::hypot(footprint_rad, other.footprint_rad);
  light_rad = std::hypot(light_rad, other.light_rad);
  output_step_mm = std::max(output_step_mm, other.output_step_mm);
  log_echo += other.log_echo;
  log_intensity += other.log_intensity;
  return *this;
}

const char* name_of(Observable observable) {
  switch (observable) {
    case Observable::range_mean:
      return "range-mean";
    case Observable::range_variance:
      return "range-variance";
    case Observable::range_distribution:
      return "range-distribution";
    case Observable::intensity:
      return "intensity";
    case Observable::dropout:
      return "dropout";
    case Observable::time_correlation:
      return "time-correlation";
  }
  return "";
}

const char* name_of(Coordinate coordinate) {
  static const char* const names[] = {"beam_deg",      "stage_deg",         "range_mm",   "intensity",
                                      "incidence_deg", "edge_distance_deg", "time_s",     "temperature_c",
                                      "approach",      "stage_rate_deg_s",  "range_rate", "scan_seq",
                                      "target"};
  return names[static_cast<int>(coordinate)];
}

const char* unit_of(Coordinate coordinate) {
  static const char* const units[] = {" deg", " deg", " mm",    " counts", " deg", " deg", " s",
                                      " K",   "",     " deg/s", " mm/rad", "",     ""};
  return units[static_cast<int>(coordinate)];
}

Estimate Finding::at(const std::string& name) const {
  const auto found = parameters.find(name);
  return found == parameters.end() ? Estimate{} : found->second;
}

Parameter Parameter::expecting(double that) const {
  Parameter p = *this;
  p.expected = that;
  return p;
}

Parameter Parameter::generalising(double that) const {
  Parameter p = expecting(that);
  p.generalises = true;
  return p;
}

Parameter Parameter::on(Scale that) const {
  Parameter p = *this;
  p.scale = that;
  return p;
}

Parameter log_shape(std::string name, double lower, double upper, int starts) {
  return {.name = std::move(name),
          .role = Parameter::Role::shape,
          .lower = lower,
          .upper = upper,
          .starts = starts};
}

Parameter even_shape(std::string name, double lower, double upper, int starts) {
  Parameter p = log_shape(std::move(name), lower, upper, starts);
  p.logarithmic = false;
  return p;
}

namespace {

constexpr double ever_s = 1e12;  // as good as always

Parameter time_of(const char* name, double expected_s) {
  return {.name = name, .role = Parameter::Role::shape, .expected = expected_s, .logarithmic = false};
}

}  // namespace

Parameter begins_at() { return time_of("from_s", -ever_s).on(Parameter::Scale::from); }
Parameter ends_at() { return time_of("to_s", ever_s); }

bool Mechanism::happened_once(std::span<const double> values) const {
  const auto from = parameter_of(Parameter::Scale::from);
  return parameter_of(Parameter::Scale::moment) ||
         (from && (values[*from] > -ever_s || values[*from + 1] < ever_s));
}

double Parameter::left_out() const {
  return role == Role::shape && expected == 0 ? std::clamp(0.0, lower, upper) : expected;
}

double Parameter::u_left_out() const {
  if (!generalises || scale == Scale::choice) return 0;
  const auto in = [this](double value) { return logarithmic ? std::log(value) : value; };
  const double plain = left_out(), span = in(upper)-in(lower),
               to_middle = (in(upper) + in(lower)) / 2 - in(plain),
               u = std::sqrt((span * span / 12 + to_middle * to_middle) / 2);
  return logarithmic ? plain * u : u;
}

std::vector<double> Mechanism::values(const std::map<std::string, Estimate>& given) const {
  std::vector<double> list;
  for (const Parameter& parameter : parameters) {
    const auto found = given.find(parameter.name);
    if (found != given.end())
      list.push_back(found->second.value);
    else
      list.push_back(parameter.left_out());
  }
  return list;
}

std::optional<std::size_t> Mechanism::parameter_of(Parameter::Scale scale) const {
  const auto found = std::ranges::find(parameters, scale, &Parameter::scale);
  if (found == parameters.end()) return {};
  return static_cast<std::size_t>(found - parameters.begin());
}

const std::vector<Mechanism>& catalogue() {
  static const std::vector<Mechanism> mechanisms = mechanisms::all();
  return mechanisms;
}

const Mechanism* find_mechanism(const std::string& id) { return find_by_id(catalogue(), id); }

std::string rounded(double value, int digits) {
  char text[40];
  const double size = std::abs(value), unit = std::pow(10, std::floor(std::log10(size)) + 1 - digits),
               shown = std::round(value / unit) * unit;
  if (size >= 1 && std::abs(shown) >= std::pow(10, digits) && size < 1e6)  // no powers of ten for people
    std::snprintf(text, sizeof text, "%.0f", shown);
  else
    std::snprintf(text, sizeof text, "%.*g", digits, value);
  return text;
}

std::string with_uncertainty(const Estimate& estimate, const std::string& unit) {
  constexpr double coverage_factor = 2;
  return format_measurement(estimate.value, coverage_factor * estimate.u, unit);
}

}  // namespace fit
