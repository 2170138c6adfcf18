// SPDX-License-Identifier: MIT
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "fit/explain/around/around.hpp"
#include "fit/explain/model/autoregression.hpp"
#include "fit/explain/model/scans.hpp"
#include "fit/explain/reduction/whole_scans.hpp"
#include "fit/numeric/median.hpp"

/// Mains-lit lamps, dimmers and switching supplies add a wave of 25 to 200 Hz. Beams of one scan follow each
/// other within a period, so that it is told from its aliases by the scans' repetition.
namespace fit::explain::mains {
namespace {

using Complex = std::complex<double>;

constexpr double least_hz = 25, most_hz = 200;

/// One part of a group's scans, scan after scan.
struct Track {
  double offset_s = 0;     ///< Of its beams, from the scan's beginning.
  double information = 0;  ///< Of one value.
  double sensitivity_mm = 0;  ///< d value / d stage angle, per rad.
  std::vector<int> scan;
  std::vector<double> value;  ///< Less their mean.
};

/// A group's scans: the wave's phase in it is not known from others.
struct Segment {
  std::vector<Track> tracks;
  int scans = 0;

  /// A wave of that frequency in every track at the scan's beginning, less what a range and an angle of the
  /// whole scan, which each may draw at random, explain of it. Of fewer tracks nothing would remain.
  [[nodiscard]] std::vector<Complex> begins(double hz) const {
    constexpr std::size_t fewest = 5;
    std::vector<Complex> wave;
    for (const Track& track : tracks) wave.push_back(std::polar(1.0, 2 * pi * hz * track.offset_s));
    if (tracks.size() < fewest) return wave;
    Eigen::Matrix2d square = Eigen::Matrix2d::Zero();
    Eigen::Vector2cd along = Eigen::Vector2cd::Zero();
    for (std::size_t t = 0; t < tracks.size(); ++t) {
      const Eigen::Vector2d x = in_common(tracks[t]);
      square += tracks[t].information * x * x.transpose();
      along += tracks[t].information * x * wave[t];
    }
    square += 1e-9 * square.trace() * Eigen::Matrix2d::Identity();  // sensitivities may all be alike
    const Eigen::Vector2cd common = square.inverse() * along;
    for (std::size_t t = 0; t < tracks.size(); ++t)
      wave[t] -=
          in_common(tracks[t]).dot(common.real()) + Complex(0, 1) * in_common(tracks[t]).dot(common.imag());
    return wave;
  }

 private:
  /// Scaled alike: sensitivities are of metres.
  static Eigen::Vector2d in_common(const Track& track) { return {1.0, track.sensitivity_mm / 1000}; }
};

/// A wave's sine and cosine in one segment, or what is known of them.
struct Normal {
  Eigen::Matrix2d square = Eigen::Matrix2d::Zero();
  Eigen::Vector2d along = Eigen::Vector2d::Zero();

