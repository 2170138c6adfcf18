// SPDX-License-Identifier: MIT
#include "fit/explain/spread/scans.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <map>
#include <optional>

#include "fit/explain/reduction/whole_scans.hpp"

namespace fit::explain::spread {
namespace {

/// Of single samples about what their scan has in common, mm^2. The typical spread of a few samples, a
/// median, is a little too small, and a thousand scans would show that.
double own_variance(const Group& group) {
  const double typical = typical_variance(group);
  const double news =
      static_cast<double>(group.pairs) * (1 - 2.0 / std::max<double>(3, static_cast<double>(group.cells)));
  if (group.scans >= weighted_from_scans || news < 200) return typical;
  return std::clamp(group.lagged[0] / news, 0.9 * typical, 1.2 * typical);
}

/// Information of one scan of a group, of so many beams, and how much its score scatters.
struct Uneven {
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero(), scatter = Eigen::Matrix2d::Zero();

  Uneven(const Reduced& reduced, const Group& group) {
    const double precision = 1 / own_variance(group);
    for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
      const Cell& cell = reduced.cells[i];
      if (!reduction::tells_of_scans(cell) || cell.n < 2) continue;
      const Eigen::Vector2d lever(1, cell.sight.stage_lever());
      information += precision * lever * lever.transpose();
      scatter += precision * precision * cell.variance_mm2 * lever * lever.transpose();
    }
  }
  [[nodiscard]] bool is_known() const {
    return scatter.determinant() > 1e-6 * scatter(0, 0) * scatter(1, 1);  // no angle shows in equal levers
  }
};

}  // namespace

double typical_variance(const Group& group) { return group.sigma_mm * group.sigma_mm + rounding_mm2; }

std::vector<Scan> scans_of(const std::vector<Group>& groups, const std::vector<Sector>& sectors) {
  std::vector<Scan> scans;
  for (const Sector& s : sectors) {
    const Group& group = groups[static_cast<std::size_t>(s.group)];
    if (scans.empty() || scans.back().group != s.group || scans.back().seq != s.seq) {
      Scan scan;
      scan.group = s.group;
      scan.seq = s.seq;
      scan.counted = static_cast<std::int64_t>(scans.size());
      scan.turn = s.turn;
      scan.scans = group.scans;
      scan.capture = group.capture;
      scans.push_back(scan);
    }
    const double precision = 1 / own_variance(group);
    Scan& scan = scans.back();
    Eigen::Matrix2d information;
    information << s.w, s.wv, s.wv, s.wvv;
    scan.information += precision * information;
    scan.score += precision * Eigen::Vector2d(s.wd, s.wdv);
  }
  std::map<int, std::int64_t> last;
  for (const Scan& s : scans) last[s.capture] = std::max(last[s.capture], s.seq);
  for (Scan& s : scans)
    s.through_capture = static_cast<double>(s.seq + 1) / static_cast<double>(last[s.capture] + 1);
  return scans;
}

std::vector<Scan> by_noise_of_beams(std::vector<Scan> scans, const Reduced& reduced) {
  std::optional<Uneven> uneven;
  int group = -1;
  for (Scan& s : scans) {
    if (s.scans >= weighted_from_scans) continue;
    if (s.group != group) {
      group = s.group;
      uneven.emplace(reduced, reduced.groups[static_cast<std::size_t>(group)]);
    }
    if (!uneven->is_known()) continue;
    // The score has the covariance S, where I is expected: I S^-1 times the score has I S^-1 I, as
    // information should be, and tells of the same range and angle.
    const double beams = s.information(0, 0) / uneven->information(0, 0);
    const Eigen::Matrix2d bread = s.information * (beams * uneven->scatter).inverse();
    s.score = bread * s.score;
    s.information = bread * s.information;
  }
  return scans;
}

}  // namespace fit::explain::spread
