// SPDX-License-Identifier: MIT
#include "fit/range/family.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <numeric>
#include <set>

#include "fit/find_by_id.hpp"
#include "fit/numeric/dense.hpp"
#include "fit/numeric/distributions.hpp"
#include "fit/numeric/number_format.hpp"

namespace fit {

namespace families {
std::vector<Family> all();
}

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double ill_conditioned = 1e6;

WeightedPoints weighted(std::span<const CurvePoint> points, const ArgumentScale& scale) {
  const auto n = static_cast<Index>(points.size());
  WeightedPoints out{VectorXd(n), VectorXd(n), VectorXd(n)};
  for (Index i = 0; i < n; ++i) {
    const CurvePoint& p = points[static_cast<std::size_t>(i)];
    out.x[i] = scale.to_scaled(p.x), out.y[i] = p.y, out.weight[i] = 1 / (p.u * p.u);
  }
  return out;
}

ArgumentScale scale_of(std::span<const CurvePoint> points) {
  const auto [low, high] = std::ranges::minmax(points, {}, &CurvePoint::x);
  ArgumentScale scale{(low.x + high.x) / 2, (high.x - low.x) / 2};
  if (scale.half <= 0) scale.half = 1;
  return scale;
}

std::size_t places(std::span<const CurvePoint> points) {
  std::set<double> out;
  for (const CurvePoint& p : points) out.insert(p.x);
  return out.size();
}

/// The weighted Jacobian of the published form.
MatrixXd published_jacobian(const Family& family, const std::vector<double>& coefficients,
                            std::span<const CurvePoint> points) {
  MatrixXd out(static_cast<Index>(points.size()), static_cast<Index>(coefficients.size()));
  std::vector<double> gradient(coefficients.size());
  for (Index i = 0; i < out.rows(); ++i) {
    const CurvePoint& p = points[static_cast<std::size_t>(i)];
    family.gradient(coefficients, p.x, gradient);
    for (Index j = 0; j < out.cols(); ++j) out(i, j) = gradient[static_cast<std::size_t>(j)] / p.u;
  }
  return out;
}

/// The points without one block of neighbours, in turn. Ends stay in, because a correction is used between
/// them, unless there are so few points that each is left out in turn.
std::vector<std::pair<std::vector<CurvePoint>, std::vector<CurvePoint>>> blocks(
    std::span<const CurvePoint> points, int count) {
  std::vector<CurvePoint> sorted(points.begin(), points.end());
  std::ranges::sort(sorted, {}, &CurvePoint::x);
  std::vector<std::pair<std::vector<CurvePoint>, std::vector<CurvePoint>>> out;
  const long end = sorted.size() < 8 ? 0 : 1, inner = static_cast<long>(sorted.size()) - 2 * end;
  const long wanted = std::min<long>(count, inner);
  for (long b = 0; b < wanted; ++b) {
    const auto first = sorted.begin() + end + b * inner / wanted,
               last = sorted.begin() + end + (b + 1) * inner / wanted;
    std::vector<CurvePoint> rest(sorted.begin(), first);
    rest.insert(rest.end(), last, sorted.end());
    out.emplace_back(std::move(rest), std::vector<CurvePoint>(first, last));
  }
  return out;
}

/// Many points are joined before they are held out: the answer is the same and comes soon.
std::vector<CurvePoint> for_holding_out(std::span<const CurvePoint> points, const SearchOptions& search) {
  if (static_cast<long>(points.size()) <= search.thin_above) return {points.begin(), points.end()};
  const WeightedPoints few = thinned(weighted(points, {}), search.thin_to);
  std::vector<CurvePoint> out;
  for (Index i = 0; i < few.x.size(); ++i) out.push_back({few.x[i], few.y[i], 1 / std::sqrt(few.weight[i])});
  return out;
}

double held_out_error(const Family& family, const FamilyFit& fit, std::span<const CurvePoint> points,
                      const FamilyOptions& options) {
  double square = 0, count = 0;
  const SeparableModel model = family.honest_reference ? SeparableModel{} : family.model(fit.scale);
  const auto some = for_holding_out(points, options.search);
  for (const auto& [rest, block] : blocks(some, options.blocks)) {
    if (family.honest_reference) {
      const SmoothingSpline spline(rest);
      for (const CurvePoint& p : block) square += std::pow(p.y - spline.value(p.x), 2), ++count;
      continue;
    }
    if (static_cast<int>(rest.size()) < model.linear + model.nonlinear + 1)
      return std::numeric_limits<double>::infinity();
    const SeparableFit again = solve_separable(model, weighted(rest, fit.scale), fit.beta);
    if (!std::isfinite(again.chi2)) return std::numeric_limits<double>::infinity();
    const WeightedPoints out = weighted(block, fit.scale);
    MatrixXd phi(out.x.size(), model.linear);
    model.basis(out.x, again.beta, phi, nullptr);
    square += (out.y - phi * again.c).squaredNorm();
    count += static_cast<double>(block.size());
  }
  return count > 0 ? std::sqrt(square / count) : std::numeric_limits<double>::infinity();
}

void judge(FamilyFit& fit, std::span<const CurvePoint> points) {
  double mean = 0, total = 0;
  for (const CurvePoint& p : points) mean += p.y / static_cast<double>(points.size());
  fit.rss = fit.chi2 = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    total += std::pow(points[i].y - mean, 2);
    fit.rss += fit.residuals[i] * fit.residuals[i];
    fit.chi2 += std::pow(fit.residuals[i] / points[i].u, 2);
  }
  const double n = static_cast<double>(points.size()), freedom = n - fit.parameters, k = fit.parameters + 1;
  fit.r2 = total > 0 ? 1 - fit.rss / total : 0;
  fit.rmse = std::sqrt(fit.rss / freedom);
  fit.widening = std::sqrt(std::max(1.0, fit.chi2 / freedom));
  std::vector<std::size_t> order(points.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, {}, [&](std::size_t i) { return points[i].x; });
  std::vector<double> standardised;
  for (const std::size_t i : order) standardised.push_back(fit.residuals[i] / points[i].u);
  fit.fit_p = fit_probability(standardised, freedom);
  const double likelihood = n * std::log(std::max(fit.chi2, 1e-300) / n);
  fit.aicc = n - k - 1 > 0 ? likelihood + 2 * k + 2 * k * (k + 1) / (n - k - 1) : std::nan("");
  fit.bic = likelihood + k * std::log(n);
}

