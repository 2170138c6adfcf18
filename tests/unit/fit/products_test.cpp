// SPDX-License-Identifier: MIT
#include "fit/numeric/products.hpp"

#include <catch2/catch.hpp>
#include <random>

namespace products_test {

Eigen::MatrixXd drawn(Eigen::Index rows, Eigen::Index columns, std::mt19937& random) {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd m(rows, columns);
  for (Eigen::Index i = 0; i < m.size(); ++i) m.data()[i] = normal(random);
  return m;
}

TEST_CASE("products of columns are what their definition says, whatever their sizes") {
  std::mt19937 random(5);
  for (const Eigen::Index rows : {0, 1, 7, 8, 255, 256, 257, 1003})
    for (const Eigen::Index p : {0, 1, 3, 4, 5, 9, 12})
      for (const Eigen::Index q : {1, 2, 4, 6, 11}) {
        const Eigen::MatrixXd a = drawn(rows, p, random), b = drawn(rows, q + 2, random);
        const auto part = b.middleCols(1, q);
        CAPTURE(rows, p, q);
        CHECK((fit::transpose_product(a, part) - a.transpose().lazyProduct(part)).norm() < 1e-10);
        CHECK((fit::square_of_columns(part) - part.transpose().lazyProduct(part)).norm() < 1e-10);
      }
}

}  // namespace products_test
