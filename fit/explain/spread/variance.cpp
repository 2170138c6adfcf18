// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "fit/angle.hpp"
#include "fit/explain/odds.hpp"
#include "fit/explain/spread/curves.hpp"
#include "fit/explain/spread/doubt.hpp"
#include "fit/explain/spread/flicker.hpp"
#include "fit/explain/spread/light_at_times.hpp"
#include "fit/explain/spread/noise_columns.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"
#include "fit/explain/spread/variance_model.hpp"
#include "fit/explain/stated_noise.hpp"

namespace fit::explain::spread {
namespace {

constexpr Interval always{-1e300, 1e300};
constexpr double told_apart_at = 3, beyond_doubt = 20;

/// No noise is constant to better than that.
Estimate known_noise(const Bench& bench) {
  Estimate stated = stated_noise(bench);
  stated.u = std::max(stated.u, 0.02 * stated.value);
  return stated;
}

/// Finds, part by part, what the noise of single samples consists of.
class VarianceSearch {
 public:
  VarianceSearch(const VarianceModel& model, bool has_intensity, std::vector<std::string> targets)
      : model_(model), has_intensity_(has_intensity), targets_(std::move(targets)) {}

  /// `in_several_places`: targets were put up in different places for the captures.
  void run(bool in_several_places, SpreadResult& result) {
    if (pools().size() < 3) return;
    const bool scans_jitter = is_accepted(result, ids::angle_jitter);
    // What swells and fades is no constant that a bench could state.
    if (flickers(result)) parts_.free = true;
    in_several_places_ = in_several_places;
    if (in_several_places) tell_places_apart();
    if (scans_jitter) parts_.columns.push_back(of_lever(pools()));
    for (int step = 0; step < 2; ++step) {
      base_ = model_.fit(parts_);
      if (light_comes_and_goes(result)) base_ = model_.fit(parts_);
      if (!accept_first(believed_suspects(result), result)) break;
      if (is(result.accepted.back(), ids::intensity_noise)) let_law_of_echoes_bend();
    }
    std::set<std::size_t> gone = doubt_the_catalogue(result);
    if (bend_) gone.insert(*bend_);
    measure_held_out_gains(gone, result);
    parts_ = parts_.without(gone);
    base_ = model_.fit(parts_);
    result.sigma_mm = std::sqrt(base_.value[0]);
    if (scans_jitter) whole_jitter(result);
    doubt_light_without_its_signs(result);
    if (unconfirmed_ && result.accepted.empty() && result.undecided.empty() && result.unknown.empty())
      tell_unconfirmed(result);
    if (parts_.places > 0) result.sigma_by_capture_mm = sigma_by_capture();
    draw(result);
  }

 private:
  /// What whole scans have at random differs from capture to capture by chance: no law of it can be told from
  /// that.
  [[nodiscard]] static bool has_noise_of_whole_scans(const SpreadResult& result) {
    return result.noise.scan_range_mm2 > 0 || result.noise.scan_angle_rad2 > 0;
  }

  /// A constant noise for every place, if the places differ. Whatever depends on slant or light is then
  /// judged within places.
  void tell_places_apart() {
    int captures = 0;
    for (const Pool& p : pools()) captures = std::max(captures, p.capture + 1);
    if (captures < 2) return;
    Parts constants;
    for (int c = 1; c < captures; ++c) {
      Column& column = constants.columns.emplace_back();
      for (const Pool& p : pools()) column.push_back(p.capture == c);
    }
    constants.places = constants.columns.size();
    // Beside a slope with the slant: else a place whose walls are seen at more of a slant is only noisier.
    const Column slant = of_lever(pools());
    const double gain =
        model_.fit(constants.with(slant)).log_likelihood - model_.fit(Parts().with(slant)).log_likelihood;
    const auto places = static_cast<double>(constants.places);
    const double each = gain / places;
    if (gain - price_of_size(each) * places < accept_rare_at) return;
    parts_ = constants;
  }

