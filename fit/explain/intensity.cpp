// SPDX-License-Identifier: MIT
#include "fit/explain/intensity.hpp"

#include <nlopt.h>

#include <algorithm>
#include <array>
#include <boost/math/special_functions/erf.hpp>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

#include "fit/empirical.hpp"
#include "fit/explain/odds.hpp"
#include "fit/median.hpp"
#include "fit/radiometer.hpp"

namespace fit::explain {
namespace {

using L = IntensityLaw;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t rows_at_most = 4000;
using odds::price_of_mechanism, odds::price_of_unknown;
constexpr double worth_it = 1.5;
/// What nobody's law of intensity gets right to better: receivers bend, surfaces are not quite Lambertian.
constexpr double response_doubt = 0.02, incidence_doubt = 0.03;
constexpr double open_response =
    0.3;  ///< Where the bench leaves parts of the law open, its form is open as well.
/// Reflectances are nominal, and no surface is of one grey.
constexpr double reflectance_doubt = 0.08, stain_doubt = 0.01;
constexpr double never_better = 0.002;
constexpr std::array<double, L::size> released{0.3, 0.3, 0.3,
                                               0.3, 1.0, 0.5};  ///< Prior sizes of wrong coefficients.
constexpr std::array<double, L::size> open{3, 1, 1, 1, 0, 0};   ///< Where nothing is stated.

/// Columns with independent normal priors around zero.
struct Block {
  MatrixXd columns;
  VectorXd sigma;
  void add(const MatrixXd& more, double s) {
    const Index before = columns.cols();
    columns.conservativeResize(more.rows(), before + more.cols());
    columns.rightCols(more.cols()) = more;
    sigma.conservativeResize(before + more.cols());
    sigma.tail(more.cols()).setConstant(s);
  }
  void add(const Block& more) {
    for (Index k = 0; k < more.columns.cols(); ++k) add(more.columns.col(k), more.sigma[k]);
  }
};

/// Deviations of the logarithm of intensity from the claim; nuisances are marginalised as in MeanModel.
class Model {
 public:
  Model(VectorXd y, VectorXd weight) : weight_(std::move(weight)), white_(weight_.cwiseProduct(y)) {
    set_base({MatrixXd(white_.size(), 0), VectorXd(0)});
  }
  void set_base(const Block& base) {
    sigma_ = base.sigma;
    base_ = weight_.asDiagonal() * base.columns * base.sigma.asDiagonal();
    MatrixXd normal = base_.transpose() * base_;
    normal.diagonal().array() += 1;
    factor_.compute(normal);
    along_ = base_.transpose() * white_;
    rest_ = white_ - base_ * factor_.solve(along_);
  }
  [[nodiscard]] double log_evidence() const {
    double log_det = 0;
    for (Index i = 0; i < base_.cols(); ++i) log_det += std::log(factor_.matrixL()(i, i));
    return -0.5 * white_.dot(rest_) - log_det;
  }
  [[nodiscard]] VectorXd coefficients() const { return sigma_.cwiseProduct(factor_.solve(along_)); }
  [[nodiscard]] VectorXd uncertainties() const {
    const MatrixXd inverse = factor_.solve(MatrixXd::Identity(base_.cols(), base_.cols()));
    return sigma_.cwiseProduct(inverse.diagonal().cwiseSqrt());
  }
  /// What is left of the deviations, and of an effect, when the base has taken up what it can.
  [[nodiscard]] VectorXd residual() const { return rest_.cwiseQuotient(weight_); }
  [[nodiscard]] VectorXd left_of(const VectorXd& effect) const {
    const VectorXd white = weight_.cwiseProduct(effect);
    return white - base_ * factor_.solve(base_.transpose() * white);
  }
  [[nodiscard]] MeanModel::Products products(const MatrixXd& columns) const {
    const MatrixXd white = weight_.asDiagonal() * columns;
    const MatrixXd cross = base_.transpose() * white;
    return {white.transpose() * white - cross.transpose() * factor_.solve(cross), white.transpose() * rest_};
  }
  /// Gain of the log-likelihood by an effect of this very size.
  [[nodiscard]] double gain(const VectorXd& effect) const {
    const VectorXd white = weight_.cwiseProduct(effect), taken = base_.transpose() * white;
    return white.dot(rest_) - 0.5 * (white.squaredNorm() - taken.dot(factor_.solve(taken)));
  }
  [[nodiscard]] const VectorXd& weight() const { return weight_; }
  [[nodiscard]] VectorXd deviations() const { return white_.cwiseQuotient(weight_); }

  struct HeldOut {
    double log_likelihood = 0, rms = 0;
  };
  [[nodiscard]] HeldOut held_out(const std::vector<int>& block, int blocks) const {
    const Index k = base_.cols();
    std::vector<MatrixXd> square(static_cast<std::size_t>(blocks), MatrixXd::Zero(k, k));
    std::vector<VectorXd> along(static_cast<std::size_t>(blocks), VectorXd::Zero(k));
    for (Index i = 0; i < base_.rows(); ++i) {
      const auto b = static_cast<std::size_t>(block[static_cast<std::size_t>(i)]);
      square[b] += base_.row(i).transpose() * base_.row(i);
      along[b] += base_.row(i).transpose() * white_[i];
    }
    MatrixXd all = MatrixXd::Identity(k, k);
    VectorXd sum = VectorXd::Zero(k);
    for (std::size_t b = 0; b < square.size(); ++b) {
      all += square[b];
      sum += along[b];
    }
    HeldOut held;
    double squares = 0;
    for (int b = 0; b < blocks; ++b) {
      const auto at = static_cast<std::size_t>(b);
      const VectorXd x = MatrixXd(all - square[at]).llt().solve(sum - along[at]);
      for (Index i = 0; i < base_.rows(); ++i) {
        if (block[static_cast<std::size_t>(i)] != b) continue;
        const double z = white_[i] - (k > 0 ? base_.row(i).dot(x) : 0.0);
        held.log_likelihood -= 0.5 * z * z;
        squares += std::pow(z / weight_[i], 2);
      }
    }
    held.rms = std::sqrt(squares / std::max<double>(1, static_cast<double>(base_.rows())));
    return held;
  }

 private:
  VectorXd weight_, white_;
  MatrixXd base_;
  VectorXd sigma_, along_, rest_;
  Eigen::LLT<MatrixXd> factor_;
};

/// One way in which intensity may deviate.
struct Suspicion {
  const Mechanism* mechanism = nullptr;  ///< Null: an unnamed function.
  int target = -1;
  std::vector<double> values;                ///< Of the mechanism's parameters.
  std::vector<int> coefficients;             ///< radiometry: those that are wrong.
  Coordinate coordinate = Coordinate::beam;  ///< Of an unnamed function, ...
  int about = -1;                            ///< ... of places on this target if not negative, ...
  double length = 0;                         ///< ... and its correlation length, share of the span, ...
  struct Patch {
    double from_mm, to_mm, price;  ///< Price: log of the number of places that were looked at.
  };
  std::optional<Patch> patch;  ///< ... or brighter or darker from edge to edge.
  double size = 0;             ///< Scale of its prior, found.
  double evidence = -1e300, gain = 0;

  /// A function of range or of brightness alone is another law than the claimed one: radiometry.
  [[nodiscard]] bool other_law() const {
    return !mechanism && about < 0 &&
           (coordinate == Coordinate::range || coordinate == Coordinate::intensity);
  }
  [[nodiscard]] bool is_law() const { return other_law() || !coefficients.empty(); }
  [[nodiscard]] bool same_kind(const Suspicion& o) const { return (is_law() && o.is_law()) || same_as(o); }
  [[nodiscard]] bool same_as(const Suspicion& o) const {
    if (mechanism != o.mechanism) return false;
    if (patch && o.patch)
      return about == o.about && patch->from_mm < o.patch->to_mm && o.patch->from_mm < patch->to_mm;
    if (!mechanism) return coordinate == o.coordinate && about == o.about && !patch == !o.patch;
    return true;
  }
};

struct Row {
  std::size_t cell = 0;
  double reflectance = 0.5;
  double log_counts = 0;  ///< As it was recorded.
  int surface = 0;        ///< Target and grey: what shares one nominal reflectance.
  double sigma = 0.01;
};

class Intensity {
 public:
  Intensity(const Reduced& reduced, IntensityClaim claim)
      : reduced_(reduced), claim_(std::move(claim)), law_(claim_.law) {}

