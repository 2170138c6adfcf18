// SPDX-License-Identifier: MIT
#include <cmath>
#include <functional>
#include <map>
#include <stdexcept>

#include "concealed.hpp"

namespace challenge {
namespace {

const char* compass(std::size_t index) {
  static const char* names[] = {"east", "north", "west", "south", "fifth", "sixth"};
  return names[index % 6];
}

void add_outline(Session& session, const std::vector<Vector>& corners, Random& random) {
  for (std::size_t i = 0; i < corners.size(); ++i) {
    Wall wall;
    wall.name = compass(i);
    wall.from = corners[i];
    wall.to = corners[(i + 1) % corners.size()];
    wall.reflectance = random.uniform(0.3, 0.85);
    wall.closed = true;
    session.walls.push_back(wall);
  }
}

/// A convex room around the stage: usually a rectangle, sometimes with one wall aslant.
void add_room(Session& session, Random& random, double smallest = 1500, double largest = 5000) {
  const double e = random.uniform(smallest, largest), n = random.uniform(smallest, largest);
  const double w = random.uniform(smallest, largest), s = random.uniform(smallest, largest);
  std::vector<Vector> corners{{e, -s}, {e, n}, {-w, n}, {-w, -s}};
  if (random.chance(0.3)) corners[1] = {e * random.uniform(0.6, 0.9), n};
  if (random.chance(0.2)) corners[3] = {-w, -s * random.uniform(0.6, 0.9)};
  add_outline(session, corners, random);
}

Wall board(const std::string& name, double distance, double bearing_deg, double tilt_deg, double half_width,
           double reflectance) {
  const double bearing = bearing_deg * degree, along = bearing + pi / 2 + tilt_deg * degree;
  const Vector centre = distance * Vector(std::cos(bearing), std::sin(bearing));
  const Vector half = half_width * Vector(std::cos(along), std::sin(along));
  Wall wall;
  wall.name = name;
  wall.from = centre - half;
  wall.to = centre + half;
  wall.reflectance = reflectance;
  return wall;
}

void set_approach(Session& session) {
  for (std::size_t i = 1; i < session.captures.size(); ++i) {
    const double move = session.captures[i].stage_deg - session.captures[i - 1].stage_deg;
    session.captures[i].approach = move > 0 ? 1 : move < 0 ? -1 : session.captures[i - 1].approach;
  }
}

/// Up and down again, so that every angle is reached from both sides.
void add_turns(Session& session, double from_deg, double to_deg, double step_deg, int scans, double pause_s,
               double first_s = 1800) {
  std::vector<double> angles;
  for (double a = from_deg; a < to_deg - step_deg / 2; a += step_deg) angles.push_back(a);
  const std::size_t n = angles.size();
  for (std::size_t i = 0; i < n; ++i) angles.push_back(angles[n - 1 - i]);
  for (std::size_t i = 0; i < angles.size(); ++i) {
    Capture capture;
    capture.stage_deg = std::round(angles[i] * 100) / 100;
    capture.since_power_on_s = first_s + pause_s * static_cast<double>(i);
    capture.scans = scans;
    session.captures.push_back(capture);
  }
  set_approach(session);
}

void room(Session& session, Random& random) {
  add_room(session, random);
  const double step = random.pick(std::vector<double>{12, 15, 18, 20, 13.7, 16.3, 24});
  add_turns(session, 0, 360, step, random.integer(7, 12), random.uniform(10, 30));
}

/// Another lidar than the UST-10LX, in half of the sessions: coarser beams, slower turns.
void choose_lidar(Session& session, Random& random) {
  const double step_deg = random.pick(std::vector<double>{0.25, 0.25, 0.5, 1});
  if (step_deg == 0.25) return;
  session.step_deg = step_deg;
  session.front_step = step_deg == 1 ? 180 : 270;
  session.steps = step_deg == 1 ? 360 : 541;
  session.scan_hz = step_deg == 1 ? 10 : 40;
}

/// Irregular angles, each come to from either side, few scans or many.
void add_irregular_turns(Session& session, Random& random) {
  const int stops = random.integer(8, 26);
  double time = 1800;
  const double pause = random.uniform(10, 40);
  for (int i = 0; i < stops; ++i) {
    Capture capture;
    capture.stage_deg = std::round(100 * random.uniform(-170, 170)) / 100;
    capture.since_power_on_s = time += pause;
    capture.scans = random.integer(5, 30);
    capture.last_step = session.steps - 1;
    session.captures.push_back(capture);
  }
  set_approach(session);
}

/// A bench file that knows its scene well, or hardly.
void choose_uncertainties(Session& session, Random& random) {
  const double wide = random.pick(std::vector<double>{0.5, 1, 1, 3});
  for (Wall& wall : session.walls) {
    wall.u_mm *= wide;
    wall.u_deg *= wide;
  }
  session.u_mount_mm *= random.pick(std::vector<double>{0.5, 1, 2});
  session.u_yaw_deg *= random.pick(std::vector<double>{0.5, 1, 2});
}

void look_around(Session& session, Random& random) {
  choose_lidar(session, random);
  choose_uncertainties(session, random);
  add_irregular_turns(session, random);
}

/// A room with an outward corner, behind which part of it is hidden.
void l_room(Session& session, Random& random) {
  const double e = random.uniform(2000, 4500), w = random.uniform(1500, 3000), s = random.uniform(1500, 3000);
  const double near_n = random.uniform(900, 2000), far_n = near_n + random.uniform(1200, 2800),
               corner = random.uniform(500, 0.6 * e);
  add_outline(session, {{e, -s}, {e, near_n}, {corner, near_n}, {corner, far_n}, {-w, far_n}, {-w, -s}},
              random);
  look_around(session, random);
}

/// Two long walls, open at both ends, and a board across.
void corridor(Session& session, Random& random) {
  const double half = random.uniform(700, 1300), length = random.uniform(3500, 6500);
  session.walls.push_back(board("left", half, 90, random.uniform(-2, 2), length, random.uniform(0.3, 0.85)));
  session.walls.push_back(
      board("right", half, -90, random.uniform(-2, 2), length, random.uniform(0.3, 0.85)));
  session.walls.push_back(board("end", random.uniform(2500, 0.9 * length), 0, random.uniform(-20, 20),
                                0.6 * half, random.uniform(0.3, 0.85)));
  look_around(session, random);
}

/// A room with boards that stand free before its walls.
void furnished(Session& session, Random& random) {
  add_room(session, random, 2200, 4500);
  const int count = random.integer(1, 3);
  for (int i = 0; i < count; ++i)
    session.walls.push_back(board("board " + std::to_string(i + 1), random.uniform(900, 1700),
                                  360.0 / count * i + random.uniform(-25, 25), random.uniform(-40, 40),
                                  random.uniform(120, 450), random.uniform(0.15, 0.9)));
  look_around(session, random);
}

/// Few stage angles, short: where much cannot be told apart.
void few_angles(Session& session, Random& random) {
  add_room(session, random);
  for (int i = 0; i < 3; ++i) {
    Capture capture;
    capture.stage_deg = 10.0 * i;
    capture.since_power_on_s = 1800 + 20 * i;
    capture.scans = random.integer(20, 40);
    session.captures.push_back(capture);
  }
  set_approach(session);
}

void ladder_with(Session& session, Random& random, const std::vector<double>& reflectances) {
  Wall wall = board("board", random.uniform(250, 400), 0, 0, 250, 0.85);
  session.walls.push_back(wall);
  const double step = random.pick(std::vector<double>{100, 130, 150, 170, 210});
  const double last = random.uniform(6500, 9300);
  double time = 3600;
  const double pause = random.uniform(10, 30);
  for (const double reflectance : reflectances) {
    for (double shift = 0; shift < last; shift += step) {
      Capture capture;
      capture.target = 0;
      capture.shift_mm = shift;
      capture.reflectance = reflectance;
      capture.since_power_on_s = time += pause;
      capture.scans = 60;
      capture.first_step = 536;
      capture.last_step = 544;
      session.captures.push_back(capture);
    }
  }
}

void ladder(Session& session, Random& random) {
  ladder_with(session, random,
              {random.uniform(0.8, 0.95), random.uniform(0.35, 0.6), random.uniform(0.08, 0.2)});
}

void one_grey_ladder(Session& session, Random& random) {
  ladder_with(session, random, {random.uniform(0.7, 0.95)});
}

/// Many greys at few distances.
void grey_ladder(Session& session, Random& random) {
  session.walls.push_back(board("board", 500, 0, 0, 300, 0.85));
  double time = 3600;
  const int greys = random.integer(12, 24);
  for (const double shift : {0.0, random.uniform(700, 1500), random.uniform(2000, 4000)}) {
    for (int i = 0; i < greys; ++i) {
      Capture capture;
      capture.target = 0;
      capture.shift_mm = std::round(shift);
      capture.reflectance = 0.04 * std::pow(0.95 / 0.04, static_cast<double>((i * 7) % greys) / (greys - 1));
      capture.since_power_on_s = time += 15;
      capture.scans = random.integer(60, 80);
      capture.first_step = 530;
      capture.last_step = 550;
      session.captures.push_back(capture);
    }
  }
}

void edge(Session& session, Random& random) {
  const double distance = random.uniform(1200, 2200), end = random.uniform(120, 350);
  Wall front;
  front.name = "board";
  front.from = {distance, -600};
  front.to = {distance, end};
  front.reflectance = random.uniform(0.5, 0.9);
  Wall back;
  back.name = "background";
  back.from = {distance + random.uniform(500, 1500), -3000};
  back.to = {back.from.x(), 3000};
  back.reflectance = random.uniform(0.4, 0.8);
  session.walls = {front, back};
  const int centre =
      session.front_step + static_cast<int>(std::lround(std::atan2(end, distance) / degree / 0.25));
  const double span = random.pick(std::vector<double>{0.5, 0.6, 0.8});
  const bool both_ways = random.chance(0.5);
  const auto count = static_cast<int>(std::lround(2 * span / 0.01));
  for (int pass = 0; pass < (both_ways ? 2 : 1); ++pass) {
    for (int i = 0; i <= count; i += both_ways ? 2 : 1) {
      Capture capture;
      capture.stage_deg = std::round((pass == 0 ? -span + 0.01 * i : span - 0.01 * i) * 100) / 100;
      capture.target = 0;
      capture.approach = pass == 0 ? 1 : -1;
      capture.scans = 40;
      capture.first_step = centre - 3;
      capture.last_step = centre + 3;
      capture.since_power_on_s = 1800 + 4.0 * static_cast<double>(session.captures.size());
      session.captures.push_back(capture);
    }
  }
}

void turning(Session& session, Random& random) {
  add_room(session, random, 1500, 4800);
  const double slow = random.uniform(6, 15), fast = random.uniform(25, 45);
  double time = 1800;
  for (const double rate : {0.0, slow, -slow, fast, -fast}) {
    for (int i = 0; i < 4; ++i) {
      Capture capture;
      capture.stage_deg = 90.0 * i;
      capture.rate_deg_s = std::round(rate * 100) / 100;
      capture.approach = rate > 0 ? 1 : rate < 0 ? -1 : 0;
      capture.since_power_on_s = time += 20;
      capture.scans = 12;
      session.captures.push_back(capture);
    }
  }
}

void warmup_with(Session& session, Random& random, const std::function<double(double)>& temperature) {
  add_room(session, random, 1800, 4800);
  session.thermometer = true;
  const int captures = random.integer(80, 140);
  for (int i = 0; i < captures; ++i) {
    Capture capture;
    capture.since_power_on_s = 5 + 30.0 * i;
    capture.temperature_c = temperature(capture.since_power_on_s);
    capture.scans = 6;
    capture.first_step = 300;
    capture.last_step = 780;
    session.captures.push_back(capture);
  }
}

/// The housing warms as electronics do; the thermometer sits on the housing and lags.
void warmup(Session& session, Random& random) {
  const double rise = random.uniform(8, 14), tau = random.uniform(500, 1200);
  warmup_with(session, random, [=](double t) { return 20 + rise * (1 - std::exp(-t / tau)); });
}

/// After warming up the laboratory is heated and cooled again.
void heat_cycle(Session& session, Random& random) {
  const double swing = random.uniform(6, 12), period = random.uniform(1100, 1700);
  warmup_with(session, random, [=](double t) {
    return 22 + 8 * (1 - std::exp(-t / 700)) + swing * std::sin(2 * pi * t / period);
  });
}

/// Boards at several distances and slants around the stage: incidence and distance differ apart.
void boards(Session& session, Random& random) {
  const int count = random.integer(4, 6);
  for (int i = 0; i < count; ++i) {
    const double slant = i % 2 == 0 ? random.uniform(-15, 15) : random.sign() * random.uniform(40, 65);
    session.walls.push_back(board("board " + std::to_string(i + 1), random.uniform(900, 4000),
                                  360.0 / count * i, slant, random.uniform(300, 600),
                                  random.uniform(0.15, 0.9)));
  }
  add_turns(session, 0, 360, random.pick(std::vector<double>{9, 11.3, 14, 17.7}), random.integer(8, 14), 12);
}

/// Fine stage steps in front of slanted boards, from both sides.
void two_sided(Session& session, Random& random) {
  session.walls.push_back(board("left", random.uniform(1200, 2500), 35, random.uniform(35, 60), 700, 0.8));
  session.walls.push_back(board("right", random.uniform(1200, 2500), -35, -random.uniform(35, 60), 700, 0.8));
  const double step = random.pick(std::vector<double>{0.23, 0.37, 0.41});
  add_turns(session, -8, 8, step, random.integer(12, 20), 5);
  for (Capture& capture : session.captures) {
    capture.first_step = 340;
    capture.last_step = 740;
  }
}

/// A box close around the lidar: what happens at short range, at every beam angle.
void box(Session& session, Random& random) {
  add_room(session, random, 220, 700);
  add_turns(session, 0, 360, random.pick(std::vector<double>{17, 24, 30}), random.integer(8, 14), 10);
}

/// Bright and dark panels in front of each other by less than a pulse.
void panels(Session& session, Random& random) {
  const int count = random.integer(6, 9);
  for (int i = 0; i < count; ++i) {
    const double bearing = -60 + 120.0 * i / (count - 1);
    const double distance = i % 2 == 0 ? random.uniform(1500, 1700) : random.uniform(1800, 2050);
    const double half = distance * std::tan(120.0 / (count - 1) / 2 * degree) * (i % 2 == 0 ? 0.8 : 1.6);
    session.walls.push_back(board("panel " + std::to_string(i + 1), distance, bearing, 0, half,
                                  i % 2 == 0 ? random.uniform(0.75, 0.95) : random.uniform(0.06, 0.2)));
  }
  add_turns(session, -6, 6, random.pick(std::vector<double>{0.31, 0.43}), random.integer(12, 20), 6);
  for (Capture& capture : session.captures) {
    capture.first_step = 300;
    capture.last_step = 780;
  }
}

/// A bench on which most kinds can show, and the fixed procedure of one who suspects nothing in particular:
/// from switching on, all round and in small steps from both sides, a board at many distances in three greys,
/// a housing that is heated. The stage never turns while it records: a simulated bench at full speed cannot
/// do that either.
void whole_bench(Session& session, Random& random) {
  add_room(session, random, 2400, 4500);
  session.walls.push_back(board("board", random.uniform(700, 1100), random.uniform(-12, 12),
                                random.uniform(-4, 4), random.uniform(130, 220), 0.85));
  session.walls.push_back(
      board("slanted board", random.uniform(1200, 1900), random.sign() * random.uniform(60, 110),
            random.sign() * random.uniform(35, 60), random.uniform(200, 400), random.uniform(0.3, 0.8)));
  double time = 5;
  const auto add = [&](Capture capture, double pause_s) {
    capture.since_power_on_s = time;
    time += pause_s;
    session.captures.push_back(capture);
  };
  for (int i = 0; i < 20; ++i) add({.scans = 6}, 45);
  for (int i = 0; i < 48; ++i)
    add({.stage_deg = i < 24 ? -170 + 14.5 * i : 163.5 - 14.5 * (i - 24), .scans = 10}, 8);
  for (int i = 0; i < 44; ++i)
    add({.stage_deg = std::round(100 * (i < 22 ? -4 + 0.37 * i : 3.77 - 0.37 * (i - 22))) / 100, .scans = 20},
        5);
  const Wall& front = session.walls[session.walls.size() - 2];
  const Vector middle = (front.from + front.to) / 2;
  const int centre =
      session.front_step +
      static_cast<int>(std::lround(std::atan2(middle.y(), middle.x()) / degree / session.step_deg));
  for (const double reflectance : {0.85, 0.4, 0.12})
    for (const double shift : {-350, -200, -50, 100, 300, 600, 950, 1250})
      add({.target = static_cast<int>(session.walls.size()) - 2,
           .shift_mm = shift,
           .reflectance = reflectance,
           .first_step = centre - 8,
           .last_step = centre + 8,
           .scans = 60},
          20);
  for (const double celsius : {20.0, 26.0, 32.0, 38.0, 32.0, 26.0, 20.0})
    add({.temperature_c = celsius, .scans = 40}, 60);
  session.thermometer = true;
  set_approach(session);
}

/// Scans that begin at once when the stage says that it stopped.
void settle(Session& session, Random& random) {
  add_room(session, random, 1500, 3500);
  add_turns(session, 0, 360, random.pick(std::vector<double>{20, 24, 30}), random.integer(16, 28), 6);
}

}  // namespace

namespace {
const std::map<std::string, void (*)(Session&, Random&)>& table() {
  static const std::map<std::string, void (*)(Session&, Random&)> makers{
      {"room", room},         {"few-angles", few_angles}, {"ladder", ladder},
      {"edge", edge},         {"turning", turning},       {"one-grey-ladder", one_grey_ladder},
      {"warmup", warmup},     {"heat-cycle", heat_cycle}, {"reflectance-ladder", grey_ladder},
      {"boards", boards},     {"two-sided", two_sided},   {"settle", settle},
      {"box", box},           {"panels", panels},         {"l-room", l_room},
      {"corridor", corridor}, {"furnished", furnished},   {"whole-bench", whole_bench}};
  return makers;
}
}  // namespace

const std::vector<std::string>& scenes() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const auto& [name, maker] : table()) all.push_back(name);
    return all;
  }();
  return names;
}

