// SPDX-License-Identifier: MIT
#include "rig/runner/run_view.hpp"

#include <sys/ioctl.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>

#include "fit/numeric/number_format.hpp"
#include "rig/json_fields.hpp"
#include "rig/session/standing.hpp"

namespace rig {
namespace {

using nlohmann::json;
using std::chrono::steady_clock;

/// The messages that a view has not shown yet.
class NewMessages {
 public:
  template <class Visit>
  void each(const RunState& state, Visit visit) {
    const auto fresh = std::min<std::uint64_t>(state.messages_total - seen_, state.messages.size());
    for (std::size_t i = state.messages.size() - fresh; i < state.messages.size(); ++i)
      visit(state.messages[i]);
    seen_ = state.messages_total;
  }
  [[nodiscard]] bool any(const RunState& state) const { return state.messages_total != seen_; }

 private:
  std::uint64_t seen_ = 0;
};

/// At most so often; a change of phase or step always passes.
class Throttle {
 public:
  explicit Throttle(std::chrono::milliseconds period) : period_(period) {}
  bool passes(const RunState& state) {
    const auto now = steady_clock::now();
    if (state.phase == phase_ && state.step == step_ && now - last_ < period_) return false;
    last_ = now;
    phase_ = state.phase;
    step_ = state.step;
    return true;
  }

 private:
  std::chrono::milliseconds period_;
  steady_clock::time_point last_{};
  RunState::Phase phase_ = RunState::Phase::starting;
  std::size_t step_ = 0;
};

bool begins_letter(char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }

/// Letters as wide as they look: counts the bytes that begin a character.
std::size_t shown_width(const std::string& text) {
  return static_cast<std::size_t>(std::ranges::count_if(text, begins_letter));
}

/// As much of the text as fits, with dots where it is cut.
std::string shortened(const std::string& text, std::size_t width) {
  if (shown_width(text) <= width) return text;
  const std::string dots = std::string("...").substr(0, width);
  std::size_t end = 0, room = width - dots.size();
  for (; end < text.size(); ++end) {
    if (!begins_letter(text[end])) continue;
    if (room == 0) break;
    --room;
  }
  return text.substr(0, end) + dots;
}

/// In a narrow window the words are cut, never the time that is left.
std::string progress_line(const RunState& state, std::size_t width) {
  const std::string place =
      "[" + std::to_string(state.step + 1) + "/" + std::to_string(state.steps.size()) + "] ";
  std::string end;
  if (state.total > 1)
    end =
        " " + grouped(state.done) + "/" + grouped(state.total) + (state.unit.empty() ? "" : " " + state.unit);
  char share[64];
  std::snprintf(share, sizeof share, "  %3.0f %%, ", 100 * state.overall);
  end += share + duration_text(state.left_s) + " left";
  const std::string activity =
      state.phase == RunState::Phase::paused ? "paused: " + state.activity : state.activity;
  const std::size_t taken = place.size() + end.size();
  return shortened(place + shortened(activity, width > taken ? width - taken : 0) + end, width);
}

int columns_of(std::FILE* out) {
  winsize size{};
  return ioctl(fileno(out), TIOCGWINSZ, &size) == 0 && size.ws_col > 20 ? size.ws_col : 80;
}

class TerminalView final : public RunView {
 public:
  TerminalView(std::FILE* out, bool is_terminal) : out_(out), is_terminal_(is_terminal) {}
  ~TerminalView() override { clear(); }

  void show(const RunState& state) override {
    if (messages_.any(state)) {
      clear();
      messages_.each(state, [&](const RunState::Message& message) { print(message); });
    }
    if (state.steps.empty()) return;
    if (!is_terminal_) return log_progress(state);
    const bool ended = state.phase >= RunState::Phase::done;
    if (state.phase == RunState::Phase::prompt || ended) return clear();
    if (!throttle_.passes(state)) return;
    const auto room = static_cast<std::size_t>(columns_of(out_) - 1);
    std::fprintf(out_, "\r\033[K%s", progress_line(state, room).c_str());
    std::fflush(out_);
    drawn_ = true;
  }

 private:
  /// A log that nobody watches still tells how far a long run is: a line a minute.
  void log_progress(const RunState& state) {
    const bool works = state.phase == RunState::Phase::running || state.phase == RunState::Phase::paused;
    const auto now = steady_clock::now();
    if (!works || now - logged_ < std::chrono::minutes(1)) return;
    logged_ = now;
    std::fprintf(out_, "%s\n", progress_line(state, 1000).c_str());
    std::fflush(out_);
  }

  void print(const RunState::Message& message) {
    if (!is_terminal_ && message.level == "info") return;
    if (message.text.starts_with("asks: ")) return;  // The operator says it at length.
    if (message.level == "error") return;            // Why the run failed is the program's last line.
    const char* mark = message.level == "warning" ? "warning: " : "";
    std::fprintf(out_, "%s%s\n", mark, message.text.c_str());
  }
  void clear() {
    if (!drawn_) return;
    std::fputs("\r\033[K", out_);
    std::fflush(out_);
    drawn_ = false;
  }

