// SPDX-License-Identifier: MIT
#include "rig/runner/bench_check.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "fit/numeric/median.hpp"
#include "rig/procedure/procedure_plan.hpp"
#include "rig/runner/bench_doubts.hpp"
#include "rig/runner/lidar_doubts.hpp"
#include "rig/runner/scan_gate.hpp"
#include "rig/runner/target_detection.hpp"

namespace rig {
namespace {

using boost::asio::awaitable;
using Verdict = CheckLine::Verdict;

constexpr int scans_of_rate = 40, scans_of_medians = 20;
constexpr double stage_tolerance_deg = 0.02;
constexpr double weak_intensity = 200;
constexpr double least_share_of_noise = 0.1;  // of the stated one; less is no lidar of that kind
constexpr double longest_hold_up_ms = 300;    // of a scan, by a network or a computer that is busy

std::string rounded(double value, int digits = 0) { return rounded_text(value, digits); }

class Checker {
 public:
  Checker(const fit::Bench& bench, LidarSource& lidar, Stage& stage, RunClock& clock,
          std::function<void(const CheckLine&)> report)
      : bench_(bench),
        lidar_(lidar),
        stage_(stage),
        clock_(clock),
        report_(std::move(report)),
        limits_(stage_limits(bench)) {}

  awaitable<std::vector<CheckLine>> run(bool stay_still) {
    for (const std::string& doubt : doubts_about(bench_))
      say(Verdict::bad, "bench file", doubt,
          "Correct it. If it is right, confirm it when a run asks; a run with --yes refuses it.");
    const bool beams_fit = co_await greet();
    if (beams_fit) {
      co_await check_rate();
    }
    co_await check_stage(stay_still);
    if (!beams_fit) {
      say(Verdict::note, "scans", "not checked: the bench file's beams are not this lidar's",
          "Correct what is marked BAD, then check again.");
      co_return lines_;
    }
    const BeamMedians seen = co_await measure_beams();
    check_echoes(seen);
    check_noise();
    for (const fit::Target& target : bench_.targets) {
      co_await check_target(target, stay_still);
    }
    if (!stay_still) {
      co_await stage_.move_to(rest_deg());
    }
    co_return lines_;
  }

 private:
  void say(Verdict verdict, const std::string& what, const std::string& says,
           const std::string& remedy = "") {
    lines_.emplace_back(verdict, what, says, remedy);
    report_(lines_.back());
  }

  /// Whether the lidar has the beams that the bench file gives it.
  awaitable<bool> greet() {
    const nlohmann::json identity = co_await lidar_.connect();
    const std::string text = identity.dump();
    const std::vector<LidarDoubt> doubts = doubts_of_lidar(identity, bench_);
    const auto of_health = [](const LidarDoubt& doubt) { return doubt.what == lidar_state; };
    const bool is_well = std::ranges::none_of(doubts, of_health);
    say(is_well ? Verdict::good : Verdict::note, "lidar", text.size() > 160 ? describe(identity) : text,
        "See below.");
    for (const LidarDoubt& doubt : doubts)
      say(doubt.weight == LidarDoubt::Weight::note ? Verdict::note : Verdict::bad, doubt.what, doubt.says,
          doubt.remedy);
    if (std::ranges::all_of(doubts, of_health))
      say(Verdict::good, "lidar as stated",
          "model, serial number, steps and front as far as it reports them");
    co_return std::ranges::none_of(
        doubts, [](const LidarDoubt& doubt) { return doubt.weight == LidarDoubt::Weight::refusal; });
  }

  static std::string describe(const nlohmann::json& identity) {
    const auto stated = [&](const char* key) -> std::string {
      for (const auto& [part, values] : identity.items())
        if (values.is_object() && values.contains(key) && values[key].is_string())
          return values[key].get<std::string>();
      return "";
    };
    std::string text;
    for (const auto& [key, before] : {std::pair{"PROD", ""},
                                      {"SERI", "serial "},
                                      {"FIRM", "firmware "},
                                      {"STAT", ""},
                                      {"LASR", "laser "}})
      if (const std::string word = stated(key); !word.empty())
        text += (text.empty() ? "" : ", ") + (before + word);
    return text.empty() ? "answers in SCIP" : text;
  }

