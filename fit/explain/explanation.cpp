// SPDX-License-Identifier: MIT
#include "fit/explain/explanation.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <utility>

#include "fit/explain/intensity.hpp"
#include "fit/explain/odds.hpp"
#include "fit/explain/single_beams.hpp"
#include "fit/explain/spread/flicker.hpp"
#include "fit/explain/stray_light.hpp"
#include "fit/explain/together.hpp"
#include "fit/explain/twin.hpp"

namespace fit::explain {
namespace {

constexpr double sure = 0.9;
constexpr double not_excluded = 5;  // where some are not, those within this belong to them

double largest_effect(const Reduced& reduced, const Term& term, double* at) {
  double largest = 0;
  for (const Cell& cell : reduced.cells) {
    if (!cell.smooth || (term.target >= 0 && term.target != cell.at.target)) continue;
    const double e = cell.sight.shift(term.mechanism->act(cell.at, term.values));
    if (!(std::abs(e) > std::abs(largest))) continue;
    largest = e;
    *at = value_of(term.mechanism->coordinate, cell, reduced.groups[static_cast<std::size_t>(cell.group)]);
  }
  return largest;
}

std::map<std::string, Estimate> parameters_of(const Term& term) {
  std::map<std::string, Estimate> map;
  for (std::size_t k = 0; k < term.values.size(); ++k)
    map[term.mechanism->parameters[k].name] = {term.values[k], k < term.sigma.size() ? term.sigma[k] : 0.0};
  return map;
}

Finding finding_of(const Reduced& reduced, const Term& term) {
  Finding f;
  f.parameters = parameters_of(term);
  if (term.target >= 0) f.target = reduced.bench.targets[static_cast<std::size_t>(term.target)].name;
  f.largest_mm = largest_effect(reduced, term, &f.largest_at);
  return f;
}

std::string name_of_rival(const Rival& rival) {
  if (rival.term) return rival.term->mechanism->id;
  if (rival.shape) return std::string("an unnamed function of ") + name_of(rival.shape->coordinate);
  return "nothing";
}

std::string evidence_of(const MeanResult& means, std::size_t t) {
  std::string text = "On captures it was not fitted to, it raises the log-likelihood by " +
                     rounded(means.after.log_likelihood - means.without[t].log_likelihood, 3) + ".";
  int told = 0;
  for (const Rival& rival : means.rivals[t]) {
    if (told == 2) break;
    text += std::string(told == 0 ? " Next best: " : "; then ") + name_of_rival(rival) + ", e^" +
            rounded(rival.behind, 3) + " times less probable";
    ++told;
  }
  return text + (told > 0 ? "." : "");
}

std::vector<Located> locate_suspect(const Suspect& suspect, const Reduced& reduced) {
  const Coordinate coordinate = suspect.mechanism->coordinate;
  double low = 1e300, high = -1e300;
  for (const Cell& cell : reduced.cells) {
    const double v = value_of(coordinate, cell, reduced.groups[static_cast<std::size_t>(cell.group)]);
    if (!std::isfinite(v)) continue;
    low = std::min(low, v);
    high = std::max(high, v);
  }
  if (coordinate == Coordinate::scan_seq)
    for (const Sector& s : reduced.sectors) {
      low = std::min(low, 1.0 * s.seq);
      high = std::max(high, 1.0 * s.seq);
    }
  if (!(high >= low)) return {};
  const auto at = [&](const char* name) {
    const auto found = suspect.parameters.find(name);
    return found == suspect.parameters.end() ? 0.0 : found->second.value;
  };
  const double p = std::max(1e-300, std::exp(-std::min(600.0, suspect.gain)));
  const Observable observable = suspect.mechanism->observable;
  const std::string& id = suspect.mechanism->id;
  if (id == "sunlight") {
    std::vector<Located> light{{coordinate, at("centre_deg") - 1.2 * at("width_deg"),
                                at("centre_deg") + 1.2 * at("width_deg"), observable, p}};
    if (suspect.parameters.contains("from_s"))
      light.push_back({Coordinate::time, at("from_s"), at("to_s"), observable, p});
    return light;
  }
  if (id == "mixed-pixel") {
    const double reach = std::max(0.03, 1.5 * at("width_deg"));
    return {{coordinate, -reach, reach, observable, p}};
  }
  if (id == "settling")  // until half of it has faded
    return {{coordinate, low,
             std::clamp(std::log(2.0) * at("tau_s") * reduced.bench.lidar.scan_hz, low + 1, high), observable,
             p}};
  if (id == "intensity-noise") {
    const double top = low * std::pow(4.0, 1 / std::max(1.0, at("exponent")));
    return {{coordinate, low, std::min(high, std::max(top, low + (high - low) / 30)), observable, p}};
  }
  if (id == "dropout")
    return {{coordinate, low, std::clamp(at("intensity_min") + 2 * at("width"), low, high), observable, p}};
  if (id == "angle-jitter")
    return {{coordinate, low, low / 2, observable, p}, {coordinate, high / 2, high, observable, p}};
  return {{coordinate, low, high, observable, p}};
}

Located located(const Unexplained& u) {
  return {u.coordinate, u.from, u.to, u.observable, std::exp(-std::min(600.0, u.evidence))};
}

/// What stray light pulls out of place near an edge is no wide beam's doing; nor any other physics: how far
/// its halo reaches differs from receiver to receiver, so that means near edges are left out.
void take_off_stray_light(Reduced& reduced, double leak) {
  constexpr double reach_rad = 1.3 * rad_per_deg;  // a degree, and what is not known of the edges' places
  for (Cell& cell : reduced.cells) {
    if (cell.smooth && std::abs(cell.at.edge_rad) < reach_rad) {
      cell.smooth = false;
      ++reduced.left_out;
    }
    if (cell.far_share < 0 || !(cell.at.gap_mm > 0)) continue;
    const double pulled = leak * cell.at.pull_mm / cell.at.gap_mm;
    if (pulled == 0) continue;
    cell.far_share = std::clamp(cell.far_share - pulled, 0.0, 1.0);
    const double margin =
        (6 * reduced.groups[static_cast<std::size_t>(cell.group)].sigma_mm + 15) / cell.at.gap_mm;
    if (std::abs(pulled) > 0.3 * margin) cell.between = 0;
  }
}

/// What coarse output steps do to means where the noise does not fill them: a wave of one step's length
/// (Widrow and Kollar, Quantization Noise (2008), ch. 4; higher harmonics fade with the square of their
/// order).
Mechanism bias_of_rounding(double step_mm, double sigma_mm) {
  Mechanism m;
  m.id = "rounding";
  m.coordinate = Coordinate::range;
  m.formula_error = 0;
  m.act = [step_mm, sigma_mm](const Circumstances& c, std::span<const double>) {
    double sum = 0;
    for (int k = 1; k <= 6; ++k) {
      const double w = 2 * pi * k / step_mm;
      const double fades = std::exp(-0.5 * w * w * sigma_mm * sigma_mm);
      sum += (k % 2 == 1 ? -1 : 1) * fades * step_mm / (pi * k) * std::sin(w * c.range_mm);
    }
    return Effect{.range_mm = sum};
  };
  return m;
}

bool is_crosstalk(const Term& term) { return term.mechanism->id == "crosstalk"; }

bool names_crosstalk(const MeanResult& means) { return std::ranges::any_of(means.best.terms, is_crosstalk); }

/// As if the search had not met crosstalk: the beams beside edges, which it does not look at, say more. What
/// has no name may have been crosstalk as well.
MeanResult without_crosstalk(MeanResult means) {
  if (!names_crosstalk(means)) return means;
  std::erase_if(means.best.terms, is_crosstalk);
  means.best.shapes.clear();
  return means;
}

Reduced reduce_all(const Together& together, const Progress& progress) {
  const auto& recordings = together.recordings();
  Reduced all;
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    Reduced one = reduce(
        *recordings[i],
        [&](double share, const char* what) {
          if (progress)
            progress(0.3 * (static_cast<double>(i) + share) / static_cast<double>(recordings.size()), what);
        },
        together.standing(i));
    if (i == 0)
      all = std::move(one);
    else
      append(all, one);
  }
  return all;
}

class Writer {
 public:
  Writer(Reduced& reduced, const MeanResult& means, const SpreadResult& spread,
         const std::optional<StrayLight>& light)
      : reduced_(reduced), means_(means), spread_(spread), light_(light) {}