  void run(Explanation& out) {
    if (!collect()) {
      out.notes.push_back(
          "The bench claims a law of intensity, but the recording has too little intensity to test it.");
      return;
    }
    weigh();
    search();
    judge();
    write(out);
  }

  /// Evidence (logarithm of odds) against one (column) when another (row) is true.
  MatrixXd evidence_between(const std::vector<LightSuspect>& suspects) {
    constexpr double scatter = 0.01;  // what intensities are never better predicted than
    const auto size = static_cast<Index>(suspects.size());
    MatrixXd evidence = MatrixXd::Zero(size, size);
    if (!collect()) return evidence;
    VectorXd weight(count());
    for (Index i = 0; i < count(); ++i)
      weight[i] = 1 / std::max(scatter, rows_[static_cast<std::size_t>(i)].sigma);
    for (Index truth = 0; truth < size; ++truth)
      for (Index rival = 0; rival < size; ++rival) {
        if (truth == rival) continue;
        const Suspicion other = suspicion_of(suspects[static_cast<std::size_t>(rival)]);
        Block base = nuisances(law_, {other});
        if (other.coefficients.empty()) {
          base.add(effect_of(other), 10);
          add_freedom(other, base);
        }
        const VectorXd effect = effect_of(suspects[static_cast<std::size_t>(truth)]);
        Model model(effect, weight);
        model.set_base(base);
        evidence(truth, rival) = 0.5 * model.left_of(effect).squaredNorm();
      }
    return evidence;
  }

 private:
  static Suspicion suspicion_of(const LightSuspect& l) {
    Suspicion s;
    s.mechanism = l.mechanism;
    s.target = l.target;
    s.values = l.values;
    s.coefficients = l.coefficients;
    s.size = 1;
    return s;
  }
  [[nodiscard]] VectorXd effect_of(const LightSuspect& l) const {
    if (l.coefficients.empty()) return effect_of(suspicion_of(l));
    const MatrixXd columns = law_columns(law_);
    VectorXd sum = VectorXd::Zero(count());
    for (std::size_t k = 0; k < l.coefficients.size() && k < l.values.size(); ++k)
      sum += l.values[k] * columns.col(l.coefficients[k]);
    return sum;
  }

  // ---- data
  // ----------------------------------------------------------------------------------------------------
  [[nodiscard]] const Cell& cell(std::size_t row) const { return reduced_.cells[rows_[row].cell]; }
  [[nodiscard]] const Group& group(std::size_t row) const {
    return reduced_.groups[static_cast<std::size_t>(cell(row).group)];
  }
  [[nodiscard]] Index count() const { return static_cast<Index>(rows_.size()); }

  [[nodiscard]] bool usable(const Cell& c) const {
    return c.smooth && c.n > 0 && c.stray == 0 && std::isfinite(c.at.intensity) && c.at.intensity >= 4 &&
           c.lost * 20 <= c.n;
  }

  bool collect() {
    std::vector<std::size_t> good;
    for (std::size_t i = 0; i < reduced_.cells.size(); ++i)
      if (usable(reduced_.cells[i])) good.push_back(i);
    if (good.size() < 60) return false;
    noise_by_counts(good);
    // Neighbours are taken together in large sessions: nothing here is narrower than a few beams.
    const std::size_t together = (good.size() + rows_at_most - 1) / rows_at_most;
    std::vector<std::pair<int, double>> surfaces;
    for (std::size_t i = 0; i < good.size();) {
      std::size_t end = i + 1;
      const Cell& first = reduced_.cells[good[i]];
      while (end < good.size() && end - i < together && reduced_.cells[good[end]].group == first.group &&
             reduced_.cells[good[end]].at.target == first.at.target)
        ++end;
      rows_.push_back(row_of(good, i, end, surfaces));
      i = end;
    }
    surfaces_ = static_cast<int>(surfaces.size());
    if (!claim_.stated[L::gain]) {  // start from where the recording is
      double sum = 0;
      for (std::size_t i = 0; i < rows_.size(); ++i)
        sum += rows_[i].log_counts -
               law_.log_counts(rows_[i].reflectance, cell(i).at.cos_incidence, cell(i).at.range_mm);
      law_.value[L::gain] += sum / static_cast<double>(rows_.size());
      claim_.law.value[L::gain] = law_.value[L::gain];
    }
    blocks_of_rows();
    return true;
  }

  /// Cells `from` to `end` of `good` as one row at their middle.
  [[nodiscard]] Row row_of(const std::vector<std::size_t>& good, std::size_t from, std::size_t end,
                           std::vector<std::pair<int, double>>& surfaces) const {
    Row row;
    row.cell = good[(from + end - 1) / 2];
    const Cell& middle = reduced_.cells[row.cell];
    const CaptureInfo& info = reduced_.captures[static_cast<std::size_t>(
        reduced_.groups[static_cast<std::size_t>(middle.group)].capture)];
    const Target& target = reduced_.bench.targets[static_cast<std::size_t>(middle.at.target)];
    row.reflectance = reflectance_in(info, target);
    const auto said = [&](const Cell& c) {
      return law_.log_counts(row.reflectance, c.at.cos_incidence, c.at.range_mm);
    };
    const std::pair<int, double> surface(middle.at.target, row.reflectance);
    const auto found = std::ranges::find(surfaces, surface);
    row.surface = static_cast<int>(found - surfaces.begin());
    if (found == surfaces.end()) surfaces.push_back(surface);
    double sum = 0, weight = 0;
    for (std::size_t i = from; i < end; ++i) {
      const Cell& c = reduced_.cells[good[i]];
      const double w = std::pow(noise_at(c.at.intensity), -2);
      sum += w * (std::log(c.at.intensity) - said(c));
      weight += w;
    }
    row.log_counts = said(middle) + sum / weight;
    row.sigma = std::hypot(1 / std::sqrt(weight), never_better);
    return row;
  }

  /// Scatter of a cell's intensity among its neighbours, relative, by how bright they are: device noise,
  /// rounding, speckle, all that no law tells.
  void noise_by_counts(const std::vector<std::size_t>& good) {
    std::vector<std::pair<double, double>> bends;  // counts, squared bend over its variance factor
    for (std::size_t k = 1; k + 1 < good.size(); ++k) {
      const Cell &a = reduced_.cells[good[k - 1]], &b = reduced_.cells[good[k]],
                 &c = reduced_.cells[good[k + 1]];
      if (a.group != c.group || a.at.target != b.at.target || c.at.target != b.at.target) continue;
      if (std::abs(c.beam_rad - a.beam_rad) > 3 * rad_per_deg) continue;
      const double bend = std::log(b.at.intensity) - 0.5 * std::log(a.at.intensity * c.at.intensity);
      bends.emplace_back(b.at.intensity, bend * bend / 1.5);
    }
    std::ranges::sort(bends);
    const std::size_t parts = std::clamp<std::size_t>(bends.size() / 100, 1, 8);
    for (std::size_t p = 0; p < parts; ++p) {
      const std::size_t from = p * bends.size() / parts, to = (p + 1) * bends.size() / parts;
      if (to <= from) continue;
      std::vector<double> squares;
      for (std::size_t i = from; i < to; ++i) squares.push_back(bends[i].second);
      noise_.emplace_back(std::log(bends[(from + to) / 2].first), std::sqrt(median_of(squares) / 0.4549));
    }
    if (noise_.empty()) noise_.emplace_back(0, 0.02);
  }
  [[nodiscard]] double noise_at(double counts) const {
    const double x = std::log(counts), rounding = 0.29 / counts;
    std::size_t i = 0;
    while (i + 1 < noise_.size() && noise_[i + 1].first < x) ++i;
    double sigma = noise_[i].second;
    if (i + 1 < noise_.size() && x > noise_[i].first) {
      const double f = (x - noise_[i].first) / std::max(1e-9, noise_[i + 1].first - noise_[i].first);
      sigma += f * (noise_[i + 1].second - sigma);
    }
    return std::max(sigma, 0.3 * rounding);
  }