  static bool are_alike(const std::vector<double>& gaps_ms) {
    const double usual_ms = fit::median_or_nan(gaps_ms);
    const auto alike = std::ranges::count_if(
        gaps_ms, [&](double gap_ms) { return std::abs(gap_ms - usual_ms) <= 0.1 * usual_ms + 1; });
    return 10 * static_cast<std::size_t>(alike) >= 9 * gaps_ms.size();
  }

  awaitable<void> check_rate() {
    co_await lidar_.start(whole_scan(bench_.lidar));
    const std::uint64_t lost_before = lidar_.lost();
    double stamps_ms = 0, passed_ms = 0;
    std::vector<double> gaps_ms;
    std::uint64_t before_ms = 0;
    for (int i = 0; i < scans_of_rate; ++i) {
      const lidar::Scan scan = co_await lidar_.next();
      if (i > 0) gaps_ms.push_back(static_cast<double>(scan.device_ms) - static_cast<double>(before_ms));
      before_ms = scan.device_ms;
      const double sign = i == 0 ? -1 : i == scans_of_rate - 1 ? 1 : 0;
      stamps_ms += sign * static_cast<double>(scan.device_ms);
      passed_ms += sign * static_cast<double>(clock_.host_us()) / 1000;
    }
    co_await lidar_.stop();
    const std::uint64_t counted = lidar_.lost() - lost_before;
    // Scans are counted as lost by the period that the lidar states. A network loses some now and then; where
    // every gap is alike and longer than stated, that is the lidar's rate.
    const double stated_ms = stamps_ms / static_cast<double>(gaps_ms.size() + counted);
    const bool slower = are_alike(gaps_ms) && fit::median_or_nan(gaps_ms) > 1.5 * stated_ms;
    const std::uint64_t lost = slower ? 0 : counted;
    const double hz = 1000.0 * (scans_of_rate - 1 + static_cast<double>(lost)) / stamps_ms;
    say(std::abs(hz / bench_.lidar.scan_hz - 1) < 0.02 ? Verdict::good : Verdict::bad, "scan rate",
        rounded(hz, 2) + " Hz, the bench file says " + to_text(bench_.lidar.scan_hz) + " Hz" +
            (slower ? "; the lidar says another rate of itself than its stamps show" : ""),
        "Correct lidar.scan_hz in the bench file, or the lidar's motor setting.");
    // Scans are counted as lost by the lidar's stamps. A clock that jumps leaves a gap where nothing is
    // missing. A simulator faster than real time needs less than what came would take, too.
    const double received_ms = 1000.0 * (scans_of_rate - 1) / hz;
    if (passed_ms > received_ms / 2 && passed_ms + longest_hold_up_ms < stamps_ms)
      say(Verdict::note, "lidar's clock",
          "its stamps advanced by " + rounded(stamps_ms / 1000, 1) + " s while " +
              rounded(passed_ms / 1000, 1) + " s passed here; whether scans were lost is therefore unknown",
          "Its clock jumped, or the network held scans back. Check again; switch the lidar off and on if it "
          "persists.");
    else
      say(lost == 0 ? Verdict::good : Verdict::note, "scans lost",
          std::to_string(lost) + " beside " + std::to_string(scans_of_rate) + " received",
          "Check the network: a cable of its own, no Wi-Fi, no other client.");
  }

  awaitable<void> check_stage(bool stay_still) {
    const StageIdentity who = co_await stage_.identify();
    say(Verdict::good, "stage",
        who.model + " (language " + who.language + ")" +
            (who.serial.empty() ? "" : ", serial " + who.serial) + ", " + rounded(who.units_per_deg, 2) +
            " units/deg");
    const StageStatus status = co_await stage_.status();
    for (const auto& warning : status.warnings)
      if (status.homed)
        say(Verdict::note, "stage says", warning, "See docs/operate/stages.md, or the controller's manual.");
    if (!limits_.has_min())
      say(Verdict::note, "soft limits", "none in the bench file",
          "Write stage.limits_deg, so that no cable is torn.");
    if (stay_still) {
      at_deg_ = status.position_deg;
      say(status.homed ? Verdict::good : Verdict::note, "homed", status.homed ? "yes" : "no",
          "Home it, or let `rig check` do it (without --stay-still).");
      co_return;
    }
    co_await stage_.home();
    say(Verdict::good, "homing", "done");
    co_await travel();
  }

