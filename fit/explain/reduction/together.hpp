// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <set>
#include <string>
#include <vector>

#include "fit/explain/reduction/reduce.hpp"
#include "fit/recording.hpp"

namespace fit::explain {

class FittedRoom;

/// Several recordings of one lidar before one bench that holds all their targets. A target that stands
/// elsewhere in another session, or that is put up by hand for every distance (`placed_anew`), is there once
/// for each place, each with its own offset and orientation. The mount is that of the first recording.
///
/// A recording whose bench knows no targets is seen before the walls that it shows itself (FittedRoom).
/// Throws std::invalid_argument when that cannot be done, or when a lidar that was carried along is to be
/// compared with targets at rest.
class Together {
 public:
  explicit Together(const std::vector<const Recording*>& recordings);
  ~Together();
  Together(const Together&) = delete;
  Together& operator=(const Together&) = delete;

  /// In the order given, all with the one bench.
  [[nodiscard]] const std::vector<const Recording*>& recordings() const { return list_; }
  /// What stands where in one recording.
  [[nodiscard]] const Standing& standing(std::size_t recording) const { return standing_[recording]; }
  /// How many of its first targets make up the scene of the first capture.
  [[nodiscard]] std::size_t first_scene() const { return first_scene_; }
  /// Sentences for the operator.
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }
  /// Targets stand in several places.
  [[nodiscard]] bool in_several_places() const { return several_places_; }

 private:
  class Placed;
  [[nodiscard]] int index_of(const std::string& target) const;
  /// Adds the targets of all recordings that do not stand there already.
  void join_targets();
  /// Every placement by hand is a target of its own, which stands in for the first.
  void part_placements();
  [[nodiscard]] Standing standing_of(const Placed& placed);

  Bench bench_;
  std::set<std::string> placed_anew_;  ///< Its targets that are put up by hand.
  std::vector<int> same_as_;
  bool several_places_ = false;
  std::size_t first_scene_ = 0;
  std::vector<std::string> notes_;
  std::vector<std::unique_ptr<FittedRoom>> rooms_;
  std::vector<std::unique_ptr<Placed>> placed_;
  std::vector<const Recording*> list_;
  std::vector<Standing> standing_;
};

}  // namespace fit::explain
