// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "fit/numeric/curve_point.hpp"
#include "fit/numeric/estimate.hpp"
#include "fit/numeric/separable.hpp"
#include "fit/numeric/smoothing_spline.hpp"

namespace fit {

/// The argument brought to [-1, 1]: t = (x - centre) / half. Families are fitted in t and published in x.
struct ArgumentScale {
  double centre = 0, half = 1;
  [[nodiscard]] double to_scaled(double x) const { return (x - centre) / half; }
};

/// A family of curves for calibration. Each lives in its own file families/NAME.cpp, which defines
/// `fit::Family fit::families::make_NAME()`; the build finds it by its name.
///
/// The published form is what tables, JSON and headers carry: `equation` over the named coefficients and x,
/// in the syntax of C with exp, cos, sin and pow. The fitted form is a basis of the same curves that stays
/// well conditioned where the published one does not.
struct Family {
  std::string id;     ///< "exponential-2"
  std::string title;  ///< As in the paper's tables: "exponential(2)".
  std::vector<std::string> coefficients;
  std::string equation;
  std::vector<std::string>
      derivatives;    ///< Of the equation with respect to each coefficient, the same syntax.
  int constant = -1;  ///< Which coefficient only adds to the curve; -1: none.
  /// Column of the fitted form without which the others no longer hold a constant; -1: they hold none.
  int constant_column = -1;
  bool positive_argument = false;  ///< Needs x > 0.
  bool honest_reference = false;   ///< A smoother without an equation: judges the others, is not exported.

  std::function<double(std::span<const double> coefficients, double x)> value;
  std::function<void(std::span<const double> coefficients, double x, std::span<double> gradient)> gradient;

  /// The fitted form over t; for `positive_argument` families the scale's centre and half are needed too.
  std::function<SeparableModel(const ArgumentScale&)> model;
  /// Starting points of the search over the model's non-linear parameters.
  std::function<std::vector<Eigen::VectorXd>(const ArgumentScale&)> starts;
  /// The published coefficients of a fitted curve.
  std::function<std::vector<double>(const ArgumentScale&, const Eigen::VectorXd& beta,
                                    const Eigen::VectorXd& c)>
      publish;
  /// What is ambiguous about this curve, in words; may be absent.
  std::function<std::vector<std::string>(const ArgumentScale&, const Eigen::VectorXd& beta,
                                         SeparableFit::End end)>
      remarks;
};

/// All families, in alphabetical order of their files.
[[nodiscard]] const std::vector<Family>& all_families();
[[nodiscard]] const Family* find_family(const std::string& id);

/// A family's curve through the points, with all that is needed to judge it.
struct FamilyFit {
  std::string family, title, equation;
  bool usable = false;
  std::string message = "the fit was not run";  ///< Why it is not usable.
  std::vector<std::string> names;               ///< Of the published coefficients.
  std::vector<double> coefficients;
  Eigen::MatrixXd factor;  ///< Covariance of the coefficients = factor * factor^T (see covariance_factor).
  double condition = 0;    ///< Of the published form's scaled Jacobian.
  double fitted_condition = 0;  ///< Of the form that was fitted.
  double from = 0, to = 0;      ///< Where there were points.
  long points = 0;
  double parameters = 0;     ///< Effective number, for the smoother.
  double chi2 = 0, rss = 0;  ///< Weighted and plain sum of squared residuals.
  double r2 = 0, rmse = 0;  ///< As curve-fitting tools define them: rmse = sqrt(rss / (points - parameters)).
  double widening = 1;      ///< sqrt(chi2 / freedom) where above 1: uncertainties contain it.
  double aicc = 0, bic = 0;                                   ///< Of the weighted fit with unknown scale.
  double held_out = std::numeric_limits<double>::infinity();  ///< RMS error at points that were held out.
  double printed_mm = 0;   ///< Largest change of the curve when coefficients are rounded to 4 digits.
  double gradient = 0;     ///< Largest cosine between residuals and Jacobian: 0 at a minimum.
  bool at_bound = false;   ///< The minimum lies against a bound of the family.
  bool ambiguous = false;  ///< Other coefficients give as good a curve: not recommended if there is another.
  /// fit_probability() of the residuals.
  double fit_p = std::numeric_limits<double>::quiet_NaN();
  [[nodiscard]] bool lacks_fit() const { return fit_p < 0.01; }
  int starts = 0;
  std::vector<std::string> remarks;
  std::vector<double> residuals;

