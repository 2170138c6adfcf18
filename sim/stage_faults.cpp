// SPDX-License-Identifier: MIT
#include "sim/fault_kind.hpp"

namespace sim {

std::vector<FaultKind> stage_faults() {
  using P = const FaultParameters&;
  const auto stage = [](StageFault fault) {
    return [fault](FaultSite& site, P) { site.bench.stage->inject(fault, site.clock.now_s()); };
  };
  return {
      {"stage lose-reply",
       "the next reply is lost",
       {},
       true,
       [](FaultSite& site, P) {
         site.stage_out.push_back([](PtyPort::Passage& passage) { passage.bytes.clear(); });
       }},
      {"stage lose",
       "bytes of the next reply are lost",
       {{"bytes", 1}},
       true,
       [](FaultSite& site, P p) {
         site.stage_out.push_back([&site, n = count_of(p, "bytes")](PtyPort::Passage& passage) {
           lose_bytes(passage.bytes, n, site.random);
         });
       }},
      {"stage flip",
       "bits of the next reply are flipped",
       {{"bits", 1}},
       true,
       [](FaultSite& site, P p) {
         site.stage_out.push_back([&site, n = count_of(p, "bits")](PtyPort::Passage& passage) {
           flip_bits(passage.bytes, n, site.random);
         });
       }},
      {"stage split",
       "the next reply comes in two halves",
       {},
       true,
       [](FaultSite& site, P) {
         site.stage_out.push_back([](PtyPort::Passage& passage) { passage.split = true; });
       }},
      {"stage delay",
       "the next reply comes late",
       {{"s", 0.2}},
       true,
       [](FaultSite& site, P p) {
         site.stage_out.push_back([s = p.at("s")](PtyPort::Passage& passage) { passage.delay_s = s; });
       }},
      {"stage lose-command",
       "the next command does not arrive",
       {},
       true,
       [](FaultSite& site, P) { site.stage_in.push_back([](std::string& bytes) { bytes.clear(); }); }},
      {"stage garble-command",
       "bits of the next command are flipped",
       {{"bits", 1}},
       true,
       [](FaultSite& site, P p) {
         site.stage_in.push_back(
             [&site, n = count_of(p, "bits")](std::string& bytes) { flip_bits(bytes, n, site.random); });
       }},
      {"stage reject", "the next motion is refused", {}, true, stage(StageFault::reject_next)},
      {"stage stall",
       "the rotor stands in the middle of a motion; the controller says so",
       {},
       true,
       stage(StageFault::stall)},
      {"stage limit",
       "a limit switch is hit where none should be",
       {},
       true,
       stage(StageFault::limit_switch)},
      {"stage lose-position",
       "the rotor slips and nobody notices",
       {},
       false,
       stage(StageFault::lost_position)},
      {"stage alert-storm", "two hundred unsolicited lines", {}, true, stage(StageFault::alert_storm)},
      {"stage power-cycle",
       "power is lost and comes back: not homed",
       {},
       true,
       stage(StageFault::power_cycle)},
      {"stage dead",
       "it answers nothing for a while, then starts anew",
       {{"s", 3}},
       false,
       [](FaultSite& site, P p) {
         site.bench.stage->inject(StageFault::dead, site.clock.now_s());
         site.later(p.at("s"),
                    [&site] { site.bench.stage->inject(StageFault::power_cycle, site.clock.now_s()); });
       }},
      {"stage unplug",
       "its port is unplugged and comes back as another one",
       {{"s", 1}},
       true,
       [](FaultSite& site, P p) {
         site.bench.port->unplug();
         site.later(p.at("s"), [&site] { site.bench.port->replug(); });
       }},
  };
}

}  // namespace sim
