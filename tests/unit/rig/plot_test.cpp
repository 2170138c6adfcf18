// SPDX-License-Identifier: MIT
#include "rig/report/plot.hpp"

#include <sys/resource.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace plot_test {

using rig::Plot;
using rig::Series;

TEST_CASE("a plot is one SVG element with its labels, the same bytes each time") {
  const Plot plot{"Edge <profile>",
                  "stage angle (deg)",
                  "range (mm)",
                  {{"mean", Series::Style::errorbars, {0, 1, 2}, {5, std::nan(""), 7}, {0.1, 0.1, 0.2}}}};
  const std::string svg = rig::to_svg(plot);
  CHECK(svg.rfind("<svg", 0) == 0);
  CHECK(svg.find("</svg>") != std::string::npos);
  CHECK(svg.find("currentColor") == std::string::npos);
  CHECK(svg.find("stage angle (deg)") != std::string::npos);
  CHECK(svg == rig::to_svg(plot));
}

TEST_CASE("a disk that takes a part of a picture's points only is told, and no part of a picture drawn") {
  Plot plot{"Walk", "x", "y", {{"mean", Series::Style::points, {}, {}, {}}}};
  for (int i = 0; i < 2000; ++i) plot.series[0].x.push_back(i), plot.series[0].y.push_back(i);
  const auto before = std::signal(SIGXFSZ, SIG_IGN);
  rlimit whole{}, full{};
  ::getrlimit(RLIMIT_FSIZE, &whole);
  full = whole, full.rlim_cur = 8192;
  ::setrlimit(RLIMIT_FSIZE, &full);
  const std::string svg = rig::to_svg(plot);
  ::setrlimit(RLIMIT_FSIZE, &whole);
  std::signal(SIGXFSZ, before);
  CHECK(svg.find("no room for a temporary file, picture left out") != std::string::npos);
}

TEST_CASE("hostile text in a plot stays text") {
  const Plot plot{"'; system 'touch /tmp/rig-plot-hostile'",
                  "x",
                  "y",
                  {{"it's", Series::Style::line, {0, 1}, {0, 1}, {}}}};
  const std::string svg = rig::to_svg(plot);
  CHECK(svg.find("system") != std::string::npos);
  FILE* made = fopen("/tmp/rig-plot-hostile", "r");
  CHECK(made == nullptr);
  if (made) fclose(made);
}

TEST_CASE("a plot without a finite point says so instead of failing") {
  CHECK(rig::to_svg({"Empty", "x", "y", {{"none", Series::Style::points, {std::nan("")}, {1}, {}}}})
            .find("nothing to draw") != std::string::npos);
}

TEST_CASE("a plot is read from a result document, gaps included") {
  const auto plot = rig::plot_from_json(nlohmann::json::parse(
      R"j({"title":"t","x_label":"x (mm)","y_label":"y (mm)","equal_axes":true,
          "series":[{"name":"a","style":"ellipse","x":[1,null],"y":[2,3]}]})j"));
  REQUIRE(plot.series.size() == 1);
  CHECK(plot.equal_axes);
  CHECK(plot.series[0].style == Series::Style::ellipse);
  CHECK(std::isnan(plot.series[0].x[1]));
}

TEST_CASE("the marks of a map are apart enough to be read, and a wide scene has no empty height") {
  if (std::system("command -v gnuplot >/dev/null 2>&1") != 0) {
    WARN("skipped: gnuplot is not installed");
    return;
  }
  Plot plot{"Far", "x (mm)", "y (mm)", {{"wall", Series::Style::points, {0, 9800}, {0, 1400}, {}}}};
  plot.equal_axes = true;
  plot.height_px = 560;
  const std::string svg = rig::to_svg(plot);
  CHECK(svg.find("> 4000</text>") != std::string::npos);
  CHECK(svg.find("> 600</text>") == std::string::npos);
  CHECK(svg.find("viewBox=\"0 0 720 260\"") != std::string::npos);
  plot.series[0].x = plot.series[0].y = {5, 5};  // No extent at all.
  CHECK(rig::to_svg(plot).find("</svg>") != std::string::npos);
}

