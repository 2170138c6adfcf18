// SPDX-License-Identifier: MIT
#include "rig/archive/swapped.hpp"

#include <algorithm>
#include <boost/math/distributions/chi_squared.hpp>
#include <cmath>
#include <set>

#include "rig/archive/middle.hpp"

namespace rig {
namespace {

constexpr double false_alarms = 1e-3;  // Over all sessions of an archive.
constexpr double still_alike = 0.01;   // A lidar whose results are farther off by chance is not reported.
constexpr double far_nearer = 20;      // The other lidar must be e^10 times as likely as the own one.
constexpr double tells_devices_apart = 2;
constexpr double sure_of_line = 0.01;

/// Half the width that holds the middle two thirds, which a few strange values do not widen.
double spread_of(const std::vector<double>& v) {
  const double middle = middle_of(v);
  std::vector<double> away;
  for (const double x : v) away.push_back(std::abs(x - middle));
  return 1.4826 * middle_of(away);
}

/// What a lidar's other calibrations say of one more, with the variance of that in units of the
/// repeatability's.
struct Expected {
  double value = 0, variance = 0;
  bool is_known = false;
};

/// One lidar's values of a quantity.
struct Values {
  const QuantityHistory* history = nullptr;
  std::vector<double> all;
  /// Without one session, at a time: by their line if they drift beyond doubt, else their median.
  [[nodiscard]] Expected without(const SessionRecord* left_out, double at_years,
                                 const Repeatability& repeat) const {
    constexpr double median_is_wider = 1.5708;  // The variance of a median over that of a mean: pi/2.
    std::vector<double> years, kept;
    for (const HistoryPoint& p : history->points)
      if (p.session != left_out) {
        years.push_back(p.years);
        kept.push_back(p.value->value);
      }
    if (kept.size() < 2) return {};
    const auto n = static_cast<double>(kept.size());
    const Drift drift = drift_of(years, kept, repeat.sigma, repeat.degrees_of_freedom());
    if (kept.size() < 4 || drift.p_value > sure_of_line)
      return {middle_of(kept), 1 + median_is_wider / n, true};
    double mean = 0, tt = 0;
    for (const double t : years) mean += t / n;
    for (const double t : years) tt += (t - mean) * (t - mean);
    return {drift.at_zero + drift.per_year * at_years, 1 + 1 / n + (at_years - mean) * (at_years - mean) / tt,
            true};
  }
};

/// The quantities that tell the lidars of a model apart, with the values of each.
struct Model {
  struct Quantity {
    Repeatability repeat;
    std::map<std::string, Values> of_serial;
  };
  std::map<std::string, Quantity> quantities;
  std::set<std::string> serials;
};

std::map<std::string, Model> models_of(std::span<const QuantityHistory> histories,
                                       const std::map<std::string, Repeatability>& repeat) {
  std::map<std::string, Model> models;
  for (const QuantityHistory& h : histories) {
    const Repeatability* r = repeatability_in(repeat, h);
    if (!r || r->differences < enough_differences || !(r->sigma > 0)) continue;
    Model::Quantity& quantity = models[h.model].quantities[h.quantity];
    quantity.repeat = *r;
    Values& values = quantity.of_serial[h.serial];
    values.history = &h;
    for (const HistoryPoint& p : h.points) values.all.push_back(p.value->value);
    models[h.model].serials.insert(h.serial);
  }
  for (auto& [name, model] : models)
    std::erase_if(model.quantities, [](const auto& item) {
      std::vector<double> centres;
      for (const auto& [serial, values] : item.second.of_serial) centres.push_back(middle_of(values.all));
      return !(spread_of(centres) > tells_devices_apart * item.second.repeat.sigma);
    });
  return models;
}

struct Distance {
  double chi_squared = 0;
  std::size_t quantities = 0;
  [[nodiscard]] double p_value() const {
    if (quantities == 0) return 1;
    return boost::math::cdf(
        boost::math::complement(boost::math::chi_squared(static_cast<double>(quantities)), chi_squared));
  }
};

Distance distance_to(const Model& model, const SessionRecord& session, double at_years,
                     const std::string& serial) {
  Distance out;
  for (const auto& [name, quantity] : model.quantities) {
    const auto values = quantity.of_serial.find(serial);
    const auto own = std::ranges::find(session.values, name, &ArchivedValue::quantity);
    if (values == quantity.of_serial.end() || own == session.values.end()) continue;
    const Expected expected = values->second.without(&session, at_years, quantity.repeat);
    if (!expected.is_known) continue;
    const double off = (own->value - expected.value) / quantity.repeat.sigma;
    out.chi_squared += off * off / expected.variance;
    ++out.quantities;
  }
  return out;
}

/// When a session was measured, as the histories count; NaN if none of them has it.
double years_of(std::span<const QuantityHistory> histories, const SessionRecord& session) {
  for (const QuantityHistory& h : histories)
    for (const HistoryPoint& p : h.points)
      if (p.session == &session) return p.years;
  return std::nan("");
}

}  // namespace

std::vector<StrangeSession> strange_sessions(std::span<const SessionRecord> archive,
                                             std::span<const QuantityHistory> histories,
                                             const std::map<std::string, Repeatability>& repeat) {
  const auto models = models_of(histories, repeat);
  std::vector<StrangeSession> out;
  for (const SessionRecord& session : archive) {
    const auto model = models.find(session.model);
    if (model == models.end() || session.serial.empty()) continue;
    const double at_years = years_of(histories, session);
    if (!std::isfinite(at_years)) continue;
    const Distance own = distance_to(model->second, session, at_years, session.serial);
    if (own.quantities == 0 || own.p_value() > false_alarms / static_cast<double>(archive.size())) continue;
    StrangeSession strange{&session, "", 0, own.chi_squared, INFINITY, own.quantities, own.p_value()};
    std::size_t alike = 0;
    for (const std::string& serial : model->second.serials) {
      if (serial == session.serial) continue;
      const Distance other = distance_to(model->second, session, at_years, serial);
      if (other.quantities < own.quantities || other.p_value() < still_alike ||
          own.chi_squared - other.chi_squared < far_nearer)
        continue;
      ++alike;
      if (other.chi_squared >= strange.distance_to_other) continue;
      strange.distance_to_other = other.chi_squared;
      strange.looks_like = serial;
    }
    strange.also_like = alike > 0 ? alike - 1 : 0;
    out.push_back(strange);
  }
  return out;
}

}  // namespace rig