  [[nodiscard]] Eigen::Vector2d value() const {
    const Eigen::Matrix2d open = square + 1e-9 * (1e-9 + square.trace()) * Eigen::Matrix2d::Identity();
    return open.inverse() * along;
  }
  [[nodiscard]] double gain() const { return 0.5 * along.dot(value()); }
  /// Log Bayes factor under a normal prior of that standard size for both.
  [[nodiscard]] double evidence(double size, double inflate) const {
    const double s2 = size * size / inflate;
    const Eigen::Matrix2d m = Eigen::Matrix2d::Identity() + s2 * square;
    return 0.5 * s2 / inflate * along.dot(m.inverse() * along) - 0.5 * std::log(m.determinant());
  }
};

/// Seconds from scan to scan, by the stamps of all.
double period_of(const std::vector<Sector>& sectors) {
  std::map<std::pair<int, int>, std::pair<const Sector*, const Sector*>> ends;
  for (const Sector& s : sectors) {
    auto& [first, last] = ends[{s.group, s.number}];
    if (!first) first = &s;
    last = &s;
  }
  double seconds = 0, scans = 0;
  for (const auto& [key, end] : ends) {
    seconds += end.second->since_move_s - end.first->since_move_s;
    scans += end.second->seq - end.first->seq;
  }
  return scans > 0 ? seconds / scans : 0;
}

/// What sectors say, as tracks: `value_of` one, and what it is worth.
template <class Value>
std::map<int, Segment> segments_of(const std::vector<Sector>& sectors, double period_s,
                                   const Value& value_of) {
  std::map<int, Segment> segments;
  std::map<std::pair<int, int>, Track> tracks;
  std::map<int, int> first;
  for (const Sector& s : sectors) {
    const int k = s.seq - first.try_emplace(s.group, s.seq).first->second;
    const auto [value, information] = value_of(s);
    if (!(information > 0)) continue;
    Track& track = tracks[{s.group, s.number}];
    track.sensitivity_mm += s.wv / s.w;
    track.scan.push_back(k);
    track.value.push_back(value);
    track.information += information;
    track.offset_s += s.since_move_s - k * period_s;
  }
  constexpr int fewest_scans = 6;
  for (auto& [key, track] : tracks) {
    const auto n = static_cast<double>(track.value.size());
    if (n < fewest_scans) continue;
    double mean = 0;
    for (const double v : track.value) mean += v / n;
    for (double& v : track.value) v -= mean;
    track.information /= n;
    track.offset_s /= n;
    track.sensitivity_mm /= n;
    Segment& segment = segments[key.first];
    segment.scans = std::max(segment.scans, track.scan.back() + 1);
    segment.tracks.push_back(std::move(track));
  }
  return segments;
}

/// What one segment says of a wave of that frequency.
Normal normal_of(const Segment& segment, double hz, double period_s) {
  Normal sum;
  const std::vector<Complex> begins = segment.begins(hz);
  for (std::size_t t = 0; t < segment.tracks.size(); ++t) {
    const Track& track = segment.tracks[t];
    Eigen::Vector2d mean = Eigen::Vector2d::Zero();
    const auto n = static_cast<double>(track.scan.size());
    for (std::size_t i = 0; i < track.scan.size(); ++i) {
      const Complex at = begins[t] * std::polar(1.0, 2 * pi * hz * track.scan[i] * period_s);
      const Eigen::Vector2d x(at.real(), at.imag());
      sum.square += track.information * x * x.transpose();
      sum.along += track.information * track.value[i] * x;
      mean += x / n;
    }
    sum.square -= n * track.information * mean * mean.transpose();  // of values less their mean
  }
  return sum;
}

/// What frequencies explain, on a grid that divides the scans' repetition alike.
class Spectrum {
 public:
  /// `noise`: what of it is autocorrelated from scan to scan, of beams or of whole scans, is no wave.
  Spectrum(const std::map<int, Segment>& segments, double period_s, const MeanNoise& noise)
      : period_s_(period_s), noise_(&noise) {
    // A few dozen segments say whether there is a wave; a session of hours has thousands.
    constexpr std::size_t enough = 40;
    const std::size_t each = std::max<std::size_t>(1, segments.size() / enough);
    std::size_t i = 0;
    for (const auto& [group, segment] : segments)
      if (i++ % each == 0) {
        segments_.push_back(&segment);
        longest_ = std::max(longest_, segment.scans);
      }
    points_ = 4 * longest_;
    for (const Segment* segment : segments_) transform(*segment);
    orders_ = static_cast<int>(std::ceil(most_hz * period_s_));
    for (int order = 0; order <= orders_ && !segments_.empty(); ++order)
      continua_.push_back(continuum_of(order));
  }

  struct Line {
    double hz = 0, evidence = -1e300, gain = 0, inflate = 1;
    int order = 0, point = 0;
  };

