// SPDX-License-Identifier: MIT
// Makes a session in which some physics is concealed from the bench file it carries, and a separate file with
// the truth. Two programs are built from it: rig-conceal, whose effects are written in causes*.cpp and which
// links nothing of rig/, sim/ and fit/, and rig-conceal-world, which records the causal engine of sim/.
#include <SQLiteCpp/SQLiteCpp.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "concealed.hpp"
#include "oracle.hpp"
#include "world.hpp"

namespace {

using namespace challenge;
using nlohmann::ordered_json;

ordered_json doubtful(double value, double u) { return {{"value", value}, {"u", u}}; }

ordered_json bench_of(const Session& session) {
  ordered_json targets = ordered_json::array();
  for (const Wall& wall : session.walls) {
    targets.push_back({{"name", wall.name},
                       {"from_mm", {wall.from.x(), wall.from.y()}},
                       {"to_mm", {wall.to.x(), wall.to.y()}},
                       {"u_mm", wall.u_mm},
                       {"u_deg", wall.u_deg},
                       {"reflectance", wall.reflectance}});
  }
  ordered_json known = {
      {{"mechanism", "range-noise"},
       {"parameters", {{"sigma_mm", doubtful(session.stated_sigma_mm, session.u_sigma_mm)}}}}};
  if (session.claims_intensity)
    known.push_back({{"mechanism", "radiometry"}, {"parameters", ordered_json::parse(claimed_law(session))}});
  return {{"schema", "bench/1"},
          {"lidar",
           {{"model", "UST-10LX"},
            {"steps", session.steps},
            {"front_step", session.front_step},
            {"step_deg", session.step_deg},
            {"scan_hz", session.scan_hz},
            {"mount",
             {{"x_mm", doubtful(0, session.u_mount_mm)},
              {"y_mm", doubtful(0, session.u_mount_mm)},
              {"yaw_deg", doubtful(0, session.u_yaw_deg)}}}}},
          {"stage", {{"resolution_deg", 0.01}}},
          {"targets", targets},
          {"known", known}};
}

const char* const schema = R"(
PRAGMA application_id = 0x52494731;
PRAGMA user_version = 1;
CREATE TABLE session(key TEXT PRIMARY KEY, value TEXT);
CREATE TABLE capture(id INTEGER PRIMARY KEY, step TEXT, started_us INTEGER NOT NULL, stage_deg REAL NOT NULL,
  stage_readback_deg REAL, approach INTEGER NOT NULL, target TEXT, target_shift_mm REAL NOT NULL DEFAULT 0,
  reflectance REAL, temperature_c REAL, since_power_on_s REAL, stage_rate_deg_s REAL NOT NULL DEFAULT 0,
  first_step INTEGER NOT NULL, last_step INTEGER NOT NULL, cluster INTEGER NOT NULL DEFAULT 1);
CREATE TABLE scan(capture INTEGER NOT NULL REFERENCES capture(id), seq INTEGER NOT NULL,
  device_ms INTEGER NOT NULL, host_us INTEGER NOT NULL, range_mm BLOB NOT NULL, intensity BLOB,
  PRIMARY KEY(capture, seq)) WITHOUT ROWID;
CREATE TABLE pose(host_us INTEGER NOT NULL, x_mm REAL, y_mm REAL, heading_deg REAL,
  wheel_left_rad REAL, wheel_right_rad REAL, stage_deg REAL);
CREATE TABLE result(kind TEXT, created_utc TEXT, json TEXT);
CREATE TABLE event(host_us INTEGER, level TEXT, text TEXT);
)";

