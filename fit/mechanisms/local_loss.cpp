// SPDX-License-Identifier: MIT
#include "fit/beam_sector.hpp"

namespace fit::mechanisms {

// Something small before the window, or a spot on window or mirror, keeps echoes of some beams away, at all
// times; those that do come back scatter as all others do.
Mechanism make_local_loss() {
  Mechanism m;
  m.id = "local-loss";
  m.cause = "some beams lose echoes, at all times";
  m.observable = Observable::dropout;
  m.coordinate = Coordinate::beam;
  m.formula_error = 0.25;
  m.parameters = {{.name = "lost", .typical = 0.01, .largest = 1, .sign = 1},
                  centre_of_sector(),
                  width_of_sector(),
                  ends_of_sector("exponent")};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.lost = p[0] * share_of_sector(widths_from_centre(c, p[1], p[2]), p[3])};
  };
  m.looks_like = {"sunlight"};  // whose noise does not show
  m.shows = [](const Finding& f, const Recorded&) { return std::vector<Interval>{sector_of(f, 1.2)}; };
  m.says = [](const Finding& f) {
    return "Around " + with_uncertainty(f.at("centre_deg"), "deg") + " (within " +
           rounded(f.at("width_deg").value, 2) + " deg) " +
           with_uncertainty({100 * f.at("lost").value, 100 * f.at("lost").u}, "%") +
           " of the echoes are lost, at all times.";
  };
  m.separate = "turn the stage and see whether the losses stay with the beam; wipe the window";
  return m;
}

}  // namespace fit::mechanisms