  Explanation write() {
    out_.before = means_.before;
    out_.after = means_.after;
    out_.noise_floor_mm = means_.noise_floor_mm;
    out_.samples = reduced_.samples;
    out_.cells = reduced_.cells.size();
    out_.left_out = reduced_.left_out;
    means();
    stated_otherwise();
    stray_light_beside_edges();
    spread();
    unknown();
    locate();
    notes();
    out_.verdict = verdict_of(out_);
    bench();
    return std::move(out_);
  }

 private:
  void means() {
    for (std::size_t t = 0; t < means_.best.terms.size(); ++t) {
      const Term& term = means_.best.terms[t];
      std::vector<std::string> set{term.mechanism->id};
      std::vector<Term> members{term};
      const auto is_near = [](const Rival& rival) {
        return rival.term && (rival.behind < odds::close_behind || rival.fits_as_well);
      };
      const bool doubt = std::ranges::any_of(means_.rivals[t], is_near);
      for (const Rival& rival : means_.rivals[t]) {
        if (!is_near(rival) && !(doubt && rival.term && rival.behind < not_excluded)) continue;
        if (std::ranges::count(set, rival.term->mechanism->id)) continue;
        if (std::ranges::any_of(means_.best.terms,
                                [&](const Term& o) { return o.mechanism == rival.term->mechanism; }))
          continue;
        set.push_back(rival.term->mechanism->id);
        members.push_back(*rival.term);
      }
      // Identical in the plane: only the size could tell them apart, and the size is a prior, not evidence.
      for (const auto& [one, other] :
           {std::pair("lidar-arm", "stage-eccentricity"), std::pair("stage-eccentricity", "lidar-arm")})
        if (term.mechanism->id == one) {
          if (!std::ranges::count(set, other)) set.emplace_back(other);
          set.emplace_back("mount-offset");
        }
      if (term.mechanism->id == "index-offset") set.emplace_back("mount-yaw");  // the same on one bench
      if (const Shape* form = set.size() == 1 ? near_form(t) : nullptr) {
        set.emplace_back("unknown-physics");
        // A curve is scaled to what was recorded: of another recording it says nothing.
        if (!form->form->scaled) out_.unnamed_suspects.push_back(*form);
        out_.notes.push_back("Nearly as probable as " + term.mechanism->id +
                             ", and no mechanism that is known here: " +
                             describe(*form, MeanModel(reduced_, means_.noise)).text + ".");
      }
      if (set.size() > 1) {
        out_.undecided_between.push_back(set);
        out_.suspects.insert(out_.suspects.end(), members.begin(), members.end());
        continue;
      }
      if (means_.probability[t] < worth_telling) continue;
      Found found;
      found.mechanism = term.mechanism;
      const Finding finding = finding_of(reduced_, term);
      found.target = finding.target;
      found.parameters = finding.parameters;
      found.probability = std::min(0.999, means_.probability[t]);
      // Beside something that the catalogue does not know, no name is certain.
      if (!means_.best.shapes.empty()) found.probability = std::min(0.85, found.probability);
      found.says = term.mechanism->says(finding);
      found.evidence = evidence_of(means_, t);
      found.log_likelihood_gain = means_.after.log_likelihood - means_.without[t].log_likelihood;
      found.rms_before_mm = means_.without[t].rms_mm;
      found.rms_after_mm = means_.after.rms_mm;
      out_.mechanisms.push_back(found);
      known_.push_back({term.mechanism->id, finding.parameters, {}});
      if (!found.target.empty()) known_.back().texts["target"] = found.target;
    }
  }