  /// The most evident line and those that look nearly the same, that one first.
  [[nodiscard]] std::vector<Line> lines() const {
    if (segments_.empty()) return {};
    Line best;
    double top = -1;
    for (int order = 0; order <= orders_; ++order)
      for (int point = 1; point < points_; ++point) {
        if (!is_resolved(order, point)) continue;
        const double gain = continuum(order).gain[static_cast<std::size_t>(point - 1)];
        if (gain <= top) continue;
        top = gain;
        best = {hz_of(order, point), -1e300, gain, continuum(order).of_all, order, point};
      }
    if (top < 0) return {};
    best.evidence = evidence_of(best);
    std::vector<Line> list{best};
    for (int order = 0; order <= orders_; ++order)
      for (const int middle : {best.point, points_ - best.point}) {
        Line other;
        for (int point = middle - 2; point <= middle + 2; ++point) {
          if (point < 1 || point >= points_ || !is_resolved(order, point)) continue;
          Line line{hz_of(order, point), -1e300, 0, continuum(order).of_all, order, point};
          line.evidence = evidence_of(line);
          if (line.evidence > other.evidence) other = line;
        }
        constexpr double looks_alike = 3, apart = 3;  // in Hz: beyond the line itself
        if (other.evidence > best.evidence - looks_alike && std::abs(other.hz - best.hz) > apart)
          list.push_back(other);
      }
    return list;
  }

  /// Frequencies that can be told apart.
  [[nodiscard]] double places() const { return (most_hz - least_hz) * longest_ * period_s_; }
  /// To where the log-likelihood has fallen by a half, about.
  [[nodiscard]] double uncertainty_hz(const Line& line) const {
    return 0.4 / (longest_ * period_s_) / std::sqrt(std::max(1.0, line.gain));
  }

 private:
  [[nodiscard]] double hz_of(int order, int point) const {
    return (order + static_cast<double>(point) / points_) / period_s_;
  }
  /// Between the bounds, and not so near a multiple of the scans' repetition that it stands nearly still.
  [[nodiscard]] bool is_resolved(int order, int point) const {
    const double hz = hz_of(order, point);
    const int nearest = std::min(point, points_ - point);
    return hz >= least_hz && hz <= most_hz && nearest >= 2 * points_ / longest_;
  }

  void transform(const Segment& segment) {
    const auto n = static_cast<std::size_t>(points_);
    std::vector<Complex> turn(n);
    for (std::size_t j = 0; j < n; ++j) turn[j] = std::polar(1.0, 2 * pi * static_cast<double>(j) / points_);
    auto& sums = sums_.emplace_back();
    for (const Track& track : segment.tracks) {
      Sums s{std::vector<Complex>(n), std::vector<Complex>(n)};
      for (std::size_t i = 0; i < track.scan.size(); ++i) {
        const auto k = static_cast<std::size_t>(track.scan[i]);
        for (std::size_t j = 0, at = 0; j < n; ++j, at = (at + k) % n) {
          s.values[j] += track.value[i] * turn[at];
          s.ones[j] += turn[at];
        }
      }
      sums.push_back(std::move(s));
    }
  }

  /// The same as `normal_of`, from the sums over scans.
  [[nodiscard]] Normal normal_at(std::size_t segment, int order, int point) const {
    Normal normal;
    const auto j = static_cast<std::size_t>(point);
    const std::vector<Complex> begins = segments_[segment]->begins(hz_of(order, point));
    for (std::size_t t = 0; t < sums_[segment].size(); ++t) {
      const Track& track = segments_[segment]->tracks[t];
      const Sums& s = sums_[segment][t];
      const Complex begin = begins[t];
      const Complex along = begin * s.values[j], mean = begin * s.ones[j],
                    twice = begin * begin * s.ones[2 * j % s.ones.size()];
      const auto n = static_cast<double>(track.scan.size());
      const double w = track.information, cross = w * (twice.imag() / 2 - mean.real() * mean.imag() / n);
      normal.along += w * Eigen::Vector2d(along.real(), along.imag());
      normal.square(0, 0) += w * ((std::norm(begin) * n + twice.real()) / 2 - mean.real() * mean.real() / n);
      normal.square(1, 1) += w * ((std::norm(begin) * n - twice.real()) / 2 - mean.imag() * mean.imag() / n);
      normal.square(0, 1) += cross;
      normal.square(1, 0) += cross;
    }
    const double expected =
        model::spectral_density(2 * pi * point / points_, noise_->ar1_rho, noise_->ar1_share);
    return {normal.square / expected, normal.along / expected};
  }

