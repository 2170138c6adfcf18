// SPDX-License-Identifier: MIT
#include "rig/import/import_session.hpp"

#include <SQLiteCpp/SQLiteCpp.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>

#include "fit/numeric/number_format.hpp"
#include "rig/errors.hpp"
#include "rig/import/first_scan.hpp"
#include "rig/import/session_writer.hpp"
#include "rig/session/new_session.hpp"
#include "rig/session/session_store.hpp"
#include "rig/session/utc.hpp"

namespace rig {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::int64_t forever = std::numeric_limits<std::int64_t>::max();
constexpr std::int64_t first_plausible_s = 631'152'000;  // 1990: no recording is older.

double tidy_degrees(double rad) { return std::round(rad * fit::deg_per_rad * 1e6) / 1e6; }

/// Of the files that hold scans.
std::vector<double> true_distances(const ImportRequest& request, const std::vector<std::string>& files,
                                   ImportReport& report) {
  if (!request.true_mm.empty()) {
    if (request.true_mm.size() != files.size())
      throw UsageError("--true-mm names " + std::to_string(request.true_mm.size()) + " distances for " +
                       std::to_string(files.size()) + " files. Give one for each, in the same order.");
    return request.true_mm;
  }
  std::vector<double> guessed;
  for (const auto& file : files) {
    const auto distance = distance_in_name(file);
    if (!distance) return {};
    guessed.push_back(*distance);
  }
  if (guessed.empty()) return guessed;
  std::string list;
  for (const double mm : guessed) list += (list.empty() ? "" : ", ") + fit::format_value(mm, 0);
  report.notes.push_back("True distances were taken from the file names: " + list + " mm, each ± " +
                         fit::format_value(2 * request.true_u_mm, 0) +
                         " mm (k = 2). Give --true-mm and --true-u-mm if that is wrong.");
  return guessed;
}

json bench_document(const ImportRequest& request, const SessionWriter& written,
                    const std::vector<double>& distances) {
  if (written.most_beams() == 0) return {{"schema", "bench/1"}};  // wheels and poses alone
  json mount{{"x_mm", {{"value", 0}, {"u", 3}}},
             {"y_mm", {{"value", 0}, {"u", 3}}},
             {"yaw_deg", {{"value", 0}, {"u", 2}}}};
  if (const auto place = written.lidar_on_robot()) {
    const auto& t = place->child_in_parent;
    mount["x_mm"]["value"] = std::round(t.translation().x() * 1000) / 1000;
    mount["y_mm"]["value"] = std::round(t.translation().y() * 1000) / 1000;
    mount["yaw_deg"]["value"] = tidy_degrees(std::atan2(t.linear()(1, 0), t.linear()(0, 0)));
  }
  const double step = written.mean_step_rad();
  json bench{{"schema", "bench/1"},
             {"lidar",
              {{"model", written.lidar_model()},
               {"steps", written.most_beams()},
               {"front_step", std::max(0, static_cast<int>(std::lround(-written.mean_first_rad() / step)))},
               {"step_deg", std::abs(tidy_degrees(step))},
               {"scan_hz", std::round(written.scan_hz() * 1000) / 1000},
               {"mount", mount}}},
             {"targets", json::array()},
             {"known", json::array()}};
  if (!distances.empty()) {
    const double d = distances.front(), half = request.target_width_mm / 2;
    bench["targets"].push_back({{"name", request.target},
                                {"from_mm", {d, -half}},
                                {"to_mm", {d, half}},
                                {"u_mm", request.true_u_mm},
                                {"u_deg", 2.0},
                                {"placed_anew", true}});
    // The operator's distance is from the lidar, whatever carries it: the frame of such a session is the
    // lidar's.
    for (const char* axis : {"x_mm", "y_mm"}) bench["lidar"]["mount"][axis] = {{"value", 0}, {"u", 0}};
  }
  return bench;
}

/// How far a target of a given bench must move to stand at `true_mm` from the axis.
double shift_of(const fit::Bench& bench, const std::string& name, double true_mm) {
  const fit::Target* target = bench.target(name);
  if (!target)
    throw UsageError("The bench has no target named " + name + ". Choose one of its targets with --target.");
  return true_mm - target->outward_normal().dot(target->from_mm);
}

void write_imu(const std::string& path, const SessionWriter& written) {
  if (written.imu().empty()) return;
  SQLite::Database database(path, SQLite::OPEN_READWRITE, 5000);
  SQLite::Transaction transaction(database);
  database.exec("CREATE TABLE imu(host_us INTEGER NOT NULL, yaw_deg REAL, rate_deg_s REAL)");
  SQLite::Statement insert(database, "INSERT INTO imu VALUES(?, ?, ?)");
  for (const auto& heading : written.imu()) {
    insert.reset();
    insert.bind(1, heading.host_us);
    insert.bind(2, heading.yaw_rad * fit::deg_per_rad);
    insert.bind(3, heading.rate_rad_s * fit::deg_per_rad);
    insert.exec();
  }
  transaction.commit();
}

bool same_bytes(const fs::path& a, const fs::path& b) {
  std::error_code ignored;
  if (fs::file_size(a, ignored) != fs::file_size(b, ignored)) return false;
  std::ifstream first(a, std::ios::binary), second(b, std::ios::binary);
  return first && second &&
         std::equal(std::istreambuf_iterator<char>(first), {}, std::istreambuf_iterator<char>(second), {});
}

/// Files or folders (bags) that are one, or copies of one another.
bool same_recording(const fs::path& a, const fs::path& b) {
  std::error_code ignored;
  if (fs::equivalent(a, b, ignored)) return true;
  if (fs::is_regular_file(a, ignored) && fs::is_regular_file(b, ignored)) return same_bytes(a, b);
  if (!fs::is_directory(a, ignored) || !fs::is_directory(b, ignored)) return false;
  std::size_t files = 0;
  for (const auto& entry : fs::directory_iterator(a, ignored)) {
    const fs::path other = b / entry.path().filename();
    if (!fs::is_regular_file(entry.path(), ignored)) continue;
    if (!fs::is_regular_file(other, ignored) || !same_bytes(entry.path(), other)) return false;
    ++files;
  }
  return files > 0;
}

/// The same evidence given twice would count twice.
void refuse_copies(const std::vector<std::string>& files) {
  for (std::size_t i = 0; i < files.size(); ++i)
    for (std::size_t k = 0; k < i; ++k)
      if (same_recording(files[k], files[i]))
        throw UsageError(files[i] + " is the same recording as " + files[k] +
                         (files[i] == files[k] ? "" : ", byte for byte") +
                         ", so its evidence would count twice. Give every recording once.");
}

/// Refuses files of which nothing can be made.
std::vector<FirstScan> preview(const ImportRequest& request) {
  std::vector<FirstScan> previews;
  std::vector<bool> tables;
  for (const auto& file : request.files) {
    previews.emplace_back();
    const auto importer = importer_for(file, request.options);
    tables.push_back(importer->takes_columns());
    importer->read(file, request.options, previews.back());
  }
  const bool wheels = std::ranges::any_of(previews, &FirstScan::has_wheels);
  const bool any_scans = std::ranges::any_of(previews, &FirstScan::found);
  for (std::size_t i = 0; i < previews.size(); ++i) {
    const FirstScan& preview = previews[i];
    const bool joins = preview.has_poses() && (any_scans || wheels) && request.options.scan_topic.empty();
    if (preview.found() || joins) continue;
    std::string why;
    for (const auto& note : preview.notes()) why += " " + note;
    if (preview.has_poses() && request.options.scan_topic.empty())
      throw MeasurementError(request.files[i] +
                             " holds poses and no scan, so there is nothing to import alone." + why +
                             " Give the file with the scans too.");
    throw MeasurementError(request.files[i] + " holds no scan, so there is nothing to import." + why +
                           (!tables[i] ? " Check the recording, or name the topic with --topic."
                            : why.find("--columns") != why.npos
                                ? ""
                                : " Check its rows, and the names of its columns (--columns)."));
  }
  return previews;
}

fit::CaptureInfo capture_info(const FirstScan& preview, const std::string& file, std::int64_t epoch_ns) {
  fit::CaptureInfo info;
  const fs::path path = fs::path(file).filename().empty() ? fs::path(file).parent_path() : fs::path(file);
  std::error_code ignored;
  info.step = fs::is_directory(path, ignored) ? path.filename().string() : path.stem().string();
  info.started_us = (preview.stamp_ns() - epoch_ns) / 1000;
  info.first_step = 0;
  info.last_step = static_cast<int>(preview.beams()) - 1;
  return info;
}

/// The date that a recording's first stamp tells; none for clocks that count from some other moment (a
/// simulation's, a lidar's own).
std::optional<std::string> utc_of(std::int64_t stamp_ns) {
  const std::int64_t seconds = stamp_ns / 1'000'000'000, now = std::time(nullptr);
  if (seconds < first_plausible_s || seconds > now + 86'400) return std::nullopt;
  return utc_text(seconds);
}

void write_keys(SessionStore& store, const ImportRequest& request, const SessionWriter& written) {
  json files = json::array();
  for (const auto& file : request.files) files.push_back(fs::path(file).filename().string());
  store.set("kind", "import");
  store.set("import", json{{"files", files}, {"scans", written.source()}}.dump());
  store.set("procedure", "import");
  json lidar = json::object();
  for (const auto& [key, value] : written.properties())
    if (key == "recorded_local")
      store.set(key, value);
    else
      lidar[key] = value;
  store.set("lidar", lidar.dump());
  if (const auto recorded = utc_of(written.epoch_ns())) store.set("recorded_utc", *recorded);
  if (const json transforms = written.transforms(); !transforms.empty())
    store.set("transforms", transforms.dump());
  if (const auto place = written.lidar_on_robot()) {
    const auto& t = place->child_in_parent;
    store.set("lidar_on_robot",
              json{{"frame", written.frame()},
                   {"parent", place->parent},
                   {"x_mm", t.translation().x()},
                   {"y_mm", t.translation().y()},
                   {"yaw_deg", tidy_degrees(std::atan2(t.linear()(1, 0), t.linear()(0, 0)))}}
                  .dump());
  }
}

/// A session whose bench does not read would be refused by every command.
void refuse_unreadable(const std::string& bench) {
  try {
    (void)fit::parse_bench(bench);
  } catch (const std::invalid_argument& error) {
    throw MeasurementError(std::string("The recording makes a bench that cannot be: ") + error.what() +
                           ". Check the units of times and angles (--columns), --scan-hz, --step-deg and "
                           "--true-mm.");
  }
}

/// Looks at every file before the first scan is written.
ImportReport import_into(const std::string& unfinished, const ImportRequest& request) {
  refuse_copies(request.files);
  const auto previews = preview(request);
  ImportReport report;
  std::vector<std::string> with_scans;
  std::int64_t epoch_ns = forever;
  for (std::size_t i = 0; i < previews.size(); ++i) {
    if (!previews[i].found()) continue;
    with_scans.push_back(request.files[i]);
    epoch_ns = std::min(epoch_ns, previews[i].stamp_ns());
  }
  if (with_scans.empty())
    for (const auto& preview : previews) epoch_ns = std::min(epoch_ns, preview.first_pose_ns());
  const auto distances = true_distances(request, with_scans, report);
  std::optional<fit::Bench> bench;
  if (request.bench) bench = fit::parse_bench(*request.bench);

  auto store = std::make_unique<SessionStore>(unfinished, SessionStore::Mode::create);
  SessionWriter writer(*store, epoch_ns, request);
  writer.report() = report;
  std::size_t scan_file = 0;
  for (std::size_t i = 0; i < request.files.size(); ++i) {
    std::optional<fit::CaptureInfo> info;
    std::optional<double> true_mm;
    if (previews[i].found()) {
      info = capture_info(previews[i], request.files[i], epoch_ns);
      if (!distances.empty()) {
        const double distance = distances[scan_file];
        if (!bench) true_mm = distance;
        info->target = request.target;
        info->target_shift_mm = bench ? shift_of(*bench, request.target, distance) : distance - distances[0];
      }
      ++scan_file;
    }
    writer.begin_file(request.files[i], info);
    importer_for(request.files[i], request.options)->read(request.files[i], request.options, writer);
    writer.end_file(true_mm);
  }
  writer.end();
  if (with_scans.empty()) writer.note("It holds no scans: wheels and poses alone were imported.");
  const std::string bench_text =
      request.bench ? *request.bench : bench_document(request, writer, distances).dump(2);
  refuse_unreadable(bench_text);
  store->set("bench", bench_text);
  write_keys(*store, request, writer);
  store->finish();
  store.reset();
  write_imu(unfinished, writer);
  return writer.report();
}

}  // namespace

std::optional<double> distance_in_name(const std::string& path) {
  static const std::regex pattern(R"((?:^|[^A-Za-z0-9.])([0-9]+(?:\.[0-9]+)?) ?(mm|cm|m)(?![A-Za-z0-9]))");
  fs::path at(path);
  if (at.filename().empty()) at = at.parent_path();
  for (int level = 0; level < 2 && !at.empty(); ++level, at = at.parent_path()) {
    const std::string name = at.filename().string();
    std::smatch match;
    if (!std::regex_search(name, match, pattern)) continue;
    const double scale = match[2] == "mm" ? 1 : match[2] == "cm" ? 10 : 1000;
    const double mm = std::stod(match[1]) * scale;
    if (mm > 0 && mm < 65536) return mm;
  }
  return std::nullopt;
}

namespace {

/// Files that other commands read, and old formats: what to do with them instead.
std::string other_use(const std::string& path, std::span<const std::uint8_t> first) {
  const std::string_view text(reinterpret_cast<const char*>(first.data()), first.size());
  if (text.find("\"sm\"") != text.npos && text.find("\"phi_l\"") != text.npos)
    return " holds wheel speeds and scan matches: `rig fit odometry " + path + "` reads it as it is.";
  if (text.find("\"correction/1\"") != text.npos)
    return " is a range correction: `rig apply " + path + " SESSION -o SESSION` uses it.";
  if (text.find("\"bench/1\"") != text.npos) return " is a bench file: give it with --bench.";
  if (path.ends_with(".rig") && text.starts_with("SQLite format 3"))
    return " is a session already: `rig fit`, `rig deskew` and `rig explain` read it as it is.";
  // Of letters and digits UTF-16 has every other byte zero, its byte order mark apart.
  const bool pairs =
      text.size() > 3 && std::isprint(first[0]) && !first[1] && std::isprint(first[2]) && !first[3];
  if (text.starts_with("\xFF\xFE") || text.starts_with("\xFE\xFF") || pairs)
    return std::string(" is text in the encoding UTF-16: convert it to UTF-8 first (iconv -f ") +
           (pairs ? "UTF-16LE" : "UTF-16") + " -t UTF-8 FILE > NEW.csv, or save it as CSV in UTF-8).";
  if (text.starts_with("\x1f\x8b") || path.ends_with(".gz") || path.ends_with(".zip"))
    return " is compressed: unpack it first (gunzip, unzip).";
  return "";
}

std::vector<std::uint8_t> beginning_of(const std::string& path) {
  std::vector<std::uint8_t> first;
  std::error_code ignored;
  if (!fs::exists(path, ignored)) throw UsageError(path + ": no such file or folder. Check the name.");
  if (fs::is_directory(path, ignored)) return first;
  std::ifstream in(path, std::ios::binary);
  if (!in) throw UsageError(path + " cannot be opened. Check the permissions.");
  first.resize(4096);
  in.read(reinterpret_cast<char*>(first.data()), static_cast<std::streamsize>(first.size()));
  first.resize(static_cast<std::size_t>(in.gcount()));
  if (first.empty())
    throw UsageError(path + " is empty: nothing was recorded or copied. Record or copy it again.");
  return first;
}

}  // namespace

std::unique_ptr<Importer> importer_for(const std::string& path, const ImportOptions& options) {
  const auto first = beginning_of(path);
  if (const std::string use = other_use(path, first); !use.empty()) throw UsageError(path + use);
  std::string known;
  for (auto& importer : importers::all()) {
    if (importer->recognises(path, first) && (options.columns.empty() || importer->takes_columns()))
      return std::move(importer);
    known += (known.empty() ? "" : "; ") + importer->name();
  }
  if (!options.columns.empty())
    throw UsageError(path + " is not a table (.csv, .tsv, .txt, .dat), so --columns does not apply.");
  throw UsageError(path + " is of a format that rig does not read. It reads: " + known + ".");
}

ImportReport import_session(const ImportRequest& request) {
  ImportReport report;
  make_session(request.output,
               [&](const std::string& unfinished) { report = import_into(unfinished, request); });
  return report;
}

}  // namespace rig