  awaitable<void> travel() {
    const double first_deg = std::clamp(-180.0, limits_.min_deg, limits_.max_deg);
    const double last_deg = std::clamp(180.0, limits_.min_deg, limits_.max_deg);
    double worst_deg = 0;
    for (const double target_deg : {first_deg, last_deg, rest_deg()}) {
      const double arrived_deg = co_await stage_.move_to(target_deg);
      worst_deg = std::max(worst_deg, std::abs(arrived_deg - target_deg));
    }
    at_deg_ = rest_deg();
    say(worst_deg <= stage_tolerance_deg ? Verdict::good : Verdict::bad, "full turn",
        to_text(first_deg) + " to " + to_text(last_deg) + " deg, read-back within " + rounded(worst_deg, 4) +
            " deg",
        "Nothing may block the table; check its units (stage.units_per_deg) and its load.");
  }

  awaitable<BeamMedians> measure_beams() {
    const auto beams = static_cast<std::size_t>(bench_.lidar.steps);
    std::vector<std::vector<double>> ranges(beams), levels(beams);
    spreads_mm_.clear();
    co_await lidar_.start(whole_scan(bench_.lidar));
    for (int i = 0; i <= scans_of_medians; ++i) {
      const lidar::Scan scan = co_await lidar_.next();
      if (i == 0) continue;  // It may have begun before the stage stood.
      const auto first = static_cast<std::size_t>(scan.first_step);
      for (std::size_t k = 0; k < scan.range_mm.size() && first + k < beams; ++k) {
        if (scan.range_mm[k] == 0) continue;
        ranges[first + k].push_back(scan.range_mm[k]);
        if (k < scan.intensity.size()) levels[first + k].push_back(scan.intensity[k]);
      }
    }
    co_await lidar_.stop();
    BeamMedians seen;
    for (std::size_t k = 0; k < beams; ++k) {
      const bool sure = ranges[k].size() * 2 > scans_of_medians;
      if (sure) spreads_mm_.push_back(spread_of(ranges[k]));
      seen.range_mm.push_back(sure ? fit::median_or_nan(ranges[k])
                                   : std::numeric_limits<double>::quiet_NaN());
      seen.intensity.push_back(sure && !levels[k].empty() ? fit::median_or_nan(levels[k])
                                                          : std::numeric_limits<double>::quiet_NaN());
    }
    co_return seen;
  }

  void check_echoes(const BeamMedians& seen) {
    std::size_t echoes = 0, near = 0;
    std::vector<double> levels;
    for (std::size_t k = 0; k < seen.range_mm.size(); ++k) {
      if (!std::isfinite(seen.range_mm[k])) continue;
      ++echoes;
      near += seen.range_mm[k] < 60;
      if (std::isfinite(seen.intensity[k])) levels.push_back(seen.intensity[k]);
    }
    const double share = static_cast<double>(echoes) / (bench_.lidar.steps - bench_.lidar.first_step);
    say(share > 0.02 ? Verdict::good : Verdict::bad, "echoes", rounded(100 * share) + " % of the beams",
        "Nothing is seen: is the window covered, is anything within 10 m?");
    if (near > 0)
      say(Verdict::note, "something close", std::to_string(near) + " beams see less than 60 mm",
          "Take cables and hands away from the window, and clean it.");
    const double level = fit::median_or_nan(levels);
    say(level >= weak_intensity ? Verdict::good : Verdict::note, "intensity",
        levels.empty() ? "none" : "median " + rounded(level),
        "Echoes are weak: clean the window, use lighter targets, or go nearer.");
  }

  static double spread_of(const std::vector<double>& values) {
    const double n = static_cast<double>(values.size());
    double mean = 0, squares = 0;
    for (const double value : values) mean += value / n;
    for (const double value : values) squares += (value - mean) * (value - mean);
    return n > 1 ? std::sqrt(squares / (n - 1)) : 0;
  }

