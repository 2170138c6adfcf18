// SPDX-License-Identifier: MIT
#include "lidar/scip_request.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdio>

namespace lidar::scip {
namespace {

constexpr std::array<std::string_view, 7> single_scans = {"GD", "GS", "GE", "HD", "HE", "GF", "GG"};
constexpr std::array<std::string_view, 9> streamed_scans = {"MD", "MS", "ME",  "ND", "NE",
                                                            "MF", "MG", "%MD", "%ME"};

/// Commands and how many characters of parameters they take.
struct Plain {
  std::string_view command;
  std::size_t parameters;
};
constexpr std::array<Plain, 19> plain = {{{"VV", 0},
                                          {"PP", 0},
                                          {"II", 0},
                                          {"BM", 0},
                                          {"QT", 0},
                                          {"RS", 0},
                                          {"RT", 0},
                                          {"RB", 0},
                                          {"TM", 1},
                                          {"%TM", 1},
                                          {"%ST", 0},
                                          {"%SL", 0},
                                          {"SS", 6},
                                          {"HS", 1},
                                          {"CR", 2},
                                          {"DB", 2},
                                          {"$IP", 36},
                                          {"SCIP2.0", 0},
                                          {"PR", 0}}};

template <class List>
bool contains(const List& list, std::string_view command) {
  return std::ranges::find(list, command) != list.end();
}

std::string number(int value, int digits) {
  char text[16];
  std::snprintf(text, sizeof text, "%0*d", digits, value);
  return text;
}

/// `digits` decimal digits from the front of `text`; false if one of them is none.
bool take_number(std::string_view& text, std::size_t digits, int& value) {
  value = 0;
  for (std::size_t i = 0; i < digits; ++i) {
    if (!std::isdigit(static_cast<unsigned char>(text[i]))) return false;
    value = 10 * value + (text[i] - '0');
  }
  text.remove_prefix(digits);
  return true;
}

tl::expected<Request, std::string> parse_scan(Request request, std::string_view body) {
  const bool streamed = request.streams();
  const std::size_t expected = streamed ? 13 : 10;
  if (body.size() < expected) return tl::unexpected<std::string>("0C");
  if (body.size() > expected) return tl::unexpected<std::string>("0D");
  if (!take_number(body, 4, request.first_step)) return tl::unexpected<std::string>("01");
  if (!take_number(body, 4, request.last_step)) return tl::unexpected<std::string>("02");
  if (!take_number(body, 2, request.cluster)) return tl::unexpected<std::string>("03");
  if (!streamed) return request;
  if (!take_number(body, 1, request.skip)) return tl::unexpected<std::string>("06");
  if (!take_number(body, 2, request.count)) return tl::unexpected<std::string>("07");
  return request;
}

}  // namespace

bool Request::streams() const { return contains(streamed_scans, command); }
bool Request::scans() const { return streams() || contains(single_scans, command); }

std::string Request::text() const {
  std::string out = command;
  if (scans()) {
    out += number(first_step, 4) + number(last_step, 4) + number(cluster, 2);
    if (streams()) out += number(skip, 1) + number(count, 2);
  } else {
    out += parameters;
  }
  return tag.empty() ? out : out + ";" + tag;
}

Request scan_request(const std::string& command, int first_step, int last_step, int cluster, int skip,
                     int count, const std::string& tag) {
  Request request;
  request.command = command;
  request.first_step = first_step;
  request.last_step = last_step;
  request.cluster = cluster;
  request.skip = request.streams() ? std::max(skip, 0) : -1;
  request.count = request.streams() ? std::max(count, 0) : -1;
  request.tag = tag;
  return request;
}

tl::expected<Request, std::string> parse_request(std::string_view line) {
  Request request;
  const std::size_t semicolon = line.find(';');
  if (semicolon != std::string_view::npos) {
    request.tag = std::string(line.substr(semicolon + 1));
    line = line.substr(0, semicolon);
    if (request.tag.size() > 16) return tl::unexpected<std::string>("0G");
    if (!std::ranges::all_of(request.tag, [](char c) { return c >= 0x20 && c < 0x7f; }))
      return tl::unexpected<std::string>("0H");
  }
  for (const std::size_t length : {std::size_t{3}, std::size_t{2}}) {
    const std::string_view command = line.substr(0, length);
    if (!contains(single_scans, command) && !contains(streamed_scans, command)) continue;
    if (command.empty()) continue;
    request.command = std::string(command);
    return parse_scan(std::move(request), line.substr(command.size()));
  }
  for (const Plain& known : plain) {
    if (!line.starts_with(known.command)) continue;
    request.command = std::string(known.command);
    request.parameters = std::string(line.substr(known.command.size()));
    if (request.parameters.size() < known.parameters) return tl::unexpected<std::string>("0C");
    if (request.parameters.size() > known.parameters) return tl::unexpected<std::string>("0D");
    return request;
  }
  return tl::unexpected<std::string>("0E");
}

}  // namespace lidar::scip
