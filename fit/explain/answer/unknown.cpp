// SPDX-License-Identifier: MIT
#include <vector>

#include "fit/explain/answer/chapters.hpp"

namespace fit::explain::answer {
namespace {

/// The functions without a name that were needed: the place of the first, and all in words.
Unexplained of_shapes(const Reduced& reduced, const Inferred& inferred) {
  const MeanResult& means = inferred.means;
  const MeanModel model(reduced, means.noise);
  const Shape& shape = means.best.shapes.front();
  const Described first = describe(shape, model);
  Unexplained u;
  u.observable = Observable::range_mean;
  u.coordinate = shape.coordinate;
  u.describes = first.text;
  u.from = shape.is_along_one_target() ? shape.target : first.from;
  u.to = shape.is_along_one_target() ? shape.target : first.to;
  for (std::size_t i = 1; i < means.best.shapes.size(); ++i)
    u.describes += "; and " + describe(means.best.shapes[i], model).text;
  return u;
}

}  // namespace

void report_unknown(const Reduced& reduced, const Inferred& inferred, Explanation& out) {
  std::vector<Unexplained> all = inferred.unknown;
  if (!inferred.means.best.shapes.empty()) all.insert(all.begin(), of_shapes(reduced, inferred));
  if (all.empty()) return;
  out.unknown = all.front();
  for (std::size_t i = 1; i < all.size(); ++i) out.unknown->describes += "; and " + all[i].describes;
}

}  // namespace fit::explain::answer
