// SPDX-License-Identifier: MIT
#include "fit/bench/radiometer.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace fit {
namespace {

using L = IntensityLaw;
constexpr std::array<const char*, L::size> names{"counts_at_1m",      "range_power", "incidence_power",
                                                 "reflectance_power", "overlap_mm",  "full_counts"};

bool logarithmic(int k) { return k == L::gain || k == L::overlap || k == L::full; }

/// A change of the law, as the mechanism of that name has it (fit/mechanisms/radiometry.cpp).
struct Change {
  const char* name;
  void (*apply)(L& law, double by);
};
double log_of_sum(double log_square, double more) {
  return 0.5 * std::log(std::max(1e-12, std::exp(2 * log_square) + more));
}
constexpr Change changes[] = {
    {"log_gain", [](L& law, double by) { law.value[L::gain] += by; }},
    {"range_exponent", [](L& law, double by) { law.value[L::range_power] += by; }},
    {"response_exponent",
     [](L& law, double by) {
       law.value[L::range_power] += 2 * by;
       law.value[L::incidence_power] += by;
       law.value[L::reflectance_power] += by;
     }},
    {"incidence_exponent", [](L& law, double by) { law.value[L::incidence_power] += by; }},
    {"reflectance_exponent", [](L& law, double by) { law.value[L::reflectance_power] += by; }},
    // log(1 + by (500 mm)^2 / r^2), next to the range's power of log(1 + overlap^2 / r^2)
    {"overlap",
     [](L& law, double by) {
       law.value[L::overlap] =
           log_of_sum(law.value[L::overlap], by * 250000 / std::max(0.1, law.value[L::range_power]));
     }},
    // half of log(1 + by (counts / 1000)^2), as by another full scale
    {"compression",
     [](L& law, double by) { law.value[L::full] = -log_of_sum(-law.value[L::full], by * 1e-6); }}};

void state(IntensityClaim& claim, int k, const Estimate& e) {
  if (!std::isfinite(e.value) || (logarithmic(k) && e.value <= 0)) return;
  const auto i = static_cast<std::size_t>(k);
  claim.law.value[i] = logarithmic(k) ? std::log(e.value) : e.value;
  claim.u[i] = logarithmic(k) ? e.u / e.value : e.u;
  claim.stated[i] = true;
}

}  // namespace

double IntensityLaw::log_counts(double reflectance, double cos_incidence, double range_mm) const {
  const double r = std::max(1.0, range_mm), o = std::exp(value[overlap]);
  const double raw = value[gain] + value[reflectance_power] * std::log(std::max(1e-3, reflectance)) +
                     value[incidence_power] * std::log(std::max(0.02, cos_incidence)) -
                     value[range_power] * (std::log(r / 1000) + std::log1p(o * o / (r * r)));
  return compressed(raw);
}

double IntensityLaw::compressed(double log_raw) const {
  return log_raw - 0.5 * std::log1p(std::exp(2 * (log_raw - value[full])));
}

double IntensityLaw::counts(double reflectance, double cos_incidence, double range_mm) const {
  return std::exp(log_counts(reflectance, cos_incidence, range_mm));
}

double IntensityLaw::receiver_slope(double counts) const {
  constexpr double least = 1e-3;  // at full scale
  return std::max(least, 1 - std::exp(2 * (std::log(std::max(1e-9, counts)) - value[full])));
}

double IntensityLaw::stronger(double counts, double log_echo) const {
  const double log_raw = std::log(std::max(1e-9, counts)) - 0.5 * std::log(receiver_slope(counts)) + log_echo;
  return std::exp(compressed(log_raw));
}

std::optional<IntensityClaim> claimed_intensity(const Bench& bench) {
  const KnownMechanism* known = bench.knows(law_of_intensity);
  if (!known) return std::nullopt;
  IntensityClaim claim;
  if (const auto& sim = bench.document.section("sim"); sim.contains("intensity")) {
    const auto& given = sim["intensity"];
    for (int k = 0; k < L::size; ++k)
      if (given.contains(names[static_cast<std::size_t>(k)]))
        state(claim, k, given.value(names[static_cast<std::size_t>(k)], 1.0));
    if (given.contains("relative_noise")) claim.relative_noise = given.value("relative_noise", 0.01);
  }
  for (int k = 0; k < L::size; ++k)
    if (const auto found = known->parameters.find(names[static_cast<std::size_t>(k)]);
        found != known->parameters.end())
      state(claim, k, found->second);
  if (const auto found = known->parameters.find("relative_noise"); found != known->parameters.end())
    claim.relative_noise = found->second.value;
  return claim;
}

