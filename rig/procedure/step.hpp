// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>
#include <functional>
#include <initializer_list>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "fit/recording.hpp"
#include "lidar/scan.hpp"
#include "rig/procedure/procedure.hpp"

namespace rig {

/// What the stage may do, from the bench file's `stage` entry.
struct StageLimits {
  double min_deg = -1e9, max_deg = 1e9;  ///< Soft limits (`limits_deg`); nothing moves beyond them.
  double speed_deg_s = 20;               ///< For estimates only (`speed_deg_s`).
  [[nodiscard]] bool has_min() const { return min_deg > -1e8; }
  [[nodiscard]] bool has_max() const { return max_deg < 1e8; }
};

/// What changed on the bench, in the words of a prompt's `place`. Machine-readable, so that a simulated bench
/// does it.
struct Placement {
  std::string target;  ///< Empty: nothing but the lidar's own temperature and power.
  std::optional<double> shift_mm, reflectance, temperature_c;
  std::optional<double> since_power_on_s;  ///< The lidar was switched off, and on again so long ago.
};

/// Where a procedure stands while it is walked through without devices: for the dry run, the count of steps
/// and the estimate of time left. Angles that only the run will know are NaN.
struct Plan {
  const fit::Bench* bench = nullptr;
  StageLimits limits;
  StageRules rules;
  bool homed = false;
  double stage_deg = 0;
  double likely_deg =
      0;                ///< The same, for travel and time: where that is NaN, the last angle that was known.
  Variables variables;  ///< With Unknown for what the run will give.

  // The step being planned fills in:
  double seconds = 0, travel_deg = 0;
  long captures = 0, scans = 0;
  bool at_least = false;  ///< What only the run will know adds to these.
  std::string says;       ///< One line for the dry run.

  /// Accounts for a move; throws ProcedureError at `written_at` when it breaks a soft limit or homing was
  /// forgotten.
  void move_to(double target_deg, const FilePosition& written_at, int approach);
  void capture(long samples, double spacing_s);
  /// The estimate is a lower bound if the run alone will know one of these options.
  void depends_on(const Arguments& arguments, std::initializer_list<const char*> options);
};

/// What to capture. Beams are steps of the lidar.
struct CaptureRequest {
  std::string name;
  std::string key;  ///< Progress key; a capture whose key is recorded is not repeated.
  int samples = 1;
  int first_step = 0, last_step = 0, cluster = 1;
  double spacing_s = 0;  ///< 0: every scan.
  bool intensity = true;
  std::optional<std::string> target;
  std::optional<double> rate_deg_s;  ///< The stage is turning.
};

struct Question {
  std::string name, unit;
  std::optional<double> min, max;
  std::optional<Value> otherwise;  ///< The answer when nobody is there to give one.
};

/// What the rig itself should see before it believes that a prompt was done.
struct Expectation {
  bool of_beams = false;  ///< What these beams see, besides the target if there is one.
  double from_deg = 0, to_deg = 0;
  std::optional<std::pair<double, double>> within_mm;
  std::optional<double> flat_within_mm;  ///< Largest deviation of the beams' medians from a straight line.
  bool of_target = false;                ///< The placed target, where it was asked for.
  std::optional<double> tolerance_mm;    ///< Of its place; from the stated uncertainties if not given.
  bool surface = true;                   ///< Its echo must follow the reflectance that was asked for.
  bool echo = true;                      ///< It must give an echo at all.
  std::optional<fit::Target> target;     ///< Where it should stand, as the runner knows it.
};

struct Prompt {
  std::string title, text, picture;
  int number = 0;  ///< In its run, counted from 1; one that is asked again has a new number.
  std::optional<Question> question;
  std::optional<Placement> place;
  std::optional<Expectation> until;
  double timeout_s = 0;  ///< 0: waits for ever.
  bool skippable = true;
  bool repeatable = true;
  std::string check;  ///< What is wrong with what the rig saw at the last look; empty if nothing is.
  std::string seen;   ///< What the rig sees when that is as asked for; empty before the first look.
  std::optional<double> to_go_mm;  ///< How much too far away the target is seen.
  std::string refusal;             ///< Why the operator's last answer was not taken; empty if none was given.
};

struct Answer {
  enum class Kind { confirmed, skipped, repeat, abort };
  Kind kind = Kind::confirmed;
  std::optional<Value> value;
};

/// What the runner offers to a step that runs.
class StepContext {
 public:
  template <class T>
  using awaitable = boost::asio::awaitable<T>;

  virtual ~StepContext() = default;
  [[nodiscard]] virtual const fit::Bench& bench() const = 0;
  [[nodiscard]] virtual const StageRules& rules() const = 0;
  /// Identifies this step in this run ("4.1[distance_mm=300]"); name of its captures unless it has one.
  [[nodiscard]] virtual const std::string& key() const = 0;
  [[nodiscard]] virtual const std::string& name() const = 0;