void remark(FamilyFit& fit, const Family& family, const SearchResult& found) {
  if (fit.lacks_fit())
    fit.remarks.push_back(
        "does not fit: the residuals are larger than the points' scatter, or neighbours are alike (a "
        "right family leaves such in " +
        formatted("%.1g", 100 * fit.fit_p) + " % of all cases)");
  if (fit.condition > ill_conditioned)
    fit.remarks.push_back("ill-conditioned: its coefficients are so strongly correlated (condition number " +
                          formatted("%.1e", fit.condition) +
                          ") that they mean nothing one by one; printed with four digits the curve would " +
                          "be off by up to " + formatted("%.2g", fit.printed_mm) +
                          " mm, so only full precision reproduces it");
  if (family.remarks)
    for (std::string& word : family.remarks(fit.scale, fit.beta, found.best().end))
      fit.remarks.push_back(std::move(word));
  if (found.best().end == SeparableFit::End::at_bound)
    fit.remarks.emplace_back("the best curve lies on a bound of the family: these points do not ask for it");
  if (found.best().end == SeparableFit::End::not_converged)
    fit.remarks.push_back("the search did not settle (largest cosine of the gradient " +
                          formatted("%.1e", found.best().gradient) + ")");
  for (std::size_t i = 1; i < found.minima.size(); ++i) {
    const SeparableFit& other = found.minima[i];
    if (!other.usable() || other.chi2 - fit.chi2 > 4 * fit.widening * fit.widening) continue;
    if ((other.beta - fit.beta).norm() < 0.05 * (1e-3 + fit.beta.norm())) continue;
    fit.ambiguous = true;
    fit.remarks.emplace_back("ambiguous: a second set of coefficients fits these points as well");
    break;
  }
}