  /// Ranges that do not vary are no measurement, whatever else looks right.
  void check_noise() {
    if (spreads_mm_.empty()) return;
    const std::string remedy =
        "Frozen or simulated data look like this: switch the lidar off and on, and move something before it.";
    if (std::ranges::all_of(spreads_mm_, [](double mm) { return mm == 0; }))
      return say(Verdict::note, "noise",
                 "none: every beam gives the same range in " + std::to_string(scans_of_medians) + " scans",
                 remedy);
    const double usual_mm = fit::median_or_nan(spreads_mm_);
    for (const fit::KnownMechanism& known : bench_.known) {
      const auto sigma = known.parameters.find("sigma_mm");
      if (known.mechanism != "range-noise" || sigma == known.parameters.end()) continue;
      if (usual_mm < least_share_of_noise * sigma->second.value)
        say(Verdict::note, "noise",
            rounded(usual_mm, 2) + " mm, the bench file says " + to_text(sigma->second.value) + " mm",
            remedy);
    }
  }

  /// Zero, or what the limits allow next to it.
  [[nodiscard]] double rest_deg() const { return std::clamp(0.0, limits_.min_deg, limits_.max_deg); }

  /// The stage's angle at which beam 0 looks at the middle of the target, if the limits allow it.
  double facing_deg(const fit::Target& target) const {
    const Eigen::Vector2d middle = (target.from_mm + target.to_mm) / 2;
    const double wanted_rad =
        fit::wrap_angle(std::atan2(middle.y(), middle.x()) - bench_.lidar.mount.yaw_rad.value);
    const double wanted_deg = std::round(wanted_rad * fit::deg_per_rad);
    for (const double same_deg : {wanted_deg, wanted_deg + 360, wanted_deg - 360})
      if (same_deg >= limits_.min_deg && same_deg <= limits_.max_deg) return same_deg;
    return std::clamp(wanted_deg, limits_.min_deg, limits_.max_deg);
  }

  awaitable<void> check_target(fit::Target target, bool stay_still) {
    if (!stay_still) {
      at_deg_ = facing_deg(target);
      co_await stage_.move_to(at_deg_);
    }
    const BeamMedians seen = co_await measure_beams();
    judge_target(target, detect_target(bench_, target, bench_.targets, at_deg_ * fit::rad_per_deg, seen));
  }

  void judge_target(const fit::Target& target, const TargetDetection& detection) {
    const std::string what = "target " + target.name;
    const std::string level =
        std::isfinite(detection.intensity) ? ", intensity " + rounded(detection.intensity) : std::string();
    switch (detection.outcome) {
      case TargetDetection::Outcome::out_of_view:
        return say(Verdict::note, what, "not in the field of view at " + to_text(at_deg_) + " deg",
                   "It cannot be checked from here.");
      case TargetDetection::Outcome::undetected:
        return say(Verdict::bad, what, detection.words,
                   "It is not where the bench file says, is too dark, or something stands in front of it.");
      case TargetDetection::Outcome::misplaced:
      case TargetDetection::Outcome::in_place:
        return say(detection.good() ? Verdict::good : Verdict::bad, what, detection.words + level,
                   "Measure its place and correct from_mm and to_mm, or put it where they say. Check that "
                   "nothing stands in front of it.");
    }
  }

  const fit::Bench& bench_;
  LidarSource& lidar_;
  Stage& stage_;
  RunClock& clock_;
  std::function<void(const CheckLine&)> report_;
  StageLimits limits_;
  double at_deg_ = 0;
  std::vector<double> spreads_mm_;  ///< Of the beams with echoes, when last measured.
  std::vector<CheckLine> lines_;
};

}  // namespace

awaitable<std::vector<CheckLine>> check_bench(const fit::Bench& bench, LidarSource& lidar, Stage& stage,
                                              RunClock& clock, bool stay_still,
                                              std::function<void(const CheckLine&)> report) {
  Checker checker(bench, lidar, stage, clock, std::move(report));
  auto lines = co_await checker.run(stay_still);
  co_return lines;
}

}  // namespace rig
