// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <optional>
#include <set>
#include <vector>

#include "fit/explain/spread/interval.hpp"

/// What comes and goes: the search for where and when something happens.
namespace fit::explain::spread {

/// All beam angles, or those around one.
struct Place {
  bool everywhere = false;
  double centre_deg = 0, width_deg = 0;
};

/// A place, from one time to another.
struct PlaceAndTimes {
  Place place;
  Interval times_s;
  double u_from_s = 0, u_to_s = 0;  ///< Of these times.
};

/// Times at which something was recorded, in order. Neighbours of more than `most` are taken together: spans
/// are as many as their square.
class Times {
 public:
  Times(const std::set<double>& different_s, std::size_t most);
  [[nodiscard]] std::size_t count() const { return (all_s_.size() + each_ - 1) / each_; }
  /// Of a time that is one of them.
  [[nodiscard]] std::size_t index_of(double time_s) const;
  /// What lasted from one index to another, both included, began and ended between two recordings, nobody
  /// knows when; `u_open_s`: if nothing was recorded before it, or after it.
  [[nodiscard]] PlaceAndTimes lasting(const Place& place, std::size_t first, std::size_t last,
                                      double u_open_s) const;

 private:
  std::vector<double> all_s_;
  std::size_t each_;
};

/// Two sums over whatever was recorded at a place, of what only the caller knows.
using Sums = Eigen::Array2d;

struct SpanSearch {
  /// One pair of sums a time.
  std::function<std::vector<Sums>(const Place&)> sums_at;
  /// How well that tells a span from all others; none where it does not.
  std::function<std::optional<double>(const Sums&)> score;
  double u_open_s = 0;  ///< Of a time before which, or after which, nothing was recorded.
};

struct FoundSpan {
  PlaceAndTimes where_and_when;
  Sums within = Sums::Zero();
  double score = 0;
};

/// The place and the span of times, at most half of all, with the best score. None where there are not
/// several times.
[[nodiscard]] std::optional<FoundSpan> best_span(const Times& times, const std::vector<Place>& places,
                                                 const SpanSearch& search);

}  // namespace fit::explain::spread