TEST_CASE("axes end near the data: a share is not drawn below nought") {
  if (std::system("command -v gnuplot >/dev/null 2>&1") != 0) {
    WARN("skipped: gnuplot is not installed");
    return;
  }
  const std::string svg = rig::to_svg(
      {"Share", "stage angle (deg)", "share", {{"a", Series::Style::points, {0, 1, 2}, {0, 0.4, 1}, {}}}});
  CHECK(svg.find("-0.2</text>") == std::string::npos);
  CHECK(svg.find("> 1.2</text>") == std::string::npos);
  CHECK(svg.find("> 0.8</text>") != std::string::npos);
}

TEST_CASE("the figures of the y axis do not overlap in a low picture") {
  if (std::system("command -v gnuplot >/dev/null 2>&1") != 0) {
    WARN("skipped: gnuplot is not installed");
    return;
  }
  constexpr double font_px = 13;
  Plot plot{"Low",
            "difference / standard uncertainty",
            "share",
            {{"a", Series::Style::line, {-4, 0, 4}, {0, 0.134, 0}, {}}}};
  for (const int height_px : {220, 240, 300, 400}) {
    plot.height_px = height_px;
    const std::string svg = rig::to_svg(plot);
    // Figures of the y axis end at one place beside it; the key's text ends elsewhere.
    std::vector<double> at_px;
    std::string column;
    for (std::size_t at = 0; (at = svg.find("<g transform=\"translate(", at)) != std::string::npos; ++at) {
      const std::string tag = svg.substr(at, svg.find('>', at) - at);
      if (tag.find("text-anchor=\"end\"") == std::string::npos) continue;
      const std::string place = tag.substr(tag.find('(') + 1);
      if (column.empty()) column = place.substr(0, place.find(','));
      if (place.starts_with(column + ",")) at_px.push_back(std::atof(place.c_str() + column.size() + 1));
    }
    INFO(height_px);
    REQUIRE(at_px.size() >= 2);
    for (std::size_t i = 1; i < at_px.size(); ++i) CHECK(at_px[i - 1] - at_px[i] > 1.2 * font_px);
  }
  // Rounding alone is no reason for figures.
  plot.series[0].y = {5, 5 + 1e-12, 5};
  CHECK(rig::to_svg(plot).find("</svg>") != std::string::npos);
}

TEST_CASE("dates are written as dates, and the label of an axis is broken to its length") {
  if (std::system("command -v gnuplot >/dev/null 2>&1") != 0) {
    WARN("skipped: gnuplot is not installed");
    return;
  }
  Plot plot{"History",
            "date",
            "Range error at the reference condition (200 mm, 2040 counts)",
            {{"a", Series::Style::errorbars, {1796000000, 1796800000}, {1, 2}, {0.1, 0.1}}}};
  plot.x_is_date = true, plot.height_px = 320;
  const std::string svg = rig::to_svg(plot);
  CHECK(svg.find("2026-12-0") != std::string::npos);
  CHECK(svg.find("2026.9") == std::string::npos);
  CHECK(svg.find("Range error at the reference<") != std::string::npos);
}

TEST_CASE("points are drawn in the colour of their series") {
  if (std::system("command -v gnuplot >/dev/null 2>&1") != 0) {
    WARN("skipped: gnuplot is not installed");
    return;
  }
  rig::Plot plot;
  plot.series.push_back({"before", rig::Series::Style::points, {1, 2, 3}, {1, 2, 3}, {}});
  plot.series.push_back({"after", rig::Series::Style::points, {1, 2, 3}, {3, 2, 1}, {}});
  const std::string svg = rig::to_svg(plot);
  const auto count = [&svg](const std::string& part) {
    int found = 0;
    for (std::size_t at = 0; (at = svg.find(part, at)) != std::string::npos; ++at) ++found;
    return found;
  };
  CHECK(count("stroke='none' fill='rgb(  0, 114, 178)' transform=") == 4);  // Three, and the key's.
  CHECK(count("stroke='none' fill='rgb(213,  94,   0)' transform=") == 4);
  CHECK(count("currentColor") == 0);
}

}  // namespace plot_test