  /// The random effects of scans, autocorrelated or not, are a continuum: a line stands out from it. An angle
  /// that is drawn for every scan moves much where walls are slanted, and nothing elsewhere: every segment
  /// has its own.
  struct Continuum {
    double of_all = 1;
    std::vector<double> of_segment;
    std::vector<double> gain;  ///< Of every point but the first, over the continua.
  };
  [[nodiscard]] const Continuum& continuum(int order) const {
    return continua_[static_cast<std::size_t>(order)];
  }
  [[nodiscard]] Continuum continuum_of(int order) const {
    constexpr double median_of_chi2 = 0.69;  // of one segment's; of many, nearly their number
    const auto count = static_cast<double>(segments_.size());
    const double usual = count > 1 ? count - 1.0 / 3 : median_of_chi2;
    std::vector<double> all(static_cast<std::size_t>(points_ - 1), 0.0);
    std::vector<std::vector<double>> gains;
    for (std::size_t i = 0; i < segments_.size(); ++i) {
      std::vector<double>& own = gains.emplace_back();
      for (int point = 1; point < points_; ++point) {
        own.push_back(normal_at(i, order, point).gain());
        all[static_cast<std::size_t>(point - 1)] += own.back();
      }
    }
    Continuum result;
    result.of_all = std::max(1.0, median_of(all) / usual);
    result.gain.assign(all.size(), 0.0);
    for (const std::vector<double>& own : gains) {
      result.of_segment.push_back(std::max(result.of_all, median_of(std::vector(own)) / median_of_chi2));
      for (std::size_t j = 0; j < own.size(); ++j) result.gain[j] += own[j] / result.of_segment.back();
    }
    return result;
  }

  [[nodiscard]] double evidence_of(const Line& line) const {
    constexpr double penalty_of_scale = 2;
    std::vector<Normal> normals;
    for (std::size_t i = 0; i < segments_.size(); ++i)
      normals.push_back(normal_at(i, line.order, line.point));
    double best = -1e300;
    for (double size = 0.01; size < 10; size *= 2) {
      double sum = 0;
      for (std::size_t i = 0; i < normals.size(); ++i)
        sum += normals[i].evidence(size, continuum(line.order).of_segment[i]);
      best = std::max(best, sum);
    }
    return best - penalty_of_scale - std::log(places());
  }

