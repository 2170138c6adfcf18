// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "fit/explain/spread/growing_pattern.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"
#include "fit/explain/spread/unseen.hpp"

namespace fit::explain::spread {
namespace {

constexpr std::size_t fewest_scans = 20;

/// Squared scatter of scans with the same number in their captures, in units of their own noise, whatever
/// the pattern is; at least 1.
double scatter_of_numbers(const std::vector<Scan>& scans) {
  std::map<std::int64_t, std::vector<const Scan*>> by_number;
  for (const Scan& s : scans)
    if (s.range_information() > 0) by_number[s.seq].push_back(&s);
  double excess = 0, count = 0;
  const bool few = by_number.size() * 2 > scans.size();
  for (const auto& [seq, list] : by_number) {
    if (list.size() < 2) continue;
    double mean = 0, weight = 0;
    for (const Scan* s : list) {
      mean += s->range_score();
      weight += s->range_information();
    }
    mean /= weight;
    for (const Scan* s : list) {
      const double d = s->range_score() / s->range_information() - mean;
      excess += d * d * s->range_information();
      count += 1;
    }
    count -= 1;
  }
  return count > 10 ? std::max(1.0, excess / count) : few ? 1.5 : 1.0;
}

/// Amplitude and phase of the faces' first harmonic.
std::map<std::string, Estimate> harmonic_of(const Classes& pattern, double inflate) {
  const auto faces = static_cast<double>(pattern.size());
  double sine = 0, cosine = 0;
  for (std::size_t i = 0; i < pattern.size(); ++i) {
    const double x = 2 * pi * static_cast<double>(i) / faces;
    sine += 2 * pattern.value(i) * std::sin(x) / faces;
    cosine += 2 * pattern.value(i) * std::cos(x) / faces;
  }
  const double u = std::sqrt(2 * inflate / pattern.information());
  double amplitude = std::hypot(sine, cosine), phase = std::atan2(cosine, sine) * deg_per_rad,
         phase_u = u / std::max(u, amplitude) * deg_per_rad;
  if (faces == 2) {
    amplitude = std::abs(pattern.value(0) - pattern.value(1)) / 2;
    phase = pattern.value(0) > pattern.value(1) ? 90 : -90;
    phase_u = 0;
  }
  return {{"amplitude_mm", {amplitude, u}}, {"phase_deg", {phase, phase_u}}, {"facets", {faces, 0}}};
}

/// The mirror faces that explain most.
struct Faces {
  Suspect suspect = suspected(ids::facet_wobble);
  Numbering counted_as = numberings.front();
  double inflate = 1;  ///< Variance of scans, in units of their own noise.
  bool drift = false;  ///< Then they are none.

