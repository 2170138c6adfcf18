// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

namespace fit::explain::inference {

/// Values of a term's parameters, and the log evidence there.
struct Peak {
  std::vector<double> values;
  double log_evidence = 0;
  double log_share = 0;  ///< Log of its width over the distances of the starts, for which it stands.
};

/// The highest place near one of a grid of starts and not beyond its ends, in some of the parameters: a step
/// or a bump lies up to half a distance away, and where samples are many that costs more than a wrong name
/// gains.
[[nodiscard]] Peak peak_between(const std::vector<std::vector<double>>& starts,
                                const std::vector<std::size_t>& parameters, Peak from,
                                const std::function<double(const std::vector<double>&)>& log_evidence);

/// The highest place near that peak where the parameters, the ends of what begins and ends, are among those
/// borders: a row more or less at either end costs as much as a whole effect.
[[nodiscard]] Peak peak_among(const std::vector<double>& borders, const std::vector<std::size_t>& parameters,
                              Peak from,
                              const std::function<double(const std::vector<double>&)>& log_evidence);

/// A free variable: where it begins, its bounds, and how far it is moved first.
struct Free {
  double at = 0, lower = 0, upper = 0, first = 0;
};

/// Climbs to a peak of that function of the free variables, by simplices (NLopt's Nelder and Mead); `before`:
/// its value where they begin.
void climb(const std::vector<Free>& free, double before,
           const std::function<double(const double* x)>& function);

}  // namespace fit::explain::inference
