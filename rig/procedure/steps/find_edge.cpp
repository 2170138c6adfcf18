// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "fit/numeric/distributions.hpp"
#include "fit/numeric/median.hpp"
#include "rig/procedure/step.hpp"

namespace rig::steps {
namespace {

using Type = Option::Type;

/// Ranges of the followed beam at one stop: on the board, on the background, or (jitter) neither the one nor
/// the other. Experiment A4 of Zhao et al.: smooth, jitter, smooth.
enum class State { board, jitter, background };

struct Level {
  double median_mm = 0, gate_mm = 0;
  double outside = 0;  ///< Expected share of samples outside the gate when nothing is wrong.
  bool echo = true;

  [[nodiscard]] bool holds(double range_mm) const {
    return echo ? range_mm > 0 && std::abs(range_mm - median_mm) <= gate_mm : range_mm == 0;
  }
};

/// The level of samples that are known to be smooth: median, a gate of 5 robust standard deviations (never
/// less than three steps of the 1 mm rounding), and the share outside it, with one doubtful sample added
/// (rule of succession) so that a short reference promises nothing.
Level level_of(const std::vector<double>& samples) {
  Level level;
  std::vector<double> echoes;
  for (const double sample : samples)
    if (sample > 0) echoes.push_back(sample);
  level.echo = echoes.size() * 2 > samples.size();
  if (level.echo) {
    level.median_mm = fit::median_of(std::vector(echoes));
    std::vector<double> deviations;
    for (const double echo : echoes) deviations.push_back(std::abs(echo - level.median_mm));
    level.gate_mm = std::max(3.0, 5 * 1.4826 * fit::median_of(std::move(deviations)));
  }
  const auto outside = std::ranges::count_if(samples, [&](double sample) { return !level.holds(sample); });
  level.outside = (static_cast<double>(outside) + 1) / (static_cast<double>(samples.size()) + 2);
  return level;
}

/// True if as many samples outside the level's gate happen by chance less than once in a thousand stops.
bool leaves(const Level& level, const std::vector<double>& samples) {
  const auto outside = std::ranges::count_if(samples, [&](double sample) { return !level.holds(sample); });
  if (outside == 0) return false;
  return fit::binomial_at_least(static_cast<double>(samples.size()), std::min(level.outside, 0.5),
                                static_cast<double>(outside)) < 1e-3;
}

/// The level where these samples show it, if most of them do: a slanted surface's range drifts as the stage
/// turns, so the level of the search's far end may be centimetres off near the edge.
Level followed(Level level, const std::vector<double>& samples, double reach_mm) {
  if (!level.echo) return level;
  std::vector<double> echoes;
  for (const double sample : samples)
    if (sample > 0) echoes.push_back(sample);
  if (echoes.empty()) return level;
  const double here_mm = fit::median_of(std::vector(echoes));
  if (std::abs(here_mm - level.median_mm) < reach_mm) level.median_mm = here_mm;
  return level;
}

struct Settings {
  std::string target, save;
  bool right = true;
  int beam = 0, spread = 0;
  double from_deg = 0, to_deg = 0, step_deg = 0.01;
  int samples = 0;
  int approach = 1;