  /// The unnamed form that leaves a term less than sure, if that is what does.
  [[nodiscard]] const Shape* near_form(std::size_t t) const {
    if (means_.probability[t] >= sure) return nullptr;
    const auto form =
        std::ranges::find_if(means_.rivals[t], [](const Rival& r) { return r.shape.has_value(); });
    return form != means_.rivals[t].end() && form->behind < odds::close_behind ? &*form->shape : nullptr;
  }

  /// What only the bench file's uncertainties show may be any of several mechanisms, or the bench file
  /// itself.
  void stated_otherwise() {
    for (const std::vector<Term>& suspects : means_.stated_otherwise) {
      std::vector<std::string> set;
      for (const Term& term : suspects) set.push_back(term.mechanism->id);
      const Eigen::VectorXd stated = Nuisance(reduced_.bench).as_vector(),
                            found = means_.best.nuisance.as_vector(),
                            u = Nuisance::prior_sigma(reduced_.bench);
      Eigen::Index worst = 0;
      for (Eigen::Index i = 1; i < stated.size(); ++i)
        if (u[i] > 0 && std::abs(found[i] - stated[i]) / u[i] >
                            std::abs(found[worst] - stated[worst]) / std::max(1e-12, u[worst]))
          worst = i;
      const std::string itself = worst < 2        ? "mount-offset"
                                 : worst == 2     ? "mount-yaw"
                                 : worst % 2 == 1 ? "target-offset"
                                                  : "target-tilt";
      if (!std::ranges::count(set, itself)) set.push_back(itself);
      out_.undecided_between.push_back(set);
      out_.suspects.insert(out_.suspects.end(), suspects.begin(), suspects.end());
      out_.notes.push_back("No capture shows " + set.front() +
                           " by itself; only what the bench file states about mount and targets does. Check "
                           "the bench file first.");
    }
  }

