// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/explain/inference/steps.hpp"
#include "fit/explain/numbers.hpp"
#include "fit/numeric/products.hpp"

namespace fit::explain::inference {
namespace {

using Eigen::Index;

constexpr int blocks_of_few = 6, most_blocks = 8;
enum class Few { sectors, captures };  // What is left out of less than six captures.

bool has_beams(const ChannelRows& rows) {
  return rows.rows() > 0 && rows.at(0).beam_rad != rows.at(rows.rows() - 1).beam_rad;
}

struct Blocks {
  int count = 0;
  bool few = false;

  Blocks(std::size_t captures, Few few_leave)
      : count(static_cast<int>(std::min<std::size_t>(most_blocks, captures))),
        few(few_leave == Few::sectors && captures < blocks_of_few) {
    if (few) count = blocks_of_few;
  }
  [[nodiscard]] int of(const ChannelRows& rows, Index row) const {
    constexpr double sector_deg = 9;
    // What has no beam, such as whole scans, is left out capture by capture, be they few.
    const int number = few && has_beams(rows)
                           ? static_cast<int>((rows.at(row).beam_rad + 4) * deg_per_rad / sector_deg)
                           : rows.capture(row);
    return number % count;
  }
};

/// Rows of one block in one channel.
struct Part {
  std::vector<Index> rows;
  Eigen::MatrixXd white;
  Eigen::VectorXd residual;
};

Part part_of(const Session& session, const Fitted& f, std::size_t c, const Blocks& blocks, int block) {
  const ChannelRows& rows = *session.channels()[c];
  Part part;
  for (Index i = 0; i < rows.rows(); ++i)
    if (blocks.of(rows, i) == block) part.rows.push_back(i);
  part.white = f.optimum.white[c](part.rows, Eigen::all);
  part.residual = f.optimum.white_residual[c](part.rows);
  return part;
}

/// Shapes stay as all captures have them: nothing tells a threshold where no echo is as weak.
constexpr double as_all_have_them = 1e12;

/// Predicts one block from all others and adds what comes of it.
class Block {
 public:
  Block(const Session& session, const Fitted& fitted, const Eigen::LLT<Eigen::MatrixXd>& all,
        const Blocks& blocks, int block, bool only_means)
      : session_(session), f_(fitted), all_(all) {
    Eigen::MatrixXd rest = fitted.optimum.factor.reconstructedMatrix();
    score_ = Eigen::VectorXd::Zero(rest.rows());
    square_ = Eigen::MatrixXd::Zero(rest.rows(), rest.rows());
    for (std::size_t c = 0; c < session.channels().size(); ++c) {
      const bool counts = session.channels()[c] && (!only_means || c == model::channel_of("mean"));
      parts_.push_back(counts ? part_of(session, fitted, c, blocks, block) : Part{});
      if (parts_[c].rows.empty()) continue;
      const auto& index = fitted.design.parts[c].index;
      score_(index) += parts_[c].white.transpose() * parts_[c].residual;
      square_(index, index) += square_of_columns(parts_[c].white);
    }
    rest -= square_;
    hold_shapes(fitted.design, as_all_have_them, rest);
    hold_shapes(fitted.design, 0, square_);
    for (const Design::Block& term : fitted.design.blocks)
      score_.segment(term.first_shape(), term.shapes).setZero();
    factor_.compute(rest);
  }

  void add_to(HeldOutFigures& sum) const {
    const Eigen::VectorXd without = f_.optimum.x - factor_.solve(score_);
    sum.log_likelihood += log_density(factor_, all_, without - f_.optimum.x);
    for (std::size_t c = 0; c < parts_.size(); ++c) {
      if (parts_[c].rows.empty()) continue;
      const Eigen::VectorXd logs = session_.channels()[c]->log_likelihoods(f_.optimum.eta[c]);
      for (const Index row : parts_[c].rows) sum.log_likelihood += logs[row];
      if (c == model::channel_of("mean")) add_means(c, without, sum);
    }
  }

  /// What the other captures' say on those coefficients adds to the log density: against these being drawn
  /// anew for this block, by their priors.
  [[nodiscard]] double gain_of_others(const std::vector<Index>& of) const {
    const Index n = score_.size();
    const Eigen::VectorXd off = -factor_.solve(score_);
    const Eigen::MatrixXd covariance = factor_.solve(Eigen::MatrixXd::Identity(n, n));
    Eigen::MatrixXd anew = covariance;
    Eigen::VectorXd from = off;
    for (const Index k : of) {
      anew.row(k).setZero();
      anew.col(k).setZero();
      anew(k, k) = 1;
      from[k] = -f_.optimum.x[k];
    }
    const Eigen::MatrixXd information = anew.inverse();
    const Eigen::LLT<Eigen::MatrixXd> before(information), after(information + square_);
    return log_density(factor_, all_, off) - log_density(before, after, from);
  }

