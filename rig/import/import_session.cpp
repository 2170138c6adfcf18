// SPDX-License-Identifier: MIT
#include "rig/import/import_session.hpp"

#include <SQLiteCpp/SQLiteCpp.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>

#include "fit/number_format.hpp"
#include "rig/errors.hpp"
#include "rig/import/plausibility.hpp"
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

/// Looks at a file's beginning: when it starts, and what its scans are like.
class FirstScan : public ImportSink {
 public:
  void scan(const ImportedScan& scan) override {
    if (found_) return;
    found_ = true;
    stamp_ns_ = std::min(stamp_ns_, scan.stamp_ns);
    geometry_ = scan.geometry;
    beams_ = scan.range_mm.size();
    frame_ = scan.frame;
  }
  void pose(std::int64_t stamp_ns, const std::string&, const std::string&,
            const fit::TrackPose& pose) override {
    poses_ = true;
    wheels_ = wheels_ || pose.wheel_left_rad;
    first_pose_ns_ = std::min(first_pose_ns_, stamp_ns);
  }
  void imu(std::int64_t, const std::string&, double, double) override {}
  void transform(const ImportedTransform&) override {}
  void property(const std::string&, const std::string&) override {}
  void note(const std::string& text) override { notes_.push_back(text); }
  bool wants_more() const override { return !found_; }

  [[nodiscard]] bool found() const { return found_; }
  [[nodiscard]] bool has_poses() const { return poses_; }
  [[nodiscard]] bool has_wheels() const { return wheels_; }
  [[nodiscard]] std::int64_t stamp_ns() const { return stamp_ns_; }
  [[nodiscard]] std::int64_t first_pose_ns() const { return first_pose_ns_; }
  [[nodiscard]] std::size_t beams() const { return beams_; }
  [[nodiscard]] const fit::ScanGeometry& geometry() const { return geometry_; }
  [[nodiscard]] const std::string& frame() const { return frame_; }
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }

 private:
  bool found_ = false, poses_ = false, wheels_ = false;
  std::int64_t stamp_ns_ = forever, first_pose_ns_ = forever;
  std::size_t beams_ = 0;
  fit::ScanGeometry geometry_;
  std::string frame_;
  std::vector<std::string> notes_;
};

/// Where `child` sits on the robot: the chain of transforms up to `wanted`, or as far as it goes.
struct Placement {
  std::string parent;
  Eigen::Isometry3d child_in_parent = Eigen::Isometry3d::Identity();
};

std::optional<Placement> placement(const std::map<std::string, ImportedTransform>& by_child,
                                   const std::string& child, const std::string& wanted) {
  Placement result;
  std::string at = child;
  for (std::size_t hops = 0; hops <= by_child.size() && at != wanted; ++hops) {
    const auto up = by_child.find(at);
    if (up == by_child.end()) break;
    const ImportedTransform& t = up->second;
    const Eigen::Quaterniond q(t.qw, t.qx, t.qy, t.qz);
    if (!(q.norm() > 0.1)) return std::nullopt;
    Eigen::Isometry3d step(q.normalized());
    step.translation() << t.x_mm, t.y_mm, t.z_mm;
    result.child_in_parent = step * result.child_in_parent;
    at = result.parent = t.parent;
  }
  if (result.parent.empty()) return std::nullopt;
  return result;
}

/// Writes what the importers read.
class SessionWriter : public ImportSink {
 public:
  SessionWriter(SessionStore& store, std::int64_t epoch_ns, const ImportRequest& request)
      : store_(store), epoch_ns_(epoch_ns), request_(request) {}

  /// Without circumstances for a file that holds no scans.
  void begin_file(const std::string& file, const std::optional<fit::CaptureInfo>& info) {
    file_ = file;
    seq_ = 0;
    plausibility_ = {};
    if (info) capture_ = store_.begin_capture(*info);
  }
  void end_file(std::optional<double> true_mm) {
    for (const auto& doubt : plausibility_.doubts(true_mm)) this->doubt(file_ + ": " + doubt);
    if (const auto hz = plausibility_.stamped_hz(); hz && timed_ == 0) stamped_hz_ = hz;
    if (capture_) {
      store_.commit_capture(*capture_);
      ++report_.captures;
    }
    capture_.reset();
  }
  /// What scans and track together cannot be.
  void end() {
    if (report_.scans == 0 || report_.poses == 0) return;
    if (first_pose_us_ > last_scan_us_ || last_pose_us_ < first_scan_us_)
      doubt("The wheels or poses (" + seconds(first_pose_us_) + " to " + seconds(last_pose_us_) +
            " s after the first scan) and the scans (until " + seconds(last_scan_us_) +
            " s) do not overlap in time: they need one clock.");
  }