  /// In whole steps of `step_deg`.
  [[nodiscard]] long width() const { return std::lround((to_deg - from_deg) / step_deg); }
};

/// Of a search over so many steps: its two ends, and a bisection on either side of a first stop in the
/// middle.
int most_stops(long width) {
  return 2 * static_cast<int>(std::ceil(std::log2(static_cast<double>(std::max(2L, width))))) + 1;
}

/// Stage angle at which `beam_rad` of the lidar points at `edge_mm`.
double stage_angle_of(const Eigen::Vector2d& edge_mm, double beam_rad, const fit::Mount& mount) {
  double theta = 0;
  for (int i = 0; i < 20; ++i) {  // The lidar's arm is short against the distance: this contracts fast.
    const Eigen::Vector2d origin(std::cos(theta) * mount.x_mm.value - std::sin(theta) * mount.y_mm.value,
                                 std::sin(theta) * mount.x_mm.value + std::cos(theta) * mount.y_mm.value);
    const Eigen::Vector2d ray = edge_mm - origin;
    theta = fit::wrap_angle(std::atan2(ray.y(), ray.x()) - mount.yaw_rad.value - beam_rad);
  }
  return theta;
}

/// The board's end as the lidar sees it: right is the clockwise one.
Eigen::Vector2d edge_of(const fit::Target& target, bool right) {
  const double turn = target.from_mm.x() * target.to_mm.y() - target.from_mm.y() * target.to_mm.x();
  return (turn > 0) == right ? target.from_mm : target.to_mm;
}

constexpr double usual_search_deg = 1.5;

Settings settings_of(const Arguments& arguments, const fit::Bench& bench, int approach) {
  Settings settings;
  settings.target = *capture_request(arguments, bench, 1).target;
  settings.save = arguments.text_or("save", "edge");
  settings.right = arguments.text_or("edge", "right") == "right";
  settings.samples = arguments.integer_or("samples", 100);
  settings.step_deg = arguments.number_or("step_deg", 0.01);
  settings.spread = arguments.integer_or("spread", 8);
  settings.approach = approach_of(arguments, approach);
  const double beam_deg = arguments.number("beam_deg"),
               search_deg = arguments.number_or("search_deg", usual_search_deg);
  const fit::LidarGeometry& lidar = bench.lidar;
  const bool knows_beam = !std::isnan(beam_deg);
  settings.beam = lidar.front_step;
  if (knows_beam)
    settings.beam += static_cast<int>(std::lround(beam_deg * fit::rad_per_deg / lidar.step_rad));
  if (knows_beam && (settings.beam < lidar.first_step || settings.beam >= lidar.steps))
    throw ProcedureError(arguments.position_of("beam_deg"),
                         "the lidar has no beam at " + to_text(beam_deg) + " deg.");
  const fit::Target* target = bench.target(settings.target);
  if (!target)
    throw ProcedureError(arguments.position_of("target"),
                         "the bench has no target '" + settings.target + "'.");
  double expected_deg =
      stage_angle_of(edge_of(*target, settings.right), lidar.beam_angle(settings.beam), lidar.mount) *
      fit::deg_per_rad;
  if (!knows_beam) expected_deg = NAN;
  if (arguments.has("near_deg")) expected_deg = arguments.number("near_deg");
  const auto on_grid = [&](double deg) { return std::round(deg / settings.step_deg) * settings.step_deg; };
  settings.from_deg = on_grid(expected_deg - search_deg);
  settings.to_deg = on_grid(expected_deg + search_deg);
  return settings;
}

/// The search itself. Stops are counted in whole steps from settings.from_deg, so that no rounding adds up.
class Search {
 public:
  Search(const Settings& settings, StepContext& context, const FilePosition& position)
      : settings_(settings), context_(context), position_(position) {}

  StepContext::awaitable<void> run() {
    const long last = settings_.width();
    // Turning counter-clockwise, a beam comes onto the board at its right end and leaves it at its left end.
    const long board_stop = settings_.right ? last : 0, background_stop = settings_.right ? 0 : last;
    const auto on_board = co_await sample(board_stop);
    const auto behind = co_await sample(background_stop);
    board_ = level_of(on_board);
    background_ = level_of(behind);
    check_levels();
    co_await narrow(board_stop, background_stop);
    save();
  }

 private:
  double angle_deg(long stop) const {
    return std::round((settings_.from_deg + static_cast<double>(stop) * settings_.step_deg) * 1e6) / 1e6;
  }

