// SPDX-License-Identifier: MIT
#include "rig/stage/stage_factory.hpp"

#include <libserialport.h>

#include <algorithm>
#include <array>
#include <boost/asio/use_awaitable.hpp>
#include <cmath>
#include <cstdio>
#include <functional>
#include <nlohmann/json.hpp>
#include <utility>

#include "rig/stage/stage_driver.hpp"
#include "rig/stage/stage_language.hpp"

namespace rig {

using boost::asio::awaitable;
using nlohmann::json;

namespace stages {
std::vector<StageLanguage> all();  // Generated from the files in languages/.
}

namespace {

constexpr double probe_reply_s = 0.15;  ///< Who is there answers at once; three attempts in each language.

[[noreturn]] void wrong(const std::string& key, const json& value, const std::string& expected) {
  throw UsageError("the stage's `" + key + "` is " + value.dump() + ", but must be " + expected +
                   ". Correct it in the bench file or in the stage's URL.");
}

double number(const std::string& key, const json& value, double least, double most,
              const std::string& expected) {
  if (!value.is_number() || !(value.get<double>() >= least) || !(value.get<double>() <= most))
    wrong(key, value, expected);
  return value.get<double>();
}

int whole(const std::string& key, const json& value, int least, int most) {
  const std::string expected = "a whole number from " + std::to_string(least) + " to " + std::to_string(most);
  const double result = number(key, value, least, most, expected);
  if (result != std::floor(result)) wrong(key, value, expected);
  return static_cast<int>(result);
}

std::string known_languages() {
  std::string names;
  for (const StageLanguage& language : stages::all())
    for (const std::string& name : language.names) names += (names.empty() ? "" : ", ") + name;
  return names;
}

const StageLanguage* find_language(const std::vector<StageLanguage>& all, const std::string& name) {
  for (const StageLanguage& language : all)
    if (std::ranges::count(language.names, name) > 0) return &language;
  return nullptr;
}

void set_limits(StageOptions& options, const json& value) {
  const std::string expected = "two angles in degrees, the smaller first";
  if (!value.is_array() || value.size() != 2) wrong("limits_deg", value, expected);
  options.min_deg = number("limits_deg", value[0], -1e6, 1e6, expected);
  options.max_deg = number("limits_deg", value[1], options.min_deg, 1e6, expected);
}

/// False if there is no such key.
bool set_option(StageOptions& options, const std::string& key, const json& value) {
  const auto text = [&] {
    return value.is_string() ? value.get<std::string>() : (wrong(key, value, "text"), "");
  };
  const auto positive = [&](double most) {
    return number(key, value, 1e-9, most, "a number above 0, at most " + json(most).dump());
  };
  const auto from_zero = [&](double most) {
    return number(key, value, 0, most, "a number from 0 to " + json(most).dump());
  };
  if (key == "language") {
    options.language = text();
    const auto all = stages::all();
    if (!options.language.empty() && find_language(all, options.language) == nullptr)
      wrong(key, value, "one of " + known_languages());
  } else if (key == "model") {
    options.model = text();
  } else if (key == "units_per_deg") {
    options.units_per_deg = positive(1e9);
  } else if (key == "units_per_turn") {
    options.units_per_deg = positive(1e12) / 360;
  } else if (key == "direction") {
    options.direction = whole(key, value, -1, 1);
    if (options.direction == 0) wrong(key, value, "1 or -1");
  } else if (key == "zero_deg") {
    options.zero_deg = number(key, value, -1e6, 1e6, "an angle in degrees");
  } else if (key == "limits_deg") {
    set_limits(options, value);
  } else if (key == "min_deg") {
    options.min_deg = number(key, value, -1e6, 1e6, "an angle in degrees");
  } else if (key == "max_deg") {
    options.max_deg = number(key, value, -1e6, 1e6, "an angle in degrees");
  } else if (key == "speed_deg_s") {
    options.speed_deg_s = positive(1e4);
  } else if (key == "acceleration_deg_s2") {
    options.acceleration_deg_s2 = positive(1e6);
  } else if (key == "tolerance_deg") {
    options.tolerance_deg = positive(360);
  } else if (key == "settle_s") {
    options.settle_s = from_zero(600);
  } else if (key == "reply_s") {
    options.reply_s = positive(60);
  } else if (key == "home_s") {
    options.home_s = positive(3600);
  } else if (key == "needs_homing") {
    if (!value.is_boolean()) wrong(key, value, "true or false");
    options.needs_homing = value.get<bool>();
  } else if (key == "baud") {
    options.baud = whole(key, value, 300, 1000000);
  } else if (key == "address") {
    options.address = whole(key, value, 1, 99);
  } else if (key == "axis") {
    options.axis = whole(key, value, 1, 9);
  } else {
    return false;
  }
  return true;
}

struct PortUrl {
  PortUrl() {}
  std::string path;
  StageOptions options;
};

PortUrl parse_url(const std::string& url, StageOptions options) {
  const std::string scheme = "serial:";
  PortUrl result;
  result.options = std::move(options);
  std::string rest = url.starts_with(scheme) ? url.substr(scheme.size()) : url.starts_with("/") ? url : "";
  if (rest.starts_with("//")) rest.erase(0, 2);
  const std::size_t question = rest.find('?');
  result.path = rest.substr(0, question);
  if (result.path.empty())
    throw UsageError("the stage's address is '" + url +
                     "', but must be like serial:/dev/ttyUSB0 or serial:/dev/ttyUSB0?language=zaber. `rig "
                     "devices` lists what is "
                     "connected.");
  while (question != std::string::npos && rest.size() > question + 1) {
    const std::size_t begin = question + 1;
    const std::size_t end = std::min(rest.find('&', begin), rest.size());
    const std::string pair = rest.substr(begin, end - begin);
    rest.erase(begin, end - begin + 1);
    const std::size_t equals = pair.find('=');
    const std::string key = pair.substr(0, equals),
                      text = equals == std::string::npos ? "" : pair.substr(equals + 1);
    json value = json::parse(text, nullptr, false);
    if (value.is_discarded() || key == "model" || key == "language") value = text;
    if (!set_option(result.options, key, value))
      throw UsageError(
          "the stage's address has the option '" + key +
          "', which does not exist. Options are the keys of the bench "
          "file's stage (docs/operate/stages.md): language, baud, address, units_per_deg, settle_s ...");
  }
  if (!(result.options.min_deg <= result.options.max_deg))
    throw UsageError(
        "the stage's soft limits leave no angle: min_deg is above max_deg. Correct them in the bench file.");
  return result;
}

std::string usb_id(const sp_port* port) {
  int vendor = 0, product = 0;
  if (sp_get_port_transport(port) != SP_TRANSPORT_USB ||
      sp_get_port_usb_vid_pid(port, &vendor, &product) != SP_OK)
    return "";
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%04x:%04x", static_cast<unsigned>(vendor),
                static_cast<unsigned>(product));
  return text.data();
}

std::string text_or_empty(const char* text) { return text == nullptr ? "" : text; }

std::unique_ptr<SerialLink> open_link(const boost::asio::any_io_executor& executor, const PortUrl& port,
                                      const StageLanguage& language) {
  return std::make_unique<SerialLink>(executor, port.path,
                                      port.options.baud > 0 ? port.options.baud : language.baud,
                                      language.hardware_flow_control);
}

/// Who answers in this dialect. Throws when the port itself fails.
awaitable<StageProbe> who_answers(boost::asio::any_io_executor executor, PortUrl port,
                                  const StageLanguage& language, std::string dialect, double reply_s) {
  StageProbe answers;
  port.options.reply_s = reply_s;
  const auto link = open_link(executor, port, language);
  port.options.language.clear();  // What is only guessed must prove itself.
  const auto protocol = language.create(dialect, *link, port.options);
  try {
    answers.identity = printable(co_await protocol->identify());
  } catch (const StageRefusal& refusal) {  // Who refuses in words speaks the language.
    answers.heard = link->heard();
    answers.baud = link->baud();
    answers.refused = "a stage answers in the language " + dialect + ", but " + refusal.what();
  } catch (const StageError&) {
    answers.heard = link->heard();
    answers.baud = link->baud();
  }
  co_return answers;
}

/// The dialect spoken at the port, with who speaks it.
awaitable<StageProbe> find_quick_speaker(boost::asio::any_io_executor executor, PortUrl port,
                                         double reply_s) {
  StageProbe all_answers;
  auto all = stages::all();
  std::ranges::stable_sort(all, std::greater(), &StageLanguage::baud);  // Fast lines are asked sooner.
  for (const StageLanguage& language : all) {
    for (const std::string& dialect : language.names) {
      StageProbe answers = co_await who_answers(executor, port, language, dialect, reply_s);
      const bool says_more =
          all_answers.refused.empty() && (!answers.refused.empty() || all_answers.heard.empty());
      if (answers.identity || says_more) all_answers = answers;
      if (answers.identity) co_return all_answers;
    }
  }
  co_return all_answers;
}

/// As above. A stage that is said to be slow is asked again with the patience that it needs.
awaitable<StageProbe> find_speaker(boost::asio::any_io_executor executor, PortUrl port) {
  auto searching = find_quick_speaker(executor, port, probe_reply_s);
  StageProbe found = co_await std::move(searching);
  if (found.identity || port.options.reply_s <= StageOptions().reply_s) co_return found;
  auto searching_on = find_quick_speaker(executor, port, port.options.reply_s);
  co_return co_await std::move(searching_on);
}

}  // namespace

