// SPDX-License-Identifier: MIT
#include "rig/investigate/prediction_file.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"

namespace rig::investigate {
namespace {

using fit::explain::Forecast;
using nlohmann::json;

/// To a thousandth: nobody measures finer, and the file stays small.
double thousandths(double value) { return std::round(1000 * value) / 1000; }

json capture_json(const fit::CaptureInfo& c) {
  json j = {{"stage_deg", thousandths(c.stage_rad * fit::deg_per_rad)}};
  if (fit::is_turning(c)) j["stage_rate_deg_s"] = thousandths(c.stage_rate_rad_s * fit::deg_per_rad);
  if (c.target) j["target"] = *c.target, j["target_shift_mm"] = c.target_shift_mm;
  if (c.reflectance) j["reflectance"] = *c.reflectance;
  if (c.temperature_c) j["temperature_c"] = *c.temperature_c;
  return j;
}

}  // namespace

std::vector<fit::CaptureInfo> after(const std::vector<fit::CaptureInfo>& so_far,
                                    std::vector<fit::CaptureInfo> planned) {
  constexpr double apart_s = 5;  // a move, and its scans
  std::int64_t latest_us = 0;
  std::optional<double> on_since_s;  // on the sessions' clock
  for (const fit::CaptureInfo& c : so_far) {
    latest_us = std::max(latest_us, c.started_us);
    if (c.since_power_on_s) on_since_s = static_cast<double>(c.started_us) * 1e-6 - *c.since_power_on_s;
  }
  for (fit::CaptureInfo& c : planned) {
    latest_us += static_cast<std::int64_t>(apart_s * 1e6);
    c.started_us = latest_us;
    if (on_since_s) c.since_power_on_s = static_cast<double>(latest_us) * 1e-6 - *on_since_s;
  }
  return planned;
}

json prediction_document(const fit::explain::Explanation& found, const std::vector<fit::CaptureInfo>& planned,
                         const Forecast& forecast, const std::string& title) {
  json says = json::array();
  for (const auto& mechanism : found.mechanisms)
    says.push_back(mechanism.mechanism->id + ": " + mechanism.says);
  for (const auto& set : found.undecided_between)
    says.push_back("One of " + fit::explain::listed(fit::explain::suspects_in_words(set), "or") + ".");
  if (found.unknown) says.push_back("Unknown physics: " + found.unknown->describes + ".");
  json captures = json::array();
  for (const fit::CaptureInfo& c : planned) captures.push_back(capture_json(c));
  std::vector<int> capture;
  std::vector<double> beam, range, u, sd, incidence;
  for (const fit::explain::PredictedBeam& b : forecast.beams) {
    capture.push_back(b.capture);
    beam.push_back(thousandths(b.beam_rad * fit::deg_per_rad));
    incidence.push_back(thousandths(b.incidence_rad * fit::deg_per_rad));
    range.push_back(thousandths(b.range_mm));
    u.push_back(thousandths(b.u_mm));
    sd.push_back(thousandths(b.sd_mm));
  }
  return {{"schema", "prediction/1"},
          {"title", title},
          {"says", says},
          {"captures", captures},
          {"beams",
           {{"capture", capture},
            {"beam_deg", beam},
            {"incidence_deg", incidence},
            {"range_mm", range},
            {"u_mm", u},
            {"sample_sd_mm", sd}}},
          {"bench", json::parse(fit::to_json_text(found.bench))}};
}

WrittenPrediction read_prediction(const std::string& text, const std::string& file) {
  try {
    const json j = json::parse(text);
    WrittenPrediction out;
    out.twin = fit::parse_bench(j.at("bench").dump(), file);
    const json& beams = j.at("beams");
    const auto column = [&](const char* name) { return beams.at(name).get<std::vector<double>>(); };
    const auto capture = beams.at("capture").get<std::vector<int>>();
    const auto beam = column("beam_deg"), incidence = column("incidence_deg"), range = column("range_mm"),
               u = column("u_mm"), sd = column("sample_sd_mm");
    for (const auto* list : {&beam, &incidence, &range, &u, &sd})
      if (list->size() != capture.size()) throw UsageError(file + " holds columns of different lengths.");
    for (std::size_t i = 0; i < capture.size(); ++i)
      out.forecast.beams.push_back(
          {capture[i], beam[i] * fit::rad_per_deg, incidence[i] * fit::rad_per_deg, range[i], u[i], sd[i]});
    return out;
  } catch (const json::exception& error) {
    throw UsageError(file + " is not a prediction (" + error.what() +
                     "). Restore it, or begin a new investigation.");
  }
}

json comparison_document(const fit::explain::ForecastScore& score, const fit::explain::Prediction& gain,
                         const Confirmation& judged) {
  constexpr double width_deg = 3, pull_width = 1.0 / 3, reach = 4;
  // For pictures: means over neighbouring beams of all captures, and how often which pull occurs.
  struct Sum {
    double off = 0, weight = 0, before = 0, before_count = 0;
  };
  std::map<long, Sum> bins;
  std::vector<double> pulls(static_cast<std::size_t>(2 * reach / pull_width), 0);
  const auto bin_of = [&](double beam_deg) { return std::lround(beam_deg / width_deg); };
  for (const auto& b : score.beams) {
    Sum& sum = bins[bin_of(b.beam_deg)];
    const double weight = 1 / (b.u_mm * b.u_mm);
    sum.off += weight * b.mean_minus_forecast_mm;
    sum.weight += weight;
    const double place = std::floor((b.mean_minus_forecast_mm / b.u_mm + reach) / pull_width);
    const double last = static_cast<double>(pulls.size()) - 1;
    pulls[static_cast<std::size_t>(std::clamp(place, 0.0, last))] +=
        1 / static_cast<double>(score.beams.size());
  }
  for (const auto& cell : gain.shown) {
    Sum& sum = bins[bin_of(cell.beam_deg)];
    sum.before += cell.mean_mm;
    sum.before_count += 1;
  }
  json along = {{"beam_deg", json::array()},
                {"off_mm", json::array()},
                {"u_mm", json::array()},
                {"before_mm", json::array()}};
  for (const auto& [bin, sum] : bins) {
    if (sum.weight <= 0 || sum.before_count < 1) continue;
    along["beam_deg"].push_back(width_deg * static_cast<double>(bin));
    along["off_mm"].push_back(thousandths(sum.off / sum.weight));
    along["u_mm"].push_back(thousandths(1 / std::sqrt(sum.weight)));
    along["before_mm"].push_back(thousandths(sum.before / sum.before_count));
  }
  json pulls_at = json::array();
  for (std::size_t i = 0; i < pulls.size(); ++i)
    pulls_at.push_back(-reach + pull_width * (static_cast<double>(i) + 0.5));
  return {{"confirmed", judged.confirmed},
          {"reasons", judged.reasons},
          {"samples", score.samples},
          {"coverage_95", score.coverage_95},
          {"coverage_95_of_means", score.coverage_95_of_means},
          {"rms_mm", score.rms_mm},
          {"rms_of_means_mm", score.rms_of_means_mm},
          {"expected_rms_of_means_mm", score.expected_rms_of_means_mm},
          {"log_likelihood_gain", {{"value", gain.gain}, {"u", gain.u_gain}}},
          {"rms_of_means_before_mm", gain.before.rms_of_means_mm},
          {"beams", score.beams.size()},
          {"along_beam", along},
          {"pulls", {{"at", pulls_at}, {"share", pulls}, {"width", pull_width}}}};
}

}  // namespace rig::investigate
