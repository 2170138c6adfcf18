// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <string>
#include <vector>

#include "fit/explain/model/mean_model.hpp"

namespace fit::explain {

/// A suspect that acts on something other than the cells' means, with its evidence.
struct Suspect {
  const Mechanism* mechanism = nullptr;  ///< Null: something outside the catalogue.
  std::map<std::string, Estimate> parameters;
  int target = -1;  ///< The only one on which it acts; -1: all.
  double gain = 0;  ///< Of the log-likelihood.
};

/// Something that no mechanism of the catalogue explains.
struct Unexplained {
  Observable observable = Observable::range_mean;
  Coordinate coordinate = Coordinate::beam;
  std::string describes;
  double gain = 0;
  double from = 0, to = 0;
};

/// A picture for people of what whole scans, noise, echoes or memory do along a coordinate: as recorded, as
/// simulated before anything was explained, and as explained.
struct SpreadCurve {
  std::string shows, unit;  ///< What is drawn: "scatter of samples" in "mm".
  Observable observable = Observable::range_variance;
  Coordinate coordinate = Coordinate::beam;
  std::string along;       ///< What is drawn against, if the coordinate's name does not say it.
  std::vector<double> at;  ///< File unit of the coordinate.
  std::vector<double> recorded, sigma, before, after;

  void add(double place, const Estimate& seen, double simulated, double explained) {
    at.push_back(place);
    recorded.push_back(seen.value);
    sigma.push_back(seen.u);
    before.push_back(simulated);
    after.push_back(explained);
  }
};

}  // namespace fit::explain