  /// Light that falls in for a while only: `sunlight` with its times where others of these times confirm it,
  /// and unknown where they do not, or where all angles have it. It has no rivals that do not know the time,
  /// and is believed if it is more evident than all of these.
  bool light_comes_and_goes(SpreadResult& result) {
    if (in_several_places_ || flickers(result) || is_accepted(result, ids::sunlight) || comes_and_goes_)
      return false;
    if (has_noise_of_whole_scans(result)) return false;
    const auto found = light_at_times(model_, model_.variances(parts_, base_));
    if (!found) return false;
    const auto& [place, times_s, u_from_s, u_to_s] = found->where_and_when;
    Light light{place.centre_deg, place.width_deg, 0, times_s};
    if (!place.everywhere) {
      light.gain = gain_of_light(light);
      light = refined(light, suspected(ids::sunlight).mechanism->parameters[2]);
    }
    const Column column = place.everywhere ? between_times(pools(), Column(pools().size(), 1), light.times_s)
                                           : column_of(light);
    if (has_intensity_ && !reaches_no_weaker_echoes(pools(), column)) return false;
    double gain = 0;
    const Estimate size = fit_with(column, gain).last();
    Suspect suspect = suspected(ids::sunlight);
    suspect.gain = gain;
    suspect.evidence = gain - price_of_size(gain) - odds::against_place(gain, found->spans) -
                       (place.everywhere ? 0 : odds::against_place(gain, 20) + odds::against_place(gain, 2));
    if (suspect.evidence < accept_rare_at) return false;
    for (const Suspect& other : {has_intensity_ ? intensity_noise() : Suspect{}, sunlight(), angle_jitter()})
      if (other.evidence + told_apart_at > suspect.evidence) return false;
    if (!place.everywhere) {
      suspect.parameters = parameters_of(light);
      suspect.parameters["from_s"] = {light.times_s.from, u_from_s};
      suspect.parameters["to_s"] = {light.times_s.to, u_to_s};
    }
    const auto unseen = model_.unseen_gain(parts_, column);
    const bool confirmed = unseen.value_or(-1) > 0 && found->seen > 1;
    if (confirmed && !place.everywhere) {
      result.accepted.push_back(suspect);
      names_.push_back({suspect, {parts_.columns.size()}});
    } else if (confirmed || suspect.evidence > beyond_doubt) {
      tell_noise_at_times(suspect, light, place.everywhere, root(size).value, result);
    } else {
      return false;
    }
    comes_and_goes_ = true;
    parts_.columns.push_back(column);
    return true;
  }

  /// Whatever may explain more than is known so far, the best first.
  [[nodiscard]] std::vector<Suspect> believed_suspects(const SpreadResult& result) {
    std::vector<Suspect> suspects;
    if (has_intensity_ && !is_accepted(result, ids::intensity_noise)) suspects.push_back(intensity_noise());
    if (!is_accepted(result, ids::sunlight) && !comes_and_goes_) suspects.push_back(sunlight());
    if (!parts_.free) suspects.push_back(range_noise());
    if (!is_accepted(result, ids::angle_jitter)) suspects.push_back(angle_jitter());
    std::ranges::sort(suspects, [](const auto& a, const auto& b) { return a.evidence > b.evidence; });
    // What does not help on captures that it has not seen is not believed.
    std::erase_if(suspects, [&](const Suspect& s) {
      if (s.evidence < accept_at || is(s, constant_noise)) return false;
      const auto gain = model_.unseen_gain(parts_, of_suspect(pools(), s));
      if (!gain || *gain >= 0) return false;
      if (s.evidence > beyond_doubt && (!unconfirmed_ || s.evidence > unconfirmed_->evidence))
        unconfirmed_ = s;
      return true;
    });
    return suspects;
  }

  /// Weak echoes may be in one capture only: there others cannot confirm their law.
  void tell_unconfirmed(SpreadResult& result) const {
    if (is(*unconfirmed_, ids::intensity_noise))
      result.undecided.push_back({*unconfirmed_, Suspect{}});
    else
      result.unknown.push_back(noise_of_some_captures(*unconfirmed_));
  }

  /// What is there beyond doubt, but which captures that it was not fitted to do not confirm.
  [[nodiscard]] Unexplained noise_of_some_captures(const Suspect& suspect) const {
    Unexplained u;
    u.observable = Observable::range_variance;
    u.coordinate = suspect.mechanism->coordinate;
    u.gain = suspect.gain;
    u.evidence = suspect.evidence;
    const bool of_light = u.coordinate == Coordinate::intensity;
    const auto place = [of_light](const Pool& p) { return of_light ? p.intensity : p.beam_deg; };
    u.from = place(std::ranges::min(pools(), {}, place));
    u.to = place(std::ranges::max(pools(), {}, place));
    u.describes = std::string("samples scatter more than the simulation says ") +
                  (of_light ? "where echoes are weak" : "at some angles") +
                  ", but in some captures only: the others do not confirm any law of it";
    return u;
  }