FamilyFit fit_spline(const Family& family, std::span<const CurvePoint> points, FamilyFit fit,
                     const FamilyOptions& options) {
  if (places(points) < 6) {
    fit.message = "needs points at 6 places or more; there are " + std::to_string(places(points));
    return fit;
  }
  fit.spline = std::make_shared<SmoothingSpline>(points);
  fit.parameters = fit.spline->effective_parameters();
  for (const CurvePoint& p : points) fit.residuals.push_back(p.y - fit.spline->value(p.x));
  judge(fit, points);
  fit.usable = true;
  fit.message.clear();
  if (options.held_out) fit.held_out = held_out_error(family, fit, points, options);
  return fit;
}

}  // namespace

const std::vector<Family>& all_families() {
  static const std::vector<Family> families = families::all();
  return families;
}

const Family* find_family(const std::string& id) { return find_by_id(all_families(), id); }

double FamilyFit::operator()(double x) const {
  if (spline) return spline->value(x);
  const Family* known = find_family(family);
  return known && !coefficients.empty() ? known->value(coefficients, x) : std::nan("");
}

double FamilyFit::u(double x) const {
  if (spline) return spline->u(x) * widening;
  const SeparableModel model = find_family(family)->model(scale);
  MatrixXd phi(1, model.linear);
  std::vector<MatrixXd> dphi(static_cast<std::size_t>(model.nonlinear), MatrixXd(1, model.linear));
  model.basis(VectorXd::Constant(1, scale.to_scaled(x)), beta, phi, &dphi);
  Eigen::RowVectorXd tangent(model.linear + model.nonlinear);
  tangent.head(model.linear) = phi.row(0);
  for (int k = 0; k < model.nonlinear; ++k)
    tangent[model.linear + k] = dphi[static_cast<std::size_t>(k)].row(0).dot(c);
  return (tangent * fitted_factor).norm();
}

double rounding_effect(const Family& family, std::span<const double> coefficients, double x, int digits) {
  std::vector<double> gradient(coefficients.size());
  family.gradient(coefficients, x, gradient);
  double effect = 0;
  for (std::size_t j = 0; j < coefficients.size(); ++j) {
    if (coefficients[j] == 0) continue;
    const double exponent = std::floor(std::log10(std::abs(coefficients[j])));
    effect += std::abs(gradient[j]) * 0.5 * std::pow(10.0, exponent - digits + 1);
  }
  return effect;
}