  void scan(const ImportedScan& given) override {
    ImportedScan scan = given;
    if (const auto hz = request_.options.scan_hz)
      scan.geometry.scan_s =
          std::abs(scan.geometry.step_rad) * static_cast<double>(scan.range_mm.size()) / (2 * fit::pi * *hz);
    plausibility_.scan(scan);
    if (!capture_) return;  // The file has changed since it was looked at.
    fit::ScanView view;
    view.seq = seq_++;
    view.host_us = host_us(scan.stamp_ns);
    view.device_ms = view.host_us / 1000;
    view.range_mm = scan.range_mm;
    view.intensity = scan.intensity;
    view.geometry = scan.geometry;
    store_.add_scan(*capture_, view);
    first_scan_us_ = std::min(first_scan_us_, view.host_us);
    last_scan_us_ = std::max(last_scan_us_, view.host_us);
    frame_ = scan.frame;
    source_ = scan.source;
    ++report_.scans;
    most_beams_ = std::max(most_beams_, scan.range_mm.size());
    step_sum_ += scan.geometry.step_rad;
    first_sum_ += scan.geometry.first_rad;
    with_intensity_ += scan.intensity.empty() ? 0 : 1;
    const double swept_rad = std::abs(scan.geometry.step_rad) * static_cast<double>(scan.range_mm.size());
    if (scan.geometry.scan_s && *scan.geometry.scan_s > 0 && swept_rad > 0) {
      turn_s_sum_ += *scan.geometry.scan_s * 2 * fit::pi / swept_rad;
      ++timed_;
    }
  }

  void pose(std::int64_t stamp_ns, const std::string&, const std::string& frame,
            const fit::TrackPose& pose) override {
    fit::TrackPose placed = pose;
    placed.host_us = host_us(stamp_ns);
    store_.add_pose(placed);
    first_pose_us_ = std::min(first_pose_us_, placed.host_us);
    last_pose_us_ = std::max(last_pose_us_, placed.host_us);
    if (!frame.empty()) tracked_ = frame;
    ++report_.poses;
  }

  void imu(std::int64_t stamp_ns, const std::string&, double yaw_rad, double rate_rad_s) override {
    imu_.push_back({host_us(stamp_ns), yaw_rad, rate_rad_s});
  }