  /// More noise for a while, of which no more is known: where it is, and when.
  static void tell_noise_at_times(const Suspect& suspect, const auto& light, bool at_all_angles,
                                  double sigma_mm, SpreadResult& result) {
    Unexplained u;
    u.observable = Observable::range_variance;
    u.gain = suspect.gain;
    u.evidence = suspect.evidence;
    u.describes = "samples scatter by " + rounded(sigma_mm, 2) + " mm more from " +
                  rounded(light.times_s.from) + " to " + rounded(light.times_s.to) + " s after power-on, " +
                  (at_all_angles ? "at all angles"
                                 : "at beams around " + rounded(light.centre_deg) +
                                       " deg: light may have fallen in, but no other capture confirms it");
    if (!at_all_angles) {
      u.coordinate = Coordinate::beam;
      u.from = light.centre_deg - 1.2 * light.width_deg;
      u.to = light.centre_deg + 1.2 * light.width_deg;
      result.unknown.push_back(u);
    }
    u.coordinate = Coordinate::time;
    u.from = light.times_s.from;
    u.to = light.times_s.to;
    result.unknown.push_back(u);
  }

  /// Accepts the first, or answers with all that cannot be told from it; false if there is nothing more to
  /// find.
  bool accept_first(const std::vector<Suspect>& suspects, SpreadResult& result) {
    if (suspects.empty() || suspects.front().evidence < accept_at) return false;
    Suspect first = suspects.front();
    std::vector<Suspect> set{first};
    for (std::size_t i = 1; i < suspects.size(); ++i)
      if (suspects[i].evidence > first.evidence - told_apart_at) set.push_back(suspects[i]);
    if (set.size() > 1) {
      result.undecided.push_back(set);
      names_.push_back({first, {}, true});
      return false;
    }
    if (suspects.size() > 1) first.ahead = first.evidence - suspects[1].evidence;
    if (is(first, constant_noise)) {
      names_.push_back({first, {}});
      parts_.free = true;
    } else {
      names_.push_back({first, {parts_.columns.size()}});
      parts_.columns.push_back(of_suspect(pools(), first));
    }
    result.accepted.push_back(first);
    return true;
  }

  /// No receiver's noise follows its law exactly, least of all near its threshold: beside noise of weak
  /// echoes, what noise of another exponent explains is nobody else's.
  void let_law_of_echoes_bend() {
    base_ = model_.fit(parts_);
    double most = 0;
    Column best;
    for (const double exponent : exponents_of_noise) {
      Column column = of_intensity(pools(), exponent);
      double gain = 0;
      (void)fit_with(column, gain);
      if (gain <= most) continue;
      most = gain;
      best = std::move(column);
    }
    if (best.empty()) return;
    bend_ = parts_.columns.size();
    names_.back().columns.push_back(*bend_);
    parts_.columns.push_back(std::move(best));
  }

  /// Structure that no name explains is not forced into one: where an unnamed law of some coordinate explains
  /// more than names do, these give way, and where it explains as much they are not certain.
  /// Returns their columns, which are no parts any more.
  [[nodiscard]] std::set<std::size_t> doubt_the_catalogue(SpreadResult& result) {
    std::set<std::size_t> gone;
    // Coarse steps make patterns of the range that are no noise.
    if (flickers(result) || has_noise_of_whole_scans(result) ||
        model_.step_mm() > 1.5 * std::sqrt(base_.value[0]))
      return gone;
    // Echoes that are about to be lost have a law of their own, which only the weakest show.
    const auto is_of_losses = [](const NamedNoise& n) { return is_steeper_than_a_receiver(n.suspect); };
    if (std::ranges::any_of(names_, is_of_losses) ||
        (unconfirmed_ && is_steeper_than_a_receiver(*unconfirmed_)))
      return gone;
    const Doubted doubted = doubt(model_, parts_, names_);
    // The last first: an open set is the last of the undecided until others are told behind it.
    for (std::size_t i = names_.size(); i-- > 0;) {
      if (doubted.stays[i]) {
        limit_lead(names_[i], doubted.ahead[i], result);
        continue;
      }
      gone.insert(names_[i].columns.begin(), names_[i].columns.end());
      take_back(names_[i], result);
    }
    if (doubted.unnamed) {
      parts_.free = true;
      const Unexplained law = told(*doubted.unnamed);
      const auto is_of_same = [&](const Unexplained& u) {
        return u.observable == law.observable && u.coordinate == law.coordinate;
      };
      if (std::ranges::none_of(result.unknown, is_of_same)) result.unknown.push_back(law);  // not told twice
    }
    return gone;
  }

