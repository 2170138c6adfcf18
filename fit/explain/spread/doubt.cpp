// SPDX-License-Identifier: MIT
#include "fit/explain/spread/doubt.hpp"

#include <algorithm>
#include <set>
#include <utility>

#include "fit/explain/odds.hpp"
#include "fit/explain/spread/noise_columns.hpp"
#include "fit/explain/spread/suspects.hpp"
#include "fit/explain/stated_noise.hpp"

namespace fit::explain::spread {
namespace {

// Noise outside the catalogue is seldom as simple as the form that describes it: what the form leaves is
// hardly ever another mechanism.
constexpr double against_a_name_beside = 10;

/// Some of the names, and an unnamed law beside them.
struct Alternative {
  std::vector<bool> kept;
  UnnamedNoise noise;
  double evidence = 0;
};

/// Light with the profile that fits best.
Column of_any_profile(const VarianceModel& model, const Parts& parts, const NamedNoise& light) {
  const auto value = [&](const char* id) { return light.suspect.parameters.at(id).value; };
  const std::vector<Pool>& pools = model.pools();
  const std::size_t at = light.columns.front();
  Column best = parts.columns[at];
  double most = model.fit(parts).log_likelihood;
  for (const double power : {2.0, 4.0, 8.0, 16.0})
    for (const double wider : {0.8, 1.0, 1.2, 1.4, 1.7})
      for (const double aside : {-0.4, -0.2, 0.0, 0.2, 0.4}) {
        const double width_deg = value("width_deg");
        Parts other = parts;
        Column& column = other.columns[at];
        column = of_light(pools, value("centre_deg") + aside * width_deg, wider * width_deg, power);
        if (light.suspect.parameters.contains("from_s"))
          column = between_times(pools, column, {value("from_s"), value("to_s")});
        const double likelihood = model.fit(other).log_likelihood;
        if (likelihood <= most) continue;
        most = likelihood;
        best = column;
      }
  return best;
}

class Doubts {
 public:
  Doubts(const VarianceModel& model, Parts parts, std::vector<NamedNoise> names)
      : model_(model), parts_(std::move(parts)), names_(std::move(names)) {
    for (NamedNoise& name : names_) {
      if (is(name.suspect, constant_noise)) {
        parts_.free = true;
      } else if (name.columns.empty()) {
        name.columns.push_back(parts_.columns.size());
        parts_.columns.push_back(of_suspect(model_.pools(), name.suspect));
      }
      if (is(name.suspect, ids::sunlight))
        parts_.columns[name.columns.front()] = of_any_profile(model_, parts_, name);
    }
    const std::vector<bool> all(names_.size(), true);
    likelihood_ = model_.fit(of(all)).log_likelihood;
    for (const NamedNoise& name : names_) may_be_of_formulas_ += may_be_of_its_formula(name.suspect);
    for (unsigned mask = 0; mask < 1U << names_.size(); ++mask) consider(mask);
    drop_those_that_predict_less();
  }

  [[nodiscard]] Doubted answer() const {
    const std::vector<bool> all(names_.size(), true);
    const double named = likelihood_ - price_of(all);
    const auto strongest = std::ranges::max_element(alternatives_, {}, &Alternative::evidence);
    const bool is_unnamed = strongest != alternatives_.end() && strongest->evidence > named;
    Doubted doubted{{}, is_unnamed ? strongest->kept : all, {}};
    if (is_unnamed) doubted.unnamed = strongest->noise;
    for (std::size_t i = 0; i < names_.size(); ++i)
      doubted.ahead.push_back((is_unnamed ? strongest->evidence : named - odds::more_than_forms_show) -
                              without(i));
    return doubted;
  }

 private:
  /// The parts with these names only.
  [[nodiscard]] Parts of(const std::vector<bool>& kept) const {
    std::set<std::size_t> gone;
    Parts parts = parts_;
    for (std::size_t i = 0; i < names_.size(); ++i) {
      if (kept[i]) continue;
      gone.insert(names_[i].columns.begin(), names_[i].columns.end());
    }
    return parts.without(gone);
  }

  /// The same beside an unnamed law, which has a level of its own.
  [[nodiscard]] Parts beside_law(const std::vector<bool>& kept) const {
    Parts parts = of(kept);
    parts.free = true;
    return parts;
  }

  [[nodiscard]] double price_of(const std::vector<bool>& kept) const {
    double price = 0;
    for (std::size_t i = 0; i < names_.size(); ++i)
      if (kept[i]) price += names_[i].price();
    return price;
  }

  void consider(unsigned mask) {
    Alternative alternative;
    for (std::size_t i = 0; i < names_.size(); ++i) {
      alternative.kept.push_back((mask >> i & 1U) != 0);
      if (alternative.kept[i] && is(names_[i].suspect, constant_noise)) return;  // the law has its own level
    }
    const Parts parts = beside_law(alternative.kept);
    const VarianceModel::Fit fit = model_.fit(parts);
    const auto noise = unnamed_noise(model_, model_.variances(parts, fit), parts.places > 0);
    // It must be worth something beside the level alone.
    if (!noise || noise->evidence() < accept_at + odds::worth_a_name) return;
    // Of noise of weak echoes only the coordinate is certain: another law along it is its own.
    const auto is_of_echoes = [](const NamedNoise& name) { return is(name.suspect, ids::intensity_noise); };
    if (noise->coordinate == Coordinate::intensity && std::ranges::any_of(names_, is_of_echoes)) return;
    alternative.noise = *noise;
    alternative.evidence =
        fit.log_likelihood + noise->evidence() - price_of(alternative.kept) - odds::worth_a_name -
        may_be_of_formulas_ -
        against_a_name_beside * static_cast<double>(std::ranges::count(alternative.kept, true));
    alternatives_.push_back(std::move(alternative));
  }

  /// Captures that it was not fitted to must be predicted no worse by an unnamed law, beside the names that
  /// are kept, than by all names: these know how noise goes on elsewhere.
  void drop_those_that_predict_less() {
    if (alternatives_.empty()) return;
    const Parts none = of(std::vector<bool>(names_.size()));
    const auto of_names = model_.unseen_gain(none, of(std::vector<bool>(names_.size(), true)));
    std::erase_if(alternatives_, [&](const Alternative& a) {
      if (!of_names || !a.noise.unseen_gain) return false;
      return *model_.unseen_gain(none, beside_law(a.kept)) + *a.noise.unseen_gain < *of_names;
    });
  }

  /// Evidence of the best that does without that name.
  [[nodiscard]] double without(std::size_t name) const {
    double best = -1e300;
    for (const Alternative& a : alternatives_)
      if (!a.kept[name]) best = std::max(best, a.evidence);
    return best;
  }

  const VarianceModel& model_;
  Parts parts_;
  std::vector<NamedNoise> names_;
  double likelihood_ = 0;          ///< With all names.
  double may_be_of_formulas_ = 0;  ///< Of what an unnamed law gains.
  std::vector<Alternative> alternatives_;
};

}  // namespace

Doubted doubt(const VarianceModel& model, Parts parts, std::vector<NamedNoise> names) {
  return Doubts(model, std::move(parts), std::move(names)).answer();
}

}  // namespace fit::explain::spread