  virtual awaitable<void> home(bool again) = 0;
  /// Moves so that the last move has the sign `approach` (0: the shortest way), judges the read-back and
  /// returns it. Cheap if the stage stands there already.
  virtual awaitable<double> move_to(double target_deg, int approach, const FilePosition& written_at) = 0;
  [[nodiscard]] virtual double stage_deg() const = 0;

  /// Captures, commits, and returns the capture's id; at once if its key is recorded already.
  virtual awaitable<std::int64_t> capture(CaptureRequest request) = 0;
  /// Captures while the stage turns from `from_deg` on at the rate of `request`, and stops it. A turn during
  /// which a device was lost for a while is started again.
  virtual awaitable<std::int64_t> capture_turning(CaptureRequest request, double from_deg,
                                                  const FilePosition& written_at) = 0;
  [[nodiscard]] virtual bool recorded(const std::string& key) const = 0;
  /// Reads a committed capture back, scan by scan.
  virtual void for_each_scan(std::int64_t capture,
                             const std::function<void(const fit::ScanView&)>& visit) const = 0;
  /// Lets the lidar measure until its own clock has advanced so far: real or simulated time.
  virtual awaitable<void> wait(double seconds) = 0;

  virtual awaitable<Answer> ask(Prompt prompt) = 0;
  /// Gives a variable its value, now and in every resumed run.
  virtual void set(const std::string& variable, const Value& value) = 0;
  virtual void skip_rest_of_iteration() = 0;

  /// Computed beside all else that goes on; a wait that is called off ends at once.
  virtual awaitable<nlohmann::json> fit(std::string kind, nlohmann::json options) = 0;
  virtual awaitable<void> report(std::string file) = 0;

  /// Pauses here if the operator asked for it, and tells observers how far the step is.
  virtual awaitable<void> checkpoint(long done, long total) = 0;
  virtual void note(const std::string& level, const std::string& text) = 0;
};

/// One kind of step. Each lives in its own file rig/procedure/steps/NAME.cpp, which defines
/// `std::unique_ptr<rig::StepKind> rig::steps::make_NAME()`; the build finds it by its name.
class StepKind {
 public:
  template <class T>
  using awaitable = boost::asio::awaitable<T>;

  virtual ~StepKind() = default;
  [[nodiscard]] virtual std::string name() const = 0;
  [[nodiscard]] virtual std::string about() const = 0;
  [[nodiscard]] virtual const std::vector<Option>& options() const = 0;
  [[nodiscard]] virtual bool has_steps() const { return false; }
  /// The options are names that the procedure chooses.
  [[nodiscard]] virtual bool takes_any_option() const { return false; }
  // What the runner asks of a kind, which it knows by nothing else.
  /// Measures its option `target`, or without one any target: these must stand where they should.
  [[nodiscard]] virtual bool measures() const { return false; }
  /// Needs scans and stage positions on one clock.
  [[nodiscard]] virtual bool turns_stage() const { return false; }
  /// The stage is homed once this ran.
  [[nodiscard]] virtual bool homes_stage() const { return false; }
  /// Adds nothing to what a certificate says.
  [[nodiscard]] virtual bool only_reports() const { return false; }
  /// How long it takes is up to a person.
  [[nodiscard]] virtual bool asks_a_person() const { return false; }
  /// The map that says what a person changes on the bench; null if nothing.
  [[nodiscard]] virtual const Node* places(const Node& /*options*/) const { return nullptr; }
  /// The calibration that it computes: the node of its kind; null if none.
  [[nodiscard]] virtual const Node* calibration(const Node& /*options*/) const { return nullptr; }
  /// Variables that later steps may use once this one ran.
  [[nodiscard]] virtual std::vector<std::string> defines(const Node& options) const;
  /// Checks that need no devices but do need the bench (throws ProcedureError), and the estimate.
  virtual void plan(const Arguments& arguments, Plan& plan) const = 0;
  virtual awaitable<void> run(const Arguments& arguments, StepContext& context) const = 0;
};

[[nodiscard]] const std::vector<std::unique_ptr<StepKind>>& step_kinds();

/// The variables of every turn of a for-each, in order: a list's turns, or every value with every other.
[[nodiscard]] std::vector<Variables> iterations(const Node& options, const Variables& variables);

// Options that several kinds share.
[[nodiscard]] std::vector<Option> capture_options();
/// Steps of the lidar, samples and so on as the options say; the whole field of view by default.
[[nodiscard]] CaptureRequest capture_request(const Arguments& arguments, const fit::Bench& bench,
                                             int samples);
[[nodiscard]] Option approach_option();
/// +1, -1, 0 for positive, negative, direct; `otherwise` if not given.
[[nodiscard]] int approach_of(const Arguments& arguments, int otherwise);

}  // namespace rig
