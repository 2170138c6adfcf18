// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "fit/explain/intensity/readings.hpp"

namespace fit::explain::intensity {

/// Mechanisms of the catalogue that act on intensity beside the law.
[[nodiscard]] std::vector<const Mechanism*> beside_the_law();
/// Whether what a mechanism does is a surface's doing, of all targets or of one, and not the lidar's.
[[nodiscard]] bool is_of_surfaces(const Mechanism& mechanism);

/// One way in which intensity may deviate: a mechanism that acts beside the law, coefficients of the law that
/// are wrong (mechanism radiometry), or an unnamed function (no mechanism).
struct Suspicion {
  const Mechanism* mechanism = nullptr;      ///< Null: an unnamed function.
  int target = -1;                           ///< The only one on which the mechanism acts; -1: all.
  std::vector<double> values;                ///< Of the mechanism's parameters, or of the coefficients.
  std::vector<int> coefficients;             ///< radiometry: those that are wrong.
  Coordinate coordinate = Coordinate::beam;  ///< Of an unnamed function, ...
  int about = -1;                            ///< ... of places on this target if not negative, ...
  double length = 0;                         ///< ... and its correlation length, share of the span, ...
  struct Patch {
    double from_mm, to_mm;
    double price;  ///< Log of the number of places that were looked at.
  };
  std::optional<Patch> patch;  ///< ... or brighter or darker from edge to edge.
  double size = 0;             ///< Scale of its prior, found.
  double evidence = -1e300;    ///< Log of the Bayes factor, prices of what was searched included.
  double gain = 0;             ///< Of the log-likelihood.

  /// A mechanism with an effect of its own.
  [[nodiscard]] bool acts() const { return mechanism && coefficients.empty(); }
  /// A function of range or of brightness alone is another law than the claimed one: radiometry.
  [[nodiscard]] bool other_law() const {
    return !mechanism && about < 0 &&
           (coordinate == Coordinate::range || coordinate == Coordinate::intensity);
  }
  [[nodiscard]] bool is_law() const { return other_law() || !coefficients.empty(); }
  [[nodiscard]] bool has_name() const { return mechanism || other_law(); }
  [[nodiscard]] std::string name() const { return mechanism ? mechanism->id : law_of_intensity; }
  /// The coordinate along which it shows.
  [[nodiscard]] Coordinate along() const { return mechanism ? mechanism->coordinate : coordinate; }
  [[nodiscard]] bool same_as(const Suspicion& other) const;
  /// Whether people would give both the same name.
  [[nodiscard]] bool same_kind(const Suspicion& other) const {
    return (is_law() && other.is_law()) || same_as(other);
  }
};

/// The list without its member number `index`.
[[nodiscard]] std::vector<Suspicion> without(std::vector<Suspicion> list, std::size_t index);

/// What a mechanism that acts does to every row.
[[nodiscard]] Eigen::VectorXd effect_of(const Readings& readings, const Suspicion& suspicion);

/// A parameter of a mechanism, in the unit in which it is searched.
struct Searched {
  std::size_t parameter = 0;
  double sigma = 1;  ///< Standard deviation of its prior.
};
[[nodiscard]] std::vector<Searched> searched(const Mechanism& mechanism);
/// Whether that unit is the logarithm.
[[nodiscard]] bool by_logarithm(const Parameter& parameter);
/// Derivative of the effect by a searched parameter, a value for every row.
[[nodiscard]] Eigen::VectorXd slope_of(const Readings& readings, const Suspicion& suspicion,
                                       const Searched& by);

/// Basis of an unnamed function: a column a bell, of standard size one together; one of a patch.
[[nodiscard]] Eigen::MatrixXd columns_of(const Readings& readings, const Suspicion& unnamed);
/// Its coordinate row by row: file unit, or mm along the target that it is about; NaN elsewhere.
[[nodiscard]] Eigen::VectorXd places_of(const Readings& readings, const Suspicion& unnamed);

}  // namespace fit::explain::intensity
