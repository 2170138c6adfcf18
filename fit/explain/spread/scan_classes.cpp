// SPDX-License-Identifier: MIT
#include "fit/explain/spread/scan_classes.hpp"

#include <algorithm>
#include <cmath>

namespace fit::explain::spread {

std::int64_t longest_capture(const std::vector<Scan>& scans) {
  std::int64_t longest = 0;
  for (const Scan& s : scans) longest = std::max(longest, s.seq + 1);
  return longest;
}

std::size_t most_classes(const std::vector<Scan>& scans) {
  constexpr std::int64_t most_faces = 8;
  return static_cast<std::size_t>(std::min(most_faces, longest_capture(scans) - 1));
}

Classes::Classes(const std::vector<Scan>& scans, Numbering number, std::size_t modulus)
    : number_(number), score_(modulus, 0.0), information_(modulus, 0.0) {
  for (const Scan& s : scans) {
    const std::size_t at = static_cast<std::size_t>(s.*number) % modulus;
    score_[at] += s.range_score();
    information_[at] += s.range_information();
  }
}

double Classes::information() const {
  double sum = 0;
  for (const double information : information_) sum += information;
  return sum;
}

Pattern Classes::pattern(double inflate) const {
  double sum = 0, best = -1e300;
  for (std::size_t c = 0; c < size(); ++c)
    if (information_[c] > 0) sum += 0.5 * score_[c] * score_[c] / information_[c] / inflate;
  for (double scale_mm = least_pattern_mm; scale_mm < most_pattern_mm; scale_mm *= 2)
    best = std::max(best, evidence_at(scale_mm, inflate));
  return {sum, best - price_of_pattern_size, {}};
}

double Classes::evidence_at(double scale_mm, double inflate) const {
  double evidence = 0;
  const auto modulus = static_cast<double>(size());
  for (std::size_t c = 0; c < size(); ++c) {
    if (information_[c] <= 0) continue;
    const double known = information_[c] / inflate * scale_mm * scale_mm;
    const double own = 0.5 * score_[c] * score_[c] / information_[c] / inflate;
    evidence += own * known / (1 + known);
    // Deviations from a mean: one class says nothing that the others have not said.
    evidence -= 0.5 * std::log(1 + known) * (modulus - 1) / modulus;
  }
  return evidence;
}

double Classes::scatter(const std::vector<Scan>& scans) const {
  double squares = 0;
  for (const Scan& s : scans) {
    if (s.range_information() <= 0) continue;
    const double off = s.range_score() / s.range_information() - value_at(s);
    squares += off * off * s.range_information();
  }
  return std::max(1.0, squares / std::max(1.0, static_cast<double>(scans.size() - size())));
}

bool Classes::grow_or_fade(const std::vector<Scan>& scans, double inflate) const {
  const double last = std::max(1, scans.back().group);
  const auto significance = [&](const auto& place) {
    // The pattern with a slope beside the pattern itself, whose size is open.
    Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
    Eigen::Vector2d score = Eigen::Vector2d::Zero();
    for (const Scan& s : scans) {
      const double size = value_at(s);
      const Eigen::Vector2d x(size, size * place(s));
      information += s.range_information() * x * x.transpose();
      score += s.range_score() * x;
    }
    const double own = information(1, 1) - information(0, 1) * information(0, 1) / information(0, 0);
    if (!(own > 1e-9 * information(1, 1)) || !(information(1, 1) > 0)) return 0.0;
    const double slope = score[1] - information(0, 1) / information(0, 0) * score[0];
    return 0.5 * slope * slope / own / inflate;
  };
  constexpr double beyond_chance = 6;
  return significance([](const Scan& s) {
           return (static_cast<double>(s.seq) - (s.scans - 1) / 2.0) / std::max(1, s.scans);
         }) > beyond_chance ||
         significance([last](const Scan& s) { return s.group / last - 0.5; }) > beyond_chance;
}

}  // namespace fit::explain::spread