IntensityLaw fold_corrections(Bench& bench, IntensityLaw law) {
  for (KnownMechanism& known : bench.known) {
    if (known.mechanism != law_of_intensity) continue;
    for (const Change& change : changes) {
      const auto found = known.parameters.find(change.name);
      if (found == known.parameters.end()) continue;
      change.apply(law, found->second.value);
      known.parameters.erase(found);
    }
    break;
  }
  return law;
}

void state_intensity(Bench& bench, const IntensityLaw& law, const std::array<double, L::size>& u,
                     std::optional<double> relative_noise) {
  for (KnownMechanism& known : bench.known) {
    if (known.mechanism != law_of_intensity) continue;
    for (int k = 0; k < L::size; ++k) {
      const auto i = static_cast<std::size_t>(k);
      // What stands at "none" need not be said.
      if ((k == L::overlap && law.value[i] <= 0) || (k == L::full && law.value[i] >= 20)) continue;
      known.parameters[names[i]] = in_file_unit(static_cast<L::Coefficient>(k), {law.value[i], u[i]});
    }
    if (relative_noise) known.parameters["relative_noise"] = *relative_noise;
    return;
  }
}

double DescribedIntensity::gain(const std::string& target, double reflectance) const {
  for (const Surface& s : surfaces)
    if (s.target == target && std::abs(s.reflectance - reflectance) < 1e-6) return s.gain;
  return 1;
}

std::optional<DescribedIntensity> described_intensity(const Bench& bench) {
  const auto& sim = bench.document.section("sim");
  if (!sim.contains("intensity") || !sim["intensity"].is_object()) return std::nullopt;
  const auto& given = sim["intensity"];
  DescribedIntensity described;
  described.law.value = {std::log(1000.0), 1, 1, 1, 0, 20};
  for (int k = 0; k < L::size; ++k) {
    const auto i = static_cast<std::size_t>(k);
    if (!given.contains(names[i])) continue;
    const double value = given.value(names[i], 1.0);
    if (logarithmic(k) && value <= 0) continue;
    described.law.value[i] = logarithmic(k) ? std::log(value) : value;
  }
  described.relative_noise = given.value("relative_noise", 0.01);
  if (given.contains("surfaces") && given["surfaces"].is_array())
    for (const auto& s : given["surfaces"])
      if (s.is_object())
        described.surfaces.push_back(
            {s.value("target", std::string()), s.value("reflectance", 0.0), s.value("gain", 1.0)});
  return described;
}

void describe_intensity(Bench& bench, const DescribedIntensity& described) {
  bench.document.change([&](nlohmann::json& document) {
    auto& intensity = document["sim"]["intensity"];
    for (int k = 0; k < L::size; ++k) {
      const auto i = static_cast<std::size_t>(k);
      if ((k == L::overlap && described.law.value[i] <= 0) || (k == L::full && described.law.value[i] >= 20))
        continue;
      intensity[names[i]] = in_file_unit(static_cast<L::Coefficient>(k), {described.law.value[i], 0}).value;
    }
    intensity["relative_noise"] = described.relative_noise;
    for (const auto& s : described.surfaces)
      intensity["surfaces"].push_back(
          {{"target", s.target}, {"reflectance", s.reflectance}, {"gain", s.gain}});
  });
}

const char* file_name(L::Coefficient coefficient) { return names[static_cast<std::size_t>(coefficient)]; }

Estimate in_file_unit(L::Coefficient coefficient, const Estimate& e) {
  if (!logarithmic(coefficient)) return e;
  return {std::exp(e.value), std::exp(e.value) * e.u};
}

IntensityLaw law_of_bench(const Bench& bench) {
  if (const auto claim = claimed_intensity(bench)) return claim->law;
  if (const auto described = described_intensity(bench)) return described->law;
  return {};
}

}  // namespace fit
