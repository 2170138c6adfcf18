// SPDX-License-Identifier: MIT
#include "rig/report/certificate_page.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <kainjow/mustache.hpp>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <regex>

#include "fit/explain/explanation.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/json_fields.hpp"
#include "rig/report/plot.hpp"
#include "rig/report/shown_numbers.hpp"

namespace rig {

extern const char* const certificate_template;

namespace {

using json = nlohmann::json;
namespace mustache = kainjow::mustache;

/// JSON to what the template engine reads. Empty arrays and nulls are false there.
mustache::data to_mustache(const json& value) {
  if (value.is_object()) {
    mustache::data object;
    for (const auto& [key, part] : value.items()) object.set(key, to_mustache(part));
    return object;
  }
  if (value.is_array()) {
    mustache::data list{mustache::data::type::list};
    for (const json& part : value) list.push_back(to_mustache(part));
    return list;
  }
  if (value.is_boolean())
    return value.get<bool>() ? mustache::data{mustache::data::type::bool_true}
                             : mustache::data{mustache::data::type::bool_false};
  if (value.is_null()) return mustache::data{mustache::data::type::bool_false};
  return mustache::data{value.is_string() ? value.get<std::string>() : value.dump()};
}

const std::map<std::string, std::string>& section_titles() {
  static const std::map<std::string, std::string> titles = {
      {"sensitivity", "Angular sensitivity at an edge"},
      {"centre", "Rotation centre"},
      {"range", "Range calibration"},
      {"range-intensity", "Range error against intensity"},
      {"range-distance", "Range error against distance"},
      {"validation", "Validation: as found and as left"},
      {"wall", "Right-angle wall calibration"},
      {"odometry", "Odometry and lidar pose"},
      {"deskew", "Motion distortion"},
      {"noise", "Noise as recorded"},
  };
  return titles;
}

/// Tables that are longer than a reader of results wants to pass stand at the end; here stands where. `annex`
/// gains them.
void move_to_annex(json& section, json& annex) {
  constexpr std::size_t rows_of_a_result = 8;
  json kept = json::array(), places = json::array();
  for (json& table : section["tables"]) {
    if (table["rows"].size() <= rows_of_a_result) {
      kept.push_back(std::move(table));
      continue;
    }
    table["number"] = "T" + std::to_string(annex.size() + 1);
    places.push_back({{"number", table["number"]},
                      {"title", table["title"]},
                      {"rows", std::to_string(table["rows"].size())}});
    table["section"] = section["title"];
    annex.push_back(std::move(table));
  }
  section["tables"] = std::move(kept);
  section["in_annex"] = std::move(places);
}

/// Of a certificate with one result all values with their uncertainty stand in front already.
void leave_to_headline(json& section) {
  json kept = json::array();
  for (json& value : section["values"])
    if (value.at("expanded").get<std::string>().empty()) kept.push_back(std::move(value));
  section["values"] = std::move(kept);
  section["has_values"] = !section["values"].empty();
}

/// A picture of axes alone says nothing.
bool has_points(const json& plot) {
  const json series = list_of(plot, "series");
  return std::any_of(series.begin(), series.end(),
                     [](const json& each) { return !list_of(each, "x").empty(); });
}

json shown_section(const std::string& kind, const json& result) {
  const auto known = section_titles().find(kind);
  json section = {{"title", text_of(result, "title", known == section_titles().end() ? kind : known->second)},
                  {"method", text_of(result, "method")},
                  {"values", json::array()},
                  {"plots", json::array()},
                  {"tables", json::array()},
                  {"comparisons", json::array()},
                  {"use", list_of(result, "use")},
                  {"notes", list_of(result, "notes")},
                  {"undetermined", list_of(result, "undetermined")}};
  for (const json& value : list_of(result, "values")) section["values"].push_back(shown_value(value));
  for (const json& plot : list_of(result, "plots"))
    if (has_points(plot))
      section["plots"].push_back(
          {{"svg", to_svg(plot_from_json(plot))}, {"map", plot.value("equal_axes", false)}});
  for (const json& table : list_of(result, "tables"))
    if (!list_of(table, "rows").empty()) section["tables"].push_back(shown_table(table));
  for (const json& comparison : list_of(result, "comparisons"))
    section["comparisons"].push_back(
        {{"verdict", comparison.value("agree", true) ? "Two methods agree." : "Two methods do not agree."},
         {"says", text_of(comparison, "says")}});
  section["has_values"] = !section["values"].empty();
  return section;
}

/// The quantity's unit by the input's; none where both are the same.
std::string unit_of_sensitivity(const std::string& unit, const std::string& input_unit) {
  if (unit == input_unit) return "";
  if (input_unit.empty()) return unit;
  return (unit.empty() ? "1" : unit) + "/" + input_unit;
}

/// The budgets of a result, a table for each quantity.
void add_budgets(json& budgets, const json& result) {
  std::string before;
  for (const json& row : list_of(result, "budget")) {
    const std::string quantity = text_of(row, "quantity");
    if (budgets.empty() || quantity != before || before.empty())
      budgets.push_back({{"label", text_of(row, "label", text_of(row, "source"))}, {"rows", json::array()}});
    before = quantity;
    const bool sum = text_of(row, "kind") == "combined";
    const double nu = number_of(row, "nu"), input = number_of(row, "input_u");
    const std::string unit = text_of(row, "unit");
    json shown = {{"source", text_of(row, "source")},
                  {"kind", sum ? "" : text_of(row, "kind")},
                  {"distribution", text_of(row, "distribution")},
                  {"input", std::isfinite(input) && !sum
                                ? fit::with_unit(fit::format_uncertainty(input), text_of(row, "input_unit"))
                                : ""},
                  {"sensitivity", std::isfinite(number_of(row, "sensitivity"))
                                      ? fit::with_unit(fit::format_value(number_of(row, "sensitivity"), 0),
                                                       unit_of_sensitivity(unit, text_of(row, "input_unit")))
                                      : ""},
                  {"nu", !row.contains("quantity")       ? ""
                         : std::isfinite(nu) && nu < 1e5 ? fit::format_fixed(nu, 0)
                                                         : "\u221e"},
                  {"u", fit::format_uncertainty(number_of(row, "u"))},
                  {"unit", unit},
                  {"sum", sum}};
    if (sum)
      shown["source"] =
          "combined; U = " + fit::with_unit(fit::format_uncertainty(number_of(row, "U")), unit) +
          " with k = " + fit::format_fixed(number_of(row, "k", 2), 2);
    budgets.back()["rows"].push_back(std::move(shown));
  }
}

json shown_explanation(const json& explanation) {
  json out = {{"verdict", verdict_in_words(explanation)},
              {"mechanisms", json::array()},
              {"undecided", json::array()},
              {"next", text_of(explanation, "next_experiment")}};
  for (const json& found : list_of(explanation, "mechanisms")) {
    char probability[32];
    std::snprintf(probability, sizeof probability, "%.3f", number_of(found, "probability"));
    out["mechanisms"].push_back({{"name", text_of(found, "mechanism")},
                                 {"probability", probability},
                                 {"says", text_of(found, "says")}});
  }
  for (const json& set : list_of(explanation, "undecided_between")) {
    std::vector<std::string> suspects;
    for (const json& name : set) suspects.push_back(name.is_string() ? name.get<std::string>() : name.dump());
    out["undecided"].push_back(fit::explain::listed(fit::explain::suspects_in_words(suspects), "or"));
  }
  const json fit = explanation.value("fit", json::object());
  if (fit.contains("rms_before_mm")) {
    char text[256];
    std::snprintf(
        text, sizeof text, "Residual rms before %.2f mm, after %.2f mm; noise floor %.2f mm (held-out data).",
        number_of(fit, "rms_before_mm"), number_of(fit, "rms_after_mm"), number_of(fit, "noise_floor_mm"));
    out["fit"] = text;
  }
  return out;
}

json shown_checks(const json& limits) {
  json checks = json::array();
  for (const json& check : list_of(limits, "checks")) {
    const double expanded = number_of(check, "U", 0);
    const double low = number_of(check, "min"), high = number_of(check, "max");
    const std::string unit = text_of(check, "unit");
    std::string range;
    if (std::isfinite(low) && std::isfinite(high))
      range = fit::format_value(low, 0) + " to " + fit::with_unit(fit::format_value(high, 0), unit);
    else if (std::isfinite(low))
      range = "at least " + fit::with_unit(fit::format_value(low, 0), unit);
    else if (std::isfinite(high))
      range = "at most " + fit::with_unit(fit::format_value(high, 0), unit);
    if (const double widest = number_of(check, "max_U"); std::isfinite(widest))
      range += (range.empty() ? "U at most " : "; U at most ") +
               fit::with_unit(fit::format_value(widest, 0), unit);
    checks.push_back(
        {{"name", text_of(check, "label", text_of(check, "name"))},
         {"value", fit::format_value(number_of(check, "value"), expanded)},
         {"unit", unit},
         {"expanded", expanded > 0 ? fit::with_unit(fit::format_uncertainty(expanded), unit) : ""},
         {"limits", range},
         {"verdict", text_of(check, "verdict", "inconclusive")},
         {"reason", text_of(check, "reason")}});
  }
  return checks;
}

json overall_verdict(const json& checks) {
  if (checks.empty()) return nullptr;
  int failed = 0, open = 0;
  for (const json& check : checks) {
    failed += check.at("verdict") == "fail";
    open += check.at("verdict") != "fail" && check.at("verdict") != "pass";
  }
  if (failed > 0)
    return {
        {"class", "fail"},
        {"word", "FAIL"},
        {"text", std::to_string(failed) + " of " + std::to_string(checks.size()) + " requirements not met"}};
  if (open > 0)
    return {
        {"class", "inconclusive"},
        {"word", "INCONCLUSIVE"},
        {"text", std::to_string(open) + " of " + std::to_string(checks.size()) + " requirements undecided"}};
  return {{"class", "pass"},
          {"word", "PASS"},
          {"text", "all " + std::to_string(checks.size()) + " requirements met"}};
}

std::string shown_time(std::int64_t host_us) {
  char text[64];
  const double s = static_cast<double>(host_us) / 1e6;
  std::snprintf(text, sizeof text, "%d:%02d:%04.1f", static_cast<int>(s / 3600),
                static_cast<int>(std::fmod(s / 60, 60)), std::fmod(s, 60));
  return text;
}

/// Every "2026-05-04T10:00:00Z" in a text as people write it: "2026-05-04 10:00 UTC".
std::string readable_utc(const std::string& text) {
  static const std::regex iso(R"((\d{4}-\d\d-\d\d)T(\d\d:\d\d):\d\dZ)");
  return std::regex_replace(text, iso, "$1 $2 UTC");
}

/// What simple acceptance means to one who does not know the guideline.
std::string rule_in_words(const std::string& rule) {
  if (!rule.starts_with("simple acceptance")) return "";
  return "A value passes when it lies within its limit. Its uncertainty is stated but does not narrow the "
         "limit: the true value of a result near the limit may lie beyond it.";
}

/// The certificate's date is that of the measurement; without one it says so rather than another.
std::string shown_date(const json& certificate) {
  const std::string imported = text_of(certificate, "imported_utc");
  if (imported.empty())
    return readable_utc(text_of(certificate, "measured_utc", text_of(certificate, "created_utc")));
  const std::string known =
      readable_utc(text_of(certificate, "measured_utc", text_of(certificate, "measured_local")));
  return (known.empty() ? "at an unknown time" : known) + ", imported " + readable_utc(imported);
}

/// The calibration before, value by value beside the new one.
json shown_previous(const json& previous) {
  json rows = json::array();
  for (const json& v : list_of(previous, "values")) {
    const double expanded = number_of(v, "U", 0), expanded_before = number_of(v, "previous_U", 0);
    const double error = number_of(v, "e_n");
    rows.push_back(
        {{"label", text_of(v, "label")},
         {"value", fit::format_measurement(number_of(v, "value"), expanded, text_of(v, "unit"))},
         {"previous", fit::format_measurement(number_of(v, "previous"), expanded_before, text_of(v, "unit"))},
         {"change", fit::with_unit(fit::format_value(number_of(v, "change"), expanded), text_of(v, "unit"))},
         {"e_n", std::isfinite(error) ? fit::format_fixed(error, 2) : ""},
         {"class", std::abs(error) > 1 ? "fail" : ""}});
  }
  const std::string state = text_of(previous, "item_state");
  return {{"dated", readable_utc(text_of(previous, "measured_utc")) + (state.empty() ? "" : ", " + state)},
          {"session", text_of(previous, "session")},
          {"values", rows}};
}

}  // namespace

std::string to_html(const json& certificate) {
  json page = certificate;
  page["dated"] = shown_date(certificate);
  page["issued"] = readable_utc(text_of(certificate, "issued_utc"));
  for (const char* part : {"identification", "conditions"})
    for (json& row : page[part]) row["text"] = readable_utc(text_of(row, "text"));
  page["no_result"] = list_of(certificate, "results").empty();
  page["hash"] = text_of(certificate, "sha256");
  page["sections"] = json::array();
  json annex = json::array(), budgets = json::array();
  json headline = json::array();
  for (const json& entry : list_of(certificate, "results")) {
    json section = shown_section(text_of(entry, "kind"), entry.value("result", json::object()));
    for (const json& value : section["values"])
      if (!value.at("expanded").get<std::string>().empty()) headline.push_back(value);
    move_to_annex(section, annex);
    add_budgets(budgets, entry.value("result", json::object()));
    page["sections"].push_back(std::move(section));
  }
  if (page["sections"].size() == 1 && !headline.empty()) leave_to_headline(page["sections"].front());
  page["budgets"] = budgets, page["has_budgets"] = !budgets.empty();
  page["has_accuracy"] = !list_of(certificate, "accuracy").empty();
  page["has_equipment"] = !list_of(certificate, "equipment").empty();
  page["reasons"] = list_of(certificate, "not_certified_because");
  page["not_certified"] = !page["reasons"].empty();
  page["kind_of_document"] = certificate.value("certifies", true) ? "certificate" : "report";
  page["authorised_by"] =
      text_of(certificate.value("laboratory", json::object()), "authorised_by", "not stated");
  for (const char* unused : {"laboratory", "as_found", "as_left", "item"}) page.erase(unused);
  if (!annex.empty()) page["annex"] = {{"tables", annex}};
  if (!headline.empty()) page["headline"] = {{"values", headline}};
  const json limits = certificate.value("limits", json::object());
  page["checks"] = shown_checks(limits);
  page["has_checks"] = !page["checks"].empty();
  page["rule"] = text_of(limits, "rule", "simple acceptance (ILAC-G8:09/2019, guard band w = 0)");
  page["rule_in_words"] = rule_in_words(text_of(page, "rule"));
  page["verdict"] = overall_verdict(page["checks"]);
  if (certificate.contains("previous")) page["previous"] = shown_previous(certificate.at("previous"));
  if (certificate.contains("explanation"))
    page["explanation"] = shown_explanation(certificate.at("explanation"));
  for (json& event : page["events"]) event["time"] = shown_time(event.value("host_us", std::int64_t{0}));
  page["has_events"] = !page["events"].empty();
  page.erase("results");
  page.erase("limits");
  mustache::mustache layout{std::string(certificate_template)};
  return layout.render(to_mustache(page));
}

}  // namespace rig