void write_captures(SQLite::Database& database, const Session& session) {
  SQLite::Statement insert(database, "INSERT INTO capture VALUES(?,?,?,?,?,?,?,?,?,?,?,?,?,?,1)");
  const double start = session.captures.front().since_power_on_s;
  for (std::size_t i = 0; i < session.captures.size(); ++i) {
    const Capture& capture = session.captures[i];
    insert.reset();
    insert.clearBindings();
    insert.bind(1, static_cast<std::int64_t>(i + 1));
    insert.bind(2, session.scene);
    insert.bind(3, static_cast<std::int64_t>(std::llround((capture.since_power_on_s - start) * 1e6)));
    insert.bind(4, capture.stage_deg);
    insert.bind(5, capture.stage_deg);
    insert.bind(6, capture.approach);
    if (capture.target >= 0) insert.bind(7, session.walls[static_cast<std::size_t>(capture.target)].name);
    insert.bind(8, capture.shift_mm);
    if (capture.reflectance >= 0) insert.bind(9, capture.reflectance);
    insert.bind(10, capture.temperature_c);
    insert.bind(11, capture.since_power_on_s);
    insert.bind(12, capture.rate_deg_s);
    insert.bind(13, capture.first_step);
    insert.bind(14, capture.last_step);
    insert.exec();
  }
}

void write_scans(SQLite::Database& database, const Session& session, const Causes& causes, Random& random) {
  const auto recorder = make_recorder(session, causes);
  SQLite::Statement insert(database, "INSERT INTO scan VALUES(?,?,?,?,?,?)");
  const double start = session.captures.front().since_power_on_s;
  std::vector<std::uint16_t> range, intensity;
  for (std::size_t i = 0; i < session.captures.size(); ++i) {
    const Capture& capture = session.captures[i];
    for (int seq = 0; seq < capture.scans; ++seq) {
      recorder->scan(i, seq, random, range, intensity);
      const double seconds = seq / session.scan_hz + capture.first_scan_s;
      insert.reset();
      insert.bind(1, static_cast<std::int64_t>(i + 1));
      insert.bind(2, seq);
      insert.bind(3, static_cast<std::int64_t>(std::llround((capture.since_power_on_s + seconds) * 1e3)));
      insert.bind(
          4, static_cast<std::int64_t>(std::llround((capture.since_power_on_s - start + seconds) * 1e6)));
      insert.bind(5, range.data(), static_cast<int>(2 * range.size()));
      insert.bind(6, intensity.data(), static_cast<int>(2 * intensity.size()));
      insert.exec();
    }
  }
}

