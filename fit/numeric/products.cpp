// SPDX-License-Identifier: MIT
#include "fit/numeric/products.hpp"

#include <algorithm>

namespace fit {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

/// Columns beside each other, each that far behind the one before.
struct Panel {
  const double* first = nullptr;
  Index stride = 0, columns = 0;
};

struct Job {
  Panel a, b;
  Index rows = 0;
  double* product = nullptr;  ///< Column by column; a.columns each.
  bool is_square = false;     ///< b is a: what lies above the diagonal blocks is not asked.
};

/// Adds a block of a' b, p by q, over some rows. Vectors of so many doubles; the compiler makes of them what
/// the processor has for the function that this is part of.
template <int lanes, int p, int q>
[[gnu::always_inline]] inline void add_block(const Job& job, Index i, Index j, Index from, Index end) {
  typedef double Vector __attribute__((vector_size(8 * lanes), aligned(8), may_alias));
  const double* a = job.a.first + i * job.a.stride;
  const double* b = job.b.first + j * job.b.stride;
  Vector sums[p][q] = {};
  Index row = from;
  for (; row + lanes <= end; row += lanes) {
    Vector x[p];
    for (int k = 0; k < p; ++k) x[k] = *reinterpret_cast<const Vector*>(a + k * job.a.stride + row);
    for (int l = 0; l < q; ++l) {
      const Vector y = *reinterpret_cast<const Vector*>(b + l * job.b.stride + row);
      for (int k = 0; k < p; ++k) sums[k][l] += x[k] * y;
    }
  }
  for (int k = 0; k < p; ++k)
    for (int l = 0; l < q; ++l) {
      double sum = 0;
      for (int lane = 0; lane < lanes; ++lane) sum += sums[k][l][lane];
      for (Index rest = row; rest < end; ++rest)
        sum += a[k * job.a.stride + rest] * b[l * job.b.stride + rest];
      job.product[(j + l) * job.a.columns + i + k] += sum;
    }
}

template <int lanes>
[[gnu::always_inline]] inline void add_products(const Job& job) {
  constexpr Index together = 256;  // rows, whose columns a cache holds
  for (Index from = 0; from < job.rows; from += together) {
    const Index end = std::min(job.rows, from + together);
    for (Index j = 0; j < job.b.columns;) {
      const bool four_b = j + 4 <= job.b.columns;
      for (Index i = job.is_square ? j : 0; i < job.a.columns;) {
        const bool four_a = i + 4 <= job.a.columns;
        if (four_a && four_b)
          add_block<lanes, 4, 4>(job, i, j, from, end);
        else if (four_a)
          add_block<lanes, 4, 1>(job, i, j, from, end);
        else if (four_b)
          add_block<lanes, 1, 4>(job, i, j, from, end);
        else
          add_block<lanes, 1, 1>(job, i, j, from, end);
        i += four_a ? 4 : 1;
      }
      j += four_b ? 4 : 1;
    }
  }
}

using Kernel = void (*)(const Job&);
void by_two(const Job& job) { add_products<2>(job); }
#ifdef __x86_64__
[[gnu::target("avx2")]] void by_four(const Job& job) { add_products<4>(job); }
[[gnu::target("avx512f")]] void by_eight(const Job& job) { add_products<8>(job); }
#endif

Kernel fastest() {
#ifdef __x86_64__
  if (__builtin_cpu_supports("avx512f")) return by_eight;
  if (__builtin_cpu_supports("avx2")) return by_four;
#endif
  return by_two;
}

void run(const Job& job) {
  static const Kernel kernel = fastest();
  kernel(job);
}

Panel panel_of(const Eigen::Ref<const MatrixXd>& m) { return {m.data(), m.outerStride(), m.cols()}; }

}  // namespace

MatrixXd transpose_product(const Eigen::Ref<const MatrixXd>& a, const Eigen::Ref<const MatrixXd>& b) {
  MatrixXd product = MatrixXd::Zero(a.cols(), b.cols());
  run({panel_of(a), panel_of(b), a.rows(), product.data()});
  return product;
}

MatrixXd square_of_columns(const Eigen::Ref<const MatrixXd>& a) {
  MatrixXd product = MatrixXd::Zero(a.cols(), a.cols());
  run({panel_of(a), panel_of(a), a.rows(), product.data(), true});
  product.triangularView<Eigen::StrictlyUpper>() = product.transpose();
  return product;
}

}  // namespace fit
