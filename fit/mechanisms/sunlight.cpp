// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/beam_sector.hpp"
#include "fit/weakest_echo.hpp"

namespace fit::mechanisms {
namespace {

std::string times(const Finding& f) {
  if (!f.parameters.contains("from_s")) return "";
  return ", from " + rounded(f.at("from_s").value) + " to " + rounded(f.at("to_s").value) + " s";
}

/// Where the sun stands while the stage turns the lidar: its middle is an angle of the world then.
bool is_in_room(const Finding& f) { return f.parameters.contains("in_room") && f.at("in_room").value > 0.5; }

/// As `centre_of_sector()`, all around: the stage turns what the room holds into view.
Parameter centre_all_around() {
  Parameter centre = centre_of_sector(49);
  centre.lower = -180;
  centre.upper = 180;
  return centre;
}

double away_deg(const Circumstances& c, double centre_deg, double in_room) {
  return deg_from_centre(c.beam_rad + in_room * c.stage_rad, centre_deg);
}

std::string on_weak_echoes(const Finding& f) {
  if (!f.parameters.contains("exponent") || f.at("exponent").value < 0.5) return "";
  return " at 1000 counts (its variance grows with the power " + rounded(f.at("exponent").value, 2) +
         " of one over the intensity)";
}

}  // namespace

// Shot noise of background light over part of the field of view, at all times or from one to another (since
// power-on): more variance, and echoes that drown in it. What makes the signal noisy makes its crossing of a
// threshold uncertain by noise over slope (Kilpelae, Pennala and Kostamovaara 2001): least on strong echoes,
// whose counts may be any root of the signal. What shines in from the room stays there while the stage turns.
Mechanism make_sunlight() {
  Mechanism m;
  m.id = "sunlight";
  m.cause = "background light falls into part of the field of view";
  m.observable = Observable::range_variance;
  m.coordinate = Coordinate::beam;
  m.formula_error = 0.25;
  m.parameters = {{.name = "sigma_mm", .typical = 6, .sign = 1},
                  centre_all_around(),
                  width_of_sector(),
                  begins_at(),
                  ends_at(),
                  {.name = "lost", .typical = 0.01, .largest = 1, .sign = 1},
                  // of one over the intensity, in the variance
                  even_shape("exponent", 0, 4, 2).generalising(),
                  ends_of_sector("edge_exponent"),
                  {.name = "in_room",
                   .role = Parameter::Role::shape,
                   .scale = Parameter::Scale::choice,
                   .generalises = true}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    if (c.clock_s < p[3] || c.clock_s > p[4]) return Effect{};
    const double light = share_of_sector(away_deg(c, p[1], p[8]) / p[2], p[7]);
    if (light == 0) return Effect{};
    const double weak =
        p[6] != 0 && std::isfinite(c.intensity) ? std::pow(1000 / counts_of_echo(c.intensity), p[6]) : 1;
    return Effect{.variance_mm2 = p[0] * p[0] * light * weak, .lost = p[5] * light};
  };
  m.away = [](const Circumstances& c, std::span<const double> p) { return away_deg(c, p[1], p[8]); };
  m.looks_like = {"local-noise", "local-loss"};  // of which nothing comes and goes, one of both shows
  // Light drowns echoes, or disturbs weak ones the most. A rough surface or something loose before it does
  // neither.
  m.has_own_sign = [](std::span<const double> p, std::span<const double> u) {
    constexpr double on_weak_echoes = 0.5;
    return p[5] > 2 * u[5] || p[6] > on_weak_echoes;
  };
  m.shows = [](const Finding& f, const Recorded&) {
    std::vector<Interval> places;
    if (!is_in_room(f)) places.push_back(sector_of(f, 1.2));
    if (f.parameters.contains("from_s"))
      places.push_back({Coordinate::time, f.at("from_s").value, f.at("to_s").value});
    return places;
  };
  m.says = [](const Finding& f) {
    const Estimate sigma = f.at("sigma_mm"), lost = f.at("lost");
    const std::string where = "Around " + with_uncertainty(f.at("centre_deg"), "deg") +
                              (is_in_room(f) ? " of beam and stage together" : "") + " (within " +
                              rounded(f.at("width_deg").value, 2) + " deg) ",
                      losses =
                          with_uncertainty({100 * lost.value, 100 * lost.u}, "%") + " of the echoes are lost",
                      scatter = "the range scatters by " + with_uncertainty(sigma, "mm") + " more" +
                                on_weak_echoes(f);
    const bool scatters = sigma.value > sigma.u, loses = lost.value > 2 * lost.u;
    return where +
           (scatters && loses ? scatter + ", and " + losses
            : loses           ? losses
                              : scatter) +
           times(f) + ": light falls in there" +
           (is_in_room(f) ? ", and it stays in the room while the stage turns." : ".");
  };
  m.separate = "close the blinds; turn the stage and see whether the noise stays in the room";
  return m;
}

}  // namespace fit::mechanisms
