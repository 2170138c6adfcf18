// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/reduce.hpp"
#include "fit/explain/reduction/temperature.hpp"

namespace fit::explain {

void append(Reduced& reduced, const Reduced& other) {
  const auto captures = static_cast<int>(reduced.captures.size()),
             groups = static_cast<int>(reduced.groups.size());
  const std::size_t cells = reduced.cells.size();
  reduced.captures.insert(reduced.captures.end(), other.captures.begin(), other.captures.end());
  const double mine_c = reduced.reference_temperature_c;
  reduced.reference_temperature_c = reduction::reference_temperature(reduced.captures).value_or(0);
  for (Cell& cell : reduced.cells) cell.at.temperature_k += mine_c - reduced.reference_temperature_c;
  const double warmer_k = other.reference_temperature_c - reduced.reference_temperature_c;
  reduced.absent.insert(reduced.absent.end(), other.absent.begin(), other.absent.end());
  for (Group group : other.groups) {
    group.capture += captures;
    group.first_cell += cells;
    group.last_cell += cells;
    reduced.groups.push_back(group);
  }
  for (Cell cell : other.cells) {
    cell.group += groups;
    cell.first_beside += reduced.beside.size();
    cell.at.temperature_k += warmer_k;
    reduced.cells.push_back(cell);
  }
  reduced.beside.insert(reduced.beside.end(), other.beside.begin(), other.beside.end());
  for (Sector sector : other.sectors) {
    sector.group += groups;
    sector.first_cell += cells;
    sector.last_cell += cells;
    reduced.sectors.push_back(sector);
  }
  for (Passer passer : other.passers) {
    passer.capture += captures;
    reduced.passers.push_back(passer);
  }
  for (std::size_t mm = 0; mm < reduced.shown.size(); ++mm) reduced.shown[mm] += other.shown[mm];
  reduced.strays_mm.insert(reduced.strays_mm.end(), other.strays_mm.begin(), other.strays_mm.end());
  reduced.strays_of_target.insert(reduced.strays_of_target.end(), other.strays_of_target.begin(),
                                  other.strays_of_target.end());
  reduced.samples += other.samples;
  reduced.has_intensity = reduced.has_intensity || other.has_intensity;
  reduced.left_out += other.left_out;
  reduced.in_clear += other.in_clear;
  reduced.astray += other.astray;
  reduced.scans += other.scans;
  reduced.repeated += other.repeated;
  reduced.broken += other.broken;
}

}  // namespace fit::explain