void write_session(const std::filesystem::path& path, const Session& session, const Causes& causes,
                   Random& random) {
  std::filesystem::remove(path);
  SQLite::Database database(path.string(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
  database.exec("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF;");
  database.exec(schema);
  SQLite::Transaction transaction(database);
  const std::map<std::string, std::string> about{
      {"bench", bench_of(session).dump()},
      {"procedure", "concealed"},
      {"lidar", R"({"MODL": "UST-10LX", "ARES": 1440, "AMIN": 0, "AMAX": 1080, "AFRT": 540, "SCAN": 2400})"},
      {"stage", "{}"},
      {"created_utc", "2026-01-01T00:00:00Z"},
      {"software", "rig-conceal"},
      {"kind", session.scene}};
  SQLite::Statement insert(database, "INSERT INTO session VALUES(?,?)");
  for (const auto& [key, value] : about) {
    insert.reset();
    insert.bind(1, key);
    insert.bind(2, value);
    insert.exec();
  }
  write_captures(database, session);
  write_scans(database, session, causes, random);
  transaction.commit();
}

/// Catalogue mechanisms that, whatever their size and with some shape, would leave less than SNR 3 of the
/// concealed effect: the session cannot tell them from the truth.
std::vector<std::string> alternatives_to(const Session& session, const std::shared_ptr<Cause>& cause) {
  const Oracle oracle(session, {cause}, 6000);
  std::vector<std::string> names;
  std::vector<Causes> rivals;
  Random shapes(4711);
  Session scratch = session;
  for (const auto& [id, in] : cause_scenes()) {
    if (id == cause->id || id.starts_with("unknown-") || id == "motion-skew") continue;
    if (id == "time-quantisation" || id == "mixed-pixel" || id == "crosstalk") continue;
    for (int draw = 0; draw < 12; ++draw) {
      auto rival = make_cause(id);
      rival->draw(scratch, shapes);
      rival->strength = 0.3;
      rival->build(scratch);
      rivals.push_back({rival});
      names.push_back(id);
    }
  }
  std::vector<std::string> found;
  const std::vector<double> left = oracle.left_by({cause}, rivals);
  for (std::size_t i = 0; i < left.size(); ++i) {
    if (left[i] < 3 && !std::ranges::count(found, names[i])) found.push_back(names[i]);
  }
  return found;
}

struct Wanted {
  std::vector<std::string> kinds;
  std::string scene;
  double snr = 12;
  std::uint64_t seed = 1;
  std::filesystem::path out = ".";
  std::string name;
  bool rivals = true, claim = false;
};

std::string scene_for(const Wanted& wanted, Random& random) {
  if (!wanted.scene.empty()) return wanted.scene;
  if (wanted.kinds.empty()) {
    return random.pick(std::vector<std::string>{"room", "ladder", "edge", "turning", "warmup", "boards",
                                                "settle", "two-sided", "reflectance-ladder", "heat-cycle"});
  }
  std::vector<std::string> common;
  for (std::size_t i = 0; i < wanted.kinds.size(); ++i) {
    for (const auto& [id, in] : concealed_scenes()) {
      if (id != wanted.kinds[i]) continue;
      if (i == 0) common = in;
      std::erase_if(common, [&](const std::string& s) { return !std::ranges::count(in, s); });
    }
  }
  if (common.empty()) throw std::invalid_argument("no scene shows all of these kinds; name one with --scene");
  return random.pick(common);
}

void conceal(const Wanted& wanted) {
  for (const std::string& kind : wanted.kinds) make_concealed(kind);  // unknown names are refused first
  Random random(wanted.seed);
  Session session = make_scene(scene_for(wanted, random), random);
  prepare(session);
  session.claims_intensity = wanted.claim;
  for (const std::string& kind : wanted.kinds)
    if (make_concealed(kind)->shows_in_intensity()) session.claims_intensity = true;
  if (session.claims_intensity) draw_claim(session, random);
  Causes causes;
  ordered_json snr = ordered_json::object(), parameters = ordered_json::object();
  ordered_json located = ordered_json::array(), rivals = ordered_json::object();
  ordered_json free_snr = ordered_json::object(), given = ordered_json::object();
  bool outside = false;
  std::set<std::string> also;
  for (const std::string& kind : wanted.kinds) {
    auto cause = make_concealed(kind);
    cause->draw(session, random);
    calibrate(cause, session, wanted.snr);
    causes.push_back(cause);
  }
  // What is concealed besides changes how an effect shows: each is as strong as wanted beside the other.
  for (int round = 0; causes.size() == 2 && round < 2; ++round)
    for (const std::size_t i : {0, 1})
      if (causes[i]->stand_beside(session, *causes[1 - i])) calibrate(causes[i], session, wanted.snr);
  for (const auto& cause : causes) {
    const std::string& kind = cause->id;
    const Oracle oracle(session, {cause});
    const Oracle::Verdict verdict = oracle.judge({cause});
    snr[kind] = verdict.snr;
    free_snr[kind] =
        std::sqrt(std::max(0.0, verdict.snr * verdict.snr - verdict.mean)) + verdict.snr_with_free_nuisances;
    for (const auto& [from, to] : oracle.located(verdict, *cause)) {
      located.push_back({{"mechanism", kind},
                         {"coordinate", cause->coordinate},
                         {"observable", cause->observable},
                         {"from", from},
                         {"to", to}});
    }
    const bool shifts_means = verdict.mean > 0.5 * verdict.snr * verdict.snr;
    rivals[kind] =
        wanted.rivals && shifts_means ? alternatives_to(session, cause) : std::vector<std::string>{};
    parameters[kind] = cause->parameters();
    for (const std::string& other : cause->also_makes()) also.insert(other);
    outside = outside || kind.starts_with("unknown-");
  }
  if (causes.size() == 2) {
    const Oracle oracle(session, causes);
    given[causes[0]->id] = oracle.left_by({causes[0]}, {{causes[1]}}).front();
    given[causes[1]->id] = oracle.left_by({causes[1]}, {{causes[0]}}).front();
  }
  const Oracle::Verdict all = Oracle(session, causes).judge(causes);
  std::string name = wanted.name;
  if (name.empty()) {
    for (const std::string& kind : wanted.kinds) name += (name.empty() ? "" : "+") + kind;
    if (name.empty()) name = "nothing";
    name += "-" + session.scene + "-" + std::to_string(wanted.seed);
  }
  std::filesystem::create_directories(wanted.out);
  write_session(wanted.out / (name + ".rig"), session, causes, random);
  std::vector<double> tilt_deg;
  for (const double tilt : session.truth.tilt_rad) tilt_deg.push_back(tilt / degree);
  const ordered_json truth{{"kinds", wanted.kinds},
                           {"scene", session.scene},
                           {"seed", wanted.seed},
                           {"also_made", also},
                           {"outside_catalogue", outside},
                           {"snr", snr},
                           {"snr_with_free_nuisances", free_snr},
                           {"snr_given_the_other", given},
                           {"cannot_be_told_from", rivals},
                           {"parameters", parameters},
                           {"located", located},
                           {"oracle",
                            {{"rms_before_mm", all.rms_before_mm},
                             {"rms_floor_mm", all.rms_floor_mm},
                             {"log_likelihood_gain", all.log_likelihood_gain}}},
                           {"nuisance",
                            {{"x_mm", session.truth.x_mm},
                             {"y_mm", session.truth.y_mm},
                             {"yaw_deg", session.truth.yaw_rad / degree},
                             {"offset_mm", session.truth.offset_mm},
                             {"tilt_deg", tilt_deg},
                             {"sigma_mm", session.sigma_mm}}}};
  if (const std::string world = world_file(session, causes); !world.empty())
    std::ofstream(wanted.out / (name + ".world.json")) << world << '\n';
  std::ofstream(wanted.out / (name + ".truth.json")) << truth.dump(1) << '\n';
  std::cout << ordered_json{{"session", (wanted.out / (name + ".rig")).string()}, {"snr", snr}}.dump()
            << '\n';
}

void list() {
  std::cout << "kinds and the scenes that show them:\n";
  for (const auto& [id, in] : concealed_scenes()) {
    std::cout << "  " << id << ":";
    for (const std::string& scene : in) std::cout << ' ' << scene;
    std::cout << '\n';
  }
  std::cout << "scenes:";
  for (const std::string& scene : scenes()) std::cout << ' ' << scene;
  std::cout << '\n';
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Makes sessions with concealed physics, and the truth beside them"};
  Wanted wanted;
  bool only_list = false;
  app.add_option("--kind", wanted.kinds,
                 "concealed mechanisms, separated by commas; none: nothing is concealed")
      ->delimiter(',');
  app.add_option("--scene", wanted.scene, "scene; default: one that shows the kinds");
  app.add_option("--snr", wanted.snr, "signal-to-noise at which an oracle sees each")
      ->check(CLI::PositiveNumber);
  app.add_option("--seed", wanted.seed, "of everything that is drawn");
  app.add_option("--out", wanted.out, "folder for NAME.rig and NAME.truth.json");
  app.add_option("--name", wanted.name, "name of the case; default: kinds, scene and seed");
  app.add_flag("--radiometry", wanted.claim, "the bench states its law of intensity, truthfully");
  app.add_flag("!--no-rivals", wanted.rivals, "do not look for mechanisms that could not be told apart");
  app.add_flag("--list", only_list, "list kinds and scenes");
  CLI11_PARSE(app, argc, argv);
  if (wanted.kinds.size() == 1 && (wanted.kinds[0].empty() || wanted.kinds[0] == "nothing"))
    wanted.kinds.clear();
  try {
    if (only_list) {
      list();
    } else {
      conceal(wanted);
    }
    return 0;
  } catch (const std::invalid_argument& problem) {
    std::cerr << "rig-conceal: " << problem.what() << '\n';
    return 2;
  } catch (const std::exception& problem) {
    std::cerr << "rig-conceal: " << problem.what() << ". Nothing was written.\n";
    return 1;
  }
}
