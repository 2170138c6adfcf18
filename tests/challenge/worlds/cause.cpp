// SPDX-License-Identifier: MIT
#include "worlds/cause.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace challenge {
namespace {

bool is_unknown(const std::string& id) { return id.starts_with("unknown-"); }

/// Kinds that show in the intensity, and where.
const std::map<std::string, std::string>& lights() {
  static const std::map<std::string, std::string> table{{"radiometry", "range_mm"},
                                                        {"window-dirt", "beam_deg"},
                                                        {"specular", "incidence_deg"},
                                                        {"unknown-stripe", "target"}};
  return table;
}

/// Whether the perpendicular from the axis meets it.
bool faces(const Wall& wall) {
  const Vector along = (wall.to - wall.from).normalized();
  const double foot = -along.dot(wall.from);
  return foot > 100 && foot < (wall.to - wall.from).norm() - 100;
}

}  // namespace

WorldCause::WorldCause(const Kind& kind) : kind_(kind) {
  id = kind.id;
  if (lights().contains(id)) {
    coordinate = lights().at(id);
    observable = "intensity";
    return;
  }
  coordinate = is_unknown(id) ? "beam_deg" : make_cause(id)->coordinate;
  observable = is_unknown(id) ? "range-mean" : make_cause(id)->observable;
}

void WorldCause::draw(Session& session, Random& random) {
  for (double* x : {&shape_.a, &shape_.b, &shape_.c, &shape_.d}) *x = random.uniform(0, 1);
  shape_.sign = random.sign();
  shape_.power = power_span(session, steepest_of_echoes_rad);
  shape_.wall = static_cast<std::size_t>(random.integer(0, static_cast<int>(session.walls.size()) - 1));
  // Gloss shows on targets that are seen square on from somewhere.
  for (std::size_t i = 0; id == "specular" && i < session.walls.size() && !faces(session.walls[shape_.wall]);
       ++i)
    shape_.wall = (shape_.wall + 1) % session.walls.size();
  for (const Capture& capture : session.captures) rates_.push_back(capture.rate_deg_s);
  look_without(session);
}

json WorldCause::without(const Session& session) const {
  json world = plain_world(session);
  world.merge_patch(others_);
  return world;
}

void WorldCause::look_without(const Session& session) {
  plain_ = Table(session, without(session), kind_.each_scan);
  if (shows_in_intensity()) plain_light_ = Table(session, without(session), false, true);
}

bool WorldCause::stand_beside(Session& session, const Cause& other) {
  others_ = dynamic_cast<const WorldCause&>(other).keys();
  look_without(session);
  build(session);
  return true;
}

void WorldCause::build(Session& session) {
  session_ = &session;
  counted_.reset();
  if (id == "motion-skew") {  // its strength is how fast the stage turns
    for (std::size_t i = 0; i < rates_.size(); ++i) session.captures[i].rate_deg_s = rates_[i] * strength;
    plain_ = Table(session, without(session), true);
  }
  const json world = add_to(without(session));
  if (kind_.shifts) with_ = Table(session, world, kind_.each_scan);
  if (shows_in_intensity()) light_ = Table(session, world, false, true);
  if (id == "intensity-noise" || id == "sunlight") probe(session);
}

json WorldCause::add_to(json world) const {
  world.merge_patch(keys());
  return world;
}

double WorldCause::range(const Moment& moment, const Sight&, const World&) const {
  if (!kind_.shifts || id == "mixed-pixel") return 0;
  const double shift = with_.at(moment) - plain_.at(moment);
  return std::isfinite(shift) && std::abs(shift) < 500 ? shift : 0;
}

double WorldCause::lost(const Moment& moment, const Sight& sight) const {
  // At the end of a board a bent beam may miss it: that is no dropout.
  if (id != "dropout" || std::isnan(plain_.at(moment))) return 0;
  const json receiver = keys()["receiver"];
  const double above = sight.power - receiver["threshold"].get<double>();
  return std::erfc(above / receiver["noise"].get<double>() / std::sqrt(2.0)) / 2;
}

double WorldCause::variance(const Moment& moment, const Sight& sight, const World&) const {
  if (id == "range-noise") return 4 * strength;
  if (id != "intensity-noise" && id != "sunlight") return 0;
  const double slope = (steeper_.at(moment) - plain_.at(moment)) / probe_;
  if (!std::isfinite(slope)) return 0;
  double noise = 0;
  if (id == "intensity-noise") {
    // The comparator works at half of the peak there, so the slope is that of the middle of the flank.
    noise = 0.02 * std::sqrt(strength) * shape_.power.low;
    const double middle = 2 / (0.5 * std::sqrt(2 * std::log(2.0)) * sight.power) * light_mm_per_ns;
    return middle * middle * noise * noise;
  }
  const json sun = keys()["light"]["suns"][0];
  const double x = (moment.alpha / degree - sun["centre_deg"].get<double>()) / sun["width_deg"].get<double>();
  noise = sun["noise"].get<double>() * std::exp(-x * x);
  return slope * slope * noise * noise;
}

double WorldCause::stray(const Moment&, const Sight& sight) const {
  if (id != "outliers") return 0;
  return 1 - std::exp(-std::min(0.2, 0.002 * strength) * sight.range_mm / 1000);
}

double WorldCause::scan_angle_sigma() const { return id == "angle-jitter" ? 0.05 * strength * degree : 0; }

double WorldCause::footprint() const { return id == "mixed-pixel" ? (8 + 8 * shape_.a) * 1e-3 : 0; }

double WorldCause::output_step_mm() const { return id == "rounding" ? 4 + std::floor(8 * shape_.a) : 1; }

std::vector<std::pair<double, double>> WorldCause::memory() const {
  if (id != "correlated-noise") return {};
  return {{1.0, std::min(0.98, 0.1 * strength)}};
}

bool WorldCause::shows_in_intensity() const { return lights().contains(id); }

double WorldCause::log_intensity(const Moment& moment) const {
  return shows_in_intensity() ? light_.at(moment) - plain_light_.at(moment) : 0;
}

std::optional<double> WorldCause::counts(const Moment& moment) const {
  if (!counted_) counted_ = Table(*session_, add_to(without(*session_)), false, true);
  return std::exp(counted_->at(moment));
}

/// How far noise at the comparator moves the range: by a slightly higher threshold, without compensation.
void WorldCause::probe(const Session& session) {
  json low = without(session), high = low;
  low["receiver"]["compensation"] = high["receiver"]["compensation"] = 0;
  const double threshold = low["receiver"]["threshold"];
  probe_ = 1e-3 * threshold;
  // A trick against the changing reference of the firmware: the threshold is lifted by a constant flash.
  high["housing"] = {{"flash", -probe_}, {"flash_decay_ns", 1e9}};
  plain_ = Table(session, low, false);
  steeper_ = Table(session, high, false);
}

}  // namespace challenge
