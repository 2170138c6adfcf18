// SPDX-License-Identifier: MIT
#include "sim/faults.hpp"

#include <algorithm>
#include <boost/asio/steady_timer.hpp>
#include <charconv>
#include <chrono>
#include <cmath>
#include <deque>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>

#include "lidar/encoding.hpp"
#include "lidar/response.hpp"
#include "sim/random.hpp"

namespace sim {

namespace asio = boost::asio;

namespace {

constexpr auto tick = std::chrono::milliseconds(5);
constexpr std::size_t most_events = 10000;
/// At most so many at once, should simulated time leap.
constexpr int most_at_once = 100;

using Parameters = std::map<std::string, double>;

std::size_t count_of(const Parameters& parameters, const std::string& name) {
  return static_cast<std::size_t>(std::clamp(parameters.at(name), 0.0, 1e6));
}

std::vector<std::string> words_of(const std::string& line) {
  std::istringstream in(line.substr(0, line.find('#')));
  std::vector<std::string> words;
  for (std::string word; in >> word;) words.push_back(word);
  return words;
}

/// A number with an optional s or ms.
double number_of(const std::string& word, const std::string& text) {
  double value = 0;
  const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), value);
  const std::string_view unit(end, static_cast<std::size_t>(text.data() + text.size() - end));
  if (failed != std::errc() || (!unit.empty() && unit != "s" && unit != "ms"))
    throw std::invalid_argument("'" + word +
                                "' is not understood: a number was expected, such as 12.5 or 12.5s");
  return unit == "ms" ? value / 1e3 : value;
}

/// Splits "s=0.4"; false if there is no '='.
bool split(const std::string& word, std::string& key, double& value) {
  const std::size_t equals = word.find('=');
  if (equals == std::string::npos) return false;
  key = word.substr(0, equals);
  value = number_of(word, word.substr(equals + 1));
  return true;
}

// --- what becomes of bytes ---

void lose(std::string& bytes, std::size_t count, Random& random) {
  if (bytes.empty()) return;
  const auto at = static_cast<std::size_t>(random.uniform() * static_cast<double>(bytes.size()));
  bytes.erase(at, count);
}

void flip(std::string& bytes, std::size_t count, Random& random) {
  for (std::size_t i = 0; i < count && !bytes.empty(); ++i) {
    char& c = bytes[static_cast<std::size_t>(random.uniform() * static_cast<double>(bytes.size()))];
    c = static_cast<char>(c ^ (1 << (random.bits() % 8)));
  }
}

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

}  // namespace

struct FaultInjector::Impl : std::enable_shared_from_this<FaultInjector::Impl> {
  using ByteFault = std::function<void(std::string& bytes)>;
  struct Kind {
    std::string name, about;
    Parameters parameters;  ///< With their defaults.
    bool at_random = true;  ///< Among those that chance picks.
    std::function<void(Impl&, const Parameters&)> apply;
  };
  struct Order {
    const Kind* kind = nullptr;  ///< Null: chance picks among `choices`.
    Parameters parameters;
    std::vector<const Kind*> choices;
    double due_s = 0, every_s = 0, rate = 0;
    bool over = false;
  };

  Impl(const asio::any_io_executor& executor, SimClock& clock_, const Bench& bench_, std::uint64_t seed)
      : clock(clock_), bench(bench_), random(seed), ticker(executor) {}

  static const std::vector<Kind>& kinds();
  static const Kind& kind_called(const std::string& name);
  [[nodiscard]] bool has_device(const Kind& kind) const {
    return kind.name.starts_with("lidar") ? bench.server != nullptr : bench.port != nullptr;
  }

  void attach();
  void wait_for_tick();
  void fire_due();
  void fire(const Kind& kind, const Parameters& parameters);
  Order parse(const std::vector<std::string>& words);
  void parse_random(Order& order, const std::vector<std::string>& words) const;
  /// Real seconds: what the bench's people do (plugging, switching) takes their time.
  void later(double seconds, std::function<void()> then);
  [[nodiscard]] double chance_s(double rate) { return -std::log(1 - random.uniform()) / rate; }

