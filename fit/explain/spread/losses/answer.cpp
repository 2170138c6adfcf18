// SPDX-License-Identifier: MIT
#include "fit/explain/spread/losses/answer.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "fit/explain/spread/suspects.hpp"

namespace fit::explain::spread {

namespace {

/// What may be anything: by its beams, unless all have it, and by its times.
void tell_unknown(const PlaceAndTimes& there, Unexplained u, SpreadResult& result) {
  const auto& [place, times_s, u_from_s, u_to_s] = there;
  u.observable = Observable::dropout;
  u.describes =
      "echoes are missing from " + rounded(times_s.from) + " to " + rounded(times_s.to) +
      " s after power-on" +
      (place.everywhere ? ", at all angles" : " at beams around " + rounded(place.centre_deg) + " deg");
  if (!place.everywhere) {
    u.coordinate = Coordinate::beam;
    u.from = place.centre_deg - place.width_deg;
    u.to = place.centre_deg + place.width_deg;
    result.unknown.push_back(u);
  }
  u.coordinate = Coordinate::time;
  u.from = times_s.from;
  u.to = times_s.to;
  result.unknown.push_back(u);
}

}  // namespace

Suspect dropout_at(const Threshold& threshold, double lost) {
  const double u = threshold.width / std::sqrt(1 + lost);
  Suspect dropout = suspected(ids::dropout);
  dropout.parameters = {{"intensity_min", {threshold.at, u}}, {"width", {threshold.width, u}}};
  return dropout;
}

Suspect light_in(const Window& window) {
  Suspect sun = suspected(ids::sunlight);
  sun.parameters = {{"sigma_mm", {0, 1}}, {"centre_deg", {window.centre_deg, 5}}, {"width_deg", {14, 5}}};
  return sun;
}

void tell(const WindowInTime& window, double gain, double evidence, SpreadResult& result) {
  const auto& [place, times_s, u_from_s, u_to_s] = window.where_and_when;
  if (window.captures < 2 || place.everywhere) {
    Unexplained unknown;
    unknown.gain = gain;
    unknown.evidence = evidence;
    return tell_unknown(window.where_and_when, unknown, result);
  }
  Suspect sun = suspected(ids::sunlight);
  sun.gain = gain;
  sun.evidence = evidence;
  sun.parameters = {{"sigma_mm", {0, 1}},
                    {"centre_deg", {place.centre_deg, 5}},
                    {"width_deg", {place.width_deg, 5}},
                    {"from_s", {times_s.from, u_from_s}},
                    {"to_s", {times_s.to, u_to_s}}};
  result.accepted.push_back(sun);
}

Unexplained lost_anywhere(const Counts& counts) {
  Unexplained u;
  u.observable = Observable::dropout;
  u.coordinate = Coordinate::beam;
  u.describes = "echoes are missing, " + rounded(100 * clamped(counts.lost / counts.all), 2) +
                " % of all, whatever their strength and angle";
  u.from = 180;
  u.to = -180;
  for (const Count& c : counts.cells) {
    u.from = std::min(u.from, c.beam_deg);
    u.to = std::max(u.to, c.beam_deg);
  }
  return u;
}

}  // namespace fit::explain::spread