  std::FILE* out_;
  bool is_terminal_, drawn_ = false;
  steady_clock::time_point logged_ = steady_clock::now();
  NewMessages messages_;
  Throttle throttle_{std::chrono::milliseconds(100)};
};

class JsonLog final : public RunView {
 public:
  explicit JsonLog(std::FILE* out) : out_(out) {}

  void show(const RunState& state) override {
    messages_.each(state, [&](const RunState::Message& message) {
      write({{"type", "message"},
             {"time_s", static_cast<double>(message.time_us) / 1e6},
             {"level", message.level},
             {"text", message.text}});
    });
    if (!throttle_.passes(state) || state.steps.empty()) return;
    json line = {{"type", "progress"},
                 {"phase", phase_word(state.phase)},
                 {"step", state.step + 1},
                 {"steps", state.steps.size()},
                 {"says", state.steps[state.step].first},
                 {"activity", state.activity},
                 {"done", state.done},
                 {"total", state.total},
                 {"unit", state.unit},
                 {"overall", state.overall},
                 {"left_s", state.left_s},
                 {"stage_deg", state.stage_deg},
                 {"scans_lost", state.scans_lost},
                 {"scans_rejected", state.scans_rejected},
                 {"reconnects", state.reconnects}};
    if (state.prompt) line["prompt"] = to_json(*state.prompt);
    if (state.phase >= RunState::Phase::done) line["limits"] = json::parse(state.checks_text);
    write(line);
  }

 private:
  void write(const json& line) {
    std::fprintf(out_, "%s\n", line.dump(-1, ' ', false, json::error_handler_t::replace).c_str());
    std::fflush(out_);
  }

  std::FILE* out_;
  NewMessages messages_;
  Throttle throttle_{std::chrono::milliseconds(500)};
};

std::string padded(std::string text, std::size_t width) {
  const std::size_t shown = shown_width(text);
  if (shown < width) text.append(width - shown, ' ');
  return text;
}

/// A line of the summary: what, its name, its value.
struct SummaryLine {
  std::string first, name, value;
};

/// Lines below each other, names as wide as the longest.
std::string in_columns(const std::vector<SummaryLine>& lines) {
  std::size_t width = 0;
  for (const SummaryLine& line : lines) width = std::max(width, shown_width(line.name));
  std::string text;
  for (const SummaryLine& line : lines)
    text += "  " + padded(line.first, 12) + " " + padded(line.name, width) + "  " + line.value + "\n";
  return text;
}

void add_values(std::vector<SummaryLine>& lines, const std::string& kind, const json& result) {
  for (const json& value : list_of(result, "values")) {
    const double number = number_of(value, "value"), k = number_of(value, "k", 2);
    if (std::isnan(number)) continue;
    std::string text = fit::format_measurement(number, expanded_of(value, 0), text_of(value, "unit"));
    if (std::abs(k - 2) > 0.05) text += " (k = " + fit::format_fixed(k, 2) + ")";
    lines.push_back({kind, text_of(value, "label", text_of(value, "name")), std::move(text)});
  }
}

std::vector<SummaryLine> lines_of_limits(const json& checks) {
  std::vector<SummaryLine> lines;
  for (const json& check : checks)
    lines.push_back({check.value("verdict", ""), check.value("name", ""), check.value("text", "")});
  return lines;
}

}  // namespace

std::string summary_text(const RunState& state, const SessionStore& session, double seconds) {
  const auto recorded = std::ranges::count_if(
      state.steps, [](const auto& step) { return step.second == RunState::StepState::recorded; });
  std::string text = "\n" + state.procedure + ": " + phase_word(state.phase) + "\n  " +
                     std::to_string(recorded) + " of " + std::to_string(state.steps.size()) + " steps, " +
                     grouped(static_cast<long>(session.captures().size())) + " captures, " +
                     duration_text(seconds) + "; scans lost: " + std::to_string(state.scans_lost) +
                     ", refused: " + std::to_string(state.scans_rejected) +
                     ", reconnections: " + std::to_string(state.reconnects) + "\n";
  std::vector<SummaryLine> values;
  for (const auto& result : session.latest_results()) {
    if (result.kind == "limits") continue;
    const json found = json::parse(result.json, nullptr, false);
    for (const std::string& doubt : doubts_of(found))
      text += "DOUBTFUL: " + result.kind + ": " + doubt + "\n";
    add_values(values, result.kind, found);
  }
  if (!values.empty())
    text += "Results (± is the expanded uncertainty; k = 2 unless stated):\n" + in_columns(values);
  const json checks = json::parse(state.checks_text, nullptr, false);
  if (checks.is_array() && !checks.empty()) text += "Limits:\n" + in_columns(lines_of_limits(checks));
  // A session whose first step was not done is not kept.
  return session.progress().empty() ? text : text + "Session: " + session.path() + "\n";
}

std::unique_ptr<RunView> make_terminal_view(std::FILE* out, bool is_terminal) {
  return std::make_unique<TerminalView>(out, is_terminal);
}
std::unique_ptr<RunView> make_json_log(std::FILE* out) { return std::make_unique<JsonLog>(out); }

}  // namespace rig