std::string StageProbe::why_nobody() const {
  if (!refused.empty()) return refused;
  const std::string languages = " in a language that the rig speaks (" + known_languages() + "). ";
  const std::string slow =
      " While it searches, the rig waits " + json(probe_reply_s).dump() +
      " s for an answer: for a slower stage state its `language` in the bench file, and `reply_s`.";
  if (heard.empty())
    return "nothing answers" + languages +
           "Check that the stage is switched on, its baud rate, and the `language` in the bench file." + slow;
  return "something answers, but not" + languages + "It said " + shown_bytes(heard) + " at " +
         std::to_string(baud) +
         " baud. The usual causes are another baud rate (`baud` in the bench file, or in the stage's address "
         "as in serial:/dev/ttyUSB0?baud=115200) and another device on this port." +
         slow;
}

StageOptions stage_options(const json& stage) {
  StageOptions options;
  if (stage.is_null()) return options;
  if (!stage.is_object())
    throw UsageError("the bench file's `stage` must be an object such as {\"language\": \"zaber\"}.");
  for (const auto& [key, value] : stage.items()) set_option(options, key, value);
  return options;
}

awaitable<std::unique_ptr<Stage>> open_stage(boost::asio::any_io_executor executor, std::string url,
                                             StageOptions options) {
  PortUrl port = parse_url(url, std::move(options));
  const bool language_given = !port.options.language.empty();
  if (!language_given) {
    const StageProbe found = co_await find_speaker(executor, port);
    if (!found.identity)
      throw StageError("at " + port.path + " " + found.why_nobody() + " Nothing was moved.");
    port.options.language = found.identity->language;
  }
  const auto all = stages::all();
  const StageLanguage* language = find_language(all, port.options.language);
  if (language == nullptr)
    throw UsageError("the rig does not speak the stage language '" + port.options.language +
                     "'. Choose one of " + known_languages() + ".");
  if (!port.options.zero_deg) port.options.zero_deg = language->zero_deg;
  auto link = open_link(executor, port, *language);
  const SerialLink& line = *link;  // lives as long as the stage
  auto protocol = language->create(port.options.language, *link, port.options);
  auto stage = std::make_unique<StageDriver>(executor, port.options, std::move(link), std::move(protocol));
  try {
    co_await stage->start();
  } catch (const StageLost& error) {
    if (!language_given || !line.heard().empty()) throw;
    throw StageLost(std::string(error.what()) + " It was asked in the language '" + port.options.language +
                    "' that the bench file or the stage's address names: without `language` the rig finds "
                    "out by asking in all of them, as `rig devices` does.");
  }
  co_return stage;
}

std::vector<SerialPortInfo> list_serial_ports() {
  sp_port** ports = nullptr;
  std::vector<SerialPortInfo> result;
  if (sp_list_ports(&ports) != SP_OK) return result;
  for (sp_port** port = ports; *port != nullptr; ++port) {
    SerialPortInfo info;
    info.path = text_or_empty(sp_get_port_name(*port));
    info.description = text_or_empty(sp_get_port_description(*port));
    info.usb_id = usb_id(*port);
    info.usb_product = text_or_empty(sp_get_port_usb_product(*port));
    info.usb_serial = text_or_empty(sp_get_port_usb_serial(*port));
    result.push_back(info);
  }
  sp_free_port_list(ports);
  return result;
}

awaitable<StageProbe> probe_stage(boost::asio::any_io_executor executor, std::string url) {
  auto searching = find_speaker(executor, parse_url(url, {}));
  co_return co_await std::move(searching);
}

}  // namespace rig