  [[nodiscard]] double operator()(double x) const;
  /// Standard uncertainty of the curve at x, from the form that was fitted.
  [[nodiscard]] double u(double x) const;
  [[nodiscard]] Estimate coefficient(std::size_t i) const {
    return {coefficients[i], factor.row(static_cast<Eigen::Index>(i)).norm()};
  }
  [[nodiscard]] Eigen::MatrixXd covariance() const { return factor * factor.transpose(); }

  // The fitted form, for u() and for joint fits.
  ArgumentScale scale;
  Eigen::VectorXd beta, c;
  Eigen::MatrixXd fitted_factor;
  std::shared_ptr<const SmoothingSpline> spline;  ///< Only of the smoother.
};

struct FamilyOptions {
  int blocks = 10;  ///< Held out in turn: blocks of neighbouring points; the two ends always stay in.
  bool held_out = true;
  SearchOptions search;
};

/// Fits one family. Too few points, or a wrong argument, leave it not usable and say why.
[[nodiscard]] FamilyFit fit_family(const Family& family, std::span<const CurvePoint> points,
                                   const FamilyOptions& options = {});

/// All families, sorted by their error at held-out points; those not usable come last.
[[nodiscard]] std::vector<FamilyFit> compare_families(std::span<const CurvePoint> points,
                                                      const FamilyOptions& options = {});

/// The usable fit that predicts best: the first of compare_families() that has an equation and is not
/// ambiguous, unless one with fewer parameters predicts as well within 2 %; an ambiguous one only where all
/// are. Null when there is none.
[[nodiscard]] const FamilyFit* best_of(const std::vector<FamilyFit>& sorted);

/// Points that tell their scatter from a wrong curve.
inline constexpr std::size_t fewest_for_fit_p = 8;

/// Probability that a right curve leaves such residuals, in order of the argument and in units of the points'
/// own u: the smaller of two tests, times two. Their mean square against 1 (F, `freedom` and points less two:
/// the scatter in u comes from as many), and von Neumann's ratio of squared differences of neighbours (Ann.
/// Math. Stat. 12 (1941) 367; normal approximation). NaN below `fewest_for_fit_p` points, or two degrees of
/// freedom: so few do not tell their scatter from a wrong curve.
[[nodiscard]] double fit_probability(std::span<const double> standardised, double freedom);

/// Which of a curve's coefficients have an uncertainty of their own. Others follow when one is changed by its
/// u; where the curve between `from` and `to` then leaves its band, the tangent plane says nothing of that
/// coefficient. (b of (a + b x) exp(-c x) near b = 0, where it and c do the same.) factor: covariance =
/// factor * factor^T, a row each. zero_at: where the curve counts as 0.
[[nodiscard]] std::vector<bool> determined_coefficients(const Family& family,
                                                        std::span<const double> coefficients,
                                                        const Eigen::MatrixXd& factor, double from, double to,
                                                        std::optional<double> zero_at = std::nullopt);

/// Where between two neighbouring points a curve is much less certain than at them.
struct OpenInterval {
  double from = 0, to = 0;  ///< The neighbouring points.
  double at = 0;            ///< Where it is least certain.
  double u = 0;             ///< Standard uncertainty there; contains how far other families part from it.
  double u_at_points = 0;   ///< The largest at any point.
};

/// The stretch on which the chosen curve is least certain: by its own uncertainty, or because families whose
/// held-out error is at most 1.5 times as large go another way. None where it is at most twice as uncertain
/// as at the points.
[[nodiscard]] std::optional<OpenInterval> most_open_interval(const std::vector<FamilyFit>& table,
                                                             const FamilyFit& chosen,
                                                             std::span<const CurvePoint> points);

/// Largest possible change of the curve at x when each coefficient is printed with so many significant
/// digits (half a unit of the last one, all against you). Source A, equation 14: 9 to 183 mm with four
/// digits.
[[nodiscard]] double rounding_effect(const Family& family, std::span<const double> coefficients, double x,
                                     int digits);

/// Replaces coefficient names in `expression` (C syntax) by `replacement(index)`.
[[nodiscard]] std::string substitute(const std::string& expression, const std::vector<std::string>& names,
                                     const std::function<std::string(std::size_t)>& replacement);

}  // namespace fit