  /// What every name gains beside all others where it was not fitted.
  void measure_held_out_gains(const std::set<std::size_t>& gone, SpreadResult& result) const {
    const Parts all = parts_.without(gone);
    for (const NamedNoise& name : names_) {
      const auto found = std::ranges::find(result.accepted, name.suspect.mechanism, &Suspect::mechanism);
      if (name.is_open || found == result.accepted.end()) continue;
      std::set<std::size_t> missing = gone;
      missing.insert(name.columns.begin(), name.columns.end());
      Parts less = parts_.without(missing);
      if (is(name.suspect, constant_noise)) less.free = false;
      found->held_out_gain = model_.held_out_gain(less, all);
    }
  }

  /// Noise at some angles that never changes is no light's: it comes and goes, or drowns echoes there. Without
  /// either it may as well be local in the beam.
  void doubt_light_without_its_signs(SpreadResult& result) const {
    const auto light = std::ranges::find_if(result.accepted, [](const Suspect& s) {
      return is(s, ids::sunlight) && !s.parameters.contains("from_s");
    });
    if (light == result.accepted.end() || drowns_echoes(*light)) return;
    result.undecided.push_back({*light, Suspect{}});
    result.accepted.erase(light);
  }

  /// Whether more echoes are lost where it falls in than elsewhere.
  [[nodiscard]] bool drowns_echoes(const Suspect& light) const {
    const double centre_deg = light.parameters.at("centre_deg").value,
                 reach_deg = 1.2 * light.parameters.at("width_deg").value;
    double lost_there = 0, all_there = 0, lost = 0, all = 0;
    for (const Pool& p : pools()) {
      const bool there = std::abs(wrap_angle((p.beam_deg - centre_deg) * rad_per_deg)) * deg_per_rad < reach_deg;
      (there ? lost_there : lost) += p.lost;
      (there ? all_there : all) += p.lost + p.freedom;
    }
    if (all <= 0 || all_there <= 0) return false;
    const double share = (lost + 0.5) / (all + 1), expected = share * all_there;
    return lost_there - expected > 3 * std::sqrt(expected + expected * expected / (lost + 0.5));
  }

  static void take_back(const NamedNoise& name, SpreadResult& result) {
    if (name.is_open)
      result.undecided.pop_back();
    else
      std::erase_if(result.accepted, [&](const Suspect& s) { return s.mechanism == name.suspect.mechanism; });
  }

  [[nodiscard]] Unexplained told(const UnnamedNoise& noise) const {
    Unexplained u;
    u.observable = Observable::range_variance;
    u.coordinate = noise.coordinate;
    u.gain = noise.gain;
    u.evidence = noise.evidence();
    u.from = noise.most.from;
    u.to = noise.most.to;
    u.describes = in_words(noise, targets_);
    return u;
  }

  /// A name that is not nearly certain beside an unnamed law is told as a set with it.
  static void limit_lead(const NamedNoise& name, double ahead, SpreadResult& result) {
    constexpr double certain = 2.2;  // log odds of nine to one
    if (name.is_open) {
      if (ahead < certain) result.undecided.back().push_back(Suspect{});
      return;
    }
    const auto found = std::ranges::find(result.accepted, name.suspect.mechanism, &Suspect::mechanism);
    if (found == result.accepted.end()) return;
    found->ahead = std::min(found->ahead, ahead);
    if (ahead >= certain) return;
    result.undecided.push_back({*found, Suspect{}});
    result.accepted.erase(found);
  }

  /// The scatter of samples along the coordinates of what was found.
  void draw(SpreadResult& result) const {
    Parts places;
    places.columns.assign(parts_.columns.begin(),
                          parts_.columns.begin() + static_cast<std::ptrdiff_t>(parts_.places));
    places.places = parts_.places;
    const std::vector<double> before = model_.variances(places, model_.fit(places)),
                              after = model_.variances(parts_, base_);
    for (const Coordinate coordinate : coordinates_of_noise(result))
      result.curves.push_back(scatter_along(model_, coordinate, before, after));
  }