  void transform(const ImportedTransform& transform) override {
    if (transforms_.size() < 10'000) transforms_[transform.child] = transform;
  }

  void property(const std::string& key, const std::string& value) override { properties_[key] = value; }

  void note(const std::string& text) override {
    const std::string full = fs::path(file_).filename().string() + ": " + text;
    if (!said_.insert(full).second) return;
    report_.notes.push_back(full);
    store_.add_event(0, "warning", full);
  }

  bool wants_more() const override { return true; }

  [[nodiscard]] std::string lidar_model() const {
    const auto model = properties_.find("model");
    return model != properties_.end() ? model->second : frame_.empty() ? "imported" : frame_;
  }
  [[nodiscard]] std::int64_t epoch_ns() const { return epoch_ns_; }
  [[nodiscard]] std::size_t most_beams() const { return most_beams_; }
  [[nodiscard]] double mean_first_rad() const { return first_sum_ / scans(); }
  [[nodiscard]] double mean_step_rad() const { return step_sum_ / scans(); }
  [[nodiscard]] double scan_hz() const {
    return timed_ > 0 && turn_s_sum_ > 0 ? static_cast<double>(timed_) / turn_s_sum_
                                         : stamped_hz_.value_or(10);
  }
  [[nodiscard]] const std::string& source() const { return source_; }
  [[nodiscard]] const std::map<std::string, std::string>& properties() const { return properties_; }
  [[nodiscard]] ImportReport& report() { return report_; }

  /// The lidar on the part of the robot that odometry tracks.
  [[nodiscard]] std::optional<Placement> lidar_on_robot() const {
    return placement(transforms_, frame_, tracked_.empty() ? "base_link" : tracked_);
  }
  [[nodiscard]] json transforms() const {
    json list = json::array();
    for (const auto& [child, t] : transforms_) {
      if (!std::isfinite(t.x_mm + t.y_mm + t.z_mm + t.qw + t.qx + t.qy + t.qz)) continue;
      list.push_back({{"parent", t.parent},
                      {"child", child},
                      {"x_mm", t.x_mm},
                      {"y_mm", t.y_mm},
                      {"z_mm", t.z_mm},
                      {"quaternion_wxyz", {t.qw, t.qx, t.qy, t.qz}}});
    }
    return list;
  }
  struct Heading {
    std::int64_t host_us;
    double yaw_rad, rate_rad_s;
  };
  [[nodiscard]] const std::vector<Heading>& imu() const { return imu_; }
  [[nodiscard]] const std::string& frame() const { return frame_; }

 private:
  [[nodiscard]] std::int64_t host_us(std::int64_t stamp_ns) const { return (stamp_ns - epoch_ns_) / 1000; }
  [[nodiscard]] double scans() const {
    return static_cast<double>(std::max<std::uint64_t>(1, report_.scans));
  }
  static std::string seconds(std::int64_t us) { return fit::format_fixed(1e-6 * static_cast<double>(us), 1); }

  void doubt(const std::string& text) {
    if (!request_.accept_doubts)
      throw MeasurementError(text + " Or import it as it is with --accept-doubts.");
    note("not plausible, and imported all the same: " + text);
  }

  SessionStore& store_;
  std::int64_t epoch_ns_;
  const ImportRequest& request_;
  Plausibility plausibility_;
  std::optional<double> stamped_hz_;
  std::string file_, frame_, source_, tracked_;
  std::optional<std::int64_t> capture_;
  std::int64_t seq_ = 0, first_scan_us_ = forever, last_scan_us_ = -forever, first_pose_us_ = forever,
               last_pose_us_ = -forever;
  std::size_t most_beams_ = 0;
  double step_sum_ = 0, first_sum_ = 0, turn_s_sum_ = 0;
  std::uint64_t timed_ = 0, with_intensity_ = 0;
  std::map<std::string, ImportedTransform> transforms_;
  std::map<std::string, std::string> properties_;
  std::vector<Heading> imu_;
  std::set<std::string> said_;
  ImportReport report_;
};

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

/// Refuses files of which nothing can be made.
std::vector<FirstScan> look_at(const ImportRequest& request) {
  std::vector<FirstScan> looks;
  for (const auto& file : request.files) {
    looks.emplace_back();
    importer_for(file, request.options)->read(file, request.options, looks.back());
  }
  const bool wheels = std::ranges::any_of(looks, &FirstScan::has_wheels);
  const bool any_scans = std::ranges::any_of(looks, &FirstScan::found);
  for (std::size_t i = 0; i < looks.size(); ++i) {
    const FirstScan& look = looks[i];
    const bool joins = look.has_poses() && (any_scans || wheels) && request.options.scan_topic.empty();
    if (look.found() || joins) continue;
    std::string why;
    for (const auto& note : look.notes()) why += " " + note;
    throw MeasurementError(request.files[i] + " holds no scan, so there is nothing to import." + why +
                           " Check the recording, or name the topic with --topic.");
  }
  return looks;
}

fit::CaptureInfo capture_info(const FirstScan& look, const std::string& file, std::int64_t epoch_ns) {
  fit::CaptureInfo info;
  const fs::path path = fs::path(file).filename().empty() ? fs::path(file).parent_path() : fs::path(file);
  std::error_code ignored;
  info.step = fs::is_directory(path, ignored) ? path.filename().string() : path.stem().string();
  info.started_us = (look.stamp_ns() - epoch_ns) / 1000;
  info.first_step = 0;
  info.last_step = static_cast<int>(look.beams()) - 1;
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

/// Looks at every file before the first scan is written.
ImportReport import_into(const std::string& unfinished, const ImportRequest& request) {
  const auto looks = look_at(request);
  ImportReport report;
  std::vector<std::string> with_scans;
  std::int64_t epoch_ns = forever;
  for (std::size_t i = 0; i < looks.size(); ++i) {
    if (!looks[i].found()) continue;
    with_scans.push_back(request.files[i]);
    epoch_ns = std::min(epoch_ns, looks[i].stamp_ns());
  }
  if (with_scans.empty())
    for (const auto& look : looks) epoch_ns = std::min(epoch_ns, look.first_pose_ns());
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
    if (looks[i].found()) {
      info = capture_info(looks[i], request.files[i], epoch_ns);
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
  store->set("bench", request.bench ? *request.bench : bench_document(request, writer, distances).dump(2));
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
    throw UsageError(path +
                     " is no table that --columns could name the columns of (.csv, .tsv, .txt, .dat).");
  throw UsageError(path + " is of a format that rig does not read. It reads: " + known + ".");
}

ImportReport import_session(const ImportRequest& request) {
  ImportReport report;
  make_session(request.output,
               [&](const std::string& unfinished) { report = import_into(unfinished, request); });
  return report;
}

}  // namespace rig