FamilyFit fit_family(const Family& family, std::span<const CurvePoint> points, const FamilyOptions& options) {
  FamilyFit fit;
  fit.family = family.id, fit.title = family.title, fit.equation = family.equation;
  fit.names = family.coefficients;
  fit.points = static_cast<long>(points.size());
  if (points.empty()) {
    fit.message = "there are no points";
    return fit;
  }
  fit.scale = scale_of(points);
  const auto [low, high] = std::ranges::minmax(points, {}, &CurvePoint::x);
  fit.from = low.x, fit.to = high.x;
  if (family.honest_reference) return fit_spline(family, points, std::move(fit), options);
  const std::size_t needed = family.coefficients.size() + 2;
  if (places(points) < needed) {
    fit.message = "has " + std::to_string(family.coefficients.size()) + " coefficients and needs points at " +
                  std::to_string(needed) + " places or more; there are " + std::to_string(places(points));
    return fit;
  }
  if (family.positive_argument && fit.from <= 0) {
    fit.message = "needs an argument above 0";
    return fit;
  }
  const SeparableModel model = family.model(fit.scale);
  const SearchResult found =
      search_separable(model, weighted(points, fit.scale),
                       family.starts ? family.starts(fit.scale) : std::vector<VectorXd>{}, options.search);
  if (found.minima.empty() || !std::isfinite(found.best().chi2)) {
    fit.message = "no start led to a curve";
    return fit;
  }
  const SeparableFit& best = found.best();
  fit.beta = best.beta, fit.c = best.c, fit.gradient = best.gradient, fit.starts = found.starts;
  fit.at_bound = best.end == SeparableFit::End::at_bound;
  fit.parameters = model.linear + model.nonlinear;
  fit.coefficients = family.publish(fit.scale, best.beta, best.c);
  if (!std::ranges::all_of(fit.coefficients, [](double v) { return std::isfinite(v); })) {
    fit.message = "its coefficients are beyond what numbers can hold";
    return fit;
  }
  fit.residuals.assign(best.residual.begin(), best.residual.end());
  judge(fit, points);
  const CovarianceFactor fitted = covariance_factor(best.tangent);
  fit.fitted_factor = fitted.factor * fit.widening;
  fit.fitted_condition = fitted.condition;
  const CovarianceFactor published = covariance_factor(published_jacobian(family, fit.coefficients, points));
  fit.factor = published.factor * fit.widening;
  fit.condition = published.condition;
  for (int i = 0; i <= 40; ++i)
    fit.printed_mm = std::max(fit.printed_mm, rounding_effect(family, fit.coefficients,
                                                              fit.from + (fit.to - fit.from) * i / 40, 4));
  fit.usable = true;
  fit.message.clear();
  remark(fit, family, found);
  if (options.held_out) fit.held_out = held_out_error(family, fit, points, options);
  return fit;
}

std::vector<FamilyFit> compare_families(std::span<const CurvePoint> points, const FamilyOptions& options) {
  std::vector<FamilyFit> fits;
  for (const Family& family : all_families()) fits.push_back(fit_family(family, points, options));
  std::ranges::stable_sort(fits, [](const FamilyFit& a, const FamilyFit& b) {
    if (a.usable != b.usable) return a.usable;
    return a.held_out < b.held_out;
  });
  return fits;
}

const FamilyFit* best_of(const std::vector<FamilyFit>& sorted) {
  const auto sound = [](const FamilyFit& fit) {
    return fit.usable && !fit.spline && std::isfinite(fit.held_out);
  };
  const bool any_unambiguous =
      std::ranges::any_of(sorted, [&](const FamilyFit& fit) { return sound(fit) && !fit.ambiguous; });
  const FamilyFit* best = nullptr;
  for (const FamilyFit& fit : sorted) {
    if (!sound(fit) || (any_unambiguous && fit.ambiguous)) continue;
    if (!best)
      best = &fit;
    else if (fit.held_out <= 1.02 * sorted.front().held_out && fit.parameters < best->parameters)
      best = &fit;
  }
  return best;
}

double fit_probability(std::span<const double> standardised, double freedom) {
  const auto n = static_cast<double>(standardised.size());
  if (standardised.size() < fewest_for_fit_p || freedom < 2) return std::nan("");
  double squares = 0, differences = 0;
  for (std::size_t i = 0; i < standardised.size(); ++i) {
    squares += standardised[i] * standardised[i];
    if (i > 0) differences += std::pow(standardised[i] - standardised[i - 1], 2);
  }
  if (!(squares > 0)) return 1;
  const double by_size = fisher_above(freedom, n - 2, squares / freedom);
  const double z = (1 - 0.5 * differences / squares) * std::sqrt((n * n - 1) / (n - 2));
  const double by_order = 0.5 * std::erfc(z / std::sqrt(2.0));
  return std::min(1.0, 2 * std::min(by_size, by_order));
}