  /// Beams may scatter on their own beside what a scan has in common: the spread of samples shows both.
  void whole_jitter(SpreadResult& result) const {
    const Estimate whole = root_deg(base_.at(parts_.places + 1));
    for (Suspect& s : result.accepted) {
      if (!is(s, ids::angle_jitter)) continue;
      Estimate& common = s.parameters.at("sigma_deg");
      if (whole.value > 1.2 * common.value && whole.value > common.value + 3 * std::hypot(whole.u, common.u))
        common = whole;
    }
  }

  [[nodiscard]] std::vector<double> sigma_by_capture() const {
    std::vector<double> sigma_mm;
    for (std::size_t c = 0; c <= parts_.places; ++c)
      sigma_mm.push_back(std::sqrt(std::max(1e-3, base_.value[0] + (c > 0 ? base_.at(c).value : 0))));
    return sigma_mm;
  }

  /// With one more column; `gain` of the log-likelihood.
  VarianceModel::Fit fit_with(const Column& column, double& gain) const {
    const VarianceModel::Fit fit = model_.fit(parts_.with(column));
    gain = fit.log_likelihood - base_.log_likelihood;
    return fit;
  }

  [[nodiscard]] Suspect intensity_noise() const {
    Suspect best = suspected(ids::intensity_noise);
    for (const double exponent : exponents_of_noise) {
      double gain = 0;
      const auto fit = fit_with(of_intensity(pools(), exponent), gain);
      // Steeper than any receiver's own noise only if that is clear.
      if (gain <= best.gain + (exponent > steepest_of_noise ? 2 : 0)) continue;
      best.gain = gain;
      best.parameters = {{"sigma_mm_at_1000_counts", root(fit.last())},
                         {"exponent", {exponent, 1 / std::sqrt(1 + gain)}}};
    }
    best.evidence = best.gain - price_of_size(best.gain) - odds::against_place(best.gain, 2);
    return best;
  }

  /// Light that falls in around one beam angle.
  struct Light {
    double centre_deg = 0, width_deg = 0, gain = 0;
    Interval times_s = always;
  };

  [[nodiscard]] Suspect sunlight() const {
    Suspect suspect = suspected(ids::sunlight);
    double low = 1e9, high = -1e9;
    for (const Pool& p : pools()) {
      low = std::min(low, p.beam_deg);
      high = std::max(high, p.beam_deg);
    }
    const Light light = best_light(low, high, suspect.mechanism->parameters[2]);
    if (!(light.gain > 0)) return suspect;
    suspect.gain = light.gain;
    suspect.parameters = parameters_of(light);
    suspect.evidence = light.gain - price_of_size(light.gain) -
                       odds::against_place(light.gain, (high - low) / 12) -
                       odds::against_place(light.gain, 2);
    // A fit that ends where there is no such noise gained by something else.
    if (const Estimate& size = suspect.parameters.at("sigma_mm"); size.value < size.u) suspect.evidence = -1;
    return suspect;
  }

  [[nodiscard]] Light best_light(double low_deg, double high_deg, const Parameter& bounds) const {
    Light best;
    const auto take_if_better = [&](double centre, double width) {
      if (width < bounds.lower || width > bounds.upper) return;
      const double gain = gain_of_light({centre, width});
      if (gain > best.gain) best = {centre, width, gain};
    };
    if (high_deg - low_deg > 20)
      for (const double w : {5.0, 9.0, 16.0, 28.0})
        for (double c = low_deg; c <= high_deg; c += 0.8 * w) take_if_better(c, w);
    return best.gain > 2 ? refined(best, bounds) : best;
  }

  /// From there to where it fits best, at the same times.
  [[nodiscard]] Light refined(Light best, const Parameter& bounds) const {
    const auto take_if_better = [&](double centre, double width) {
      if (width < bounds.lower || width > bounds.upper) return;
      const double gain = gain_of_light({centre, width, 0, best.times_s});
      if (gain > best.gain) best = {centre, width, gain, best.times_s};
    };
    constexpr double finest = 0.02, hardly = 0.01;
    for (double share = 0.3; share > finest;) {
      const auto [c, w, before, times] = best;
      for (const double other : {c - share * w, c + share * w}) take_if_better(other, w);
      for (const double other : {w / (1 + share), w * (1 + share)}) take_if_better(c, other);
      if (best.gain < before + hardly) share /= 2;
    }
    return best;
  }