 private:
  /// Of the block, less that at the best coefficients: those are off by `from` before it is seen; the
  /// information on them before and after.
  [[nodiscard]] double log_density(const Eigen::LLT<Eigen::MatrixXd>& before,
                                   const Eigen::LLT<Eigen::MatrixXd>& after,
                                   const Eigen::VectorXd& from) const {
    const Eigen::VectorXd score = score_ - square_ * from;
    return from.dot(score_) - 0.5 * from.dot(square_ * from) + 0.5 * score.dot(after.solve(score)) +
           0.5 * (log_determinant(before) - log_determinant(after));
  }
  void add_means(std::size_t c, const Eigen::VectorXd& x, HeldOutFigures& sum) const {
    const Design::Part& design = f_.design.parts[c];
    const ChannelRows& rows = *session_.channels()[c];
    const Eigen::VectorXd information = rows.information(f_.optimum.eta[c]);
    for (const Index row : parts_[c].rows) {
      double eta = design.offset[row];
      Eigen::VectorXd columns = Eigen::VectorXd::Zero(x.size());
      for (std::size_t k = 0; k < design.index.size(); ++k) {
        const double column = design.columns(row, static_cast<Index>(k));
        eta += column * x[design.index[k]];
        columns[design.index[k]] = column;
      }
      const double off = rows.statistic(row) - eta,
                   z = off / std::sqrt(1 / information[row] + columns.dot(factor_.solve(columns)));
      sum.rms_mm += off * off;  // the sum of squares, until all are in
      sum.coverage += std::abs(z) < 1.96;
      sum.cells += 1;
    }
  }

  const Session& session_;
  const Fitted& f_;
  const Eigen::LLT<Eigen::MatrixXd>& all_;  ///< Of all rows, shapes held.
  std::vector<Part> parts_;
  Eigen::MatrixXd square_;  ///< Information of the block.
  Eigen::VectorXd score_;
  Eigen::LLT<Eigen::MatrixXd> factor_;  ///< Of all others.
};

Eigen::LLT<Eigen::MatrixXd> factor_of_all(const Fitted& fitted) {
  Eigen::MatrixXd all = fitted.optimum.factor.reconstructedMatrix();
  hold_shapes(fitted.design, as_all_have_them, all);
  return Eigen::LLT<Eigen::MatrixXd>(all);
}

}  // namespace

HeldOutFigures hold_out(const Session& session, const Fitted& fitted, bool only_means) {
  const Blocks blocks(session.reduced().captures.size(), Few::sectors);
  HeldOutFigures sum;
  const Eigen::LLT<Eigen::MatrixXd> all = factor_of_all(fitted);
  for (int b = 0; b < blocks.count; ++b) Block(session, fitted, all, blocks, b, only_means).add_to(sum);
  const double cells = std::max(1.0, sum.cells);
  sum.rms_mm = std::sqrt(sum.rms_mm / cells);
  sum.coverage /= cells;
  return sum;
}

bool forms_carry_over(const Session& session, const Fitted& fitted) {
  const Blocks captures(session.reduced().captures.size(), Few::captures);
  std::vector<Index> of_forms;
  double gain = 0;
  for (std::size_t t = 0; t < fitted.design.blocks.size(); ++t) {
    const Kind& kind = *fitted.hypothesis.terms[t].kind;
    const Design::Block& block = fitted.design.blocks[t];
    if (!kind.is_form() || !kind.moves_means()) continue;
    gain += kind.log_prior;  // chosen among many for what all captures show
    for (Index k = 0; k < block.sizes; ++k) of_forms.push_back(block.first + k);
  }
  if (captures.count < 2 || of_forms.empty()) return true;
  const Eigen::LLT<Eigen::MatrixXd> all = factor_of_all(fitted);
  for (int b = 0; b < captures.count; ++b) {
    const double of_this = Block(session, fitted, all, captures, b, true).gain_of_others(of_forms);
    if (of_this < numbers::contradicted_at) return false;
    gain += of_this;
  }
  return gain > 0;
}

}  // namespace fit::explain::inference
