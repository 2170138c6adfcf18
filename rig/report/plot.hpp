// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace rig {

/// One set of points in a plot. `u` (same length, or empty) draws error bars of one standard uncertainty
/// times `u_factor`; non-finite points leave a gap.
struct Series {
  enum class Style { points, line, errorbars, steps, ellipse, band, bars };
  std::string name;
  Style style = Style::points;
  std::vector<double> x, y, u;
};

/// A picture with labelled axes. Units belong in the labels ("error (mm)").
struct Plot {
  std::string title, x_label, y_label;
  std::vector<Series> series;
  bool equal_axes = false;  ///< One millimetre is as long on x as on y: maps, ellipses.
  bool log_y = false;
  bool x_is_date = false;  ///< x: seconds since 1970, UTC.
  int width_px = 720, height_px = 400;
};

/// Draws the plot as an SVG element that can stand in HTML and prints well (gnuplot does the drawing; the
/// same plot gives the same bytes). Without gnuplot, with one that is not done within `longest`, or with
/// nothing to draw, an SVG that says so.
[[nodiscard]] std::string to_svg(const Plot& plot,
                                 std::chrono::milliseconds longest = std::chrono::seconds(30));

/// Reads the "plots" entries of a result document (docs/reference/result.md).
[[nodiscard]] Plot plot_from_json(const nlohmann::json& json);

}  // namespace rig
