// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/together.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "fit/bench/placed_anew.hpp"
#include "fit/explain/reduction/temperature.hpp"
#include "fit/explain/scene/fitted_room.hpp"

namespace fit::explain {

/// One recording before the common bench.
class Together::Placed : public Forwarded {
 public:
  /// `room_seen`: the recording itself, if its bench knows no targets; else null.
  Placed(const Recording& own, const FittedRoom* room_seen, const Bench& bench)
      : Forwarded(own), moved_captures(own.captures()), room(room_seen), bench_(bench) {}

  [[nodiscard]] const Bench& bench() const override { return bench_; }
  [[nodiscard]] const std::vector<CaptureInfo>& captures() const override { return moved_captures; }
  [[nodiscard]] const Bench& own_bench() const { return Forwarded::bench(); }

  std::vector<CaptureInfo> moved_captures;
  const FittedRoom* room;
  std::set<std::string> standing;                 ///< Targets that every capture sees.
  std::map<std::string, std::string> joint_name;  ///< Of its own targets.

 private:
  const Bench& bench_;
};

namespace {

void refuse_if_carried(const Recording& recording) {
  const Carried way = carried(recording);
  if (!way.moved()) return;
  throw std::invalid_argument("the lidar was carried along (" + std::to_string(way.poses) + " poses, " +
                              rounded(way.path_mm / 1000, 2) + " m, turned by " +
                              rounded(way.turned_rad * deg_per_rad, 3) +
                              " deg), and the bench's targets hold for a lidar at rest or on a stage. Leave "
                              "the targets out: then the "
                              "stretches at rest are explained before the walls they show. `rig fit "
                              "odometry` and `rig deskew` calibrate "
                              "what shows on the move");
}

/// A lidar that numbers its beams in another way is another one. (Scans that bring their own geometry number
/// them from 0, and their spacing may differ from session to session.)
void refuse_if_another_lidar(const LidarGeometry& first, const LidarGeometry& other) {
  const bool own_geometry = first.front_step == 0 && other.front_step == 0;
  if (own_geometry || (first.steps == other.steps && first.front_step == other.front_step &&
                       std::abs(first.step_rad - other.step_rad) < 1e-9))
    return;
  const auto words = [](const LidarGeometry& lidar) {
    return std::to_string(lidar.steps) + " steps of " + rounded(lidar.step_rad * deg_per_rad, 6) +
           " deg with the front at step " + std::to_string(lidar.front_step);
  };
  throw std::invalid_argument(
      "the sessions are not of one lidar: the first one's bench has " + words(first) + ", another one's " +
      words(other) + ". Explain each alone, or give the bench file that holds for both with --bench");
}

/// Drifts of several sessions are compared by how long the lidar has been on, and how warm it is.
void note_unknown_warmth(const std::vector<const Recording*>& recordings, std::vector<std::string>& notes) {
  const auto know = [&](auto member) {
    return std::ranges::count_if(recordings, [&](const Recording* recording) {
      return std::ranges::any_of(recording->captures(),
                                 [&](const CaptureInfo& c) { return (c.*member).has_value(); });
    });
  };
  const auto all = static_cast<std::ptrdiff_t>(recordings.size());
  const std::ptrdiff_t on = know(&CaptureInfo::since_power_on_s), warm = know(&CaptureInfo::temperature_c);
  if (on > 0 && on < all)
    notes.push_back(
        "Not every session says how long the lidar had been on; where none does, it counts as switched on "
        "when the session began.");
  if (warm > 0 && warm < all)
    notes.push_back(
        "Not every session says how warm the lidar's housing was; where none does, it counts as " +
        rounded(steady_c, 2) + " \u00b1 " + rounded(2 * u_unread_k, 2) + " deg C.");
}

/// What benches say beside their targets holds for all sessions as the first has it.
void note_other_benches(const std::vector<const Recording*>& recordings, std::vector<std::string>& notes) {
  std::set<std::string> differ;
  const Bench& first = recordings.front()->bench();
  for (const Recording* recording : recordings) {
    const Bench& other = recording->bench();
    if (first.lidar.mount != other.lidar.mount) differ.insert("mount");
    for (const Bench* bench : {&first, &other})
      for (const KnownMechanism& known : bench->known) {
        const KnownMechanism *here = first.knows(known.mechanism), *there = other.knows(known.mechanism);
        if (!here || !there || *here != *there) differ.insert(known.mechanism);
      }
  }
  if (differ.empty()) return;
  std::string list;
  for (const std::string& what : differ) list += (list.empty() ? "" : ", ") + what;
  notes.push_back(
      "The sessions' bench files do not say the same of: " + list +
      ". What the first one says holds for all. If they are of different benches, explain each alone.");
}

bool stands_alike(const Target& a, const Target& b) {
  return a.name == b.name && (a.from_mm - b.from_mm).norm() < 1e-6 && (a.to_mm - b.to_mm).norm() < 1e-6;
}

std::string unused_name(const Bench& bench, const std::string& wanted) {
  std::string name = wanted;
  for (int number = 2; bench.target(name); ++number) name = wanted + " (" + std::to_string(number) + ")";
  return name;
}

std::string name_of_place(const Bench& bench, const Target& target, double shift_mm) {
  const double away = target.outward_normal().dot(target.from_mm) + shift_mm;
  return unused_name(bench, target.name + " at " + std::to_string(std::lround(away)) + " mm");
}

}  // namespace

Together::Together(const std::vector<const Recording*>& given) {
  if (given.empty()) return;
  std::vector<const Recording*> recordings;
  for (const Recording* recording : given) {
    const FittedRoom* room = nullptr;
    if (recording->bench().targets.empty()) {
      room = rooms_.emplace_back(std::make_unique<FittedRoom>(*recording)).get();
      notes_.push_back(room->note());
    } else {
      refuse_if_carried(*recording);
    }
    recordings.push_back(room ? room : recording);
    placed_.push_back(std::make_unique<Placed>(*recordings.back(), room, bench_));
  }
  bench_ = recordings.front()->bench();
  first_scene_ = bench_.targets.size();
  if (const FittedRoom* room = placed_.front()->room) first_scene_ -= room->absent().front().size();
  note_unknown_warmth(recordings, notes_);
  note_other_benches(recordings, notes_);
  for (const Recording* recording : recordings)
    refuse_if_another_lidar(bench_.lidar, recording->bench().lidar);
  join_targets();
  part_placements();
  for (const auto& placed : placed_) {
    standing_.push_back(standing_of(*placed));
    list_.push_back(placed.get());
  }
}

int Together::index_of(const std::string& target) const {
  return static_cast<int>(bench_.target(target) - bench_.targets.data());
}

void Together::join_targets() {
  std::map<std::string, int> first_of_its_kind;
  for (const auto& placed : placed_) {
    for (const Target& target : placed->own_bench().targets) {
      std::string name = target.name;
      const bool known = placed == placed_.front() ||
                         (!placed->room && std::ranges::any_of(bench_.targets, [&](const Target& other) {
                           return stands_alike(target, other);
                         }));
      if (!known) {
        Target more = target;
        more.name = name = unused_name(bench_, target.name);
        bench_.targets.push_back(more);
      }
      for (std::size_t t = same_as_.size(); t < bench_.targets.size(); ++t)
        same_as_.push_back(static_cast<int>(t));
      if (is_placed_anew(placed->own_bench(), target.name)) {
        const int at = index_of(name);
        same_as_[static_cast<std::size_t>(at)] = first_of_its_kind.try_emplace(target.name, at).first->second;
        placed_anew_.insert(name);
      }
      placed->standing.insert(name);
      placed->joint_name[target.name] = name;
      for (CaptureInfo& capture : placed->moved_captures)
        if (capture.target == target.name) capture.target = name;
    }
  }
}

void Together::part_placements() {
  for (const auto& placed : placed_) {
    std::map<std::pair<std::string, double>, std::string> places;
    for (CaptureInfo& capture : placed->moved_captures) {
      const Target* target = capture.target ? bench_.target(*capture.target) : nullptr;
      if (!target || !placed_anew_.contains(target->name)) continue;
      const Target first = *target;
      auto [place, is_new] = places.try_emplace({first.name, capture.target_shift_mm});
      if (is_new) {
        place->second = name_of_place(bench_, first, capture.target_shift_mm);
        Target copy = first;
        copy.name = place->second;
        same_as_.push_back(same_as_[static_cast<std::size_t>(index_of(first.name))]);
        bench_.targets.push_back(copy);
      }
      capture.target = place->second;
    }
  }
}

Standing Together::standing_of(const Placed& placed) {
  Standing stands;
  stands.same_as = same_as_;
  for (std::size_t c = 0; c < placed.captures().size(); ++c) {
    const CaptureInfo& capture = placed.captures()[c];
    Absent absent;
    if (placed.room)
      for (const std::string& wall : placed.room->absent()[c])
        absent.insert(index_of(placed.joint_name.at(wall)));
    const auto about = std::ranges::find(bench_.targets, capture.target, &Target::name);
    for (std::size_t t = 0; t < bench_.targets.size(); ++t) {
      const std::string& name = bench_.targets[t].name;
      const bool stood_in_for =
          about != bench_.targets.end() && about->name != name && placed_anew_.contains(name) &&
          same_as_[static_cast<std::size_t>(about - bench_.targets.begin())] == same_as_[t];
      if (capture.target != name && (stood_in_for || !placed.standing.contains(name)))
        absent.insert(static_cast<int>(t));
    }
    several_places_ = several_places_ || !absent.empty();
    stands.absent.push_back(std::move(absent));
  }
  return stands;
}

Together::~Together() = default;

}  // namespace fit::explain
