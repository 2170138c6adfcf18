// SPDX-License-Identifier: MIT
#include "sim/world.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>

#include "fit/bench/json_position.hpp"
#include "fit/numeric/angle.hpp"

namespace sim {
namespace {

using json = nlohmann::json;
constexpr double huge = std::numeric_limits<double>::max();

/// One object of the file. Every key that is read is noted; finish() refuses the others.
class Section {
 public:
  Section(const json& value, std::string pointer, const std::string& text, const std::string& name)
      : value_(value), pointer_(std::move(pointer)), text_(text), name_(name) {
    if (!value_.is_object()) refuse(pointer_, "must be an object {...}");
  }

  [[noreturn]] void refuse(const std::string& pointer, const std::string& complaint) const {
    throw std::invalid_argument(fit::position_of(text_, pointer).in(name_) + "\"" +
                                (pointer.empty() ? pointer : pointer.substr(1)) + "\" " + complaint);
  }

  const json* find(const std::string& key) {
    known_.insert(key);
    const auto it = value_.find(key);
    return it == value_.end() ? nullptr : &*it;
  }

  /// Reads a number if it is there; `factor` turns the file's unit into the member's.
  void number(const std::string& key, double& into, double factor = 1, double low = -huge,
              double high = huge) {
    const json* found = find(key);
    if (!found) return;
    if (!found->is_number()) refuse(pointer_ + "/" + key, "must be a number, not " + found->dump());
    const double value = found->get<double>();
    if (!(value >= low && value <= high)) {
      refuse(pointer_ + "/" + key, "is " + found->dump() + ", outside " + json(low).dump() + " to " +
                                       (high == huge ? "any size" : json(high).dump()));
    }
    into = value * factor;
  }

  void positive(const std::string& key, double& into, double factor = 1) {
    number(key, into, factor, 1e-12, huge);
  }

  void choice(const std::string& key, std::string& into, const std::vector<std::string>& words) {
    const json* found = find(key);
    if (!found) return;
    if (!found->is_string() || !std::ranges::count(words, found->get<std::string>())) {
      std::string list;
      for (const std::string& word : words) list += (list.empty() ? "\"" : ", \"") + word + "\"";
      refuse(pointer_ + "/" + key, "must be one of " + list + ", not " + found->dump());
    }
    into = found->get<std::string>();
  }

  void whole(const std::string& key, int& into, int low, int high) {
    double value = into;
    number(key, value, 1, low, high);
    if (value != std::floor(value)) refuse(pointer_ + "/" + key, "must be a whole number");
    into = static_cast<int>(value);
  }

  template <typename Read>
  void section(const std::string& key, Read read) {
    if (const json* found = find(key)) {
      Section inner(*found, pointer_ + "/" + key, text_, name_);
      read(inner);
      inner.finish();
    }
  }

  template <typename Read>
  void list(const std::string& key, Read read) {
    const json* found = find(key);
    if (!found) return;
    if (!found->is_array()) refuse(pointer_ + "/" + key, "must be a list [...]");
    for (std::size_t i = 0; i < found->size(); ++i) {
      Section inner((*found)[i], pointer_ + "/" + key + "/" + std::to_string(i), text_, name_);
      read(inner);
      inner.finish();
    }
  }

  [[nodiscard]] const json& value() const { return value_; }
  [[nodiscard]] const std::string& pointer() const { return pointer_; }

  void finish() const {
    for (const auto& [key, ignored] : value_.items()) {
      if (known_.count(key)) continue;
      const std::string meant = fit::nearest_word(key, known_);
      refuse(pointer_ + "/" + key,
             "is not a key here" + (meant.empty() ? std::string() : "; did you mean \"" + meant + "\"?"));
    }
  }

