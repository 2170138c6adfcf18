// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <span>
#include <sstream>
#include <stdexcept>

#include "fit/bench/bench.hpp"
#include "fit/bench/json_position.hpp"

namespace fit {
namespace {

using json = nlohmann::json;

/// Whether two words differ in their units of one kind only: limits_rad and limits_deg.
bool same_but_for_units(const std::string& a, const std::string& b) {
  static const std::vector<std::set<std::string>> kinds = {{"um", "mm", "cm", "m", "inch"},
                                                           {"deg", "degrees", "rad", "mrad"},
                                                           {"us", "ms", "s", "min", "h"},
                                                           {"hz", "khz", "hertz"},
                                                           {"c", "k", "f"}};
  std::istringstream words(a), others(b);
  for (std::string word, other;;) {
    const bool is_one = static_cast<bool>(std::getline(words, word, '_')),
               is_other = static_cast<bool>(std::getline(others, other, '_'));
    if (!is_one || !is_other) return is_one == is_other;
    const auto alike = [&](const auto& units) { return units.contains(word) && units.contains(other); };
    if (word != other && std::ranges::none_of(kinds, alike)) return false;
  }
}

/// A part of the document together with where it stands, so that every complaint names its place.
class Reader {
 public:
  Reader(const json& value, std::string pointer, const std::string& text, const std::string& name)
      : value_(value), pointer_(std::move(pointer)), text_(text), name_(name) {}

  [[nodiscard]] const json& value() const { return value_; }
  /// NAME:LINE:COLUMN.
  [[nodiscard]] std::string place() const {
    const TextPosition position = position_of(text_, pointer_);
    return name_ + ":" + std::to_string(position.line) + ":" + std::to_string(position.column);
  }
  [[nodiscard]] bool has(const std::string& key) const { return value_.contains(key); }

  [[noreturn]] void refuse(const std::string& complaint) const {
    throw std::invalid_argument(position_of(text_, pointer_).in(name_) +
                                (pointer_.empty() ? "" : "\"" + pointer_.substr(1) + "\" ") + complaint);
  }

  [[nodiscard]] Reader at(const std::string& key) const {
    if (!has(key)) refuse("needs the key \"" + key + "\", which is missing");
    return {value_.at(key), pointer_ + "/" + key, text_, name_};
  }

  [[nodiscard]] Reader at(std::size_t index) const {
    return {value_.at(index), pointer_ + "/" + std::to_string(index), text_, name_};
  }

  void must_be_object() const {
    if (!value_.is_object()) refuse("must be an object {...}");
  }

  void must_be_array() const {
    if (!value_.is_array()) refuse("must be a list [...]");
  }

  /// Other tools may add keys, which are kept; one that looks like a slip of the pen is refused.
  template <std::size_t n>
  void refuse_misspelt(const std::array<const char*, n>& known) const {
    for (const auto& [key, ignored] : value_.items()) {
      bool is_known = false;
      for (const char* name : known) is_known = is_known || key == name;
      if (is_known) continue;
      for (const char* name : known)
        if (!has(name) && same_but_for_units(key, name))
          at(key).refuse("is in another unit than a bench file has it; the key is \"" + std::string(name) +
                         "\"");
      const std::string meant = nearest_word(key, known);
      if (!meant.empty() && !has(meant) && edit_distance(key, meant) <= 2)
        at(key).refuse("is not a key of a bench file; did you mean \"" + meant + "\"?");
    }
  }

  [[nodiscard]] double number() const {
    if (!value_.is_number()) refuse("must be a number, not " + value_.dump());
    const double number = value_.get<double>();
    if (!std::isfinite(number)) refuse("must be a finite number");
    return number;
  }

  [[nodiscard]] double number_from(double low, double high) const {
    const double read = number();
    if (read < low || read > high)
      refuse("is " + json(read).dump() + " but must lie between " + json(low).dump() + " and " +
             json(high).dump());
    return read;
  }

  [[nodiscard]] int integer_from(int low, int high) const {
    const double read = number_from(low, high);
    if (read != std::floor(read)) refuse("must be a whole number");
    return static_cast<int>(read);
  }