std::vector<bool> determined_coefficients(const Family& family, std::span<const double> coefficients,
                                          const MatrixXd& factor, double from, double to,
                                          std::optional<double> zero_at) {
  constexpr int places = 24;
  const auto count = static_cast<Index>(coefficients.size());
  const auto curve = [&](std::span<const double> c, double x) {
    return family.value(c, x) - (zero_at ? family.value(c, *zero_at) : 0);
  };
  MatrixXd gradients(places + 1, count);
  VectorXd values(places + 1);
  std::vector<double> gradient(coefficients.size());
  const auto place = [&](Index i) { return from + (to - from) * static_cast<double>(i) / places; };
  for (Index i = 0; i <= places; ++i) {
    family.gradient(coefficients, place(i), gradient);
    gradients.row(i) = Eigen::Map<const Eigen::RowVectorXd>(gradient.data(), count);
    if (!zero_at) continue;
    family.gradient(coefficients, *zero_at, gradient);
    gradients.row(i) -= Eigen::Map<const Eigen::RowVectorXd>(gradient.data(), count);
  }
  for (Index i = 0; i <= places; ++i) values[i] = curve(coefficients, place(i));
  const double band = (gradients * factor).norm();
  std::vector<bool> out;
  for (Index k = 0; k < count; ++k) {
    const double u = factor.row(k).norm();
    bool holds = u > 0;
    for (const double sign : {1.0, -1.0}) {
      if (!holds) break;
      const VectorXd change = sign / u * factor * factor.row(k).transpose();
      std::vector<double> changed(coefficients.begin(), coefficients.end());
      for (Index j = 0; j < count; ++j) changed[static_cast<std::size_t>(j)] += change[j];
      VectorXd off = -values - gradients * change;
      for (Index i = 0; i <= places; ++i) off[i] += curve(changed, place(i));
      holds = off.norm() <= band;  // false for NaN
    }
    out.push_back(holds);
  }
  return out;
}

std::optional<OpenInterval> most_open_interval(const std::vector<FamilyFit>& table, const FamilyFit& chosen,
                                               std::span<const CurvePoint> points) {
  constexpr double as_well = 1.5, much = 2;
  constexpr int places = 8;  // Looked at between two points.
  const auto u_at = [&](double x) {
    double u = chosen.u(x);
    for (const FamilyFit& rival : table)
      if (rival.usable && rival.held_out <= as_well * chosen.held_out)
        u = std::max(u, std::abs(rival(x) - chosen(x)) / 2);
    return u;
  };
  std::vector<double> at;
  for (const CurvePoint& point : points) at.push_back(point.x);
  std::ranges::sort(at);
  OpenInterval open;
  for (const double x : at) open.u_at_points = std::max(open.u_at_points, u_at(x));
  for (std::size_t i = 0; i + 1 < at.size(); ++i)
    for (int k = 1; k < places; ++k) {
      const double x = at[i] + (at[i + 1] - at[i]) * k / places, u = u_at(x);
      if (u > open.u) open = {at[i], at[i + 1], x, u, open.u_at_points};
    }
  if (!(open.u > much * open.u_at_points)) return std::nullopt;
  return open;
}

std::string substitute(const std::string& expression, const std::vector<std::string>& names,
                       const std::function<std::string(std::size_t)>& replacement) {
  std::string out;
  for (std::size_t i = 0; i < expression.size();) {
    const auto letter = [&](std::size_t at) {
      return at < expression.size() &&
             (std::isalnum(static_cast<unsigned char>(expression[at])) || expression[at] == '_');
    };
    if (!letter(i)) {
      out += expression[i++];
      continue;
    }
    std::size_t end = i;
    while (letter(end)) ++end;
    const std::string word = expression.substr(i, end - i);
    const auto found = std::ranges::find(names, word);
    out += found == names.end() ? word : replacement(static_cast<std::size_t>(found - names.begin()));
    i = end;
  }
  return out;
}

}  // namespace fit