  /// Halves the interval until a stop jitters or nothing is left between, then the window's two ends
  /// likewise.
  StepContext::awaitable<void> narrow(long board, long background) {
    long jitter = board;
    while (std::abs(background - board) > 1 && jitter == board) {
      const long middle = std::midpoint(board, background);
      const State state = co_await observe(middle);
      if (state == State::board)
        board = middle, jitter = middle;
      else if (state == State::background)
        background = middle;
      else
        jitter = middle;
    }
    board_end_ = co_await boundary(board, jitter, State::board);
    background_end_ = co_await boundary(background, jitter, State::background);
  }

  /// The last stop in `state`, coming from `smooth` towards `jitter`.
  StepContext::awaitable<long> boundary(long smooth, long jitter, State state) {
    while (std::abs(jitter - smooth) > 1) {
      const long middle = std::midpoint(smooth, jitter);
      auto observing = observe(middle);
      if (co_await std::move(observing) == state)
        smooth = middle;
      else
        jitter = middle;
    }
    co_return smooth;
  }

  StepContext::awaitable<State> observe(long stop) {
    const auto samples = co_await sample(stop);
    if (!leaves(followed(board_, samples, drift_mm()), samples)) co_return State::board;
    if (!leaves(followed(background_, samples, drift_mm()), samples)) co_return State::background;
    co_return State::jitter;
  }

  /// How far a surface may drift within the search and still be told from the other one.
  double drift_mm() const {
    const double gap_mm =
        background_.echo ? background_.median_mm - board_.median_mm : 0.4 * board_.median_mm;
    return gap_mm / 4;
  }

  /// Ranges of the followed beam at a stop; from the session if it was recorded before an interruption.
  StepContext::awaitable<std::vector<double>> sample(long stop) {
    co_await context_.checkpoint(stops_, most_stops(settings_.width()));
    ++stops_;
    CaptureRequest request;
    request.name = context_.name();
    request.key = context_.key() + "/" + std::to_string(stop);
    request.samples = settings_.samples;
    request.first_step = std::max(context_.bench().lidar.first_step, settings_.beam - settings_.spread);
    request.last_step = std::min(context_.bench().lidar.steps - 1, settings_.beam + settings_.spread);
    request.target = settings_.target;
    if (!context_.recorded(request.key))
      co_await context_.move_to(angle_deg(stop), settings_.approach, position_);
    const std::int64_t id = co_await context_.capture(request);
    std::vector<double> samples;
    const auto followed = static_cast<std::size_t>(settings_.beam - request.first_step);
    context_.for_each_scan(id, [&](const fit::ScanView& scan) {
      if (followed < scan.range_mm.size()) samples.push_back(scan.range_mm[followed]);
    });
    if (samples.empty())
      throw MeasurementError("find-edge: the capture at " + rounded_text(angle_deg(stop), 4) +
                             " deg is empty.");
    co_return samples;
  }

  void check_levels() const {
    const auto seen = [](const Level& level) {
      return level.echo ? rounded_text(level.median_mm, 0) + " mm" : std::string("no echo");
    };
    const bool apart =
        board_.echo != background_.echo ||
        (board_.echo && background_.median_mm - board_.median_mm > board_.gate_mm + background_.gate_mm);
    if (apart && board_.echo) return;
    throw MeasurementError("find-edge: no edge of '" + settings_.target + "' between stage angles " +
                           rounded_text(settings_.from_deg, 4) + " and " + rounded_text(settings_.to_deg, 4) +
                           " deg: the beam sees " + seen(settings_.right ? background_ : board_) + " and " +
                           seen(settings_.right ? board_ : background_) +
                           ". Compare the target's place with the bench file, or widen search_deg.");
  }

  void save() {
    const double board_deg = angle_deg(board_end_), background_deg = angle_deg(background_end_);
    context_.set(settings_.save + "_smooth_deg", board_deg);
    context_.set(settings_.save + "_background_deg", background_deg);
    context_.set(settings_.save + "_deg", (board_deg + background_deg) / 2);
    context_.note(
        "info", context_.name() + ": the edge is at " + rounded_text((board_deg + background_deg) / 2, 4) +
                    " deg; smooth on the board at " + rounded_text(board_deg, 4) + ", on the background at " +
                    rounded_text(background_deg, 4) + " deg; " + std::to_string(stops_) + " stops");
  }