  SimClock& clock;
  Bench bench;
  Random random;
  asio::steady_timer ticker;
  std::vector<Order> orders;
  std::deque<FaultEvent> events;
  std::uint64_t count = 0;
  std::function<void(const FaultEvent&)> observer;
  std::vector<ByteFault> lidar_out, lidar_in, stage_in;  ///< For the next bytes that pass.
  std::vector<std::function<void(PtyPort::Passage&)>> stage_out;
  bool is_firing = false;
};

// --- the catalogue ---

const std::vector<FaultInjector::Impl::Kind>& FaultInjector::Impl::kinds() {
  using P = const Parameters&;
  const auto stage = [](StageFault fault) {
    return [fault](Impl& impl, P) { impl.bench.stage->inject(fault, impl.clock.now_s()); };
  };
  static const std::vector<Kind> all{
      {"lidar lose",
       "bytes of the next answer are lost",
       {{"bytes", 1}},
       true,
       [](Impl& impl, P p) {
         impl.lidar_out.push_back(
             [&impl, n = count_of(p, "bytes")](std::string& bytes) { lose(bytes, n, impl.random); });
       }},
      {"lidar flip",
       "bits of the next answer are flipped",
       {{"bits", 1}},
       true,
       [](Impl& impl, P p) {
         impl.lidar_out.push_back(
             [&impl, n = count_of(p, "bits")](std::string& bytes) { flip(bytes, n, impl.random); });
       }},
      {"lidar checksum",
       "a character of the next answer is another one; only the sum tells",
       {},
       true,
       [](Impl& impl, P) {
         impl.lidar_out.push_back([&impl](std::string& bytes) { spoil_sum(bytes, impl.random); });
       }},
      {"lidar status",
       "the next answer is an error with this status, and the stream ends",
       {{"code", 98}},
       true,
       [](Impl& impl, P p) {
         std::string code = std::to_string(count_of(p, "code") % 100);
         if (code.size() < 2) code.insert(0, "0");
         impl.lidar_out.push_back([&impl, code](std::string& bytes) {
           bytes = lidar::build_status_response(bytes.substr(0, bytes.find('\n')), code);
           impl.bench.lidar->disconnected();
         });
       }},
      {"lidar split",
       "bytes leave in small pieces for a while",
       {{"bytes", 7}, {"s", 1}},
       true,
       [](Impl& impl, P p) { impl.bench.server->split_output(count_of(p, "bytes"), p.at("s")); }},
      {"lidar delay",
       "nothing leaves for a while",
       {{"s", 0.3}},
       true,
       [](Impl& impl, P p) { impl.bench.server->hold_output(p.at("s")); }},
      {"lidar lose-request",
       "the next request does not arrive",
       {},
       true,
       [](Impl& impl, P) { impl.lidar_in.push_back([](std::string& bytes) { bytes.clear(); }); }},
      {"lidar reset",
       "the connection is reset",
       {},
       true,
       [](Impl& impl, P) { impl.bench.server->reset_connection(); }},
      {"lidar half-open",
       "the connection is dead and nobody says so",
       {},
       true,
       [](Impl& impl, P) { impl.bench.server->abandon_connection(); }},
      {"lidar reboot",
       "it restarts: the timer begins anew, the connection is reset",
       {},
       true,
       [](Impl& impl, P) {
         impl.bench.lidar->reboot(impl.clock.now_s());
         impl.bench.server->reset_connection();
       }},
      {"lidar left-streaming",
       "whoever connects next finds it streaming",
       {},
       true,
       [](Impl& impl, P) {
         impl.bench.server->keep_streaming_once();
         impl.bench.server->drop_connection();
       }},
      {"lidar clock-jump",
       "its timer jumps",
       {{"ms", 1000}},
       true,
       [](Impl& impl, P p) { impl.bench.lidar->shift_clock_ms(std::llround(p.at("ms"))); }},
      {"lidar clock-wrap",
       "its 24-bit timer wraps soon",
       {{"ms", 500}},
       true,
       [](Impl& impl, P p) {
         impl.bench.lidar->wrap_clock_in_ms(impl.clock.now_s(), std::llround(p.at("ms")));
       }},
      {"lidar refuse-queries",
       "VV and II are refused while it streams (on=0: no longer)",
       {{"on", 1}},
       true,
       [](Impl& impl, P p) { impl.bench.lidar->refuse_queries_while_streaming(p.at("on") != 0); }},

      {"stage lose-reply",
       "the next reply is lost",
       {},
       true,
       [](Impl& impl, P) {
         impl.stage_out.push_back([](PtyPort::Passage& passage) { passage.bytes.clear(); });
       }},
      {"stage lose",
       "bytes of the next reply are lost",
       {{"bytes", 1}},
       true,
       [](Impl& impl, P p) {
         impl.stage_out.push_back([&impl, n = count_of(p, "bytes")](PtyPort::Passage& passage) {
           lose(passage.bytes, n, impl.random);
         });
       }},
      {"stage flip",
       "bits of the next reply are flipped",
       {{"bits", 1}},
       true,
       [](Impl& impl, P p) {
         impl.stage_out.push_back([&impl, n = count_of(p, "bits")](PtyPort::Passage& passage) {
           flip(passage.bytes, n, impl.random);
         });
       }},
      {"stage split",
       "the next reply comes in two halves",
       {},
       true,
       [](Impl& impl, P) {
         impl.stage_out.push_back([](PtyPort::Passage& passage) { passage.split = true; });
       }},
      {"stage delay",
       "the next reply comes late",
       {{"s", 0.2}},
       true,
       [](Impl& impl, P p) {
         impl.stage_out.push_back([s = p.at("s")](PtyPort::Passage& passage) { passage.delay_s = s; });
       }},
      {"stage lose-command",
       "the next command does not arrive",
       {},
       true,
       [](Impl& impl, P) { impl.stage_in.push_back([](std::string& bytes) { bytes.clear(); }); }},
      {"stage garble-command",
       "bits of the next command are flipped",
       {{"bits", 1}},
       true,
       [](Impl& impl, P p) {
         impl.stage_in.push_back(
             [&impl, n = count_of(p, "bits")](std::string& bytes) { flip(bytes, n, impl.random); });
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
       [](Impl& impl, P p) {
         impl.bench.stage->inject(StageFault::dead, impl.clock.now_s());
         impl.later(p.at("s"),
                    [&impl] { impl.bench.stage->inject(StageFault::power_cycle, impl.clock.now_s()); });
       }},
      {"stage unplug",
       "its port is unplugged and comes back as another one",
       {{"s", 1}},
       true,
       [](Impl& impl, P p) {
         impl.bench.port->unplug();
         impl.later(p.at("s"), [&impl] { impl.bench.port->replug(); });
       }},
  };
  return all;
}

const FaultInjector::Impl::Kind& FaultInjector::Impl::kind_called(const std::string& name) {
  const auto found = std::ranges::find(kinds(), name, &Kind::name);
  if (found != kinds().end()) return *found;
  std::string known;
  for (const Kind& kind : kinds()) known += (known.empty() ? "" : ", ") + kind.name;
  throw std::invalid_argument("there is no fault '" + name + "'; there are " + known);
}

// --- reading orders ---

FaultInjector::Impl::Order FaultInjector::Impl::parse(const std::vector<std::string>& words) {
  Order order;
  order.due_s = clock.now_s();
  std::size_t next = 0;
  std::string key;
  double value = 0;
  if (next < words.size() && words[next] == "random") {
    parse_random(order, words);
    order.due_s += chance_s(order.rate);
    return order;
  }
  if (next < words.size() && split(words[next], key, value)) {
    if ((key != "at" && key != "every") || !(value >= 0) || (key == "every" && value < 1e-3))
      throw std::invalid_argument("'" + words[next] +
                                  "' is not understood: at=12.5s or every=60s was expected");
    if (key == "every") order.every_s = value;
    order.due_s = key == "at" ? value : order.due_s + value;
    ++next;
  }
  if (words.size() < next + 2)
    throw std::invalid_argument("a fault is missing, such as `lidar reset` or `stage stall`");
  order.kind = &kind_called(words[next] + " " + words[next + 1]);
  order.parameters = order.kind->parameters;
  for (next += 2; next < words.size(); ++next) {
    if (!split(words[next], key, value) || !order.parameters.contains(key))
      throw std::invalid_argument("the fault '" + order.kind->name + "' has no '" + words[next] + "'");
    order.parameters[key] = value;
  }
  return order;
}

void FaultInjector::Impl::parse_random(Order& order, const std::vector<std::string>& words) const {
  std::string key, wanted;
  double value = 0;
  for (std::size_t i = 1; i < words.size(); ++i) {
    if (!split(words[i], key, value))
      wanted += (wanted.empty() ? "" : " ") + words[i];
    else if (key == "rate" && value > 0)
      order.rate = value;
    else
      throw std::invalid_argument("'" + words[i] +
                                  "' is not understood: rate=0.02 was expected (faults a second)");
  }
  if (!(order.rate > 0))
    throw std::invalid_argument("random faults need a rate, such as rate=0.02 (faults a second)");
  for (const Kind& kind : kinds()) {
    const bool is_wanted =
        wanted.empty() ? kind.at_random
                       : kind.name == wanted || (kind.at_random && kind.name.starts_with(wanted + " "));
    if (is_wanted && has_device(kind)) order.choices.push_back(&kind);
  }
  if (order.choices.empty())
    throw std::invalid_argument("there are no faults '" + wanted +
                                "'; choose lidar, stage, or one by its name");
}

// --- when they happen ---

void FaultInjector::Impl::attach() {
  if (bench.server != nullptr) {
    ScipServer::Fault fault;
    fault.to_host = [this](std::string bytes, bool&) {
      for (const ByteFault& change : std::exchange(lidar_out, {})) change(bytes);
      fire_due();  // For the next answer.
      return bytes;
    };
    fault.is_due = [this] {
      const double now_s = clock.now_s();
      return !lidar_out.empty() ||
             std::ranges::any_of(orders, [now_s](const Order& order) { return order.due_s <= now_s; });
    };
    fault.to_device = [this](std::string bytes) {
      for (const ByteFault& change : std::exchange(lidar_in, {})) change(bytes);
      return bytes;
    };
    bench.server->set_fault(std::move(fault));
  }
  if (bench.port != nullptr)
    bench.port->set_line_fault([this](PtyPort::Direction direction, const std::string& bytes) {
      PtyPort::Passage passage(bytes);
      if (direction == PtyPort::Direction::to_device)
        for (const ByteFault& change : std::exchange(stage_in, {})) change(passage.bytes);
      else
        for (const auto& change : std::exchange(stage_out, {})) change(passage);
      return passage;
    });
  wait_for_tick();
}

void FaultInjector::Impl::wait_for_tick() {
  ticker.expires_after(tick);
  ticker.async_wait([self = shared_from_this()](const boost::system::error_code& stopped) {
    if (stopped) return;
    self->fire_due();
    self->wait_for_tick();
  });
}

void FaultInjector::Impl::later(double seconds, std::function<void()> then) {
  auto timer = std::make_shared<asio::steady_timer>(ticker.get_executor());
  timer->expires_after(
      std::chrono::duration_cast<asio::steady_timer::duration>(std::chrono::duration<double>(seconds)));
  timer->async_wait(
      [weak = weak_from_this(), timer, then = std::move(then)](const boost::system::error_code& stopped) {
        if (!stopped && !weak.expired()) then();
      });
}

void FaultInjector::Impl::fire_due() {
  if (is_firing) return;  // A fault may send bytes, which brings us here again.
  is_firing = true;
  const double now_s = clock.now_s();
  for (std::size_t i = 0; i < orders.size(); ++i) {
    for (int n = 0; n < most_at_once && !orders[i].over && orders[i].due_s <= now_s; ++n) {
      Order& order = orders[i];
      const Kind* kind = order.kind;
      if (kind == nullptr)
        kind = order.choices[static_cast<std::size_t>(random.uniform() *
                                                      static_cast<double>(order.choices.size()))];
      if (order.rate > 0)
        order.due_s += chance_s(order.rate);
      else if (order.every_s > 0)
        order.due_s += order.every_s;
      else
        order.over = true;
      fire(*kind, order.kind == nullptr ? kind->parameters : Parameters(order.parameters));
    }
  }
  std::erase_if(orders, [](const Order& order) { return order.over; });
  is_firing = false;
}

void FaultInjector::Impl::fire(const Kind& kind, const Parameters& parameters) {
  FaultEvent event{clock.now_s(), kind.name};
  for (const auto& [name, value] : parameters) {
    std::ostringstream text;
    text << " " << name << "=" << value;
    event.text += text.str();
  }
  kind.apply(*this, parameters);
  ++count;
  events.push_back(event);
  if (events.size() > most_events) events.pop_front();
  if (observer) observer(event);
}

// --- the outside ---

FaultInjector::FaultInjector(const asio::any_io_executor& executor, SimClock& clock, const Bench& bench,
                             std::uint64_t seed)
    : impl_(std::make_shared<Impl>(executor, clock, bench, seed)) {
  impl_->attach();
}

FaultInjector::~FaultInjector() {
  impl_->ticker.cancel();
  if (impl_->bench.server != nullptr) impl_->bench.server->set_fault({});
  if (impl_->bench.port != nullptr) impl_->bench.port->set_line_fault(nullptr);
}

void FaultInjector::add(const std::string& line) {
  const std::vector<std::string> words = words_of(line);
  if (words.empty()) throw std::invalid_argument("a fault is missing, such as `at=12.5s lidar reset`");
  Impl::Order order = impl_->parse(words);
  if (order.kind != nullptr && !impl_->has_device(*order.kind))
    throw std::invalid_argument("the fault '" + order.kind->name +
                                "' needs a device that this bench has not");
  impl_->orders.push_back(std::move(order));
  impl_->fire_due();
}

void FaultInjector::add_file(const std::string& path) {
  std::ifstream in(path);
  if (!in)
    throw std::invalid_argument("cannot read the faults in " + path + ": check the name and the permission");
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (words_of(line).empty()) continue;
    try {
      add(line);
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument(path + ":" + std::to_string(number) + ": " + error.what());
    }
  }
}

void FaultInjector::observe(std::function<void(const FaultEvent&)> observer) {
  impl_->observer = std::move(observer);
}

std::vector<FaultEvent> FaultInjector::events() const { return {impl_->events.begin(), impl_->events.end()}; }
std::uint64_t FaultInjector::count() const { return impl_->count; }

std::string FaultInjector::catalogue() {
  std::string text;
  for (const Impl::Kind& kind : Impl::kinds()) {
    std::ostringstream line;
    line << kind.name;
    for (const auto& [name, value] : kind.parameters) line << " " << name << "=" << value;
    text += line.str() + std::string(line.str().size() < 32 ? 32 - line.str().size() : 1, ' ') + kind.about +
            (kind.at_random ? "" : " (never at random)") + "\n";
  }
  return text;
}

}  // namespace sim