  [[nodiscard]] std::size_t count() const {
    return static_cast<std::size_t>(std::lround(suspect.parameters.at("facets").value));
  }
  /// What scans gain by the faces that others show.
  [[nodiscard]] double unseen_gain(const std::vector<Scan>& own, const std::vector<Scan>& others) const {
    const Classes learnt(others, counted_as, count());
    double gain = 0;
    for (const Scan& s : own) {
      const double range_mm = learnt.value_at(s);
      gain += s.range_score() * range_mm - s.range_information() * range_mm * range_mm / 2;
    }
    return gain / inflate;
  }
};

Faces best_faces(const std::vector<Scan>& scans, double scatter_of_same_numbers, double price) {
  Faces best;
  best.suspect.evidence = -1;
  const std::size_t most = most_classes(scans);
  for (const Numbering number : numberings)
    for (std::size_t faces = 2; faces <= most; ++faces) {
      const Classes classes(scans, number, faces);
      const double inflate = number == &Scan::seq ? scatter_of_same_numbers : classes.scatter(scans);
      const Pattern pattern = classes.pattern(inflate);
      // A multiple of the right number fits as well, and so does another count in captures that go on.
      if (pattern.evidence - price <= best.suspect.evidence + 3) continue;
      best.suspect.evidence = pattern.evidence - price;
      best.suspect.gain = pattern.gain;
      best.suspect.parameters = harmonic_of(classes, inflate);
      best.counted_as = number;
      best.inflate = inflate;
      best.drift = best.suspect.evidence > accept_at && classes.grow_or_fade(scans, inflate);
    }
  return best;
}

/// Every number has a range of its own, the same in all captures.
Pattern any_pattern(const std::vector<Scan>& scans, double scatter_of_same_numbers) {
  constexpr std::int64_t most = 400;
  Pattern any;
  const std::int64_t longest = longest_capture(scans);
  if (longest <= most)
    any = Classes(scans, &Scan::seq, static_cast<std::size_t>(longest)).pattern(scatter_of_same_numbers);
  any.describes =
      "the range depends on the number of the scan in its capture in a way that no mirror face and no "
      "swinging stage makes";
  return any;
}

bool are_believed(const Faces& faces, const Pattern& other, std::int64_t longest) {
  if (faces.drift || faces.suspect.evidence <= accept_at) return false;
  // Captures that hardly see a face twice must say so better than any pattern of scans does.
  const bool repeat = 2 * faces.count() <= static_cast<std::size_t>(longest);
  return faces.suspect.evidence > other.evidence + (repeat ? -3 : 1);
}

/// What scans do that depends on their number only.
struct Repeating {
  Faces faces;
  bool are_faces = false;  ///< Beyond chance, and beyond any other pattern.
  Pattern other;           ///< What it is if not faces.
};

Repeating repeating(const std::vector<Scan>& scans) {
  const double scatter = scatter_of_numbers(scans);
  const double price = std::log(4.0) + std::log(static_cast<double>(numberings.size()));
  Repeating found{best_faces(scans, scatter, price), false, any_pattern(scans, scatter)};
  auto& [faces, are_faces, other] = found;
  if (faces.drift) other.evidence = std::max(other.evidence, faces.suspect.evidence);
  const Pattern growing = growing_pattern(scans, price);
  faces.suspect.ahead = faces.suspect.evidence + odds::worth_a_name - growing.evidence;
  if (faces.suspect.ahead < 0 && growing.evidence > other.evidence) {
    other = growing;
    faces.drift = true;
  }
  are_faces = are_believed(faces, other, longest_capture(scans));
  return found;
}

/// The range of every face.
SpreadCurve ranges_of(const Classes& faces, double inflate) {
  SpreadCurve curve;
  curve.shows = "range of whole scans";
  curve.unit = "mm";
  curve.observable = Observable::range_mean;
  curve.coordinate = Coordinate::scan_seq;
  curve.along = "mirror face";
  for (std::size_t i = 0; i < faces.size(); ++i)
    curve.add(static_cast<double>(i), {faces.value(i), std::sqrt(inflate) * faces.uncertainty(i)}, 0,
              faces.value(i));
  return curve;
}

/// By group of scans.
std::vector<FacesInGroup> in_groups(const std::vector<Scan>& scans, const Classes& faces) {
  struct Sums {
    double scans = 0, mm = 0, mm2 = 0;
  };
  std::map<int, Sums> by_group;
  for (const Scan& s : scans) {
    const double range_mm = faces.value_at(s);
    Sums& sums = by_group[s.group];
    sums.scans += 1;
    sums.mm += range_mm;
    sums.mm2 += range_mm * range_mm;
  }
  std::vector<FacesInGroup> list(static_cast<std::size_t>(by_group.rbegin()->first) + 1);
  for (const auto& [group, sums] : by_group) {
    const double mean = sums.mm / sums.scans;
    list[static_cast<std::size_t>(group)] = {mean, std::max(0.0, sums.mm2 / sums.scans - mean * mean)};
  }
  return list;
}

Unexplained in_words(const Pattern& pattern, std::int64_t longest) {
  Unexplained u;
  u.observable = Observable::range_mean;
  u.coordinate = Coordinate::scan_seq;
  u.gain = pattern.gain;
  u.evidence = pattern.evidence;
  u.from = 0;
  u.to = static_cast<double>(longest - 1);
  u.describes = pattern.describes;
  return u;
}

}  // namespace

void scan_numbers(std::vector<Scan>& scans, SpreadResult& result) {
  if (scans.size() < fewest_scans) return;
  Repeating found = repeating(scans);
  if (found.are_faces) {
    const auto unseen = [&](const auto& own, const auto& others) {
      return found.faces.unseen_gain(own, others);
    };
    found.faces.suspect.held_out_gain = held_out_gain(scans, unseen, &Scan::capture);
    result.accepted.push_back(found.faces.suspect);
    const Classes pattern(scans, found.faces.counted_as, found.faces.count());
    result.curves.push_back(ranges_of(pattern, found.faces.inflate));
    result.faces = in_groups(scans, pattern);
    for (Scan& s : scans) s.score -= s.information.col(0) * pattern.value_at(s);
  } else if (found.other.evidence > accept_rare_at) {
    result.unknown.push_back(in_words(found.other, longest_capture(scans)));
  }
}

bool take_off_evident_faces(const std::vector<Scan>& scans, double least_evidence,
                            std::vector<Sector>& sectors) {
  if (scans.size() < fewest_scans) return false;
  const auto [faces, are_faces, other] = repeating(scans);
  if (!are_faces || faces.suspect.evidence <= least_evidence) return false;
  const Classes pattern(scans, faces.counted_as, faces.count());
  auto scan = scans.begin();
  for (Sector& s : sectors) {
    if (s.group != scan->group || s.seq != scan->seq) ++scan;  // both are in the recording's order
    const double range_mm = pattern.value_at(*scan);
    s.wd -= s.w * range_mm;
    s.wdv -= s.wv * range_mm;
  }
  return true;
}

}  // namespace fit::explain::spread