  [[nodiscard]] std::string string() const {
    if (!value_.is_string()) refuse("must be text in quotes");
    return value_.get<std::string>();
  }

  /// A bare number (known exactly) or {"value": v, "u": u}, and nothing else: an uncertainty under another
  /// name would be none.
  [[nodiscard]] Estimate estimate() const {
    if (!value_.is_object()) return number();
    for (const auto& [key, ignored] : value_.items())
      if (key != "value" && key != "u")
        at(key.c_str())
            .refuse(
                "is no part of a value with its uncertainty; write {\"value\": ..., \"u\": ...}, u being the "
                "standard uncertainty in the same unit");
    const double u = has("u") ? at("u").number() : 0;
    if (u < 0) at("u").refuse("is a standard uncertainty and cannot be negative");
    return {at("value").number(), u};
  }

  [[nodiscard]] Eigen::Vector2d point() const {
    if (!value_.is_array() || value_.size() != 2) refuse("must be a point [x, y] in millimetres");
    constexpr double farthest_mm = 1e8;
    return {at(0).number_from(-farthest_mm, farthest_mm), at(1).number_from(-farthest_mm, farthest_mm)};
  }

 private:
  const json& value_;
  std::string pointer_;
  const std::string& text_;
  const std::string& name_;
};

Estimate scaled(const Estimate& estimate, double factor) {
  return {estimate.value * factor, estimate.u * std::abs(factor)};
}

/// Standard uncertainties of a device's systematic deviations; accuracy_of() reads them.
template <std::size_t n>
void check_accuracy(const Reader& device, const std::array<const char*, n>& known) {
  if (!device.has("accuracy")) return;
  const Reader accuracy = device.at("accuracy");
  accuracy.must_be_object();
  accuracy.refuse_misspelt(known);
  for (const char* key : known)
    if (accuracy.has(key)) (void)accuracy.at(key).number_from(0, 1000);
}

Mount read_mount(const Reader& reader) {
  reader.must_be_object();
  reader.refuse_misspelt(std::array{"x_mm", "y_mm", "yaw_deg"});
  Mount mount;
  if (reader.has("x_mm")) mount.x_mm = reader.at("x_mm").estimate();
  if (reader.has("y_mm")) mount.y_mm = reader.at("y_mm").estimate();
  if (reader.has("yaw_deg")) mount.yaw_rad = scaled(reader.at("yaw_deg").estimate(), rad_per_deg);
  return mount;
}

LidarGeometry read_lidar(const Reader& reader) {
  reader.must_be_object();
  reader.refuse_misspelt(std::array{"model", "steps", "first_step", "front_step", "step_deg", "scan_hz",
                                    "serial", "largest_error_mm", "mount", "accuracy"});
  check_accuracy(reader,
                 std::array{"u_beam_eccentricity_deg", "u_range_mm", "u_range_scale", "u_range_walk_mm"});
  LidarGeometry lidar;
  if (reader.has("model")) lidar.model = reader.at("model").string();
  if (reader.has("steps")) lidar.steps = reader.at("steps").integer_from(1, 100000);
  if (reader.has("first_step"))
    lidar.first_step = reader.at("first_step").integer_from(0, std::max(0, lidar.steps - 1));
  if (reader.has("serial")) lidar.serial = reader.at("serial").string();
  if (reader.has("front_step")) lidar.front_step = reader.at("front_step").integer_from(-100000, 100000);
  if (reader.has("step_deg")) lidar.step_rad = reader.at("step_deg").number_from(1e-4, 90) * rad_per_deg;
  if (reader.has("scan_hz")) lidar.scan_hz = reader.at("scan_hz").number_from(1e-3, 1e4);
  // Stays in the document: only those who look for a target ask for it.
  if (reader.has("largest_error_mm")) (void)reader.at("largest_error_mm").number_from(0, 1e6);
  if (reader.has("mount")) lidar.mount = read_mount(reader.at("mount"));
  return lidar;
}

Target read_target(const Reader& reader) {
  reader.must_be_object();
  reader.refuse_misspelt(std::array{"name", "from_mm", "to_mm", "centre_mm", "radius_mm", "u_mm", "u_deg",
                                    "u_radius_mm", "reflectance", "placed_anew"});
  Target target;
  target.name = reader.at("name").string();
  if (reader.has("centre_mm") || reader.has("radius_mm")) {
    for (const char* of_a_flat_one : {"from_mm", "to_mm", "u_deg"})
      if (reader.has(of_a_flat_one))
        reader.at(of_a_flat_one)
            .refuse(
                "is of a flat target, and centre_mm and radius_mm are of a round one: leave one of them out");
    RoundShape shape;
    shape.centre_mm = reader.at("centre_mm").point();
    shape.radius_mm = reader.at("radius_mm").number_from(1, 1e5);
    if (reader.has("u_radius_mm")) shape.u_radius_mm = reader.at("u_radius_mm").number_from(0, 1e5);
    if (shape.centre_mm.norm() <= shape.radius_mm)
      reader.refuse("stands on the stage's axis: centre_mm must be farther away than radius_mm");
    target.set_round(shape);
  } else {
    if (reader.has("u_radius_mm"))
      reader.at("u_radius_mm").refuse("is of a round target: give centre_mm and radius_mm as well");
    target.from_mm = reader.at("from_mm").point();
    target.to_mm = reader.at("to_mm").point();
    if ((target.to_mm - target.from_mm).norm() < 1e-6)
      reader.refuse("has no length: from_mm and to_mm are the same point");
  }
  if (reader.has("u_mm")) target.u_mm = reader.at("u_mm").number_from(0, 1e6);
  if (reader.has("u_deg")) target.u_rad = reader.at("u_deg").number_from(0, 360) * rad_per_deg;
  if (reader.has("reflectance") && !reader.at("reflectance").value().is_null())
    target.reflectance = reader.at("reflectance").number_from(0, 1000);
  // Stays in the document: only those who compare placements ask for it.
  if (reader.has("placed_anew") && !reader.at("placed_anew").value().is_boolean())
    reader.at("placed_anew").refuse("must be true or false");
  return target;
}

/// What every stage has, whoever speaks to it: limits that are not understood would be none. Returns its
/// resolution in radians.
double read_stage(const Reader& reader) {
  reader.must_be_object();
  reader.refuse_misspelt(std::array{"language", "model", "resolution_deg", "limits_deg", "speed_deg_s",
                                    "acceleration_deg_s2", "tolerance_deg", "units_per_deg", "units_per_turn",
                                    "direction", "zero_deg", "settle_s", "reply_s", "home_s", "needs_homing",
                                    "baud", "address", "axis", "accuracy",
                                    // of the simulated one
                                    "homed", "axes", "acknowledges", "physics"});
  check_accuracy(reader, std::array{"u_scale", "u_eccentricity_deg", "u_backlash_deg", "u_position_deg"});
  for (const char* quickness : {"speed_deg_s", "acceleration_deg_s2"})
    if (reader.has(quickness)) (void)reader.at(quickness).number_from(1e-6, 1e6);
  if (reader.has("limits_deg")) {
    const Reader limits = reader.at("limits_deg");
    constexpr double farthest_deg = 1e6;
    if (!limits.value().is_array() || limits.value().size() != 2)
      limits.refuse("must be two angles [from, to] in degrees");
    const double from = limits.at(0).number_from(-farthest_deg, farthest_deg);
    if (from >= limits.at(1).number_from(-farthest_deg, farthest_deg))
      limits.refuse("must be [from, to] with from below to, not " + limits.value().dump());
  }
  return reader.has("resolution_deg") ? reader.at("resolution_deg").number_from(1e-7, 90) * rad_per_deg
                                      : Bench().stage_resolution_rad;
}

KnownMechanism read_known(const Reader& reader) {
  reader.must_be_object();
  reader.refuse_misspelt(std::array{"mechanism", "parameters"});
  KnownMechanism known;
  known.mechanism = reader.at("mechanism").string();
  if (!reader.has("parameters")) return known;
  const Reader parameters = reader.at("parameters");
  parameters.must_be_object();
  for (const auto& [key, value] : parameters.value().items()) {
    if (value.is_string())
      known.texts[key] = value.get<std::string>();
    else if (value.is_number() || (value.is_object() && value.contains("value")))
      known.parameters[key] = parameters.at(key).estimate();
    // anything else (a table of an empirical correction, say) stays in the document for whoever reads it
    // there
  }
  return known;
}

json estimate_json(const Estimate& estimate) {
  if (estimate.u == 0) return estimate.value;
  return {{"value", estimate.value}, {"u", estimate.u}};
}

json target_json(const Target& target, json document) {
  document["name"] = target.name;
  document["u_mm"] = target.u_mm;
  if (target.round) {
    document["centre_mm"] = {target.round->centre_mm.x(), target.round->centre_mm.y()};
    document["radius_mm"] = target.round->radius_mm;
    document["u_radius_mm"] = target.round->u_radius_mm;
  } else {
    document["from_mm"] = {target.from_mm.x(), target.from_mm.y()};
    document["to_mm"] = {target.to_mm.x(), target.to_mm.y()};
    document["u_deg"] = target.u_rad * deg_per_rad;
  }
  if (target.reflectance) document["reflectance"] = *target.reflectance;
  return document;
}

/// The entry of the document that describes the same thing, so that keys we do not model survive.
json entry_with(const json& list, const char* key, const std::string& name) {
  if (list.is_array())
    for (const json& entry : list)
      if (entry.is_object() && entry.value(key, "") == name) return entry;
  return json::object();
}

/// What the certificate prints stays in the document; whoever writes it is told of slips.
void check_certificate(const Reader& certificate) {
  static constexpr std::array keys{
      "environment",      "equipment",  "laboratory",    "address",     "country",
      "customer_address", "received",   "place",         "customer",    "item",
      "item_condition",   "item_state", "authorised_by", "traceability"};
  certificate.must_be_object();
  certificate.refuse_misspelt(keys);
  for (const char* text : std::span(keys).subspan(2))
    if (certificate.has(text)) static_cast<void>(certificate.at(text).string());
  // As text, "" is what a new bench file has for what is not stated.
  const auto stated = [&](const char* key) {
    return certificate.has(key) ? certificate.at(key).string() : std::string();
  };
  static const std::regex date(R"((\d{4}-\d{2}-\d{2})?)");
  if (!std::regex_match(stated("received"), date))
    certificate.at("received").refuse("must be a date as YYYY-MM-DD");
  if (const std::string state = stated("item_state");
      !state.empty() && state != "as found" && state != "as left")
    certificate.at("item_state")
        .refuse("must be \"as found\" or \"as left\"; without it the item is not adjusted");
  if (certificate.has("environment")) {
    const Reader environment = certificate.at("environment");
    environment.must_be_object();
    environment.refuse_misspelt(std::array{"temperature_c", "humidity_percent", "illuminance_lux"});
    const auto check = [&](const char* key, double low, double high) {
      if (environment.has(key) && !environment.at(key).value().is_string())
        static_cast<void>(environment.at(key).number_from(low, high));
    };
    check("temperature_c", -100, 200);
    check("humidity_percent", 0, 100);
    check("illuminance_lux", 0, 1e6);
  }
  if (!certificate.has("equipment")) return;
  const Reader equipment = certificate.at("equipment");
  equipment.must_be_array();
  for (std::size_t i = 0; i < equipment.value().size(); ++i) {
    static constexpr std::array of_item{"name", "serial", "certificate", "due"};
    const Reader item = equipment.at(i);
    item.must_be_object();
    item.refuse_misspelt(of_item);
    static_cast<void>(item.at("name"));
    for (const char* key : of_item)
      if (item.has(key)) static_cast<void>(item.at(key).string());
  }
}

}  // namespace

Bench parse_bench(const std::string& text, const std::string& name) {
  const json document = parse_json(
      text, name,
      "not JSON here: look for a missing comma, quote or bracket, or one too many, just before this place. "
      "A bench file is JSON and begins with {");
  const Reader reader(document, "", text, name);
  reader.must_be_object();
  if (!reader.has("schema")) reader.refuse("not a bench file: the key \"schema\": \"bench/1\" is missing");
  if (reader.at("schema").string() != "bench/1")
    reader.at("schema").refuse("says " + document.at("schema").dump() + "; this program reads \"bench/1\"");
  reader.refuse_misspelt(std::array{"schema", "lidar", "stage", "targets", "known", "certificate"});
  Bench bench;
  bench.document = BenchDocument(document);
  if (reader.has("lidar")) {
    const Reader lidar = reader.at("lidar");
    bench.lidar = read_lidar(lidar);
    bench.lidar_places[""] = lidar.place();
    for (const auto& [key, ignored] : lidar.value().items()) bench.lidar_places[key] = lidar.at(key).place();
  }
  if (reader.has("stage")) bench.stage_resolution_rad = read_stage(reader.at("stage"));
  if (reader.has("targets")) {
    const Reader targets = reader.at("targets");
    targets.must_be_array();
    for (std::size_t i = 0; i < targets.value().size(); ++i) {
      bench.targets.push_back(read_target(targets.at(i)));
      for (std::size_t j = 0; j < i; ++j)
        if (bench.targets[j].name == bench.targets[i].name)
          targets.at(i).refuse("has the name \"" + bench.targets[i].name +
                               "\" of an earlier target; names must differ");
    }
  }
  if (reader.has("known")) {
    const Reader known = reader.at("known");
    known.must_be_array();
    for (std::size_t i = 0; i < known.value().size(); ++i) bench.known.push_back(read_known(known.at(i)));
  }
  return bench;
}

Bench parse_bench_file(const std::string& text, const std::string& name) {
  Bench bench = parse_bench(text, name);
  refuse_keys_given_twice(text, name);
  const json document = bench.document.json();
  if (const Reader reader(document, "", text, name); reader.has("certificate"))
    check_certificate(reader.at("certificate"));
  return bench;
}

std::string to_json_text(const Bench& bench) {
  json document = bench.document.json();
  const json old_targets = document.value("targets", json::array()),
             old_known = document.value("known", json::array());
  document["schema"] = "bench/1";
  json& lidar = document["lidar"];
  lidar["model"] = bench.lidar.model;
  lidar["steps"] = bench.lidar.steps;
  if (bench.lidar.first_step != 0) lidar["first_step"] = bench.lidar.first_step;
  if (!bench.lidar.serial.empty()) lidar["serial"] = bench.lidar.serial;
  lidar["front_step"] = bench.lidar.front_step;
  lidar["step_deg"] = bench.lidar.step_rad * deg_per_rad;
  lidar["scan_hz"] = bench.lidar.scan_hz;
  lidar["mount"] = {{"x_mm", estimate_json(bench.lidar.mount.x_mm)},
                    {"y_mm", estimate_json(bench.lidar.mount.y_mm)},
                    {"yaw_deg", estimate_json(scaled(bench.lidar.mount.yaw_rad, deg_per_rad))}};
  document["stage"]["resolution_deg"] = bench.stage_resolution_rad * deg_per_rad;
  document["targets"] = json::array();
  for (const Target& target : bench.targets)
    document["targets"].push_back(target_json(target, entry_with(old_targets, "name", target.name)));
  document["known"] = json::array();
  for (const KnownMechanism& known : bench.known) {
    json entry = entry_with(old_known, "mechanism", known.mechanism);
    entry["mechanism"] = known.mechanism;
    json& parameters = entry["parameters"];
    if (!parameters.is_object()) parameters = json::object();
    for (const auto& [key, value] : known.parameters) parameters[key] = estimate_json(value);
    for (const auto& [key, value] : known.texts) parameters[key] = value;
    document["known"].push_back(entry);
  }
  return document.dump(2);
}

}  // namespace fit