  /// What is predicted from the rest to judge an explanation: whole captures, or sectors of beams of few.
  void blocks_of_rows() {
    std::vector<int> captures;
    for (std::size_t i = 0; i < rows_.size(); ++i) captures.push_back(group(i).capture);
    std::vector<int> distinct = captures;
    std::ranges::sort(distinct);
    distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
    by_capture_ = distinct.size() >= 6;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const int sector = static_cast<int>(std::floor(cell(i).beam_rad * deg_per_rad / 4 + 1000));
      const auto number = std::ranges::lower_bound(distinct, captures[i]) - distinct.begin();
      block_.push_back(by_capture_ ? static_cast<int>(number % blocks) : sector % blocks);
    }
  }

  // ---- prediction
  // ----------------------------------------------------------------------------------------------
  [[nodiscard]] double predicted(std::size_t i, const L& law) const {
    return law.log_counts(rows_[i].reflectance, cell(i).at.cos_incidence, cell(i).at.range_mm);
  }
  [[nodiscard]] double effect_at(const Suspicion& s, std::size_t i) const {
    if (s.target >= 0 && s.target != cell(i).at.target) return 0;
    return s.mechanism->act(cell(i).at, s.values).log_intensity;
  }
  [[nodiscard]] VectorXd effect_of(const Suspicion& s) const {
    VectorXd f(count());
    for (Index i = 0; i < count(); ++i) f[i] = effect_at(s, static_cast<std::size_t>(i));
    return f;
  }
  [[nodiscard]] VectorXd coordinate(Coordinate c) const {
    VectorXd x(count());
    for (Index i = 0; i < count(); ++i) {
      const auto at = static_cast<std::size_t>(i);
      // Brightness as predicted: what was measured would be its own cause.
      x[i] = c == Coordinate::intensity ? std::exp(predicted(at, law_)) : value_of(c, cell(at), group(at));
    }
    return x;
  }
  /// Deviations from the law and from mechanisms that the bench knows already.
  [[nodiscard]] VectorXd deviations(const L& law, const std::vector<Suspicion>& accepted) const {
    VectorXd y(count());
    for (Index i = 0; i < count(); ++i) {
      const auto at = static_cast<std::size_t>(i);
      y[i] = rows_[at].log_counts - predicted(at, law);
      for (const KnownMechanism& known : reduced_.bench.known) {
        const Mechanism* m = find_mechanism(known.mechanism);
        if (!m || known.mechanism == "radiometry" || m->observable != Observable::intensity) continue;
        const auto target = known.texts.find("target");
        if (target != known.texts.end() &&
            reduced_.bench.targets[static_cast<std::size_t>(cell(at).at.target)].name != target->second)
          continue;
        y[i] -= m->act(cell(at).at, m->values(known.parameters)).log_intensity;
      }
    }
    for (const Mechanism& unnamed : reduced_.empirical)
      if (unnamed.observable == Observable::intensity)
        for (Index i = 0; i < count(); ++i) {
          Circumstances at = cell(static_cast<std::size_t>(i)).at;
          at.intensity = std::exp(predicted(static_cast<std::size_t>(i), law));
          y[i] -= unnamed.act(at, {}).log_intensity;
        }
    for (const Suspicion& s : accepted)
      if (s.mechanism && s.coefficients.empty()) y -= effect_of(s);
    return y;
  }
  [[nodiscard]] MatrixXd law_columns(const L& law) const {
    MatrixXd columns(count(), L::size);
    for (int k = 0; k < L::size; ++k) {
      const auto c = static_cast<std::size_t>(k);
      L up = law, down = law;
      up.value[c] += 0.01;
      down.value[c] -= 0.01;
      for (Index i = 0; i < count(); ++i) {
        const auto at = static_cast<std::size_t>(i);
        columns(i, k) = (predicted(at, up) - predicted(at, down)) / 0.02;
      }
    }
    return columns;
  }

  /// Bells along x; together a smooth function of standard size one and that correlation length.
  static MatrixXd bells(const VectorXd& x, double length) {
    double low = 1e300, high = -1e300;
    for (const double v : x)
      if (std::isfinite(v)) {
        low = std::min(low, v);
        high = std::max(high, v);
      }
    if (!(high > low)) return MatrixXd(x.size(), 0);
    const int knots = static_cast<int>(std::ceil((high - low) / length)) + 3;
    MatrixXd columns = MatrixXd::Zero(x.size(), knots);
    for (int k = 0; k < knots; ++k)
      for (Index i = 0; i < x.size(); ++i) {
        if (!std::isfinite(x[i])) continue;
        const double d = (x[i] - (low + (k - 1) * length)) / length;
        if (std::abs(d) < 4) columns(i, k) = 0.75 * std::exp(-d * d / 2);
      }
    return columns;
  }
  static double span_of(const VectorXd& x) {
    double low = 1e300, high = -1e300;
    for (const double v : x)
      if (std::isfinite(v)) {
        low = std::min(low, v);
        high = std::max(high, v);
      }
    return high > low ? high - low : 0;
  }

  /// What may differ from any claim without being physics that was left out; coefficients of the law come
  /// first.
  [[nodiscard]] Block nuisances(const L& law, const std::vector<Suspicion>& accepted) const {
    Block base;
    const MatrixXd columns = law_columns(law);
    std::array<bool, L::size> wrong{};
    double scale = 1;
    for (const Suspicion& s : accepted)
      for (const int k : s.coefficients) {
        wrong[static_cast<std::size_t>(k)] = true;
        scale = std::max(1.0, s.size);
      }
    for (int k = 0; k < L::size; ++k) {
      const auto c = static_cast<std::size_t>(k);
      double sigma = claim_.stated[c] ? std::hypot(claim_.u[c], 1e-6) : open[c];
      if (wrong[c]) sigma = std::hypot(sigma, scale * released[c]);
      base.add(columns.col(k), std::max(1e-9, sigma));
    }
    MatrixXd surface = MatrixXd::Zero(count(), surfaces_);
    for (Index i = 0; i < count(); ++i) surface(i, rows_[static_cast<std::size_t>(i)].surface) = 1;
    base.add(surface, reflectance_doubt);
    VectorXd brightness(count()), slant(count());
    for (Index i = 0; i < count(); ++i) {
      brightness[i] = predicted(static_cast<std::size_t>(i), law);
      slant[i] = std::abs(cell(static_cast<std::size_t>(i)).at.incidence_rad) * deg_per_rad;
    }
    const bool whole =
        claim_.stated[L::gain] && claim_.stated[L::range_power] && claim_.stated[L::reflectance_power];
    if (span_of(brightness) > 0.05) base.add(bells(brightness, 0.7), whole ? response_doubt : open_response);
    if (!whole) {  // nothing is claimed of the way in which echoes fall with range either
      VectorXd far(count());
      for (Index i = 0; i < count(); ++i) far[i] = std::log(cell(static_cast<std::size_t>(i)).at.range_mm);
      if (span_of(far) > 0.05) base.add(bells(far, 0.5), open_response);
    }
    if (span_of(slant) > 5) base.add(bells(slant, 20), incidence_doubt);
    return base;
  }

