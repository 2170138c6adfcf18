// SPDX-License-Identifier: MIT
#include "sim/faults.hpp"

#include <algorithm>
#include <boost/asio/steady_timer.hpp>
#include <charconv>
#include <chrono>
#include <cmath>
#include <deque>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "sim/fault_kind.hpp"

namespace sim {

namespace asio = boost::asio;

namespace {

constexpr auto tick = std::chrono::milliseconds(5);
constexpr std::size_t most_events = 10000;
/// At most so many at once, should simulated time leap.
constexpr int most_at_once = 100;

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

}  // namespace

// --- what becomes of bytes ---

std::size_t count_of(const FaultParameters& parameters, const std::string& name) {
  return static_cast<std::size_t>(std::clamp(parameters.at(name), 0.0, 1e6));
}

void lose_bytes(std::string& bytes, std::size_t count, Random& random) {
  if (bytes.empty()) return;
  const auto at = static_cast<std::size_t>(random.uniform() * static_cast<double>(bytes.size()));
  bytes.erase(at, count);
}

void flip_bits(std::string& bytes, std::size_t count, Random& random) {
  for (std::size_t i = 0; i < count && !bytes.empty(); ++i) {
    char& c = bytes[static_cast<std::size_t>(random.uniform() * static_cast<double>(bytes.size()))];
    c = static_cast<char>(c ^ (1 << (random.bits() % 8)));
  }
}

struct FaultInjector::Impl final : FaultSite, std::enable_shared_from_this<FaultInjector::Impl> {
  using Kind = FaultKind;
  using Parameters = FaultParameters;
  struct Order {
    const Kind* kind = nullptr;  ///< Null: chance picks among `choices`.
    Parameters parameters;
    std::vector<const Kind*> choices;
    double due_s = 0, every_s = 0, rate = 0;
    bool over = false;
  };

  Impl(const asio::any_io_executor& executor, SimClock& clock_, const Bench& bench_, std::uint64_t seed)
      : FaultSite(clock_, bench_, seed), ticker(executor) {}

  static const std::vector<Kind>& kinds();
  static const Kind& kind_called(const std::string& name);
  [[nodiscard]] bool has_device(const Kind& kind) const {
    return kind.name.starts_with("lidar") ? bench.server != nullptr : bench.port != nullptr;
  }

  void attach();
  std::string pass_to_host(std::string bytes);
  void change_message(std::string& message);
  void wait_for_tick();
  void fire_due();
  void fire(const Kind& kind, const Parameters& parameters);
  Order parse(const std::vector<std::string>& words);
  void parse_random(Order& order, const std::vector<std::string>& words) const;
  void later(double seconds, std::function<void()> then) override;
  [[nodiscard]] double chance_s(double rate) { return -std::log(1 - random.uniform()) / rate; }

  asio::steady_timer ticker;
  std::vector<Order> orders;
  std::deque<FaultEvent> events;
  std::uint64_t count = 0;
  std::function<void(const FaultEvent&)> observer;
  bool is_firing = false;
};

const std::vector<FaultKind>& FaultInjector::Impl::kinds() {
  static const std::vector<FaultKind> all = [] {
    std::vector<FaultKind> kinds = lidar_faults();
    const std::vector<FaultKind> of_stage = stage_faults();
    kinds.insert(kinds.end(), of_stage.begin(), of_stage.end());
    return kinds;
  }();
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
      bytes = pass_to_host(std::move(bytes));
      fire_due();  // For the next answer.
      return bytes;
    };
    fault.is_due = [this] {
      const double now_s = clock.now_s();
      const bool is_waited_for = std::ranges::any_of(lidar_messages, [](const WaitingFault& waiting) {
        return waiting.of != MessageFault::Of::parameters;
      });
      return !lidar_out.empty() || is_waited_for ||
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

std::string FaultInjector::Impl::pass_to_host(std::string bytes) {
  for (const ByteFault& change : std::exchange(lidar_out, {})) change(bytes);
  if (lidar_messages.empty() && always.empty() && concerns(MessageFault::Of::scan, bytes)) return bytes;
  std::string out;
  for (std::size_t begin = 0; begin < bytes.size();) {
    const std::size_t empty_line = bytes.find("\n\n", begin);
    const std::size_t end = empty_line == std::string::npos ? bytes.size() : empty_line + 2;
    std::string message = bytes.substr(begin, end - begin);
    begin = end;
    const std::string as_sent = message;
    change_message(message);
    if (!concerns(MessageFault::Of::scan, as_sent)) previous_answer = as_sent;
    out += message;
  }
  return out;
}

/// Faults that wait for such a message act on it, once.
void FaultInjector::Impl::change_message(std::string& message) {
  std::vector<WaitingFault> due;
  for (std::size_t i = 0; i < lidar_messages.size();) {
    if (!concerns(lidar_messages[i].of, message)) {
      ++i;
      continue;
    }
    due.push_back(std::move(lidar_messages[i]));
    lidar_messages.erase(lidar_messages.begin() + static_cast<std::ptrdiff_t>(i));
  }
  for (const WaitingFault& fault : due) fault.change(message);
  std::erase_if(always, [&message](const auto& change) { return !change(message); });
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