Session make_scene(const std::string& scene, Random& random) {
  const auto maker = table().find(scene);
  if (maker == table().end()) throw std::invalid_argument("unknown scene '" + scene + "'; --list shows them");
  Session session;
  session.scene = scene;
  maker->second(session, random);
  session.radiometer = {random.uniform(0.4, 0.7), random.uniform(0.5, 2)};
  session.sigma_mm = random.uniform(3, 9);
  session.stated_sigma_mm = std::round(10 * (session.sigma_mm + 0.3 * random.normal())) / 10;
  session.truth.x_mm = session.u_mount_mm * random.normal();
  session.truth.y_mm = session.u_mount_mm * random.normal();
  session.truth.yaw_rad = session.u_yaw_deg * degree * random.normal();
  for (const Wall& wall : session.walls) {
    session.truth.offset_mm.push_back(wall.u_mm * random.normal());
    session.truth.tilt_rad.push_back(wall.u_deg * degree * random.normal());
  }
  return session;
}

std::string claimed_law(const Session& s) {
  const auto said = [](double value, double u) {
    return "{\"value\": " + std::to_string(value) + ", \"u\": " + std::to_string(u) + "}";
  };
  return "{\"counts_at_1m\": " + said(s.claimed_gain, s.u_gain * s.claimed_gain) +
         ", \"range_power\": " + said(2 * s.claimed_power, 2 * s.u_power) +
         ", \"incidence_power\": " + said(s.claimed_power, s.u_power) +
         ", \"reflectance_power\": " + said(s.claimed_power, s.u_power) +
         ", \"overlap_mm\": " + said(s.claimed_overlap_mm, s.u_overlap_mm) +
         ", \"full_counts\": " + said(s.claimed_full, 0.03 * s.claimed_full) + "}";
}

}  // namespace challenge
