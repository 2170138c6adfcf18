// SPDX-License-Identifier: MIT
#include <cmath>

#include "rig/procedure/step.hpp"

namespace rig::steps {
namespace {

using Type = Option::Type;

/// Stops of a sweep, counted rather than added up: 36,000 additions of 0.01 deg miss 360 deg.
struct Stops {
  double from_deg = 0, step_deg = 0;
  long count = 0;
  [[nodiscard]] double at(long i) const {
    return std::round((from_deg + static_cast<double>(i) * step_deg) * 1e6) / 1e6;
  }
};

class Sweep final : public StepKind {
 public:
  std::string name() const override { return "sweep"; }
  bool measures() const override { return true; }
  std::string about() const override { return "Steps the stage through an arc and captures at every stop"; }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> options = [] {
      std::vector<Option> all = {
          {.name = "start_deg", .about = "first stop", .required = true},
          {.name = "stop_deg", .about = "last stop", .required = true},
          {.name = "step_deg", .about = "angle between stops, 0.01 by default", .min = 0.001, .max = 360},
          {.name = "samples",
           .type = Type::integer,
           .about = "scans at every stop",
           .required = true,
           .min = 1,
           .max = 10'000'000},
          approach_option()};
      for (auto& option : capture_options()) all.push_back(option);
      return all;
    }();
    return options;
  }
  void plan(const Arguments& arguments, Plan& plan) const override {
    const auto request = capture_request(arguments, *plan.bench, arguments.integer_or("samples", 1));
    const Stops stops = stops_of(arguments);
    const int approach = approach_of(arguments, plan.rules.approach);
    for (long i = 0; i < stops.count; ++i) {
      plan.move_to(stops.at(i), arguments.position(), approach);
      plan.capture(request.samples, request.spacing_s);
    }
    plan.depends_on(arguments, {"start_deg", "stop_deg", "step_deg", "samples", "spacing_s"});
    plan.says =
        "sweep " +
        (std::isnan(stops.at(0)) ? std::to_string(stops.count) + " stops"
                                 : to_text(stops.at(0)) + " to " + to_text(stops.at(stops.count - 1)) +
                                       " deg, " + std::to_string(stops.count) + " stops") +
        " of " + std::to_string(request.samples) + " scans";
  }
  awaitable<void> run(const Arguments& arguments, StepContext& context) const override {
    const CaptureRequest pattern =
        capture_request(arguments, context.bench(), arguments.integer_or("samples", 1));
    const Stops stops = stops_of(arguments);
    const int approach = approach_of(arguments, context.rules().approach);
    for (long i = 0; i < stops.count; ++i) {
      co_await context.checkpoint(i, stops.count);
      CaptureRequest request = pattern;
      request.name = context.name();
      request.key = context.key() + "/" + std::to_string(i);
      if (context.recorded(request.key)) continue;
      co_await context.move_to(stops.at(i), approach, arguments.position());
      co_await context.capture(request);
    }
  }

 private:
  static Stops stops_of(const Arguments& arguments) {
    Stops stops;
    stops.from_deg = arguments.number("start_deg");
    const double to = arguments.number("stop_deg");
    stops.step_deg = std::copysign(arguments.number_or("step_deg", 0.01), to - stops.from_deg);
    if (std::isnan(stops.from_deg + to + stops.step_deg)) {
      stops.step_deg = NAN;  // Nor is it known where they are.
      stops.count = 30;      // A guess for the dry run; the run itself knows.
      return stops;
    }
    const double count = std::floor((to - stops.from_deg) / stops.step_deg + 1e-6) + 1;
    if (count > 100'000)
      throw ProcedureError(arguments.position(), "the sweep has more than 100,000 stops; make it shorter.");
    stops.count = static_cast<long>(count);
    return stops;
  }
};

}  // namespace

std::unique_ptr<StepKind> make_sweep();
std::unique_ptr<StepKind> make_sweep() { return std::make_unique<Sweep>(); }

}  // namespace rig::steps