  void stray_light_beside_edges() {
    if (!light_) return;
    if (light_->or_mixed_pixel) {
      const auto is_wide_beam = [](const Suspect& s) { return s.mechanism->id == "mixed-pixel"; };
      if (reduced_.bench.knows("mixed-pixel") || std::ranges::any_of(spread_.accepted, is_wide_beam)) return;
      for (const Located& l : light_->located) out_.located.push_back(l);
      out_.undecided_between.push_back({"crosstalk", "mixed-pixel"});
      return;
    }
    const Suspect& suspect = light_->suspect;
    Found found;
    found.mechanism = suspect.mechanism;
    found.parameters = suspect.parameters;
    found.probability = std::min(0.999, 1 / (1 + std::exp(-suspect.evidence)));
    Finding finding;
    finding.parameters = suspect.parameters;
    for (const Cell& cell : reduced_.cells)
      if (const double pulled = suspect.parameters.at("leak").value * cell.at.pull_mm;
          cell.n > 0 && std::abs(pulled) > std::abs(finding.largest_mm))
        finding.largest_mm = pulled;
    found.says = suspect.mechanism->says(finding);
    found.log_likelihood_gain = suspect.gain - 1;
    found.evidence =
        "Beams beside edges are pulled by the light of the other surface: the log-likelihood is higher by " +
        rounded(suspect.gain, 3) + ", and more than by a beam that is too wide.";
    found.rms_before_mm = means_.after.rms_mm;
    found.rms_after_mm = means_.after.rms_mm;
    out_.mechanisms.push_back(found);
    for (const Located& l : light_->located) out_.located.push_back(l);
  }