  [[nodiscard]] Column column_of(const Light& light) const {
    return between_times(pools(), of_light(pools(), light.centre_deg, light.width_deg), light.times_s);
  }

  [[nodiscard]] double gain_of_light(const Light& light) const {
    const Column column = column_of(light);
    double gain = 0;
    if (*std::ranges::max_element(column) < 0.5) return gain;  // a size at a place that no beam saw
    (void)fit_with(column, gain);
    return gain;
  }

  [[nodiscard]] std::map<std::string, Estimate> parameters_of(const Light& light) const {
    const double centre = light.centre_deg, width = light.width_deg;
    double gain = 0;
    const Estimate variance = fit_with(column_of(light), gain).last();
    const auto gain_at = [&](double c, double w) { return gain_of_light({c, w, 0, light.times_s}); };
    // To where the log-likelihood has fallen by a half, on a parabola through places well aside.
    const double aside = 0.25 * width;
    const auto uncertainty = [&](double one, double other) {
      return aside / std::sqrt(2 * std::max(0.05, light.gain - (one + other) / 2));
    };
    const double centre_u = uncertainty(gain_at(centre - aside, width), gain_at(centre + aside, width));
    const double width_u = uncertainty(gain_at(centre, width - aside), gain_at(centre, width + aside));
    // A window's light has another profile than this one: its width at half height is 1.2 of this one's.
    constexpr double unknown_profile = 0.18;
    return {{"sigma_mm", root(variance)},
            {"centre_deg", {centre, centre_u}},
            {"width_deg", {width, std::hypot(width_u, unknown_profile * width)}}};
  }

  /// More noise than the bench states.
  [[nodiscard]] Suspect range_noise() const {
    Suspect suspect = suspected(constant_noise);
    Parts parts = parts_;
    parts.free = true;
    const auto fit = model_.fit(parts);
    suspect.gain = fit.log_likelihood - base_.log_likelihood;
    const Estimate all = fit.at(0), stated = model_.stated_variance();
    const double extra = all.value - stated.value;
    suspect.parameters = {{"sigma_mm", root({std::max(0.0, extra), std::hypot(all.u, stated.u)})}};
    suspect.evidence = extra > 0 ? suspect.gain - 2 : -1;
    return suspect;
  }

  [[nodiscard]] Suspect angle_jitter() const {
    Suspect suspect = suspected(ids::angle_jitter);
    const Estimate sigma = root_deg(fit_with(of_lever(pools()), suspect.gain).last());
    suspect.parameters = {{"sigma_deg", sigma}};
    suspect.evidence = suspect.gain - price_of_size(suspect.gain);
    // No mirror is so loose: something else scatters.
    if (sigma.value > suspect.mechanism->parameters.front().largest) suspect.evidence = -1;
    return suspect;
  }

  [[nodiscard]] const std::vector<Pool>& pools() const { return model_.pools(); }

  const VarianceModel& model_;
  bool has_intensity_, in_several_places_ = false;
  bool comes_and_goes_ = false;         ///< More noise at some times is part of the parts.
  Parts parts_;                         ///< Accepted so far, and how the law of one of them bends.
  std::optional<std::size_t> bend_;     ///< Which column the latter is.
  std::vector<NamedNoise> names_;       ///< In the order in which they were found.
  std::vector<std::string> targets_;    ///< Names of the bench's.
  std::optional<Suspect> unconfirmed_;  ///< The most evident of those that no other capture confirms.
  VarianceModel::Fit base_;             ///< With these.
};

}  // namespace

void variance(const Reduced& reduced, double step_mm, double worth_of_sample, SpreadResult& result) {
  const VarianceModel model(pools_of(reduced), known_noise(reduced.bench), step_mm * step_mm / 12,
                            worth_of_sample);
  std::vector<std::string> targets;
  for (const auto& target : reduced.bench.targets) targets.push_back(target.name);
  VarianceSearch(model, reduced.has_intensity, targets).run(reduced.in_several_places(), result);
}

}  // namespace fit::explain::spread