 private:
  const json& value_;
  std::string pointer_;
  const std::string& text_;
  const std::string& name_;
  std::set<std::string> known_;
};

constexpr double deg = fit::rad_per_deg;

void read_target(Section& s, TargetTruth& target) {
  s.number("offset_mm", target.offset_mm);
  s.number("aside_mm", target.aside_mm);
  s.number("thicker_mm", target.thicker_mm);
  s.number("tilt_deg", target.tilt_rad, deg, -45, 45);
  s.number("plumb_deg", target.plumb_rad, deg, -45, 45);
  s.number("sagitta_mm", target.sagitta_mm);
  s.number("reflectance", target.reflectance, 1, 0, 5);
  s.number("gloss", target.gloss, 1, 0, 1);
  s.number("specular", target.specular, 1, 0, 1000);
  s.positive("specular_width_deg", target.specular_width_rad, deg);
  s.number("depth_mm", target.depth_mm, 1, 0, 1000);
  s.list("stripes", [&](Section& stripe) {
    TargetTruth::Stripe read;
    stripe.number("from_mm", read.from_mm);
    stripe.number("to_mm", read.to_mm);
    stripe.number("reflectance", read.reflectance, 1, 0, 5);
    target.stripes.push_back(read);
  });
  s.section("moved", [&](Section& moved) {
    moved.number("from_s", target.moved.from_s);
    moved.number("to_s", target.moved.to_s);
    moved.number("offset_mm", target.moved.offset_mm);
    moved.number("turn_deg", target.moved.turn_rad, deg, -45, 45);
    moved.number("aside_mm", target.moved.aside_mm);
  });
}

void read_truth(Section& s, World& world) {
  const auto optional = [&](const char* key, std::optional<double>& into, double factor) {
    double value = std::nan("");
    s.number(key, value, factor);
    if (!std::isnan(value)) into = value;
  };
  optional("mount_x_mm", world.mount_x_mm, 1);
  optional("mount_y_mm", world.mount_y_mm, 1);
  optional("mount_yaw_deg", world.mount_yaw_rad, deg);
  s.section("knock", [&](Section& knock) {
    knock.number("from_s", world.knock.from_s);
    knock.number("x_mm", world.knock.x_mm);
    knock.number("y_mm", world.knock.y_mm);
    knock.number("yaw_deg", world.knock.yaw_rad, deg, -180, 180);
  });
  if (const json* targets = s.find("targets")) {
    if (!targets->is_object())
      s.refuse(s.pointer() + "/targets", "must be an object: name -> how it really is");
    for (const auto& [name, ignored] : targets->items()) {
      if (!world.bench.target(name)) {
        s.refuse(s.pointer() + "/targets/" + name, "is not a target of the bench");
      }
    }
    s.section("targets", [&](Section& list) {
      for (const auto& item : targets->items()) {
        const std::string& name = item.key();
        list.section(name, [&](Section& target) { read_target(target, world.targets[name]); });
      }
    });
  }
}

void read_optics(Section& top, World& w) {
  top.section("beam", [&](Section& s) {
    s.number("long_mrad", w.beam.long_rad, 1e-3, 0, 100);
    s.number("short_mrad", w.beam.short_rad, 1e-3, 0, 100);
    s.number("aperture_mm", w.beam.aperture_mm, 1, 0, 100);
    s.number("aside_mm", w.beam.aside_mm);
  });
  top.section("pulse", [&](Section& s) {
    s.choice("shape", w.pulse.shape, {"gaussian", "two-pole", "raised-cosine"});
    s.positive("rise_ns", w.pulse.rise_ns);
  });
  top.section("receiver", [&](Section& s) {
    s.choice("timing", w.receiver.timing, {"threshold", "fraction", "centre"});
    s.choice("echo", w.receiver.echo, {"first", "strongest"});
    s.positive("threshold", w.receiver.threshold);
    s.number("fraction", w.receiver.fraction, 1, 0.05, 0.95);
    s.number("compensation", w.receiver.compensation, 1, 0, 2);
    s.number("noise", w.receiver.noise, 1, 0, 1);
    s.number("photon_noise", w.receiver.photon_noise, 1, 0, 1);
    s.number("wander", w.receiver.wander, 1, 0, 1);
    s.positive("wander_memory_s", w.receiver.wander_memory_s);
    s.number("memory", w.receiver.memory, 1, 0, 0.9999);
    s.positive("clip", w.receiver.clip);
    s.number("overlap_mm", w.receiver.overlap_mm, 1, 0, 10000);
    s.number("parallax_mm", w.receiver.parallax_mm, 1, 0, 1000);
    s.number("stray", w.receiver.stray, 1, 0, 1);
    s.positive("stray_width_deg", w.receiver.stray_width_rad, deg);
    s.positive("counts", w.receiver.counts);
    s.number("counts_exponent", w.receiver.counts_exponent, 1, 0.05, 2);
    s.positive("counts_full", w.receiver.counts_full);
    s.number("counts_noise", w.receiver.counts_noise, 1, 0, 1);
  });
  top.section("counter", [&](Section& s) {
    s.number("bin_ns", w.counter.bin_ns, 1, 0, 100);
    s.number("ppm", w.counter.ppm, 1, -1e5, 1e5);
    s.number("jitter_ns", w.counter.jitter_ns, 1, 0, 100);
    s.number("jitter_memory", w.counter.jitter_memory, 1, 0, 0.9999);
    s.number("leak", w.counter.leak, 1, -1, 1);
    s.positive("leak_mhz", w.counter.leak_mhz);
    s.number("leak_phase_deg", w.counter.leak_phase_rad, deg);
  });
  top.section("housing", [&](Section& s) {
    s.number("delay_ns", w.housing.delay_ns);
    s.number("flash", w.housing.flash, 1, -10, 10);
    s.positive("flash_decay_ns", w.housing.flash_decay_ns);
    s.number("glint", w.housing.glint, 1, -10, 10);
    s.number("glint_centre_deg", w.housing.glint_centre_rad, deg);
    s.positive("glint_width_deg", w.housing.glint_width_rad, deg);
    s.list("dirt", [&](Section& d) {
      World::Housing::Dirt dirt;
      d.number("centre_deg", dirt.centre_rad, deg);
      d.positive("width_deg", dirt.width_rad, deg);
      d.number("loss", dirt.loss, 1, 0, 1);
      d.number("there", dirt.there, 1, 0, 1);
      w.housing.dirt.push_back(dirt);
    });
  });
}

void read_mechanics(Section& top, World& w) {
  top.section("rotor", [&](Section& s) {
    s.number("disk_offset", w.rotor.disk_offset, 1, 0, 0.5);
    s.number("disk_phase_deg", w.rotor.disk_phase_rad, deg);
    s.number("disk_lean_deg", w.rotor.disk_lean_rad, deg, 0, 60);
    s.number("disk_lean_phase_deg", w.rotor.disk_lean_phase_rad, deg);
    s.number("speed_error", w.rotor.speed_error, 1, -0.2, 0.2);
    s.number("ripple_deg", w.rotor.ripple_rad, deg, 0, 5);
    s.whole("ripple_order", w.rotor.ripple_order, 1, 1000);
    s.number("lost_slit_deg", w.rotor.lost_slit_rad, deg, -5, 5);
    s.number("lost_slit_at_deg", w.rotor.lost_slit_at_rad, deg);
    s.number("interpolation_deg", w.rotor.interpolation_rad, deg, 0, 5);
    s.whole("slits", w.rotor.slits, 0, 100000);
    s.number("index_jitter_deg", w.rotor.index_jitter_rad, deg, 0, 5);
    s.number("plane_tilt_deg", w.rotor.plane_tilt_rad, deg, -45, 45);
    s.number("plane_axis_deg", w.rotor.plane_axis_rad, deg);
    if (const json* rolling = s.find("rolling")) {
      if (!rolling->is_boolean()) s.refuse(s.pointer() + "/rolling", "must be true or false");
      w.rotor.rolling = rolling->get<bool>();
    }
    s.list("facets", [&](Section& f) {
      World::Rotor::Facet facet;
      f.number("range_mm", facet.range_mm);
      f.number("angle_deg", facet.angle_rad, deg);
      w.rotor.facets.push_back(facet);
    });
  });
  top.section("heat", [&](Section& s) {
    s.number("rise_fast_k", w.heat.rise_fast_k);
    s.positive("fast_s", w.heat.fast_s);
    s.number("rise_slow_k", w.heat.rise_slow_k);
    s.positive("slow_s", w.heat.slow_s);
    s.number("delay_ps_per_k", w.heat.delay_ps_per_k);
    s.number("gain_per_k", w.heat.gain_per_k, 1, -0.05, 0.05);
    s.number("reference_c", w.heat.reference_c);
  });
  top.section("stage", [&](Section& s) {
    s.number("worm_deg", w.stage.worm_rad, deg, 0, 5);
    s.number("worm_second", w.stage.worm_second, 1, -1, 1);
    s.whole("worm_teeth", w.stage.worm_teeth, 1, 100000);
    s.number("worm_phase_deg", w.stage.worm_phase_rad, deg);
    s.number("wheel_deg", w.stage.wheel_rad, deg, 0, 20);
    s.number("wheel_phase_deg", w.stage.wheel_phase_rad, deg);
    s.number("scale", w.stage.scale, 1, -0.1, 0.1);
    s.number("play_deg", w.stage.play_rad, deg, 0, 10);
    s.number("runout_mm", w.stage.runout_mm);
    s.number("runout_phase_deg", w.stage.runout_phase_rad, deg);
    s.number("wobble_deg", w.stage.wobble_rad, deg, 0, 10);
    s.number("wobble_phase_deg", w.stage.wobble_phase_rad, deg);
    s.number("ring_deg", w.stage.ring_rad, deg, 0, 10);
    s.positive("ring_hz", w.stage.ring_hz);
    s.positive("ring_decay_s", w.stage.ring_decay_s);
    s.number("late_ms", w.stage.late_s, 1e-3);
  });
}

void read_surroundings(Section& top, World& w) {
  top.section("light", [&](Section& s) {
    s.list("suns", [&](Section& one) {
      World::Light::Sun sun;
      one.number("centre_deg", sun.centre_rad, deg);
      one.positive("width_deg", sun.width_rad, deg);
      one.number("noise", sun.noise, 1, 0, 1);
      one.number("in_room", sun.in_room, 1, 0, 1);
      one.number("from_s", sun.from_s);
      one.number("to_s", sun.to_s);
      w.light.suns.push_back(sun);
    });
    s.number("lamp", w.light.lamp, 1, -1, 1);
    s.positive("lamp_hz", w.light.lamp_hz);
  });
  top.section("air", [&](Section& s) {
    s.number("dust_per_m", w.air.dust_per_m, 1, 0, 1);
    s.number("index_error", w.air.index_error, 1, -0.1, 0.1);
  });
  top.section("firmware", [&](Section& s) {
    s.number("step_mm", w.firmware.step_mm, 1, 1, 1000);
    s.whole("median", w.firmware.median, 1, 31);
    if (w.firmware.median % 2 == 0) s.refuse(s.pointer() + "/median", "must be odd");
  });
}

constexpr const char* not_json = "is not JSON. Check for a missing comma, quote or bracket just before.";

}  // namespace

World parse_world(const std::string& text, const std::string& name, const std::optional<fit::Bench>& bench) {
  const json document = fit::parse_json(text, name, not_json);
  Section top(document, "", text, name);
  const json* schema = top.find("schema");
  if (!schema || *schema != "world/1") top.refuse(schema ? "/schema" : "", "needs \"schema\": \"world/1\"");
  World world;
  const json* own_bench = top.find("bench");
  if (bench) {
    world.bench = *bench;
  } else if (own_bench) {
    world.bench = fit::parse_bench(own_bench->dump(1), name + " (bench)");
  } else {
    top.refuse("", "needs a \"bench\": what the operator knows, or give a bench file beside it");
  }
  top.find("says");        // prose for the reader
  top.find("$schema");     // for editors
  top.find("bench_file");  // load_world() has read it
  top.section("truth", [&](Section& s) { read_truth(s, world); });
  read_optics(top, world);
  read_mechanics(top, world);
  read_surroundings(top, world);
  top.finish();
  return world;
}

World load_world(const std::filesystem::path& path, const std::optional<fit::Bench>& bench) {
  const auto read = [](const std::filesystem::path& from) {
    std::ifstream file(from, std::ios::binary);
    if (!file) throw std::invalid_argument(from.string() + ": cannot be read. Check the path.");
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  const std::string text = read(path);
  if (bench) return parse_world(text, path.string(), bench);
  const json document = fit::parse_json(text, path.string(), not_json);
  const auto beside = document.is_object() ? document.find("bench_file") : document.end();
  if (!document.is_object() || beside == document.end() || !beside->is_string()) {
    return parse_world(text, path.string());
  }
  const std::filesystem::path bench_path = path.parent_path() / beside->get<std::string>();
  return parse_world(text, path.string(), fit::parse_bench(read(bench_path), bench_path.string()));
}

std::string compile_world(const World& world) {
  // The noise that a user would state: robust spread of repeated scans from rest, without any concealed
  // motion.
  constexpr int scans = 60;
  const auto steps = static_cast<std::size_t>(world.bench.lidar.steps);
  const auto engine = make_causal_engine(world, 1);
  std::vector<std::vector<double>> samples(steps);
  std::vector<std::uint32_t> range(steps), intensity(steps);
  for (int i = 0; i < scans; ++i) {
    engine->scan(
        3600 + i / world.bench.lidar.scan_hz, [](double) { return StageMoment{}; }, range, intensity);
    for (std::size_t k = 0; k < steps; ++k) {
      if (range[k] > 4 && range[k] < 65000) samples[k].push_back(range[k]);
    }
  }
  std::vector<double> spreads;
  for (auto& column : samples) {
    if (column.size() < scans / 2) continue;
    std::ranges::sort(column);
    spreads.push_back((column[column.size() * 84 / 100] - column[column.size() * 16 / 100]) / 2);
  }
  fit::Bench bench = world.bench;
  bench.document.change([](json& document) {
    if (document.contains("stage") && document["stage"].is_object()) document["stage"].erase("physics");
  });
  if (!spreads.empty() && !bench.knows("range-noise")) {
    std::ranges::sort(spreads);
    fit::KnownMechanism noise;
    noise.mechanism = "range-noise";
    noise.parameters["sigma_mm"] = fit::Estimate{std::round(10 * spreads[spreads.size() / 2]) / 10, 1.0};
    bench.known.push_back(noise);
  }
  return fit::to_json_text(bench);
}

}  // namespace sim