  void spread() {
    for (const Suspect& suspect : spread_.accepted) {
      if (reduced_.bench.knows(suspect.mechanism->id) && suspect.mechanism->id != "range-noise") continue;
      Found found;
      found.mechanism = suspect.mechanism;
      found.parameters = suspect.parameters;
      found.probability = std::min(
          0.999, 1 / (1 + std::exp(odds::against_any - suspect.evidence) + std::exp(-suspect.ahead)));
      Finding finding;
      finding.parameters = suspect.parameters;
      found.says = suspect.mechanism->says(finding);
      found.log_likelihood_gain = suspect.gain - static_cast<double>(suspect.parameters.size());
      found.evidence = "Its log-likelihood is higher by " + rounded(suspect.gain, 3) + ", of which " +
                       rounded(suspect.gain - suspect.evidence, 2) + " would be chance.";
      found.rms_before_mm = means_.after.rms_mm;
      found.rms_after_mm = means_.after.rms_mm;
      out_.mechanisms.push_back(found);
      if (suspect.mechanism->id != "range-noise")
        known_.push_back({suspect.mechanism->id, suspect.parameters, {}});
    }
    for (const Suspect& suspect : spread_.brought_along) {
      known_.push_back({suspect.mechanism->id, suspect.parameters, {}});
      out_.notes.push_back("Echoes that are about to be lost scatter more; that is no other physics.");
    }
    for (const auto& set : spread_.undecided) {
      std::vector<std::string> names, ways;
      const bool has_unnamed = std::ranges::any_of(set, [](const Suspect& s) { return !s.mechanism; });
      for (const Suspect& s : set) {
        if (!s.mechanism) continue;
        names.push_back(s.mechanism->id);
        out_.noise_suspects.push_back(s);
        if (!std::ranges::count(ways, s.mechanism->separate)) ways.push_back(s.mechanism->separate);
      }
      out_.notes.push_back("What would tell " + listed(names) + " apart: " + listed(ways, "or") + ".");
      if (has_unnamed) names.emplace_back("unknown-physics");
      out_.undecided_between.push_back(names);
    }
  }

  void unknown() {
    if (!means_.best.shapes.empty()) {
      const MeanModel model(reduced_, means_.noise);
      Unexplained u;
      const Shape& shape = means_.best.shapes.front();
      u.observable = Observable::range_mean;
      u.coordinate = shape.coordinate;
      const Described first = describe(shape, model);
      u.describes = first.text;
      u.from = first.from;
      u.to = first.to;
      for (std::size_t i = 1; i < means_.best.shapes.size(); ++i)
        u.describes += "; and " + describe(means_.best.shapes[i], model).text;
      u.evidence = means_.after.log_likelihood - means_.before.log_likelihood;
      out_.unknown = u;
    } else if (!spread_.unknown.empty()) {
      out_.unknown = spread_.unknown.front();
    }
  }

  void locate() {
    Hypothesis nothing(reduced_.bench);
    nothing.nuisance = means_.best.nuisance;
    predict_at(reduced_, nothing);
    const MeanModel before = model_of(reduced_, means_.noise, nothing);
    std::set<Coordinate> taken;
    for (const Term& term : means_.best.terms) {
      if (!taken.insert(term.mechanism->coordinate).second) continue;
      for (const Located& l : locate_effect(before, effect_of(before, term), term.mechanism->coordinate))
        out_.located.push_back(l);
    }
    for (const Shape& shape : means_.best.shapes) {
      if (!taken.insert(shape.coordinate).second) continue;
      for (const Located& l : locate_effect(before, effect_of(before, shape), shape.coordinate))
        out_.located.push_back(l);
    }
    for (const Suspect& suspect : spread_.accepted) {
      for (const Located& l : locate_suspect(suspect, reduced_)) out_.located.push_back(l);
    }
    if (out_.unknown && means_.best.shapes.empty())
      for (const Unexplained& u : spread_.unknown) out_.located.push_back(located(u));
    if (!means_.best.terms.empty() || !means_.best.shapes.empty())
      for (const Located& l : locate_residuals(before, 0.01))
        if (!taken.contains(l.coordinate)) out_.located.push_back(l);
    for (Located& l : out_.located) {
      if (l.coordinate != Coordinate::temperature) continue;
      l.from += reduced_.first_temperature_c;
      l.to += reduced_.first_temperature_c;
    }
    // Pictures.
    predict_at(reduced_, means_.best);
    const MeanModel after = model_of(reduced_, means_.noise, means_.best);
    predict_at(reduced_, nothing);
    std::vector<Coordinate> wanted;
    for (const Term& term : means_.best.terms) wanted.push_back(term.mechanism->coordinate);
    for (const Shape& shape : means_.best.shapes) wanted.push_back(shape.coordinate);
    for (const Coordinate c : {Coordinate::beam, Coordinate::range, Coordinate::time}) wanted.push_back(c);
    std::set<Coordinate> drawn;
    for (const Coordinate c : wanted) {
      if (!drawn.insert(c).second) continue;
      Curve curve = curve_of(before, after, c);
      if (curve.at.size() > 1) out_.curves.push_back(std::move(curve));
    }
    predict_at(reduced_, means_.best);
  }