  const Settings& settings_;
  StepContext& context_;
  const FilePosition& position_;
  Level board_, background_;
  long board_end_ = 0, background_end_ = 0;
  int stops_ = 0;
};

class FindEdge final : public StepKind {
 public:
  std::string name() const override { return "find-edge"; }
  bool measures() const override { return true; }
  std::string about() const override {
    return "Turns the stage until one beam just sees a target's edge without jitter, coarse to fine. Gives "
           "SAVE_smooth_deg (last stop wholly on the board), SAVE_background_deg and SAVE_deg (between them)";
  }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> options = {
        {.name = "target", .type = Type::text, .about = "the bench's target", .required = true},
        {.name = "edge",
         .type = Type::choice,
         .about = "which end, as the lidar sees it",
         .choices = {"right", "left"}},
        {.name = "beam_deg",
         .about = "the beam that is followed, in degrees of the lidar's frame",
         .required = true},
        {.name = "near_deg", .about = "stage angle to search around; from the bench if not given"},
        {.name = "search_deg", .about = "search this far to both sides", .min = 0.05, .max = 30},
        {.name = "step_deg", .about = "finest step", .min = 0.001, .max = 1},
        {.name = "samples", .type = Type::integer, .about = "scans at every stop", .min = 10, .max = 100000},
        {.name = "spread",
         .type = Type::integer,
         .about = "beams recorded to each side of the followed one",
         .min = 0,
         .max = 540},
        {.name = "save",
         .type = Type::text,
         .about = "first part of the variables' names, 'edge' by default"},
        approach_option()};
    return options;
  }
  std::vector<std::string> defines(const Node& options) const override {
    const Node* save = options.find("save");
    const std::string prefix = save ? save->scalar : "edge";
    return {prefix + "_smooth_deg", prefix + "_background_deg", prefix + "_deg"};
  }
  void plan(const Arguments& arguments, Plan& plan) const override {
    const Settings settings = settings_of(arguments, *plan.bench, plan.rules.approach);
    for (const double angle : {settings.to_deg, settings.from_deg})
      plan.move_to(angle, arguments.position(), settings.approach);
    constexpr int usual_stops = 16;
    const double found_deg = settings.to_deg - settings.from_deg;
    const double width_deg = std::isnan(found_deg) ? 2 * usual_search_deg : found_deg;
    for (int i = 0; i < usual_stops; ++i) {
      plan.capture(settings.samples, 0);
      plan.travel_deg += width_deg / 8;
      plan.seconds += 0.5 + width_deg / 8 / plan.limits.speed_deg_s;
    }
    plan.depends_on(arguments, {"near_deg", "beam_deg", "search_deg", "step_deg", "samples"});
    const double middle = (settings.from_deg + settings.to_deg) / 2;
    plan.stage_deg = middle;
    if (!std::isnan(middle)) plan.likely_deg = middle;
    plan.says =
        "find the " + std::string(settings.right ? "right" : "left") + " edge of " + settings.target +
        " with beam " + arguments.text_or("beam_deg", "?") + " deg, " +
        (std::isnan(middle) ? "" : "near " + rounded_text(middle, 2) + " deg, ") + "about " +
        std::to_string(usual_stops) + " stops" +
        (std::isnan(middle) ? "" : " (at most " + std::to_string(most_stops(settings.width())) + ")") +
        " of " + std::to_string(settings.samples) + " scans";
  }
  awaitable<void> run(const Arguments& arguments, StepContext& context) const override {
    const Settings settings = settings_of(arguments, context.bench(), context.rules().approach);
    Search search(settings, context, arguments.position());
    co_await search.run();
  }
};

}  // namespace

std::unique_ptr<StepKind> make_find_edge();
std::unique_ptr<StepKind> make_find_edge() { return std::make_unique<FindEdge>(); }

}  // namespace rig::steps
