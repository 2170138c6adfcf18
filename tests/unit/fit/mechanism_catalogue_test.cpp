// SPDX-License-Identifier: MIT
// docs/method/mechanisms.md says of every mechanism what the code does.
#include <catch2/catch.hpp>
#include <fstream>
#include <map>
#include <sstream>

#include "fit/mechanism.hpp"

namespace mechanism_catalogue_test {
namespace {

/// The page's entries by mechanism, each on one line.
std::map<std::string, std::string> entries() {
  std::ifstream page(RIG_SOURCE_DIR "/docs/method/mechanisms.md");
  std::map<std::string, std::string> list;
  std::string line, id;
  while (std::getline(page, line)) {
    if (line.starts_with("## "))
      id = line.substr(3);
    else if (!id.empty())
      list[id] += line + " ";
  }
  return list;
}

/// By what the name says.
std::string unit_of(const std::string& name) {
  static const std::pair<const char*, const char*> by_end[] = {{"_mm_at_100_counts", "mm"},
                                                               {"_mm_per_100_counts", "mm"},
                                                               {"_mm_per_k", "mm/K"},
                                                               {"_per_k", "1/K"},
                                                               {"_deg2", "deg²"},
                                                               {"_mm", "mm"},
                                                               {"_deg", "deg"},
                                                               {"_ms", "ms"},
                                                               {"_s", "s"},
                                                               {"_hz", "Hz"},
                                                               {"_counts", "counts"}};
  for (const auto& [end, unit] : by_end)
    if (name.ends_with(end)) return unit;
  const bool in_counts = name == "intensity_scale" || name == "intensity_min" || name == "width";
  return in_counts ? "counts" : "1";
}

}  // namespace

TEST_CASE(
    "the page of mechanisms has every mechanism with its parameters, units and usual sizes, and no other") {
  const auto page = entries();
  CHECK(page.size() == fit::catalogue().size());
  for (const fit::Mechanism& m : fit::catalogue()) {
    INFO(m.id);
    REQUIRE(page.contains(m.id));
    const std::string& entry = page.at(m.id);
    std::size_t parameters = 0;
    for (std::size_t at = entry.find("- Parameters: "); at < entry.find("- Literature: ");
         at = entry.find('`', at + 1))
      ++parameters;
    CHECK(parameters == 1 + 2 * m.parameters.size());  // two quotes each
    for (const fit::Parameter& p : m.parameters) {
      std::ostringstream text;
      text << '`' << p.name << "` (" << unit_of(p.name) << ')';
      if (p.role == fit::Parameter::Role::size) text << ", usually " << p.typical;
      if (p.generalises) text << ", plain " << p.left_out();
      CHECK_THAT(entry, Catch::Contains(text.str() + (p.name == m.parameters.back().name ? " " : ";")));
    }
    for (const char* part : {"- Equation: ", "- Literature: ", "- Confused with: "})
      CHECK_THAT(entry, Catch::Contains(part));
    CHECK_THAT(entry, Catch::Contains("- What separates it: " + m.separate));
  }
}

}  // namespace mechanism_catalogue_test