  /// How an accepted mechanism may yet move and bend.
  void add_freedom(const Suspicion& s, Block& base) const {
    const VectorXd f = effect_of(s);
    for (const auto& [k, sigma] : searched(s)) {
      Suspicion up = s, down = s;
      const double h = 0.02 * sigma;
      move(up, k, h);
      move(down, k, -h);
      base.add((effect_of(up) - effect_of(down)) / (2 * h), sigma);
    }
    const double largest = f.cwiseAbs().maxCoeff();
    if (largest <= 0) return;
    for (const int wave : {1, 2}) {  // real causes only resemble formulas
      VectorXd bent(count());
      for (Index i = 0; i < count(); ++i) bent[i] = f[i] * std::cos(wave * pi * f[i] / largest);
      base.add(bent, s.mechanism->formula_error);
    }
  }

  /// Parameters in the unit in which they are searched, with the standard deviations of their priors.
  [[nodiscard]] std::vector<std::pair<std::size_t, double>> searched(const Suspicion& s) const {
    std::vector<std::pair<std::size_t, double>> list;
    for (std::size_t k = 0; k < s.mechanism->parameters.size(); ++k) {
      const Parameter& p = s.mechanism->parameters[k];
      if (p.role == Parameter::Role::size)
        list.emplace_back(k, p.typical);
      else if (p.logarithmic)
        list.emplace_back(k, std::log(p.upper / p.lower) / std::sqrt(12.0));
      else
        list.emplace_back(k, (p.upper - p.lower) / std::sqrt(12.0));
    }
    return list;
  }
  static void move(Suspicion& s, std::size_t k, double by) {
    const Parameter& p = s.mechanism->parameters[k];
    if (p.role == Parameter::Role::shape && p.logarithmic)
      s.values[k] = std::clamp(s.values[k] * std::exp(by), p.lower / 1.5, p.upper * 1.5);
    else
      s.values[k] += by;
  }

  [[nodiscard]] Model model_of(const std::vector<Suspicion>& accepted) const {
    return model_of(accepted, law_);
  }
  /// Expanded at another law than the claimed one.
  [[nodiscard]] Model model_of(const std::vector<Suspicion>& accepted, const L& at) const {
    VectorXd weight(count());
    for (Index i = 0; i < count(); ++i) weight[i] = 1 / rows_[static_cast<std::size_t>(i)].sigma;
    VectorXd y = deviations(at, accepted);
    Block base = nuisances(at, accepted);
    // The law's columns pull to what is claimed, not to where the model is expanded.
    for (int k = 0; k < L::size; ++k) {
      const auto c = static_cast<std::size_t>(k);
      y += (at.value[c] - law_.value[c]) * base.columns.col(k);
    }
    Model model(std::move(y), weight);
    for (const Suspicion& s : accepted) {
      if (s.mechanism && s.coefficients.empty()) add_freedom(s, base);
      if (!s.mechanism) {
        const MatrixXd columns = unnamed(s);
        base.add(columns, s.size);
      }
    }
    model.set_base(base);
    return model;
  }

  [[nodiscard]] MatrixXd unnamed(const Suspicion& s) const {
    VectorXd x = coordinate(s.coordinate);
    if (s.about >= 0)
      for (Index i = 0; i < count(); ++i) {
        const Circumstances& at = cell(static_cast<std::size_t>(i)).at;
        x[i] = at.target == s.about ? at.along_mm : std::nan("");
      }
    if (s.patch) {
      const auto inside = [&](double v) { return v >= s.patch->from_mm && v < s.patch->to_mm ? 1.0 : 0.0; };
      return x.unaryExpr(inside);
    }
    if (s.other_law()) x = x.array().log();
    return bells(x, s.length * span_of(x));
  }

  // ---- noise of the means
  // --------------------------------------------------------------------------------------
  /// What neighbouring cells share and no law tells: from the residuals of the most flexible description
  /// there is.
  void weigh() {
    std::vector<Suspicion> everything;
    Suspicion all;
    all.mechanism = find_mechanism("radiometry");
    for (int k = 0; k < L::size; ++k)
      if (claim_.stated[static_cast<std::size_t>(k)]) all.coefficients.push_back(k);
    all.size = 1;
    everything.push_back(all);
    for (Suspicion s : functions()) {
      if (s.length != finest) continue;
      s.size = 0.2;
      everything.push_back(s);
    }
    for (int pass = 0; pass < 3; ++pass) {
      const Model model = model_of(everything);
      const VectorXd residual = model.residual();
      std::vector<double> squares, single;
      for (std::size_t i = 0; i < rows_.size();) {
        double sum = 0, weight = 0;
        std::size_t k = i;
        for (; k < rows_.size() && k < i + 12 && cell(k).group == cell(i).group &&
               cell(k).at.target == cell(i).at.target;
             ++k) {
          const double w = 1 / (rows_[k].sigma * rows_[k].sigma);
          sum += w * residual[static_cast<Index>(k)];
          weight += w;
          single.push_back(std::pow(residual[static_cast<Index>(k)] / rows_[k].sigma, 2));
        }
        squares.push_back(sum * sum / weight);
        i = k;
      }
      if (squares.size() < 4) break;
      const double excess = std::max(median_of(squares), median_of(single)) / 0.4549;
      if (excess < 1.05) break;
      for (Row& row : rows_) row.sigma *= std::sqrt(excess);
      excess_ *= excess;
    }
  }

  // ---- suspects
  // ------------------------------------------------------------------------------------------------
  static constexpr double finest = 0.06;

  [[nodiscard]] std::vector<Suspicion> functions() const {
    std::vector<Suspicion> list;
    const auto offer = [&](Coordinate c, int about) {
      for (const double length : {finest, 0.15, 0.4}) {
        Suspicion s;
        s.coordinate = c;
        s.about = about;
        s.length = length;
        VectorXd x = coordinate(c);
        std::vector<double> distinct(x.data(), x.data() + x.size());
        std::erase_if(distinct, [](double v) { return !std::isfinite(v); });
        std::ranges::sort(distinct);
        distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
        if (distinct.size() > 4 || about >= 0) list.push_back(s);
      }
    };
    for (const Coordinate c : {Coordinate::beam, Coordinate::stage, Coordinate::range, Coordinate::intensity,
                               Coordinate::incidence, Coordinate::time})
      offer(c, -1);
    std::vector<int> seen(reduced_.bench.targets.size(), 0);
    for (std::size_t i = 0; i < rows_.size(); ++i) ++seen[static_cast<std::size_t>(cell(i).at.target)];
    for (std::size_t t = 0; t < seen.size() && t < 12; ++t)
      if (seen[t] > 40) offer(Coordinate::target, static_cast<int>(t));
    return list;
  }