  struct Sums {
    std::vector<Complex> values, ones;
  };
  double period_s_;
  const MeanNoise* noise_;
  std::vector<const Segment*> segments_;
  std::vector<std::vector<Sums>> sums_;  ///< By segment and track, over the points.
  std::vector<Continuum> continua_;      ///< By order.
  int longest_ = 0, points_ = 0, orders_ = 0;
};

/// Seconds that a sector's beams take.
double duration_of(const Segment& segment) {
  double least = 1e9;
  for (std::size_t t = 1; t < segment.tracks.size(); ++t)
    least = std::min(least, segment.tracks[t].offset_s - segment.tracks[t - 1].offset_s);
  return least < 1e9 ? least : 0;
}

/// A sector shows the mean of the wave over its beams.
double shown_share(double hz, double duration_s) {
  const double half = pi * hz * duration_s;
  return half > 1e-6 ? std::max(0.3, std::sin(half) / half) : 1;
}

/// Mean square amplitude, what noise alone would show taken off.
double square_amplitude(const std::map<int, Segment>& segments, const Spectrum::Line& line, double period_s) {
  double sum = 0, weight = 0;
  for (const auto& [group, segment] : segments) {
    const Normal normal = normal_of(segment, line.hz, period_s);
    const double information = normal.square.trace() / 2;
    if (!(normal.square.determinant() > 0.01 * information * information)) continue;
    const double of_noise = line.inflate * normal.square.inverse().trace();
    const double share = shown_share(line.hz, duration_of(segment));
    sum += information * (normal.value().squaredNorm() - of_noise) / (share * share);
    weight += information;
  }
  return weight > 0 ? std::max(0.0, sum / weight) : 0;
}

std::string frequency(double hz, double u_hz) {
  return rounded(hz, u_hz < 0.3 ? 4 : u_hz < 3 ? 3 : 2) + " Hz";
}

/// "at 100 Hz, which from scan to scan looks like 20 Hz; 60 Hz fits nearly as well".
std::string frequencies_in_words(const std::vector<Spectrum::Line>& lines, double u_hz, double period_s) {
  const double hz = lines.front().hz, slow = std::abs(hz - std::round(hz * period_s) / period_s);
  std::string text =
      "at " + frequency(hz, u_hz) + ", which from scan to scan looks like " + frequency(slow, u_hz);
  for (std::size_t i = 1; i < lines.size(); ++i)
    text += (i == 1 ? "; " : i + 1 < lines.size() ? ", " : " or ") + frequency(lines[i].hz, u_hz);
  if (lines.size() > 1) text += " would look nearly the same";
  return text + ": a lamp, or a supply";
}

Unexplained in_words(const std::vector<Spectrum::Line>& lines, double amplitude_mm,
                     const std::vector<Group>& groups, double u_hz, double period_s) {
  Unexplained u;
  u.observable = Observable::range_mean;
  u.coordinate = Coordinate::time;
  const auto [first, last] = std::ranges::minmax(groups, {}, &Group::time_s);
  u.from = first.time_s;
  u.to = last.time_s;
  u.gain = lines.front().gain;
  u.describes =
      "ranges swing by " + rounded(amplitude_mm, 2) + " mm " + frequencies_in_words(lines, u_hz, period_s);
  return u;
}

/// What the sectors' ranges show.
struct Ranges {
  Ranges(const std::vector<Group>& groups, const std::vector<Sector>& sectors)
      : period_s(period_of(sectors)) {
    if (!(period_s > 0)) return;
    segments = segments_of(sectors, period_s, [&](const Sector& s) {
      const double sigma = groups[static_cast<std::size_t>(s.group)].sigma_mm,
                   variance = sigma * sigma + rounding_mm2;
      return std::pair(s.w > 0 ? s.wd / s.w : 0, s.w / variance);
    });
  }
  double period_s;
  std::map<int, Segment> segments;
};

}  // namespace

std::optional<double> flicker(const Reduced& reduced, const MeanNoise& noise,
                              const std::vector<Active>& from_scan_to_scan,
                              std::vector<Unexplained>& unknown) {
  constexpr double improbable_by_chance = 5.5;  // log Bayes factor
  // A wave of its own does not keep step with captures or mirror faces: what does is somebody else's.
  const auto [period_s, rest] =
      Ranges(reduced.groups, model::without_what_repeats(reduced, from_scan_to_scan));
  const model::ScatterOfScans scans =
      model::scatter_of_scans(model::scan_parts(reduced, model::fewest_in_common, 1), false);
  MeanNoise autocorrelated = noise;
  if (scans.share > noise.ar1_share) {
    autocorrelated.ar1_rho = scans.rho;
    autocorrelated.ar1_share = scans.share;
  }
  const Spectrum spectrum(rest, period_s, autocorrelated);
  const std::vector<Spectrum::Line> lines = spectrum.lines();
  if (lines.empty() || lines.front().evidence <= improbable_by_chance) return {};
  const Ranges ranges(reduced.groups, reduced.sectors);
  const double amplitude_mm = std::sqrt(square_amplitude(ranges.segments, lines.front(), period_s));
  if (!(amplitude_mm > 0)) return {};  // no more than noise makes
  unknown.push_back(
      in_words(lines, amplitude_mm, reduced.groups, spectrum.uncertainty_hz(lines.front()), period_s));
  return lines.front().hz;
}

/// Takes off a cell what differs from scan to scan: its mean over the scans, and its variance, most of the
/// cell's own at the most.
static void take_off(double mean_mm, double variance_mm2, Cell& cell) {
  constexpr double least_left = 0.1;
  cell.mean_mm -= mean_mm;
  if (cell.n > 1)
    cell.variance_mm2 =
        std::max(least_left * cell.variance_mm2, cell.variance_mm2 - variance_mm2 * cell.n / (cell.n - 1.0));
}

/// Takes off a scan's sectors what the wave adds to their beams, each at its own time. `waves`: of every
/// group, for a beam at time 0 of its first scan.
static void take_off(const std::map<int, Complex>& waves, double turn, double period_s, Reduced& reduced) {
  struct Sums {
    Complex range = 0, sensitivity = 0;  ///< Over the sector's beams, in the group's first scan.
    Complex mean = 0;              ///< Of the scans' turns.
    int scans = 0;
  };
  std::map<std::pair<int, int>, Sums> of_sector;
  std::map<int, int> first_seq;
  const auto turned = [&](const Sector& s) {
    return std::polar(1.0, turn * (s.seq - first_seq.at(s.group)) * period_s);
  };
  for (const Sector& s : reduced.sectors) {
    first_seq.try_emplace(s.group, s.seq);
    const auto wave = waves.find(s.group);
    if (wave == waves.end()) continue;
    const auto [found, is_new] = of_sector.try_emplace({s.group, s.number});
    Sums& sums = found->second;
    sums.mean += turned(s);
    ++sums.scans;
    if (!is_new) continue;
    const Group& group = reduced.group_of(s);
    double weight = 0;
    for (std::size_t i = s.first_cell; i < s.last_cell; ++i) {
      const Cell& cell = reduced.cells[i];
      if (!reduction::is_informative(cell)) continue;
      const double q = reduction::weight_in_scan(reduced, group, i);
      const Complex begin = q * wave->second * std::polar(1.0, turn * cell.at.since_move_s);
      weight += q;
      sums.range += begin;
      sums.sensitivity += cell.sight.stage_sensitivity() * begin;
    }
    if (!(weight > 0)) continue;
    sums.range *= s.w / weight;
    sums.sensitivity *= s.w / weight;
  }
  for (Sector& s : reduced.sectors) {
    const auto found = of_sector.find({s.group, s.number});
    if (found == of_sector.end()) continue;
    const Sums& sums = found->second;
    const Complex since = turned(s) - sums.mean / static_cast<double>(sums.scans);
    s.wd -= (sums.range * since).real();
    s.wdv -= (sums.sensitivity * since).real();
  }
}

void take_off_flicker(double hz, Reduced& reduced) {
  reduced.wave_hz = hz;
  const auto [period_s, ranges] = Ranges(reduced.groups, reduced.sectors);
  const double turn = 2 * pi * hz;
  std::map<int, Complex> waves;
  for (const auto& [group, segment] : ranges) {
    const Eigen::Vector2d value =
        normal_of(segment, hz, period_s).value() / shown_share(hz, duration_of(segment));
    // Its real part with e^(i turn t).
    const Complex wave = waves[group] = Complex(value[0], -value[1]);
    // Means of the wave, and of its square's double frequency, over the scans, for a beam at time 0.
    Complex mean = 0, twice = 0;
    for (int k = 0; k < segment.scans; ++k) {
      mean += std::polar(1.0 / segment.scans, turn * k * period_s);
      twice += std::polar(1.0 / segment.scans, 2 * turn * k * period_s);
    }
    const Group& of = reduced.groups[static_cast<std::size_t>(group)];
    for (Cell& cell : reduced.cells_of(of)) {
      const Complex begin = wave * std::polar(1.0, turn * cell.at.since_move_s);
      const double of_mean = (begin * mean).real(),
                   of_squares = (std::norm(begin) + (begin * begin * twice).real()) / 2;
      take_off(of_mean, of_squares - of_mean * of_mean, cell);
    }
  }
  take_off(waves, turn, period_s, reduced);
}

}  // namespace fit::explain::mains
