// SPDX-License-Identifier: MIT
#pragma once

#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "fit/bench/accuracy.hpp"
#include "fit/numeric/estimate.hpp"

namespace rig {

/// One contribution to the uncertainty of one quantity (GUM 5.1, 8).
struct Contribution {
  static constexpr double many = std::numeric_limits<double>::infinity();

  std::string source;
  char kind = 'B';              ///< GUM 4.2 (A) or 4.3 (B).
  std::string distribution;     ///< "normal", "rectangular", "Student".
  double u = 0;                 ///< What it adds to the quantity's standard uncertainty, in its unit.
  double freedom = many;        ///< Degrees of freedom.
  double input_u = 0;           ///< Standard uncertainty of the input; 0: the contribution itself.
  std::string input_unit = {};  ///< Of the input.
};

/// The budget of one quantity: what contributes, combined as independent (GUM 5.1.2), with the effective
/// degrees of freedom after Welch and Satterthwaite (GUM G.4.1).
class UncertaintyBudget {
 public:
  UncertaintyBudget(std::string name, std::string label, std::string unit)
      : name_(std::move(name)), label_(std::move(label)), unit_(std::move(unit)) {}

  void add(Contribution contribution);
  /// A systematic deviation of a device, which says of itself whether the bench file states it.
  void add(const fit::AccuracyLine& line, double contribution);
  [[nodiscard]] double u() const;
  [[nodiscard]] double freedom() const;
  [[nodiscard]] const std::vector<Contribution>& contributions() const { return contributions_; }

  /// Appends the quantity to `values` and its rows, the combined one last, to `budget` of a result document.
  void publish(nlohmann::json& result, double value) const;

 private:
  std::string name_, label_, unit_;
  std::vector<Contribution> contributions_;
};

/// What one method gives for a quantity. `method` reads behind the quantity's name ("by counting stops").
struct MethodValue {
  std::string method;
  fit::Estimate estimate;
  double k = 2;  ///< Coverage factor of its expanded uncertainty.
};

/// Two ways to one quantity, laid side by side: appends to `comparisons` of a result document whether they
/// agree within the expanded uncertainty of their difference, and whether they are `far_apart`, by more
/// than one and a half of it: then neither may be certified. Not finite: nothing is compared.
void compare_methods(nlohmann::json& result, const std::string& quantity, const MethodValue& first,
                     const MethodValue& second, const std::string& unit);

}  // namespace rig
