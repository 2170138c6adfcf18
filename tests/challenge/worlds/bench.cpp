// SPDX-License-Identifier: MIT
#include "worlds/bench.hpp"

#include <cmath>

namespace challenge {

using nlohmann::json;

static double leaves_before_s(const Capture& capture) {
  constexpr double move_s = 0.5;
  return capture.since_power_on_s - move_s;
}

Motion::Motion(const Session& session) : session_(session), early_s_(session.scene == "settle" ? 0 : 0.1) {}

sim::StageMoment Motion::at(double time) const {
  std::size_t i = 0;
  while (i + 1 < session_.captures.size() && time >= leaves_before_s(session_.captures[i + 1])) ++i;
  const Capture& capture = session_.captures[i];
  const double rate_there = capture.rate_deg_s * degree;
  // Before the first scan the stage has arrived, or come up to the speed at which it turns through the
  // capture.
  const double begins = capture.since_power_on_s - early_s_,
               target = capture.stage_deg * degree - rate_there * early_s_;
  if (time >= begins) return {target + rate_there * (time - begins), rate_there};
  double from = target - degree;
  if (i > 0) {
    const Capture& before = session_.captures[i - 1];
    from = (before.stage_deg + before.rate_deg_s * (leaves_before_s(capture) - before.since_power_on_s)) *
           degree;
  }
  const double leaves = leaves_before_s(capture);
  if (time < leaves) return {from, 0};
  const double rate = (target - from) / (begins - leaves);
  return {from + rate * (time - leaves), rate};
}

Bench::Bench(const Session& session, const json& world, std::uint64_t seed)
    : session_(session),
      window_(window_of(session)),
      motion_(session),
      engine_(sim::make_causal_engine(sim::parse_world(world.dump()), seed, &exact_, &counts_)),
      range_(static_cast<std::size_t>(window_.last - window_.first + 1)),
      intensity_(range_.size()) {
  stage_at_ = [this](double time) { return motion_.at(time); };
}

void Bench::scan(std::size_t index, int seq) {
  const Capture& capture = session_.captures[index];
  if (static_cast<int>(index) != placed_) {
    place(capture);
    placed_ = static_cast<int>(index);
  }
  engine_->scan(capture.since_power_on_s + capture.first_scan_s + seq / session_.scan_hz, stage_at_, range_,
                intensity_);
}

void Bench::place(const Capture& capture) {
  sim::SceneState state;
  state.temperature_c = capture.temperature_c;
  if (shifted_ >= 0) {  // back to its place
    state.target = session_.walls[static_cast<std::size_t>(shifted_)].name;
    engine_->set_scene(state);
  }
  if (capture.target >= 0) {
    state.target = session_.walls[static_cast<std::size_t>(capture.target)].name;
    state.target_shift_mm = capture.shift_mm;
    state.reflectance = capture.reflectance;
  }
  engine_->set_scene(state);
  shifted_ = capture.target;
}

Table::Table(const Session& session, json world, bool each_scan, bool of_counts) : each_scan_(each_scan) {
  world["counter"]["jitter_ns"] = 0;
  world["receiver"]["noise"] = 0;
  world["receiver"]["counts_noise"] = 0;
  if (world.contains("air")) world["air"]["dust_per_m"] = 0;
  if (world.contains("light")) world.erase("light");
  world["rotor"]["index_jitter_deg"] = 0;
  Bench bench(session, world, 1);
  for (std::size_t c = 0; c < session.captures.size(); ++c) {
    const Capture& capture = session.captures[c];
    auto& rows = rows_.emplace_back();
    for (int seq = 0; seq < (each_scan ? capture.scans : 1); ++seq) {
      bench.scan(c, seq);
      auto& row = rows.emplace_back();
      for (int step = capture.first_step; step <= capture.last_step; ++step)
        row.push_back(
            static_cast<float>(of_counts ? std::log(bench.exact_counts(step)) : bench.exact_mm(step)));
    }
  }
}

double Table::at(const Moment& m) const {
  const auto& rows = rows_[m.capture_index];
  const auto& row = rows[each_scan_ ? static_cast<std::size_t>(m.seq) : 0];
  return static_cast<double>(row[static_cast<std::size_t>(m.step - m.capture->first_step)]);
}

}  // namespace challenge
