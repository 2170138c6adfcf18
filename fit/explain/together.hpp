// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <vector>

#include "fit/explain/reduce.hpp"
#include "fit/recording.hpp"

namespace fit::explain {

/// Several recordings of one lidar before one bench that holds all their targets. A target that stands
/// elsewhere in another session, or that is put up by hand for every distance (`placed_anew`), is there once
/// for each place, each with its own offset and orientation. The mount is that of the first recording.
class Together {
 public:
  explicit Together(const std::vector<const Recording*>& recordings);
  ~Together();
  Together(const Together&) = delete;
  Together& operator=(const Together&) = delete;

  [[nodiscard]] const Bench& bench() const { return bench_; }
  /// In the order given, all with bench().
  [[nodiscard]] const std::vector<const Recording*>& recordings() const { return list_; }
  /// What stands where in one recording.
  [[nodiscard]] const Standing& standing(std::size_t recording) const { return standing_[recording]; }
  /// Targets stand in several places: then the first of bench()'s targets are those of the first recording.
  [[nodiscard]] bool in_several_places() const { return several_places_; }

 private:
  class Placed;
  Bench bench_;
  bool several_places_ = false;
  std::vector<std::unique_ptr<Placed>> placed_;
  std::vector<const Recording*> list_;
  std::vector<Standing> standing_;
};

}  // namespace fit::explain
