// SPDX-License-Identifier: MIT
#include "rig/archive/history.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>

#include "fit/bench/json_position.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/errors.hpp"

namespace rig {
namespace {

using nlohmann::json;

constexpr double months_a_year = 12;
constexpr double longest_interval_years = 5, longest_extension = 2;
constexpr double sure_of_drift = 0.01;

json number_or_null(double value) { return std::isfinite(value) ? json(value) : json(); }

std::string key_of(const std::string& model, const std::string& quantity) { return model + "/" + quantity; }

double mean_since(const QuantityHistory& h) {
  double sum = 0;
  for (std::size_t i = h.since_adjustment(); i < h.points.size(); ++i) sum += h.points[i].value->value;
  return sum / static_cast<double>(h.points.size() - h.since_adjustment());
}

/// Standard deviation that the control chart's limits rest on, and who says so.
struct ChartWidth {
  double sigma = 0;
  std::string from;
};

ChartWidth chart_width(const QuantityHistory& h, const Repeatability* archive) {
  if (archive && archive->differences >= enough_differences && archive->sigma > 0)
    return {archive->sigma, "median moving range of " + std::to_string(archive->differences) +
                                " pairs of successive calibrations of this model in the archive"};
  double squares = 0;
  for (const HistoryPoint& p : h.points) squares += p.value->u * p.value->u;
  const double sigma = std::sqrt(squares / static_cast<double>(h.points.size()));
  return {sigma, "the stated uncertainties: the archive has " +
                     std::to_string(archive ? archive->differences : 0) +
                     " pairs of successive calibrations of this model, and " +
                     std::to_string(enough_differences) + " are needed to estimate their repeatability"};
}

json chart_of(const QuantityHistory& h, const Repeatability* archive) {
  const ChartWidth width = chart_width(h, archive);
  if (!(width.sigma > 0)) return nullptr;
  const std::size_t from = h.since_adjustment();
  const double centre = mean_since(h);
  std::vector<double> z;
  for (std::size_t i = from; i < h.points.size(); ++i)
    z.push_back((h.points[i].value->value - centre) / width.sigma);
  json signals = json::array();
  for (const ChartSignal& signal : chart_signals(z)) {
    json at = json::array();
    for (const std::size_t i : signal.points) at.push_back(from + i);
    signals.push_back({{"rule", signal.rule}, {"points", at}});
  }
  return {{"centre", centre},
          {"sigma", width.sigma},
          {"lower", centre - 3 * width.sigma},
          {"upper", centre + 3 * width.sigma},
          {"limits_from", width.from},
          {"signals", signals}};
}

/// The narrowest requirement that the newest session states for the quantity.
std::pair<double, double> required(const QuantityHistory& h) {
  double least = -INFINITY, most = INFINITY;
  for (const ArchivedLimit& limit : h.points.back().session->limits) {
    if (limit.quantity != h.quantity) continue;
    least = std::max(least, limit.min.value_or(-INFINITY));
    most = std::min(most, limit.max.value_or(INFINITY));
  }
  return {least, most};
}

std::string months_in_words(double months) {
  return months < 1 ? "less than a month"
                    : std::to_string(static_cast<int>(months)) + (months < 2 ? " month" : " months");
}

/// When to calibrate again: before what is known of the drift may have used up the room to the requirement,
/// or, without one, the uncertainty of the calibration; never more than twice the interval so far.
json interval_of(const QuantityHistory& h, const Drift& drift) {
  std::vector<double> gaps;
  for (std::size_t i = 1; i < h.points.size(); ++i)
    if (const double gap = h.points[i].years - h.points[i - 1].years; gap > 1e-3) gaps.push_back(gap);
  if (gaps.empty()) return nullptr;
  std::ranges::sort(gaps);
  const double present = gaps[gaps.size() / 2];
  if (drift.degrees_of_freedom <= 0)
    return {{"months", std::round(present * months_a_year)},
            {"present_months", std::round(present * months_a_year)},
            {"why", "unchanged: three calibrations are needed to detect a drift"}};
  const HistoryPoint& newest = h.points.back();
  const double expanded = newest.value->expanded, value = newest.value->value;
  const auto [least, most] = required(h);
  const bool has_requirement = std::isfinite(least) || std::isfinite(most);
  const double until = has_requirement ? years_until(most - value - expanded, value - expanded - least,
                                                     drift.per_year, drift.expanded)
                                       : years_until(expanded, expanded, drift.per_year, drift.expanded);
  const double limit = std::min(longest_extension * present, longest_interval_years);
  const double months = std::floor(std::min(until, limit) * months_a_year + 1e-6);
  std::string why =
      has_requirement
          ? "then the drift may have reached the requirement, with its uncertainty and that of the "
            "calibration"
          : "then the drift may have moved the value by the expanded uncertainty of its calibration";
  if (until > limit)
    why = "no known drift requires less; at most twice the present interval (" +
          months_in_words(std::round(present * months_a_year)) + ") and five years";
  if (months < 1) why += ". That is less than a month: adjust or withdraw the item, or relax the requirement";
  return {{"months", months}, {"present_months", std::round(present * months_a_year)}, {"why", why}};
}

json drift_json(const QuantityHistory& h, const Drift& drift) {
  if (drift.degrees_of_freedom <= 0) return nullptr;
  const double k = fit::coverage_factor(drift.degrees_of_freedom);
  return {{"per_year", drift.per_year},
          {"u", drift.u},
          {"U", drift.expanded},
          {"k", k},
          {"degrees_of_freedom", drift.degrees_of_freedom},
          {"p_value", drift.p_value},
          {"at_first", drift.at_zero},
          {"significant", drift.p_value < sure_of_drift},
          {"calibrations", h.points.size() - h.since_adjustment()}};
}

json points_json(const QuantityHistory& h) {
  json points = json::array();
  for (std::size_t i = 0; i < h.points.size(); ++i) {
    const HistoryPoint& p = h.points[i];
    json point = {{"measured_utc", p.session->measured_utc},
                  {"years", p.years},
                  {"session", p.session->path},
                  {"value", p.value->value},
                  {"u", p.value->u},
                  {"U", p.value->expanded},
                  {"item_state", p.session->item_state}};
    if (i > 0) {
      const ArchivedValue& before = *h.points[i - 1].value;
      point["change"] = p.value->value - before.value;
      point["e_n"] = number_or_null(e_n(p.value->value, p.value->expanded, before.value, before.expanded));
    }
    points.push_back(std::move(point));
  }
  return points;
}

json quantity_json(const QuantityHistory& h, const std::map<std::string, Repeatability>& archive) {
  // Years count from the lidar's own first calibration in the document.
  const Drift drift = drift_of(h, archive);
  const auto [least, most] = required(h);
  return {{"quantity", h.quantity},
          {"label", h.label},
          {"unit", h.unit},
          {"points", points_json(h)},
          {"chart", chart_of(h, repeatability_in(archive, h))},
          {"drift", drift_json(h, drift)},
          {"interval", interval_of(h, drift)},
          {"required", {{"min", number_or_null(least)}, {"max", number_or_null(most)}}}};
}

json session_json(const SessionRecord& r) {
  json out = {{"measured_utc", r.measured_utc}, {"path", r.path},
              {"procedure", r.procedure},       {"bench", r.bench},
              {"item_state", r.item_state},     {"software", r.software},
              {"sha256", r.content_sha256},     {"simulated", r.simulated}};
  if (r.explanation) out["explanation"] = r.explanation->verdict;
  return out;
}

}  // namespace

std::size_t QuantityHistory::since_adjustment() const {
  std::size_t from = 0;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (points[i].is_adjusted) from = i;
  return from;
}

std::vector<QuantityHistory> histories_of(std::span<const SessionRecord> archive) {
  double first_s = INFINITY;
  for (const SessionRecord& r : archive)
    if (const auto s = seconds_of_utc(r.measured_utc)) first_s = std::min(first_s, *s);
  std::map<std::pair<std::string, std::string>, QuantityHistory> all;
  for (const SessionRecord& r : archive) {
    const auto seconds = seconds_of_utc(r.measured_utc);
    if (!seconds || r.serial.empty()) continue;
    for (const ArchivedValue& v : r.values) {
      if (!(v.expanded > 0)) continue;  // A figure beside the results, with no claim of its own.
      QuantityHistory& h = all[{r.serial, v.quantity()}];
      h.serial = r.serial, h.model = r.model, h.quantity = v.quantity(), h.label = v.label, h.unit = v.unit;
      // A session that states a quantity twice has its last word.
      if (!h.points.empty() && h.points.back().session == &r) h.points.pop_back();
      h.points.push_back({&r, &v, (*seconds - first_s) / seconds_a_year, r.item_state == "as left"});
    }
  }
  std::vector<QuantityHistory> out;
  for (auto& [key, h] : all) {
    std::ranges::stable_sort(h.points, {}, &HistoryPoint::years);
    out.push_back(std::move(h));
  }
  return out;
}

std::map<std::string, Repeatability> repeatabilities_of(std::span<const QuantityHistory> histories) {
  std::map<std::string, std::vector<double>> differences;
  for (const QuantityHistory& h : histories)
    for (std::size_t i = 1; i < h.points.size(); ++i)
      if (!h.points[i].is_adjusted)
        differences[key_of(h.model, h.quantity)].push_back(h.points[i].value->value -
                                                           h.points[i - 1].value->value);
  std::map<std::string, Repeatability> out;
  for (auto& [key, list] : differences) out[key] = repeatability_of(std::move(list));
  return out;
}

const Repeatability* repeatability_in(const std::map<std::string, Repeatability>& all,
                                      const QuantityHistory& h) {
  const auto found = all.find(key_of(h.model, h.quantity));
  return found == all.end() ? nullptr : &found->second;
}

Drift drift_of(const QuantityHistory& h, const std::map<std::string, Repeatability>& archive) {
  std::vector<double> years, values;
  for (std::size_t i = h.since_adjustment(); i < h.points.size(); ++i) {
    years.push_back(h.points[i].years);
    values.push_back(h.points[i].value->value);
  }
  const Repeatability* r = repeatability_in(archive, h);
  const bool is_known = r && r->differences >= enough_differences;
  return drift_of(years, values, is_known ? r->sigma : 0, is_known ? r->degrees_of_freedom() : 0);
}

json history_of(std::span<const SessionRecord> archive, const std::string& serial) {
  std::vector<std::string> serials;
  json sessions = json::array(), notes = json::array(), quantities = json::array();
  std::string model;
  int undated = 0;
  for (const SessionRecord& r : archive) {
    serials.push_back(r.serial);
    if (r.serial != serial) continue;
    model = r.model;
    sessions.push_back(session_json(r));
    if (!seconds_of_utc(r.measured_utc)) ++undated;
  }
  if (sessions.empty()) {
    std::erase(serials, "");
    std::ranges::sort(serials);
    serials.erase(std::unique(serials.begin(), serials.end()), serials.end());
    throw UsageError("the archive has no session of a lidar '" + serial + "'" +
                     fit::ending_with_guess(fit::nearest_word(serial, serials)) +
                     " `rig archive list` shows them all.");
  }
  if (undated > 0)
    notes.push_back(std::to_string(undated) +
                    " of its sessions have no date and are left out of every chart.");
  const auto histories = histories_of(archive);
  const auto repeat = repeatabilities_of(histories);
  for (const QuantityHistory& h : histories)
    if (h.serial == serial) quantities.push_back(quantity_json(h, repeat));
  if (quantities.empty()) notes.push_back("None of its sessions holds a result: there is nothing to draw.");
  json months = nullptr;
  std::string by;
  for (const json& q : quantities) {
    const json& interval = q.at("interval");
    if (interval.is_null() || (!months.is_null() && interval.at("months") >= months)) continue;
    months = interval.at("months");
    by = q.at("label");
  }
  return {
      {"schema", "history/1"}, {"serial", serial},         {"model", model},
      {"sessions", sessions},  {"quantities", quantities}, {"recommended", {{"months", months}, {"by", by}}},
      {"notes", notes}};
}

json previous_calibration(std::span<const SessionRecord> archive, const SessionRecord& session) {
  const SessionRecord* previous = nullptr;
  const auto now = seconds_of_utc(session.measured_utc);
  const auto shares = [&](const SessionRecord& r) {
    return std::ranges::any_of(r.values, [&](const ArchivedValue& v) {
      return v.expanded > 0 && std::ranges::any_of(session.values, [&](const ArchivedValue& own) {
               return own.expanded > 0 && own.quantity() == v.quantity();
             });
    });
  };
  for (const SessionRecord& r : archive) {
    const auto when = seconds_of_utc(r.measured_utc);
    if (r.serial.empty() || r.serial != session.serial || r.content_sha256 == session.content_sha256)
      continue;
    if (!now || !when || *when >= *now || !shares(r)) continue;
    if (!previous || *when > *seconds_of_utc(previous->measured_utc)) previous = &r;
  }
  if (!previous) return nullptr;
  json values = json::array();
  for (const ArchivedValue& v : session.values)
    for (const ArchivedValue& before : previous->values)
      if (before.quantity() == v.quantity() && v.expanded > 0 && before.expanded > 0)
        values.push_back({{"quantity", v.quantity()},
                          {"label", v.label},
                          {"unit", v.unit},
                          {"value", v.value},
                          {"U", v.expanded},
                          {"previous", before.value},
                          {"previous_U", before.expanded},
                          {"change", v.value - before.value},
                          {"e_n", number_or_null(e_n(v.value, v.expanded, before.value, before.expanded))}});
  return {{"schema", "previous/1"},
          {"measured_utc", previous->measured_utc},
          {"session", previous->path},
          {"sha256", previous->content_sha256},
          {"item_state", previous->item_state},
          {"values", values}};
}

}  // namespace rig