  /// The noise of every place, in words.
  [[nodiscard]] std::string noise_of_places() const {
    std::string text = "The constant noise differs from place to place:";
    for (std::size_t c = 0; c < spread_.sigma_by_capture_mm.size(); ++c)
      text += (c == 0 ? " " : ", ") + rounded(spread_.sigma_by_capture_mm[c], 2) + " mm (" +
              reduced_.captures[c].target.value_or(reduced_.captures[c].step) + ")";
    return text;
  }

  void notes() {
    if (2 * reduced_.astray > reduced_.in_clear)
      out_.notes.push_back(
          "Most of what was recorded (" + std::to_string(reduced_.astray) + " of " +
          std::to_string(reduced_.in_clear) + " cells away from edges) lies more than " + rounded(astray_mm) +
          " mm off the bench file's targets: is it the "
          "bench file of this set-up? Check places, mount and the stage's zero before anything "
          "here is believed.");
    if (reduced_.left_out > 0)
      out_.notes.push_back(std::to_string(reduced_.left_out) + " of " +
                           std::to_string(reduced_.cells.size()) +
                           " cells were left out of the means: edges, grazing incidence, doubtful walls.");
    if (means_.excess > 1)
      out_.notes.push_back("The means of neighbouring beams scatter " + rounded(std::sqrt(means_.excess), 3) +
                           " times more than their samples say; everything was weighed accordingly.");
    if (means_.cut_short)
      out_.notes.push_back(
          "Nothing tried fits these means well, and the search was ended before every combination was tried: "
          "correct the bench file by what is told here, and explain again.");
    if (!means_.transfers)
      out_.notes.push_back(
          "Means deviate in ways that one place does not share with the others; nothing is built on these.");
    if (!spread_.sigma_by_capture_mm.empty()) out_.notes.push_back(noise_of_places() + ".");
    for (const Suspect& suspect : spread_.accepted) {
      if (suspect.mechanism->id != "angle-jitter") continue;
      const Estimate sigma = suspect.parameters.at("sigma_deg");
      const double grid = reduced_.bench.lidar.step_rad * deg_per_rad;
      if (std::abs(sigma.value - grid / std::sqrt(12.0)) > 2 * sigma.u + 0.02 * sigma.value) continue;
      out_.notes.push_back(
          "Beam angles scatter by as much as angles do that are rounded to the beams' spacing: " +
          rounded(grid, 3) + " deg / sqrt(12) = " + rounded(grid / std::sqrt(12.0), 3) + " deg.");
    }
    if (means_.scatter_mm > 0)
      out_.notes.push_back("Whole captures are off at random by " + rounded(means_.scatter_mm, 2) +
                           " mm; their cells were not counted as independent.");
    // A nuisance far outside its prior is a wrong bench file, not physics.
    const Eigen::VectorXd stated = Nuisance(reduced_.bench).as_vector(),
                          found = means_.best.nuisance.as_vector(), u = Nuisance::prior_sigma(reduced_.bench);
    for (Eigen::Index i = 0; i < stated.size(); ++i) {
      if (u[i] <= 0 || std::abs(found[i] - stated[i]) < 3.5 * u[i]) continue;
      const bool angle = i == 2 || (i > 3 && i % 2 == 0);
      const std::string what =
          i == 0   ? "The lidar's mount x"
          : i == 1 ? "The lidar's mount y"
          : i == 2 ? "The lidar's mount yaw"
                   : "Target '" + reduced_.bench.targets[static_cast<std::size_t>((i - 3) / 2)].name + "' " +
                         (angle ? "orientation" : "offset");
      const double scale = angle ? deg_per_rad : 1;
      out_.notes.push_back(what + " comes out " + rounded((found[i] - stated[i]) * scale, 3) +
                           (angle ? " deg" : " mm") + " from what the bench file states, " +
                           rounded(std::abs(found[i] - stated[i]) / u[i], 2) +
                           " times its uncertainty: check the bench file before looking for physics.");
    }
  }

