// SPDX-License-Identifier: MIT
#include "fit/range/correction.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "fit/bench/json_position.hpp"
#include "fit/range/family.hpp"

namespace fit {
namespace {

using nlohmann::json;

const Family& family_of(const CorrectionTerm& term) {
  const Family* family = find_family(term.family);
  if (!family || family->honest_reference)
    throw std::invalid_argument("there is no equation '" + term.family + "'");
  return *family;
}

struct Held {
  double at;
  bool outside;
};
/// Outside its calibrated range, a term keeps the value of the border.
Held hold(const CorrectionTerm& term, double x) {
  const double at = std::clamp(std::isfinite(x) ? x : term.from, term.from, term.to);
  return {at, !(x >= term.lowest() && x <= term.highest())};
}

json matrix_json(const Eigen::MatrixXd& m) {
  json rows = json::array();
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    json row = json::array();
    for (Eigen::Index j = 0; j < m.cols(); ++j) row.push_back(m(i, j));
    rows.push_back(row);
  }
  return rows;
}

json term_json(const CorrectionTerm& term) {
  const Family& family = family_of(term);
  json coefficients = json::array();
  for (std::size_t i = 0; i < term.coefficients.size(); ++i)
    coefficients.push_back({{"name", family.coefficients[i]}, {"value", term.coefficients[i]}});
  return {{"argument", term.argument == CorrectionTerm::Argument::intensity ? "intensity" : "range_mm"},
          {"family", term.family},
          {"equation", family.equation},
          {"coefficients", coefficients},
          {"from", term.from},
          {"to", term.to},
          {"sample_from", term.lowest()},
          {"sample_to", term.highest()},
          {"zero_at", term.zero_at ? json(*term.zero_at) : json(nullptr)}};
}

struct ValidityMember {
  const char* name;
  std::optional<Validity::Interval> Validity::*interval;
};
constexpr ValidityMember validity_members[] = {{"range_mm", &Validity::range_mm},
                                               {"intensity", &Validity::intensity},
                                               {"beam_deg", &Validity::beam_deg},
                                               {"temperature_c", &Validity::temperature_c}};

json validity_json(const Validity& validity) {
  json out = json::object();
  for (const auto& [name, interval] : validity_members)
    out[name] = validity.*interval
                    ? json{{"from", (validity.*interval)->from}, {"to", (validity.*interval)->to}}
                    : json(nullptr);
  return out;
}

/// Reads members one by one and says where something is wrong.
class CorrectionReader {
 public:
  CorrectionReader(const json& object, std::string path) : object_(object), path_(std::move(path)) {
    if (!object.is_object()) fail("", "must be an object");
  }
  [[noreturn]] void fail(const std::string& key, const std::string& what) const {
    throw std::invalid_argument(path_ + (key.empty() ? "" : "/" + key) + ": " + what +
                                "; write it again with 'rig export SESSION --format correction'");
  }
  [[nodiscard]] double number(const std::string& key) const {
    const auto found = object_.find(key);
    if (found == object_.end() || !found->is_number() || !std::isfinite(found->get<double>()))
      fail(key, "must be a number");
    return found->get<double>();
  }
  /// Of a value; nothing where it is left out.
  [[nodiscard]] double uncertainty(const std::string& key) const {
    const double u = object_.contains(key) ? number(key) : 0;
    if (u < 0) fail(key, "is an uncertainty, which is not negative");
    return u;
  }
  [[nodiscard]] std::string text_or(const std::string& key, const std::string& otherwise) const {
    const auto found = object_.find(key);
    if (found == object_.end() || found->is_null()) return otherwise;
    if (!found->is_string()) fail(key, "must be text");
    return found->get<std::string>();
  }
  [[nodiscard]] const json& member(const std::string& key, bool array) const {
    const auto found = object_.find(key);
    if (found == object_.end() || (array ? !found->is_array() : !found->is_object()))
      fail(key, array ? "must be a list" : "must be an object");
    return *found;
  }
  [[nodiscard]] std::vector<std::string> texts(const std::string& key) const {
    std::vector<std::string> out;
    if (!object_.contains(key)) return out;
    for (const json& item : member(key, true)) {
      if (!item.is_string()) fail(key, "must be a list of texts");
      out.push_back(item.get<std::string>());
    }
    return out;
  }
  [[nodiscard]] bool has(const std::string& key) const {
    return object_.contains(key) && !object_.at(key).is_null();
  }
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  const json& object_;
  std::string path_;
};

Validity read_validity(const CorrectionReader& reader) {
  Validity out;
  for (const auto& [name, interval] : validity_members) {
    if (!reader.has(name)) continue;
    const CorrectionReader item(reader.member(name, false), reader.path() + "/" + name);
    out.*interval = Validity::Interval{item.number("from"), item.number("to")};
    if ((out.*interval)->from > (out.*interval)->to) item.fail("to", "must not be below 'from'");
  }
  return out;
}

CorrectionTerm read_term(const CorrectionReader& reader) {
  CorrectionTerm term;
  const std::string argument = reader.text_or("argument", "");
  if (argument != "intensity" && argument != "range_mm")
    reader.fail("argument", "must be \"intensity\" or \"range_mm\"");
  term.argument =
      argument == "intensity" ? CorrectionTerm::Argument::intensity : CorrectionTerm::Argument::range;
  term.family = reader.text_or("family", "");
  const Family* family = find_family(term.family);
  if (!family || family->honest_reference) {
    std::string known;
    for (const Family& item : all_families())
      if (!item.honest_reference) known += (known.empty() ? "" : ", ") + item.id;
    reader.fail("family", "there is no equation '" + term.family + "'; there are: " + known);
  }
  const json& coefficients = reader.member("coefficients", true);
  if (coefficients.size() != family->coefficients.size())
    reader.fail("coefficients", term.family + " has " + std::to_string(family->coefficients.size()));
  for (std::size_t i = 0; i < coefficients.size(); ++i) {
    const CorrectionReader item(coefficients[i], reader.path() + "/coefficients/" + std::to_string(i));
    if (item.text_or("name", "") != family->coefficients[i])
      item.fail("name", "must be \"" + family->coefficients[i] + "\"");
    term.coefficients.push_back(item.number("value"));
  }
  if (reader.text_or("equation", family->equation) != family->equation)
    reader.fail("equation", "must be \"" + family->equation + "\"");
  term.from = reader.number("from");
  term.to = reader.number("to");
  if (!(term.from <= term.to)) reader.fail("to", "must not be below 'from'");
  if (family->positive_argument && term.from <= 0) reader.fail("from", "must be above 0 for " + term.family);
  for (const auto& [key, border] :
       {std::pair{"sample_from", &term.sample_from}, {"sample_to", &term.sample_to}})
    if (reader.has(key)) *border = reader.number(key);
  if (term.lowest() > term.from) reader.fail("sample_from", "must not be above 'from'");
  if (term.highest() < term.to) reader.fail("sample_to", "must not be below 'to'");
  if (reader.has("zero_at")) term.zero_at = reader.number("zero_at");
  if (term.zero_at && family->positive_argument && *term.zero_at <= 0)
    reader.fail("zero_at", "must be above 0");
  for (int i = 0; i <= 64; ++i)
    if (!std::isfinite(term.value(term.from + (term.to - term.from) * i / 64)))
      reader.fail("coefficients", "the curve is not finite between 'from' and 'to'");
  return term;
}

Eigen::MatrixXd read_factor(const CorrectionReader& reader, std::size_t rows) {
  const json& matrix = reader.member("covariance_factor", true);
  if (matrix.size() != rows) reader.fail("covariance_factor", "must have " + std::to_string(rows) + " rows");
  const std::size_t columns = matrix.empty() || !matrix[0].is_array() ? 0 : matrix[0].size();
  Eigen::MatrixXd out(static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(columns));
  for (std::size_t i = 0; i < rows; ++i) {
    if (!matrix[i].is_array() || matrix[i].size() != columns)
      reader.fail("covariance_factor", "must be a list of rows of equal length");
    for (std::size_t j = 0; j < columns; ++j) {
      if (!matrix[i][j].is_number()) reader.fail("covariance_factor", "must hold numbers");
      out(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = matrix[i][j].get<double>();
    }
  }
  return out;
}

}  // namespace

double CorrectionTerm::value(double x) const {
  const Family& f = family_of(*this);
  return f.value(coefficients, x) - (zero_at ? f.value(coefficients, *zero_at) : 0);
}

std::vector<double> CorrectionTerm::gradient(double x) const {
  const Family& f = family_of(*this);
  std::vector<double> out(coefficients.size()), at_zero(coefficients.size());
  f.gradient(coefficients, x, out);
  if (!zero_at) return out;
  f.gradient(coefficients, *zero_at, at_zero);
  for (std::size_t i = 0; i < out.size(); ++i) out[i] -= at_zero[i];
  return out;
}

Correction::Corrected Correction::apply(double range_mm, double counts) const {
  Corrected out;
  out.error_mm = zero_mm.value;
  if (intensity) {
    const Held held = hold(*intensity, counts);
    out.error_mm += intensity->value(held.at);
    out.intensity_outside = held.outside;
  }
  if (range) {
    const Held held = hold(*range, range_mm - out.error_mm);
    out.error_mm += range->value(held.at);
    out.range_outside = held.outside;
  }
  out.range_mm = range_mm - out.error_mm;
  if (measured.empty()) return out;
  if (!range)
    out.range_outside = !(out.range_mm >= measured.front().range_mm * (1 - measured_distances) &&
                          out.range_mm <= measured.back().range_mm * (1 + measured_distances));
  if (!intensity) out.intensity_outside = !surface_measured(out.range_mm, counts);
  return out;
}

bool Correction::surface_measured(double range_mm, double counts) const {
  if (measured.empty()) return true;
  const auto after = std::ranges::lower_bound(measured, range_mm, {}, &Measured::range_mm);
  const Measured &b = after == measured.end() ? measured.back() : *after,
                 &a = after == measured.begin() ? b : *(after - 1);
  const double share =
      b.range_mm > a.range_mm ? std::clamp((range_mm - a.range_mm) / (b.range_mm - a.range_mm), 0.0, 1.0) : 0;
  return counts >= (a.from + share * (b.from - a.from)) * (1 - measured_counts) &&
         counts <= (a.to + share * (b.to - a.to)) * (1 + measured_counts);
}

double Correction::u(double range_mm, double counts) const {
  Eigen::RowVectorXd gradient = Eigen::RowVectorXd::Zero(factor.rows());
  Eigen::Index at = 0;
  const auto add = [&](const CorrectionTerm& term, double x) {
    for (const double g : term.gradient(hold(term, x).at)) gradient[at++] = g;
  };
  double error = zero_mm.value;
  gradient[at++] = 1;
  if (intensity) {
    add(*intensity, counts);
    error += intensity->value(hold(*intensity, counts).at);
  }
  if (range) add(*range, range_mm - error);
  return std::hypot((gradient * factor).norm(), common_u_mm);
}

std::vector<std::string> Correction::parameter_names() const {
  std::vector<std::string> out = {"zero_mm"};
  for (const auto* term : {&intensity, &range})
    if (*term)
      for (const std::string& name : family_of(**term).coefficients)
        out.push_back((term == &intensity ? "intensity." : "range.") + name);
  return out;
}

std::string to_json_text(const Correction& c) {
  json terms = json::array();
  if (c.intensity) terms.push_back(term_json(*c.intensity));
  if (c.range) terms.push_back(term_json(*c.range));
  json measured = json::array();
  for (const Correction::Measured& m : c.measured)
    measured.push_back({{"range_mm", m.range_mm}, {"intensity_from", m.from}, {"intensity_to", m.to}});
  const json out = {
      {"schema", "correction/1"},
      {"says",
       "corrected = measured - error; error = zero_mm + f_intensity(I) + f_range(measured - zero_mm - "
       "f_intensity(I)); "
       "each f counts from its value at zero_at; outside from .. to the border's value holds"},
      {"lidar", {{"model", c.lidar_model}, {"serial", c.lidar_serial}, {"firmware", c.lidar_firmware}}},
      {"created_utc", c.created_utc},
      {"procedure", c.procedure},
      {"software", c.software},
      {"session_sha256", c.session_sha256},
      {"reference", {{"range_mm", c.reference_mm}, {"intensity", c.reference_intensity}}},
      {"zero_mm", {{"value", c.zero_mm.value}, {"u", c.zero_mm.u}}},
      {"terms", terms},
      {"parameters", c.parameter_names()},
      {"covariance", matrix_json(c.factor * c.factor.transpose())},
      {"covariance_factor", matrix_json(c.factor)},
      {"common_u_mm", c.common_u_mm},
      {"validity", validity_json(c.validity)},
      {"measured", measured},
      {"notes", c.notes}};
  return out.dump(1) + "\n";
}

Correction parse_correction(const std::string& text, const std::string& name) {
  const json document = parse_json(
      text, name, "this is not JSON; a correction is written by 'rig export SESSION --format correction'");
  const CorrectionReader reader(document, name);
  if (reader.text_or("schema", "") != "correction/1")
    reader.fail("schema", "must be \"correction/1\", the version that this program reads");
  Correction c;
  const CorrectionReader lidar(reader.member("lidar", false), name + "/lidar");
  c.lidar_model = lidar.text_or("model", ""), c.lidar_serial = lidar.text_or("serial", "");
  c.lidar_firmware = lidar.text_or("firmware", "");
  c.created_utc = reader.text_or("created_utc", ""), c.procedure = reader.text_or("procedure", "");
  c.software = reader.text_or("software", "");
  c.session_sha256 = reader.texts("session_sha256"), c.notes = reader.texts("notes");
  const CorrectionReader reference(reader.member("reference", false), name + "/reference");
  c.reference_mm = reference.number("range_mm"), c.reference_intensity = reference.number("intensity");
  const CorrectionReader zero(reader.member("zero_mm", false), name + "/zero_mm");
  c.zero_mm = {zero.number("value"), zero.uncertainty("u")};
  c.common_u_mm = reader.uncertainty("common_u_mm");
  if (reader.has("validity"))
    c.validity = read_validity(CorrectionReader(reader.member("validity", false), name + "/validity"));
  if (reader.has("measured")) {
    const json& measured = reader.member("measured", true);
    for (std::size_t i = 0; i < measured.size(); ++i) {
      const CorrectionReader item(measured[i], name + "/measured/" + std::to_string(i));
      c.measured.push_back(
          {item.number("range_mm"), item.number("intensity_from"), item.number("intensity_to")});
      if (c.measured.back().from > c.measured.back().to)
        item.fail("intensity_to", "must not be below 'intensity_from'");
      if (i > 0 && c.measured[i].range_mm < c.measured[i - 1].range_mm)
        item.fail("range_mm", "must not be below the one before");
    }
  }
  const json& terms = reader.member("terms", true);
  for (std::size_t i = 0; i < terms.size(); ++i) {
    const CorrectionReader item(terms[i], name + "/terms/" + std::to_string(i));
    CorrectionTerm term = read_term(item);
    auto& place = term.argument == CorrectionTerm::Argument::intensity ? c.intensity : c.range;
    if (place) item.fail("argument", "occurs twice");
    place = std::move(term);
  }
  c.factor = read_factor(reader, c.parameter_names().size());
  return c;
}

}  // namespace fit