  /// The patch of every target whose intensity deviates most from that of the rest.
  [[nodiscard]] std::vector<Suspicion> patches(const Model& model) const {
    constexpr double bin_mm = 20;
    constexpr std::array<std::size_t, 5> widths{3, 6, 12, 24, 48};
    struct Sums {
      double low_mm = 1e300, high_mm = -1e300;
      std::vector<double> weight, along;  // before each bin
    };
    std::map<int, Sums> targets;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      Sums& sums = targets[cell(i).at.target];
      sums.low_mm = std::min(sums.low_mm, cell(i).at.along_mm);
      sums.high_mm = std::max(sums.high_mm, cell(i).at.along_mm);
    }
    for (auto& [target, sums] : targets) {
      const auto bins = static_cast<std::size_t>((sums.high_mm - sums.low_mm) / bin_mm) + 1;
      sums.weight.assign(bins + 1, 0);
      sums.along.assign(bins + 1, 0);
    }
    const VectorXd residual = model.residual();
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      Sums& sums = targets.at(cell(i).at.target);
      const auto bin = static_cast<std::size_t>((cell(i).at.along_mm - sums.low_mm) / bin_mm) + 1;
      const double w = 1 / (rows_[i].sigma * rows_[i].sigma);
      sums.weight[bin] += w;
      sums.along[bin] += w * residual[static_cast<Index>(i)];
    }
    std::vector<Suspicion> list;
    for (auto& [target, sums] : targets) {
      std::partial_sum(sums.weight.begin(), sums.weight.end(), sums.weight.begin());
      std::partial_sum(sums.along.begin(), sums.along.end(), sums.along.begin());
      double best = 0, looked_at = 0;
      Suspicion s;
      s.coordinate = Coordinate::target;
      s.about = target;
      for (const std::size_t width : widths)
        for (std::size_t first = 0; 2 * width < sums.weight.size() && first + width < sums.weight.size();
             ++first) {
          const double weight = sums.weight[first + width] - sums.weight[first],
                       along = sums.along[first + width] - sums.along[first];
          ++looked_at;
          if (!(weight > 0) || along * along <= best * weight) continue;
          best = along * along / weight;
          const double from = sums.low_mm + static_cast<double>(first) * bin_mm;
          s.patch = {from, from + static_cast<double>(width) * bin_mm, 0};
        }
      if (!s.patch) continue;
      s.patch->price = std::log(looked_at / 3);  // neighbours hardly differ
      list.push_back(s);
    }
    return list;
  }

  /// Evidence of an effect around its best values (Laplace), over what the base explains.
  void weigh_up(const Model& model, Suspicion& s) const {
    const auto list = searched(s);
    MatrixXd slopes(count(), static_cast<Index>(list.size()));
    VectorXd prior(static_cast<Index>(list.size()));
    double far = 0;
    for (std::size_t j = 0; j < list.size(); ++j) {
      const auto [k, sigma] = list[j];
      Suspicion up = s, down = s;
      const double h = 0.02 * sigma;
      move(up, k, h);
      move(down, k, -h);
      slopes.col(static_cast<Index>(j)) = (effect_of(up) - effect_of(down)) / (2 * h);
      prior[static_cast<Index>(j)] = sigma;
      if (s.mechanism->parameters[k].role == Parameter::Role::size) {
        // A size far from the usual is believed, at a price.
        const double ratio = std::abs(s.values[k]) / sigma;
        if (ratio > 1) prior[static_cast<Index>(j)] *= ratio;
        far += ratio > 1 ? 0.5 + std::log(ratio) : 0.5 * ratio * ratio;
      }
    }
    MatrixXd normal = prior.asDiagonal() * model.products(slopes).square * prior.asDiagonal();
    normal.diagonal().array() += 1;
    const Eigen::LLT<MatrixXd> factor(normal);
    double log_det = 0;
    for (Index i = 0; i < normal.rows(); ++i) log_det += std::log(factor.matrixL()(i, i));
    s.gain = model.gain(effect_of(s));
    s.evidence = s.gain - log_det - far - price_of_mechanism;
    if (s.target >= 0) s.evidence -= std::log(static_cast<double>(reduced_.bench.targets.size()));
  }

  /// Best values from a start, by the gain of the likelihood.
  void refine(const Model& model, Suspicion& s, int evaluations) const {
    struct Context {
      const Intensity& self;
      const Model& model;
      Suspicion start;
      std::vector<std::pair<std::size_t, double>> list;
      static double value(unsigned n, const double* x, double*, void* data) {
        const auto& c = *static_cast<Context*>(data);
        return c.model.gain(c.self.effect_of(c.at(std::vector<double>(x, x + n))));
      }
      [[nodiscard]] Suspicion at(const std::vector<double>& x) const {
        Suspicion s = start;
        for (std::size_t j = 0; j < list.size(); ++j) {
          const auto k = list[j].first;
          const Parameter& p = s.mechanism->parameters[k];
          s.values[k] = p.role == Parameter::Role::shape && p.logarithmic ? std::exp(x[j]) : x[j];
        }
        return s;
      }
    } context{*this, model, s, searched(s)};
    std::vector<double> x, low, high, step;
    for (const auto& [k, sigma] : context.list) {
      const Parameter& p = s.mechanism->parameters[k];
      const bool logarithm = p.role == Parameter::Role::shape && p.logarithmic;
      const bool size = p.role == Parameter::Role::size;
      low.push_back(size ? (p.sign > 0 ? 0 : -0.95) : logarithm ? std::log(p.lower) : p.lower);
      high.push_back(size ? std::min(p.largest, 60 * p.typical) : logarithm ? std::log(p.upper) : p.upper);
      x.push_back(std::clamp(logarithm ? std::log(s.values[k]) : s.values[k], low.back(), high.back()));
      step.push_back(size        ? std::max(0.01, 0.3 * std::abs(s.values[k]))
                     : logarithm ? 0.3
                                 : 0.3 * s.values.back());
      if (!(std::abs(step.back()) > 1e-6)) step.back() = 0.1 * sigma;
    }
    nlopt_opt optimiser = nlopt_create(NLOPT_LN_NELDERMEAD, static_cast<unsigned>(x.size()));
    nlopt_set_lower_bounds(optimiser, low.data());
    nlopt_set_upper_bounds(optimiser, high.data());
    nlopt_set_initial_step(optimiser, step.data());
    nlopt_set_maxeval(optimiser, evaluations);
    nlopt_set_ftol_abs(optimiser, 0.01);
    nlopt_set_max_objective(optimiser, &Context::value, &context);
    double best = 0;
    nlopt_optimize(optimiser, x.data(), &best);
    nlopt_destroy(optimiser);
    s = context.at(x);
  }

  /// The best of a mechanism: a grid of its shape with the size solved for, then refined.
  Suspicion look(const Model& model, const Mechanism& m, int target) const {
    Suspicion start;
    start.mechanism = &m;
    start.target = target;
    start.values.assign(m.parameters.size(), 0);
    std::vector<Suspicion> grid{start};
    for (std::size_t k = 1; k < m.parameters.size(); ++k) {
      const Parameter& p = m.parameters[k];
      std::vector<Suspicion> more;
      const int starts = p.logarithmic ? std::max(4, p.starts) : 2 * p.starts;
      for (const Suspicion& s : grid)
        for (int i = 0; i < starts; ++i) {
          const double f = static_cast<double>(i) / (starts - 1);
          more.push_back(s);
          more.back().values[k] =
              p.logarithmic ? p.lower * std::pow(p.upper / p.lower, f) : p.lower + f * (p.upper - p.lower);
        }
      grid = std::move(more);
    }
    const VectorXd rest = model.residual().cwiseProduct(model.weight());
    for (Suspicion& s : grid) {
      s.gain = -1e300;
      double size = 0.05 * m.parameters[0].typical;
      for (int pass = 0; pass < 2; ++pass) {  // sizes are not quite linear in the logarithm
        s.values[0] = size;
        const VectorXd effect = effect_of(s) / size;
        if (effect.cwiseAbs().maxCoeff() < 1e-9) break;
        const VectorXd left = model.left_of(effect);
        const double square = left.dot(left);
        if (square < 1e-9) break;
        const double wanted = left.dot(rest) / square;
        s.gain = wanted * m.parameters[0].sign < 0 ? -1e300 : 0.5 * wanted * wanted * square;
        if (s.gain < 0) break;
        size = std::clamp(m.id == "specular" ? std::expm1(std::min(4.0, wanted)) : 1 - std::exp(-wanted),
                          1e-4, m.id == "specular" ? 50.0 : 0.95);
        s.values[0] = size;
      }
    }
    std::ranges::sort(grid, [](const Suspicion& a, const Suspicion& b) { return a.gain > b.gain; });
    Suspicion best = start;
    for (std::size_t i = 0; i < std::min<std::size_t>(2, grid.size()); ++i) {
      if (grid[i].gain < 3 || grid[i].gain < grid[0].gain - 10) break;
      refine(model, grid[i], 120);
      weigh_up(model, grid[i]);
      if (grid[i].evidence > best.evidence) best = grid[i];
    }
    return best;
  }

  /// Coefficients of the law that are wrong: each alone, and all that were stated.
  Suspicion look_at_law(const Model& model) const {
    std::vector<std::vector<int>> choices;
    std::vector<int> all;
    for (int k = 0; k < L::size; ++k)
      if (claim_.stated[static_cast<std::size_t>(k)]) {
        choices.push_back({k});
        all.push_back(k);
      }
    for (std::size_t i = 0; i < all.size(); ++i)
      for (std::size_t j = i + 1; j < all.size(); ++j) choices.push_back({all[i], all[j]});
    if (all.size() > 2) choices.push_back(all);
    const MatrixXd columns = law_columns(law_);
    Suspicion best;
    best.mechanism = find_mechanism("radiometry");
    for (const auto& choice : choices) {
      Block block;
      for (const int k : choice) block.add(columns.col(k), released[static_cast<std::size_t>(k)]);
      const MeanModel::Fit fit = MeanModel::solve(model.products(block.columns),
                                                  {VectorXd::Zero(block.sigma.size()), block.sigma}, true);
      const double evidence =
          fit.evidence - price_of_mechanism - std::log(static_cast<double>(choices.size()));
      if (evidence <= best.evidence) continue;
      best.evidence = evidence;
      best.gain = fit.gain;
      best.coefficients = choice;
      best.values.assign(fit.value.data(), fit.value.data() + fit.value.size());
      best.size = std::max(1.0, (fit.value.cwiseAbs().cwiseQuotient(block.sigma)).maxCoeff());
    }
    return best;
  }

  void look_at_function(const Model& model, Suspicion& s) const {
    const MatrixXd columns = unnamed(s);
    if (columns.cols() == 0) return;
    const MeanModel::Products products = model.products(columns);
    for (const double size : {0.01, 0.03, 0.1, 0.3}) {
      const Prior prior{VectorXd::Zero(columns.cols()), VectorXd::Constant(columns.cols(), size)};
      const MeanModel::Fit fit = MeanModel::solve(products, prior, false);
      const double price = (s.other_law() ? price_of_mechanism : price_of_unknown) + std::log(4.0) +
                           (s.patch ? s.patch->price : 0);
      if (fit.evidence - price <= s.evidence) continue;
      s.evidence = fit.evidence - price;
      s.gain = fit.gain;
      s.size = size;
    }
  }

  /// Everything that could be added to what is accepted already.
  [[nodiscard]] std::vector<Suspicion> suspects(const std::vector<Suspicion>& accepted) const {
    const Model model = model_of(accepted);
    std::vector<Suspicion> list;
    const auto taken = [&](const Suspicion& s) {
      return std::ranges::any_of(accepted, [&](const Suspicion& a) { return a.same_as(s); });
    };
    Suspicion law = look_at_law(model);
    if (!law.coefficients.empty() && !taken(law)) list.push_back(law);
    for (const char* id : {"window-dirt", "specular"}) {
      const Mechanism& m = *find_mechanism(id);
      if (m.id == "window-dirt") list.push_back(look(model, m, -1));
      if (m.id == "specular") {
        list.push_back(look(model, m, -1));
        if (reduced_.bench.targets.size() > 1)
          for (int t = 0; t < static_cast<int>(reduced_.bench.targets.size()); ++t)
            list.push_back(look(model, m, t));
      }
    }
    std::vector<Suspicion> unnamed_ones = functions();
    for (const Suspicion& s : patches(model)) unnamed_ones.push_back(s);
    for (Suspicion s : unnamed_ones) {
      if (taken(s)) continue;
      look_at_function(model, s);
      list.push_back(s);
    }
    std::erase_if(list, [](const Suspicion& s) { return s.evidence < -50; });
    std::ranges::sort(list, [](const Suspicion& a, const Suspicion& b) { return a.evidence > b.evidence; });
    return list;
  }

  // ---- search
  // --------------------------------------------------------------------------------------------------
  void search() {
    for (int round = 0; round < 5; ++round) {
      const std::vector<Suspicion> list = suspects(accepted_);
      if (list.empty() || list.front().evidence < worth_it) break;
      accepted_.push_back(list.front());
      settle();
    }
  }

  /// Values of everything accepted, together.
  void settle() {
    for (int pass = 0; pass < 3; ++pass) {
      for (std::size_t t = 0; t < accepted_.size(); ++t) {
        Suspicion& s = accepted_[t];
        if (!s.mechanism || !s.coefficients.empty()) continue;
        const Model model = model_of(without(t));
        refine(model, s, 150);
      }
    }
  }
  [[nodiscard]] std::vector<Suspicion> without(std::size_t t) const {
    std::vector<Suspicion> list = accepted_;
    list.erase(list.begin() + static_cast<std::ptrdiff_t>(t));
    return list;
  }

  // ---- judgement
  // -----------------------------------------------------------------------------------------------
  struct Judged {
    Suspicion suspicion;
    std::vector<Suspicion> rivals;  ///< Close behind.
    double probability = 0, gain = 0, rms_without = 0;
    bool unknown = false;
  };

  void judge() {
    before_ = model_of({}).held_out(block_, blocks);
    for (bool again = true; again;) {  // what does not predict data it has not seen goes
      again = false;
      after_ = model_of(accepted_).held_out(block_, blocks);
      for (std::size_t t = 0; t < accepted_.size(); ++t) {
        const Model::HeldOut held = model_of(without(t)).held_out(block_, blocks);
        if (after_.log_likelihood - held.log_likelihood > 2) continue;
        accepted_.erase(accepted_.begin() + static_cast<std::ptrdiff_t>(t));
        settle();
        again = true;
        break;
      }
    }
    for (std::size_t t = 0; t < accepted_.size(); ++t) {
      Judged j;
      j.suspicion = accepted_[t];
      const std::vector<Suspicion> others = without(t);
      const Model::HeldOut held = model_of(others).held_out(block_, blocks);
      j.gain = after_.log_likelihood - held.log_likelihood;
      j.rms_without = held.rms;
      double own = -1e300, total = 0;
      const std::vector<Suspicion> list = suspects(others);
      for (const Suspicion& s : list)
        if (s.same_as(j.suspicion)) own = std::max(own, s.evidence);
      own = std::max(own, j.suspicion.evidence);
      std::vector<const Suspicion*> kinds;
      for (const Suspicion& s : list) {
        if (s.same_kind(j.suspicion)) continue;
        if (std::ranges::any_of(kinds, [&](const Suspicion* k) { return k->same_kind(s); })) continue;
        kinds.push_back(&s);
        total += std::exp(std::min(50.0, s.evidence - own));
        if ((s.mechanism || s.other_law()) && s.evidence > own - odds::close_behind) j.rivals.push_back(s);
        if (!s.mechanism && !s.other_law() && s.evidence > own) j.unknown = true;
      }
      total += std::exp(std::min(50.0, -own));  // nothing at all
      j.probability = 1 / (1 + total);
      if (!j.suspicion.mechanism && !j.suspicion.other_law()) j.unknown = true;
      judged_.push_back(j);
    }
  }

  static std::string id_of(const Suspicion& s) { return s.mechanism ? s.mechanism->id : "radiometry"; }

  // ---- answer
  // --------------------------------------------------------------------------------------------------
  [[nodiscard]] std::string per_cent(double share) const { return rounded(100 * share, 2) + " %"; }

  Found found_of(const Judged& j, const Model& model) const {
    const Suspicion& s = j.suspicion;
    Found found;
    found.mechanism = s.mechanism;
    found.probability = std::min(0.999, j.probability);
    found.log_likelihood_gain = j.gain;
    Finding finding;
    if (s.other_law()) {
      found.mechanism = find_mechanism("radiometry");
      const auto [largest, at] = largest_of(s);
      finding.parameters["largest_deviation"] = largest;
      found.says =
          "Echoes follow another law of intensity than the bench file claims: they deviate by up to " +
          per_cent(largest) +
          (s.coordinate == Coordinate::range ? ", most at " + rounded(at, 3) + " mm."
                                             : ", most around " + rounded(at, 3) + " counts.");
    } else if (!s.coefficients.empty()) {
      std::string says;
      for (const int k : s.coefficients) {
        const auto c = static_cast<std::size_t>(k);
        const auto which = static_cast<L::Coefficient>(k);
        const Estimate now = in_file_unit(which, {law_now_.value[c], law_u_[c]});
        const Estimate said = in_file_unit(which, {claim_.law.value[c], claim_.u[c]});
        finding.parameters[file_name(which)] = now;
        says += (says.empty() ? "" : ", ") + std::string(file_name(which)) + " is " +
                with_uncertainty(now, "") + " where the bench file says " + rounded(said.value, 4);
      }
      found.says = "Echoes follow another law of intensity than the bench file claims: " + says + ".";
    } else {
      const auto [values, sigma] = uncertainties_of(s, model);
      for (std::size_t k = 0; k < s.mechanism->parameters.size(); ++k)
        finding.parameters[s.mechanism->parameters[k].name] = {values[k], sigma[k]};
      if (s.target >= 0) found.target = reduced_.bench.targets[static_cast<std::size_t>(s.target)].name;
      finding.target = found.target;
      found.says = s.mechanism->says(finding);
    }
    found.parameters = finding.parameters;
    found.evidence = "Intensities of captures it was not fitted to scatter by " + per_cent(j.rms_without) +
                     " around their prediction without it, and by " + per_cent(after_.rms) + " with it.";
    return found;
  }

  /// Posterior widths of a term's values, everything else free.
  [[nodiscard]] std::pair<std::vector<double>, std::vector<double>> uncertainties_of(
      const Suspicion& s, const Model& model) const {
    Index first = nuisances(law_now_, accepted_).columns.cols();
    for (const Suspicion& other : accepted_) {
      if (other.mechanism && other.coefficients.empty()) {
        if (other.mechanism == s.mechanism && other.target == s.target && other.values == s.values) break;
        first +=
            static_cast<Index>(searched(other).size()) + (effect_of(other).cwiseAbs().maxCoeff() > 0 ? 2 : 0);
      } else if (!other.mechanism) {
        first += unnamed(other).cols();
      }
    }
    const VectorXd u = model.uncertainties();
    std::vector<double> sigma(s.values.size(), 0);
    const auto list = searched(s);
    for (std::size_t j = 0; j < list.size(); ++j) {
      const Parameter& p = s.mechanism->parameters[list[j].first];
      const double own = u[first + static_cast<Index>(j)];
      const bool logarithm = p.role == Parameter::Role::shape && p.logarithmic;
      sigma[list[j].first] = logarithm ? own * s.values[list[j].first] : own;
    }
    return {s.values, sigma};
  }

  void write(Explanation& out) {
    law_now_ = law_;
    Model model = model_of(accepted_, law_now_);
    for (int pass = 0; pass < 5; ++pass) {  // the logarithm of an overlap bends
      if (pass > 0) model = model_of(accepted_, law_now_);
      const VectorXd x = model.coefficients(), u = model.uncertainties();
      for (int k = 0; k < L::size; ++k) {
        const auto c = static_cast<std::size_t>(k);
        law_now_.value[c] = law_.value[c] + std::clamp(x[k], -2.0, 2.0);
        law_u_[c] = u[k] > 1e-5 ? u[k] : 0;
      }
    }
    for (const Judged& j : judged_) {
      const Suspicion& s = j.suspicion;
      if (j.unknown) {
        describe_unknown(s, out);
        continue;
      }
      if (!j.rivals.empty()) {
        std::vector<std::string> set{id_of(s)};
        for (const Suspicion& r : j.rivals)
          if (!std::ranges::count(set, id_of(r))) set.push_back(id_of(r));
        if (set.size() < 2) continue;
        if (!std::ranges::count(out.undecided_between, set)) out.undecided_between.push_back(set);
        out.light_suspects.push_back(suspect_of(s));
        for (const Suspicion& r : j.rivals) out.light_suspects.push_back(suspect_of(r));
        continue;
      }
      if (j.probability < 0.3) continue;
      Found found = found_of(j, model);
      found.rms_before_mm = found.rms_after_mm = out.after.rms_mm;
      // Two spots on a window are one dirty window in the answer, and two entries in the bench.
      const bool again = std::ranges::any_of(out.mechanisms, [&](const Found& f) {
        return f.mechanism == found.mechanism && f.target == found.target;
      });
      if (s.mechanism && s.coefficients.empty()) {
        KnownMechanism known{s.mechanism->id, found.parameters, {}};
        if (!found.target.empty()) known.texts["target"] = found.target;
        out.bench.known.push_back(known);
      }
      if (!again || id_of(s) == "window-dirt") out.mechanisms.push_back(found);
      locate(s, out);
    }
    for (const Judged& j : judged_) without_name(j, out.bench);
    state_intensity(out.bench, law_now_, law_u_, sample_noise());
    pictures(model, out);
    out.notes.push_back("Intensities are compared with the bench's radiometry: held out, they scatter by " +
                        per_cent(before_.rms) + " before and " + per_cent(after_.rms) +
                        " after; neighbouring beams scatter by " + per_cent(floor()) + ".");
    if (excess_ > 1.5)
      out.notes.push_back("Intensities of neighbouring beams deviate together, " +
                          rounded(std::sqrt(excess_), 2) +
                          " times more than their scatter says; everything was weighed accordingly.");
    out.verdict = out.unknown                      ? "unknown-physics"
                  : !out.undecided_between.empty() ? "undecided"
                  : !out.mechanisms.empty()        ? "explained"
                                                   : "nothing-missing";
  }

  /// What was found and has no name, for the twin: functions of one coordinate as they are, and of suspects
  /// that nobody can choose from, the best one's effect along its coordinate.
  void without_name(const Judged& j, Bench& bench) const {
    const Suspicion& s = j.suspicion;
    const bool named = s.mechanism && j.rivals.empty() && !j.unknown && j.probability >= 0.3;
    if (named || !s.coefficients.empty()) return;  // its law is stated
    const Coordinate c = s.mechanism ? s.mechanism->coordinate : s.coordinate;
    VectorXd x = coordinate(c);
    EmpiricalFunction f{name_of(c), "log_intensity", "", {}, {}};
    const int target = s.mechanism ? s.target : s.about;
    if (target >= 0) f.target = reduced_.bench.targets[static_cast<std::size_t>(target)].name;
    if (s.about >= 0) f.coordinate = "along_mm";
    for (Index i = 0; i < count(); ++i) {
      const Circumstances& at = cell(static_cast<std::size_t>(i)).at;
      if (s.about >= 0) x[i] = at.along_mm;
      if (target >= 0 && at.target != target) x[i] = std::nan("");
    }
    const VectorXd y = s.mechanism ? effect_of(s) : function_of(s);
    std::vector<std::pair<double, double>> places;
    for (Index i = 0; i < count(); ++i)
      if (std::isfinite(x[i])) places.emplace_back(x[i], y[i]);
    std::ranges::sort(places);
    const std::size_t each = 1 + places.size() / 150;
    for (std::size_t i = 0; i < places.size();) {
      std::size_t end = std::min(places.size(), i + each);
      while (end < places.size() && places[end].first <= places[end - 1].first + 1e-9) ++end;
      double sum_x = 0, sum_y = 0;
      for (std::size_t k = i; k < end; ++k) {
        sum_x += places[k].first;
        sum_y += places[k].second;
      }
      f.at.push_back(sum_x / static_cast<double>(end - i));
      f.value.push_back(sum_y / static_cast<double>(end - i));
      i = end;
    }
    if (f.at.size() > 1) add_empirical(bench, f);
  }

  /// For the next experiment: another law is one whose stated coefficients are off.
  [[nodiscard]] LightSuspect suspect_of(const Suspicion& s) const {
    if (s.mechanism) return {s.mechanism, s.target, s.values, s.coefficients};
    LightSuspect law{find_mechanism("radiometry"), -1, {}, {}};
    for (int k = 0; k < L::size; ++k)
      if (claim_.stated[static_cast<std::size_t>(k)]) law.coefficients.push_back(k);
    const MatrixXd all = law_columns(law_);
    MatrixXd own(count(), static_cast<Index>(law.coefficients.size()));
    for (std::size_t k = 0; k < law.coefficients.size(); ++k)
      own.col(static_cast<Index>(k)) = all.col(law.coefficients[k]);
    MatrixXd normal = own.transpose() * own;
    normal.diagonal().array() += 1e-3;
    const VectorXd x = normal.ldlt().solve(own.transpose() * function_of(s));
    law.values.assign(x.data(), x.data() + x.size());
    return law;
  }

  /// Largest relative deviation that an unnamed function explains, and where.
  [[nodiscard]] std::pair<double, double> largest_of(const Suspicion& s) const {
    const VectorXd f = function_of(s);
    Index where = 0;
    const double largest = f.cwiseAbs().maxCoeff(&where);
    return {std::expm1(largest), coordinate(s.coordinate)[where]};
  }
  [[nodiscard]] VectorXd function_of(const Suspicion& s) const {
    const MatrixXd columns = unnamed(s);
    const Prior prior{VectorXd::Zero(columns.cols()), VectorXd::Constant(columns.cols(), s.size)};
    return columns * MeanModel::solve(model_of(without_function(s)).products(columns), prior, false).value;
  }

  void describe_unknown(const Suspicion& s, Explanation& out) const {
    Suspicion f = s;
    if (s.mechanism) {  // a named one that an unnamed function beats: describe it on the mechanism's
                        // coordinate
      f.coordinate =
          s.mechanism->coordinate == Coordinate::intensity ? Coordinate::range : s.mechanism->coordinate;
    }
    Unexplained u;
    u.observable = Observable::intensity;
    u.coordinate = f.coordinate;
    const VectorXd at = coordinate(f.coordinate);
    u.from = s.about >= 0 ? s.about : at.minCoeff();
    u.to = s.about >= 0 ? s.about + 0.1 : at.maxCoeff();
    if (!s.mechanism) {
      u.describes = "intensity deviates from the bench's law by up to " + per_cent(largest_of(s).first) +
                    (s.patch ? ", from " + rounded(s.patch->from_mm, 3) + " mm to " +
                                   rounded(s.patch->to_mm, 3) + " mm from the middle"
                             : ", a smooth function of " + std::string(name_of(f.coordinate))) +
                    (s.about >= 0 ? " along target '" +
                                        reduced_.bench.targets[static_cast<std::size_t>(s.about)].name + "'"
                                  : "");
    } else {
      u.describes = "intensity deviates from the bench's law along " + std::string(name_of(f.coordinate)) +
                    " in a way that resembles " + s.mechanism->id + " but follows no mechanism";
    }
    u.evidence = s.evidence;
    u.gain = s.gain;
    if (out.unknown)
      out.unknown->describes += "; and " + u.describes;
    else
      out.unknown = u;
    out.located.push_back(
        {u.coordinate, u.from, u.to, Observable::intensity, std::exp(-std::min(600.0, s.gain))});
  }
  [[nodiscard]] std::vector<Suspicion> without_function(const Suspicion& s) const {
    std::vector<Suspicion> list = accepted_;
    std::erase_if(list, [&](const Suspicion& o) { return !o.mechanism && o.same_as(s); });
    return list;
  }

  /// Where an effect carries at least a quarter of its largest information.
  void locate(const Suspicion& s, Explanation& out) const {
    const Coordinate c = s.mechanism ? s.mechanism->coordinate : s.coordinate;
    const VectorXd x = coordinate(c);
    VectorXd f = VectorXd::Zero(count());
    if (!s.mechanism) {
      f = function_of(s);
    } else if (s.coefficients.empty()) {
      f = effect_of(s);
    } else {
      for (Index i = 0; i < count(); ++i)
        f[i] =
            predicted(static_cast<std::size_t>(i), law_now_) - predicted(static_cast<std::size_t>(i), law_);
    }
    constexpr int bins = 30;
    const double low = x.minCoeff(), width = std::max(1e-9, (x.maxCoeff() - low) / bins);
    std::array<double, bins> information{};
    for (Index i = 0; i < count(); ++i) {
      const int b = std::clamp(static_cast<int>((x[i] - low) / width), 0, bins - 1);
      information[static_cast<std::size_t>(b)] +=
          std::pow(f[i] / rows_[static_cast<std::size_t>(i)].sigma, 2);
    }
    const double most = *std::ranges::max_element(information);
    int last = -10;
    std::size_t first = out.located.size();
    for (int b = 0; b < bins; ++b) {
      const double own = information[static_cast<std::size_t>(b)];
      if (own < 0.25 * most || most <= 0) continue;
      const double p = std::max(1e-300, boost::math::erfc(std::sqrt(own / 2)));
      if (b - last <= 2 && out.located.size() > first) {
        out.located.back().to = low + (b + 1) * width;
        out.located.back().p_value = std::min(out.located.back().p_value, p);
      } else {
        out.located.push_back({c, low + b * width, low + (b + 1) * width, Observable::intensity, p});
      }
      last = b;
    }
  }

  [[nodiscard]] double floor() const {
    std::vector<double> list;
    for (std::size_t i = 0; i < rows_.size(); ++i) list.push_back(noise_at(cell(i).at.intensity));
    return median_of(list);
  }

  /// Relative noise of one sample.
  [[nodiscard]] std::optional<double> sample_noise() const {
    std::vector<double> list;
    for (std::size_t i = 0; i < rows_.size(); ++i)
      if (cell(i).n > 2) list.push_back(cell(i).intensity_sd / cell(i).at.intensity);
    if (list.size() < 20) return claim_.relative_noise;
    return median_of(list);
  }

  void pictures(const Model& after, Explanation& out) const {
    const Model before = model_of({});
    const VectorXd a = before.residual(), b = after.residual();
    for (const Coordinate c : {Coordinate::beam, Coordinate::range, Coordinate::incidence}) {
      const VectorXd x = coordinate(c);
      const double low = x.minCoeff(), width = (x.maxCoeff() - low) / 40;
      if (!(width > 1e-9)) continue;
      IntensityCurve curve;
      curve.coordinate = c;
      std::array<double, 40> weight{}, first{}, second{};
      for (Index i = 0; i < count(); ++i) {
        const auto k = static_cast<std::size_t>(std::clamp(static_cast<int>((x[i] - low) / width), 0, 39));
        const double w = 1 / std::pow(rows_[static_cast<std::size_t>(i)].sigma, 2);
        weight[k] += w;
        first[k] += w * a[i];
        second[k] += w * b[i];
      }
      for (std::size_t k = 0; k < weight.size(); ++k) {
        if (weight[k] <= 0) continue;
        curve.at.push_back(low + (static_cast<double>(k) + 0.5) * width);
        curve.before.push_back(first[k] / weight[k]);
        curve.after.push_back(second[k] / weight[k]);
        curve.sigma.push_back(1 / std::sqrt(weight[k]));
      }
      out.intensity_curves.push_back(std::move(curve));
    }
  }

  static constexpr int blocks = 5;
  const Reduced& reduced_;
  IntensityClaim claim_;
  L law_, law_now_;
  std::array<double, L::size> law_u_{};
  std::vector<Row> rows_;
  int surfaces_ = 0;
  bool by_capture_ = true;
  std::vector<int> block_;
  std::vector<std::pair<double, double>> noise_;  ///< ln counts, relative scatter of a cell's mean.
  double excess_ = 1;
  std::vector<Suspicion> accepted_;
  std::vector<Judged> judged_;
  Model::HeldOut before_, after_;
};

}  // namespace

MatrixXd evidence_between(const Reduced& reduced, const std::vector<LightSuspect>& suspects) {
  auto claim = claimed_intensity(reduced.bench);
  const auto size = static_cast<Index>(suspects.size());
  if (!claim || !reduced.has_intensity) return MatrixXd::Zero(size, size);
  return Intensity(reduced, std::move(*claim)).evidence_between(suspects);
}

void explain_intensity(const Reduced& reduced, Explanation& explanation) {
  auto claim = claimed_intensity(reduced.bench);
  if (!claim || !reduced.has_intensity) return;
  Intensity(reduced, std::move(*claim)).run(explanation);
}

}  // namespace fit::explain