  void bench() {
    out_.bench = reduced_.bench;
    for (const KnownMechanism& known : known_) out_.bench.known.push_back(known);
    Mount& mount = out_.bench.lidar.mount;
    const Nuisance& n = means_.best.nuisance;
    mount.x_mm.value = n.x_mm;
    mount.y_mm.value = n.y_mm;
    mount.yaw_rad.value = n.yaw_rad;
    for (std::size_t i = 0; i < out_.bench.targets.size(); ++i) {
      Target& target = out_.bench.targets[i];
      const Eigen::Vector2d middle = (target.from_mm + target.to_mm) / 2 +
                                     n.offset_mm[i] * target.outward_normal(),
                            half = (target.to_mm - target.from_mm) / 2;
      const Eigen::Vector2d turned = Eigen::Rotation2Dd(n.turn_rad[i]) * half;
      target.from_mm = middle - turned;
      target.to_mm = middle + turned;
    }
    for (KnownMechanism& known : out_.bench.known)
      if (known.mechanism == "range-noise" && spread_.sigma_mm > 0)
        known.parameters["sigma_mm"].value = spread_.sigma_mm;
  }

  Reduced& reduced_;
  const MeanResult& means_;
  const SpreadResult& spread_;
  const std::optional<StrayLight>& light_;
  std::vector<KnownMechanism> known_;
  Explanation out_;
};

}  // namespace

std::string verdict_of(const Explanation& explanation) {
  return explanation.unknown                      ? "unknown-physics"
         : !explanation.undecided_between.empty() ? "undecided"
         : !explanation.mechanisms.empty()        ? "explained"
                                                  : "nothing-missing";
}

Explanation explain(const std::vector<const Recording*>& recordings, const Progress& progress) {
  if (recordings.empty()) throw std::invalid_argument("no recording was given");
  const std::vector<SingleBeams> single = single_beams(recordings);
  std::vector<const Recording*> looked_at;
  for (const SingleBeams& one : single) looked_at.push_back(&one);
  const Together together(looked_at);
  Reduced reduced = reduce_all(together, progress);
  if (reduced.bench.targets.empty())
    throw std::invalid_argument(
        "the bench has no targets, so there is nothing to compare the recording with. Describe the walls or "
        "boards "
        "under 'targets' and give the bench with --bench");
  if (reduced.cells.empty())
    throw std::invalid_argument(
        "no beam of the recording meets a target of the bench. Check the targets' places and the frames of "
        "the scans");
  SpreadResult spread = explain_spread(reduced);
  for (const Suspect& suspect : spread.accepted)
    if (suspect.mechanism->id == "rounding")
      reduced.empirical.push_back(bias_of_rounding(suspect.parameters.at("step_mm").value, spread.sigma_mm));
  if (spread::flickers(spread)) spread::take_off_flicker(reduced);
  const auto searched = [&](double share, const char* what) {
    if (progress) progress(0.35 + 0.63 * share, what);
  };
  MeanResult means = search_means(reduced, spread.noise, searched);
  std::optional<StrayLight> light;
  if (!reduced.bench.knows("crosstalk")) light = stray_light(reduced, without_crosstalk(means));
  if (light && light->or_mixed_pixel && names_crosstalk(means)) light.reset();
  if (light && !light->or_mixed_pixel) {
    // What reaches beams farther from edges is no other physics.
    reduced.bench.known.push_back({"crosstalk", light->suspect.parameters, {}});
    take_off_stray_light(reduced, light->suspect.parameters.at("leak").value);
    spread = explain_spread(reduced);
    means = search_means(reduced, spread.noise, searched);
  }
  Explanation explanation = Writer(reduced, means, spread, light).write();
  explain_intensity(reduced, explanation);
  complete_twin(reduced, means, explanation);
  explanation.predictor = predictor_of(reduced, means, spread);
  explanation.several_places = together.in_several_places();
  explanation.bench.targets.resize(together.first_scene());
  explanation.notes.insert(explanation.notes.begin(), together.notes().begin(), together.notes().end());
  if (const std::string note = note_on_clusters(single); !note.empty())
    explanation.notes.insert(explanation.notes.begin(), note);
  if (progress) progress(1, "done");
  return explanation;
}

}  // namespace fit::explain
