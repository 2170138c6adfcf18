// SPDX-License-Identifier: MIT
#include <cmath>

#include "lidar/encoding.hpp"
#include "lidar/response.hpp"
#include "sim/fault_kind.hpp"

namespace sim {

namespace {

using P = const FaultParameters&;

constexpr std::string_view other_serial = "H2699999";

/// Changes one character of a lidar's answer into another that is allowed there, so that only the sum can
/// tell.
void spoil_sum(std::string& bytes, Random& random) {
  const std::size_t after_echo = bytes.find('\n');
  if (after_echo == std::string::npos || after_echo + 2 >= bytes.size()) return;
  for (int attempt = 0; attempt < 100; ++attempt) {
    const auto at =
        after_echo + 1 +
        static_cast<std::size_t>(random.uniform() * static_cast<double>(bytes.size() - after_echo - 1));
    if (!lidar::is_data_character(bytes[at])) continue;
    bytes[at] = static_cast<char>(0x30 + (bytes[at] - 0x30 + 1) % 64);
    return;
  }
}

std::string two_digits(std::size_t number) {
  const std::string digits = std::to_string(number % 100);
  return digits.size() < 2 ? "0" + digits : digits;
}

/// What the device does once the next scan has left: a stream that does not run yet comes to it as well.
void after_next_scan(FaultSite& site, std::function<void()> act) {
  site.lidar_messages.push_back({MessageFault::Of::scan, [act = std::move(act)](std::string&) { act(); }});
}

/// For some real seconds something is so.
void for_a_while(FaultSite& site, double seconds, const std::function<void(bool)>& set) {
  set(true);
  site.later(seconds, [set] { set(false); });
}

/// Every answer on the present connection is spoilt, or on the next when there is none.
void spoil_connection(FaultSite& site) {
  const std::uint64_t spoilt = site.bench.server->connections() + (site.bench.server->has_host() ? 0 : 1);
  site.always.push_back([&site, spoilt](std::string& message) {
    if (site.bench.server->connections() > spoilt) return false;
    spoil_sum(message, site.random);
    return true;
  });
}

/// What is done to bytes and connections on their way.
std::vector<FaultKind> faults_of_the_way() {
  return {
      {"lidar lose",
       "bytes of the next answer are lost",
       {{"bytes", 1}},
       true,
       [](FaultSite& site, P p) {
         site.lidar_out.push_back(
             [&site, n = count_of(p, "bytes")](std::string& bytes) { lose_bytes(bytes, n, site.random); });
       }},
      {"lidar flip",
       "bits of the next answer are flipped",
       {{"bits", 1}},
       true,
       [](FaultSite& site, P p) {
         site.lidar_out.push_back(
             [&site, n = count_of(p, "bits")](std::string& bytes) { flip_bits(bytes, n, site.random); });
       }},
      {"lidar checksum",
       "a character of the next answer is another one; only the sum tells",
       {},
       true,
       [](FaultSite& site, P) {
         site.lidar_out.push_back([&site](std::string& bytes) { spoil_sum(bytes, site.random); });
       }},
      {"lidar status",
       "the next answer is an error with this status, and the stream ends",
       {{"code", 98}},
       true,
       [](FaultSite& site, P p) {
         site.lidar_out.push_back([&site, code = two_digits(count_of(p, "code"))](std::string& bytes) {
           bytes = lidar::build_status_response(bytes.substr(0, bytes.find('\n')), code);
           site.bench.lidar->disconnected();
         });
       }},
      {"lidar split",
       "bytes leave in small pieces for a while",
       {{"bytes", 7}, {"s", 1}},
       true,
       [](FaultSite& site, P p) { site.bench.server->split_output(count_of(p, "bytes"), p.at("s")); }},
      {"lidar delay",
       "nothing leaves for a while",
       {{"s", 0.3}},
       true,
       [](FaultSite& site, P p) { site.bench.server->hold_output(p.at("s")); }},
      {"lidar lose-request",
       "the next request does not arrive",
       {},
       true,
       [](FaultSite& site, P) { site.lidar_in.push_back([](std::string& bytes) { bytes.clear(); }); }},
      {"lidar reset",
       "the connection is reset",
       {},
       true,
       [](FaultSite& site, P) { site.bench.server->reset_connection(); }},
      {"lidar half-open",
       "the connection is dead and nobody says so",
       {},
       true,
       [](FaultSite& site, P) { site.bench.server->abandon_connection(); }},
      {"lidar slow",
       "bytes leave slowly for a while",
       {{"bytes_per_s", 3000}, {"s", 1}},
       true,
       [](FaultSite& site, P p) { site.bench.server->slow_output(p.at("bytes_per_s"), p.at("s")); }},
      {"lidar reset-inside",
       "the connection is reset in the middle of the next answer",
       {},
       true,
       [](FaultSite& site, P) {
         site.lidar_out.push_back([&site](std::string& bytes) {
           bytes.resize(bytes.size() / 2);
           site.bench.server->reset_after_output();
         });
       }},
      {"lidar bad-connection",
       "every answer has a wrong checksum until the host reconnects (urg_node #57)",
       {},
       true,
       [](FaultSite& site, P) { spoil_connection(site); }},
      {"lidar refuse-connections",
       "the connection is reset and the port is closed for a while",
       {{"s", 1}},
       true,
       [](FaultSite& site, P p) {
         site.bench.server->reset_connection();
         site.bench.server->refuse_connections(p.at("s"));
       }},
      {"lidar dangling",
       "the connection is dead, and keeps others waiting for a while (urg_node #22)",
       {{"s", 1}},
       true,
       [](FaultSite& site, P p) {
         site.bench.server->serve_nobody(p.at("s"));
         site.bench.server->abandon_connection();
       }},
  };
}

/// What the device itself does.
std::vector<FaultKind> faults_of_the_device() {
  return {
      {"lidar reboot",
       "it restarts: the timer begins anew, the connection is reset",
       {},
       true,
       [](FaultSite& site, P) {
         site.bench.lidar->reboot(site.clock.now_s());
         site.bench.server->reset_connection();
       }},
      {"lidar left-streaming",
       "whoever connects next finds it streaming",
       {},
       true,
       [](FaultSite& site, P) {
         site.bench.server->keep_streaming_once();
         site.bench.server->drop_connection();
       }},
      {"lidar clock-jump",
       "its timer jumps",
       {{"ms", 1000}},
       true,
       [](FaultSite& site, P p) { site.bench.lidar->clock().shift_ms(std::llround(p.at("ms"))); }},
      {"lidar clock-wrap",
       "its 24-bit timer wraps soon",
       {{"ms", 500}},
       true,
       [](FaultSite& site, P p) {
         site.bench.lidar->clock().wrap_in_ms(site.clock.now_s(), std::llround(p.at("ms")));
       }},
      {"lidar clock-drift",
       "its clock, and with it its motor, runs fast by this from now on",
       {{"ppm", 300}},
       true,
       [](FaultSite& site, P p) { site.bench.lidar->clock().set_ppm(site.clock.now_s(), p.at("ppm")); }},
      {"lidar clock-stands",
       "its timer stands for a while",
       {{"s", 0.5}},
       true,
       [](FaultSite& site, P p) { site.bench.lidar->clock().stand(site.clock.now_s(), p.at("s")); }},
      {"lidar boot",
       "it restarts, and serves nobody until it is ready",
       {{"s", 1}},
       true,
       [](FaultSite& site, P p) {
         site.bench.lidar->reboot(site.clock.now_s());
         site.bench.server->serve_nobody(p.at("s"));
         site.bench.server->reset_connection();
       }},
      {"lidar stall",
       "the stream stops without a word",
       {},
       true,
       [](FaultSite& site, P) { after_next_scan(site, [&site] { site.bench.lidar->stall(); }); }},
      {"lidar laser-off",
       "the laser goes off by itself, and the stream stops without a word",
       {},
       true,
       [](FaultSite& site, P) { after_next_scan(site, [&site] { site.bench.lidar->switch_laser_off(); }); }},
      {"lidar self-check",
       "the stream pauses: this status, and 98 when it goes on",
       {{"code", 21}, {"s", 0.3}},
       true,
       [](FaultSite& site, P p) {
         after_next_scan(site, [&site, code = two_digits(count_of(p, "code")), s = p.at("s")] {
           site.bench.lidar->check_itself(site.clock.now_s(), s, code);
         });
       }},
      {"lidar wrong-mode",
       "the next stream is of distances alone, whatever is asked for",
       {},
       true,
       [](FaultSite& site, P) { site.bench.lidar->forget_intensities_once(); }},
      {"lidar deaf",
       "it answers nothing until it hears QT (reset=1: RS)",
       {{"reset", 0}},
       true,
       [](FaultSite& site, P p) {
         site.bench.lidar->heed_only(p.at("reset") != 0 ? UstDevice::Heeds::reset
                                                        : UstDevice::Heeds::quit_or_reset);
       }},
      {"lidar ignore-quit",
       "the next QTs are ignored (urg_stamped #103)",
       {{"times", 1}},
       true,
       [](FaultSite& site, P p) { site.bench.lidar->ignore_quits(static_cast<int>(count_of(p, "times"))); }},
      {"lidar scans-after-quit",
       "scans follow the next QT's acknowledgement",
       {{"scans", 3}},
       true,
       [](FaultSite& site, P p) {
         site.bench.lidar->send_after_quit(static_cast<int>(count_of(p, "scans")));
       }},
      {"lidar refuse-time",
       "TM0 is refused for a while (urg_stamped #115)",
       {{"s", 0.2}},
       true,
       [](FaultSite& site, P p) {
         for_a_while(site, p.at("s"), [&site](bool on) { site.bench.lidar->refuse_time_adjustment(on); });
       }},
      {"lidar error-state",
       "it is in its error state for a while: 0L to all but VV and II",
       {{"s", 1}},
       true,
       [](FaultSite& site, P p) {
         for_a_while(site, p.at("s"), [&site](bool on) { site.bench.lidar->set_error_state(on); });
       }},
      {"lidar other-device",
       "the connection is reset, and for a while another device answers",
       {{"s", 1}},
       false,
       [](FaultSite& site, P p) {
         const std::string own = site.bench.lidar->serial();
         if (own == other_serial) return;
         for_a_while(site, p.at("s"), [&site, own](bool on) {
           site.bench.lidar->change_serial(on ? std::string(other_serial) : own);
           site.bench.lidar->reboot(site.clock.now_s());
           site.bench.server->reset_connection();
         });
       }},
  };
}

std::vector<FaultKind> faults_of_messages() {
  std::vector<FaultKind> all;
  for (const MessageFault& fault : message_faults()) {
    FaultKind kind;
    kind.name = "lidar " + std::string(fault.name);
    kind.about = fault.about;
    const std::string parameter(fault.parameter);
    if (!parameter.empty()) kind.parameters = {{parameter, fault.usual}};
    kind.apply = [&fault, parameter](FaultSite& site, P p) {
      const double amount = parameter.empty() ? 0 : p.at(parameter);
      site.lidar_messages.push_back(
          {fault.of, [&site, &fault, amount](std::string& message) {
             const MessageFault::Context context{amount, site.previous_answer, site.random};
             fault.change(message, context);
           }});
    };
    all.push_back(std::move(kind));
  }
  return all;
}

std::vector<FaultKind> habits() {
  std::vector<FaultKind> all;
  for (const UstHabitName& habit : ust_habits)
    all.push_back({"lidar " + std::string(habit.name),
                   std::string(habit.about) + " (on=0: no longer)",
                   {{"on", 1}},
                   true,
                   [habit = habit.habit](FaultSite& site, P p) {
                     site.bench.lidar->set_habit(habit, p.at("on") != 0);
                   }});
  return all;
}

}  // namespace

std::vector<FaultKind> lidar_faults() {
  std::vector<FaultKind> all;
  for (const std::vector<FaultKind>& some :
       {faults_of_the_way(), faults_of_messages(), faults_of_the_device(), habits()})
    all.insert(all.end(), some.begin(), some.end());
  return all;
}

}  // namespace sim
