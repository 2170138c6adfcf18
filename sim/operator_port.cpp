// SPDX-License-Identifier: MIT
#include "sim/operator_port.hpp"

#include <algorithm>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read_until.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/asio/write.hpp>
#include <list>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "sim/bound_port.hpp"

namespace sim {

namespace asio = boost::asio;
using asio::awaitable;
using asio::redirect_error;
using asio::use_awaitable;
using asio::ip::tcp;
using boost::system::error_code;
using nlohmann::json;

namespace {

constexpr std::size_t longest_line = 64 * 1024;

double number(const json& object, const std::string& key) {
  if (!object[key].is_number())
    throw std::invalid_argument("'" + key + "' must be a number, not " + object[key].dump());
  return object[key].get<double>();
}

}  // namespace

struct OperatorPort::Impl : std::enable_shared_from_this<OperatorPort::Impl> {
  Impl(const asio::any_io_executor& executor, const Options& options, Bench bench_)
      : acceptor(executor), bench(std::move(bench_)), targets(options.targets) {
    const tcp::endpoint endpoint(asio::ip::make_address(options.address), options.port);
    bind_port(acceptor, endpoint, "the operator's");
    acceptor.listen();
  }

  awaitable<void> accept();
  awaitable<void> serve(std::shared_ptr<tcp::socket> socket);
  std::string answer(const std::string& line);
  json obey(const json& request);
  void place(const json& what);

  tcp::acceptor acceptor;
  Bench bench;
  std::vector<std::string> targets;
  std::map<std::string, SceneState> placed;  ///< What a prompt does not mention stays as it is.
  double temperature_c = SceneState().temperature_c;
  std::list<std::weak_ptr<tcp::socket>> clients;
};

awaitable<void> OperatorPort::Impl::accept() {
  const auto self = shared_from_this();
  for (;;) {
    error_code failed;
    tcp::socket socket = co_await acceptor.async_accept(redirect_error(use_awaitable, failed));
    if (!acceptor.is_open()) co_return;
    if (failed) {  // Out of descriptors, say: it would fail again at once.
      asio::steady_timer soon(acceptor.get_executor(), std::chrono::milliseconds(100));
      co_await soon.async_wait(redirect_error(use_awaitable, failed));
      continue;
    }
    const auto client = std::make_shared<tcp::socket>(std::move(socket));
    clients.remove_if([](const std::weak_ptr<tcp::socket>& old) { return old.expired(); });
    clients.push_back(client);
    auto serving = serve(client);
    asio::co_spawn(acceptor.get_executor(), std::move(serving), asio::detached);
  }
}

awaitable<void> OperatorPort::Impl::serve(std::shared_ptr<tcp::socket> socket) {
  const auto self = shared_from_this();
  std::string received;
  for (;;) {
    error_code failed;
    auto buffer = asio::dynamic_buffer(received, longest_line);
    const std::size_t size =
        co_await asio::async_read_until(*socket, buffer, '\n', redirect_error(use_awaitable, failed));
    if (failed) co_return;
    const std::string reply = answer(received.substr(0, size - 1)) + "\n";
    received.erase(0, size);
    co_await asio::async_write(*socket, asio::buffer(reply), redirect_error(use_awaitable, failed));
    if (failed) co_return;
  }
}

std::string OperatorPort::Impl::answer(const std::string& line) {
  json reply;
  try {
    reply = obey(json::parse(line));
    reply["ok"] = true;
  } catch (const json::exception&) {
    reply = {
        {"ok", false},
        {"error", "not understood: one JSON object a line, such as {\"place\": {\"target\": \"board\"}}"}};
  } catch (const std::invalid_argument& error) {
    reply = {{"ok", false}, {"error", error.what()}};
  }
  return reply.dump();
}

json OperatorPort::Impl::obey(const json& request) {
  if (request.is_object() && request.size() == 1) {
    if (request.contains("place") && request["place"].is_object()) {
      place(request["place"]);
      return json::object();
    }
    if (request.contains("fault") && request["fault"].is_string()) {
      bench.fault(request["fault"].get<std::string>());
      return json::object();
    }
    if (request.contains("get") && request["get"] == "state") return bench.state();
  }
  throw std::invalid_argument("there is {\"place\": {...}}, {\"fault\": \"...\"} and {\"get\": \"state\"}");
}

void OperatorPort::Impl::place(const json& what) {
  for (const auto& [key, value] : what.items())
    if (key != "target" && key != "shift_mm" && key != "reflectance" && key != "temperature_c" &&
        key != "since_power_on_s")
      throw std::invalid_argument("'place' has no '" + key +
                                  "'; it has target, shift_mm, reflectance, temperature_c, since_power_on_s");
  const std::string target = what.contains("target") ? what["target"].get<std::string>() : "";
  if (!target.empty() && std::ranges::count(targets, target) == 0)
    throw std::invalid_argument("the bench has no target '" + target + "'");
  if (target.empty() && (what.contains("shift_mm") || what.contains("reflectance")))
    throw std::invalid_argument("'place' needs a target to shift it or to change its reflectance");
  SceneState scene = placed[target];
  scene.target = target;
  if (what.contains("shift_mm")) scene.target_shift_mm = number(what, "shift_mm");
  if (what.contains("reflectance")) scene.reflectance = number(what, "reflectance");
  constexpr double as_prompts_ask_s = 600;
  scene.held_s = what.contains("temperature_c") ? as_prompts_ask_s : 0;
  if (what.contains("temperature_c")) temperature_c = number(what, "temperature_c");
  scene.temperature_c = temperature_c;
  const bool switched = what.contains("since_power_on_s");
  const double since_s = switched ? number(what, "since_power_on_s") : 0;
  placed[target] = scene;
  bench.place(scene);
  if (switched) bench.switch_on(since_s);
}

OperatorPort::OperatorPort(const asio::any_io_executor& executor, const Options& options, Bench bench)
    : impl_(std::make_shared<Impl>(executor, options, std::move(bench))) {
  auto accepting = impl_->accept();
  asio::co_spawn(executor, std::move(accepting), asio::detached);
}

OperatorPort::~OperatorPort() {
  error_code ignored;
  impl_->acceptor.close(ignored);
  for (const auto& client : impl_->clients)
    if (const auto socket = client.lock()) socket->close(ignored);
}

std::uint16_t OperatorPort::port() const { return impl_->acceptor.local_endpoint().port(); }
std::string OperatorPort::answer(const std::string& line) { return impl_->answer(line); }

}  // namespace sim
