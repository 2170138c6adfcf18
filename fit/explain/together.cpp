// SPDX-License-Identifier: MIT
#include "fit/explain/together.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <stdexcept>

#include "fit/explain/fitted_room.hpp"
#include "fit/explain/reduction/temperature.hpp"
#include "fit/placed_anew.hpp"

namespace fit::explain {

/// One recording before the common bench.
class Together::Placed : public Recording {
 public:
  Placed(const Recording& own, const Bench& bench) : own_(own), bench_(bench), captures_(own.captures()) {}

  [[nodiscard]] const Bench& bench() const override { return bench_; }
  [[nodiscard]] const std::vector<CaptureInfo>& captures() const override { return captures_; }
  void for_each_scan(std::size_t index, const std::function<void(const ScanView&)>& visit) const override {
    own_.for_each_scan(index, visit);
  }
  [[nodiscard]] const std::vector<TrackPose>& track() const override { return own_.track(); }
  [[nodiscard]] std::vector<CaptureInfo>& mutable_captures() { return captures_; }

 private:
  const Recording& own_;
  const Bench& bench_;
  std::vector<CaptureInfo> captures_;
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
  std::vector<const FittedRoom*> rooms;  // of those without targets
  for (const Recording* recording : given) {
    rooms.push_back(nullptr);
    if (recording->bench().targets.empty()) {
      rooms_.push_back(std::make_unique<FittedRoom>(*recording));
      rooms.back() = rooms_.back().get();
      notes_.push_back(rooms_.back()->note());
      recordings.push_back(rooms_.back().get());
      continue;
    }
    refuse_if_carried(*recording);
    recordings.push_back(recording);
  }
  bench_ = recordings.front()->bench();
  note_unknown_warmth(recordings, notes_);
  note_other_benches(recordings, notes_);
  for (const Recording* recording : recordings)
    refuse_if_another_lidar(bench_.lidar, recording->bench().lidar);
  for (const Recording* recording : recordings)
    placed_.push_back(std::make_unique<Placed>(*recording, bench_));
  std::vector<std::set<std::string>> standing(recordings.size());  // what every capture of a session sees
  std::set<std::string> placed_anew;
  std::map<std::string, int> first_of_its_kind;
  std::vector<std::map<std::string, std::string>> joint_name(recordings.size());
  std::vector<int> same_as;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const Bench& own = recordings[r]->bench();
    for (const Target& target : own.targets) {
      std::string name = target.name;
      const bool known =
          r == 0 || (!rooms[r] && std::ranges::any_of(bench_.targets, [&](const Target& other) {
            return stands_alike(target, other);
          }));
      if (!known) {
        Target more = target;
        more.name = name = unused_name(bench_, target.name);
        bench_.targets.push_back(more);
      }
      const auto at = static_cast<std::size_t>(bench_.target(name) - bench_.targets.data());
      for (std::size_t t = same_as.size(); t < bench_.targets.size(); ++t)
        same_as.push_back(static_cast<int>(t));
      if (is_placed_anew(own, target.name))
        same_as[at] = first_of_its_kind.try_emplace(target.name, static_cast<int>(at)).first->second;
      standing[r].insert(name);
      joint_name[r][target.name] = name;
      if (is_placed_anew(own, target.name)) placed_anew.insert(name);
      for (CaptureInfo& capture : placed_[r]->mutable_captures())
        if (capture.target == target.name) capture.target = name;
    }
  }
  first_scene_ = recordings.front()->bench().targets.size();
  if (rooms.front()) first_scene_ -= rooms.front()->absent().front().size();
  // Every placement by hand is a target of its own, which stands in for the first.
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    std::map<std::pair<std::string, double>, std::string> places;
    for (CaptureInfo& capture : placed_[r]->mutable_captures()) {
      const Target* target = capture.target ? bench_.target(*capture.target) : nullptr;
      if (!target || !placed_anew.contains(target->name)) continue;
      const Target first = *target;
      auto [place, is_new] = places.try_emplace({first.name, capture.target_shift_mm});
      if (is_new) {
        place->second = name_of_place(bench_, first, capture.target_shift_mm);
        Target copy = first;
        copy.name = place->second;
        same_as.push_back(same_as[static_cast<std::size_t>(target - bench_.targets.data())]);
        bench_.targets.push_back(copy);
      }
      capture.target = place->second;
    }
  }
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    Standing stands;
    stands.same_as = same_as;
    for (std::size_t c = 0; c < placed_[r]->captures().size(); ++c) {
      const CaptureInfo& capture = placed_[r]->captures()[c];
      Absent absent;
      if (rooms[r])
        for (const std::string& wall : rooms[r]->absent()[c])
          absent.insert(static_cast<int>(bench_.target(joint_name[r].at(wall)) - bench_.targets.data()));
      for (std::size_t t = 0; t < bench_.targets.size(); ++t) {
        const std::string& name = bench_.targets[t].name;
        const bool stood_in_for = capture.target && *capture.target != name && placed_anew.contains(name) &&
                                  capture.target->starts_with(name + " at ");
        if (capture.target != name && (stood_in_for || !standing[r].contains(name)))
          absent.insert(static_cast<int>(t));
      }
      several_places_ = several_places_ || !absent.empty();
      stands.absent.push_back(std::move(absent));
    }
    standing_.push_back(std::move(stands));
    list_.push_back(placed_[r].get());
  }
}

Together::~Together() = default;

}  // namespace fit::explain
