// SPDX-License-Identifier: MIT
#include "rig/report/plot.hpp"

#include <stdlib.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/algorithm/string/replace.hpp>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "rig/report/child_program.hpp"
#include "rig/report/html_text.hpp"

namespace rig {
namespace {

// Distinct in print and for colour-blind readers (Okabe and Ito 2008), paired with different marks.
constexpr std::array<const char*, 7> colours = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                                "#56b4e9", "#e69f00", "#000000"};
constexpr std::array<int, 7> marks = {7, 5, 9, 11, 13, 4, 6};

struct TemporaryFile {
  TemporaryFile() {
    std::string name =
        (getenv("TMPDIR") ? std::string(getenv("TMPDIR")) : std::string("/tmp")) + "/rig-plot-XXXXXX";
    descriptor = mkstemp(name.data());
    path = name;
  }
  ~TemporaryFile() {
    if (descriptor >= 0) {
      close(descriptor);
      unlink(path.c_str());
    }
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  int descriptor = -1;
  std::string path;
};

/// Text that may stand in an attribute too.
std::string escaped_xml(const std::string& text) {
  return boost::replace_all_copy(escaped(text), "\"", "&quot;");
}

/// A string that gnuplot prints as it stands: single-quoted, enhanced text off.
std::string gnuplot_quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) {
    if (c == '\'')
      out += "''";
    else if (c == '\n')
      out += ' ';
    else
      out += c;
  }
  return out + "'";
}

/// In lines of at most so many letters, broken between words.
std::string gnuplot_quoted(const std::string& text, std::size_t letters) {
  std::string lines, line;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    if (!line.empty() && line.size() + 1 + word.size() > letters) {
      lines += gnuplot_quoted(line) + ".\"\\n\".";
      line.clear();
    }
    line += (line.empty() ? "" : " ") + word;
  }
  return lines + gnuplot_quoted(line);
}

std::string message_svg(const Plot& plot, const std::string& message) {
  std::ostringstream out;
  out << "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" << plot.width_px << "\" height=\"60\">"
      << "<text x=\"10\" y=\"35\" font-family=\"sans-serif\" font-size=\"14\">"
      << escaped_xml(plot.title + ": " + message) << "</text></svg>";
  return out.str();
}

const char* draw_style(Series::Style style) {
  switch (style) {
    case Series::Style::points:
      return "points";
    case Series::Style::line:
      return "lines";
    case Series::Style::errorbars:
      return "yerrorbars";
    case Series::Style::steps:
      return "histeps";
    case Series::Style::ellipse:
      return "lines";
    case Series::Style::band:
      return "filledcurves";
    case Series::Style::bars:
      return "boxes";
  }
  return "points";
}

bool three_columns(Series::Style style) {
  return style == Series::Style::errorbars || style == Series::Style::band;
}

void write_data(std::ostream& out, const Series& series) {
  const std::size_t n = std::min(series.x.size(), series.y.size());
  for (std::size_t i = 0; i < n; ++i) {
    if (!std::isfinite(series.x[i]) || !std::isfinite(series.y[i])) {
      out << "\n";
      continue;
    }
    const double u = i < series.u.size() && std::isfinite(series.u[i]) ? series.u[i] : 0;
    if (series.style == Series::Style::band)
      out << series.x[i] << ' ' << series.y[i] - u << ' ' << series.y[i] + u << '\n';
    else
      out << series.x[i] << ' ' << series.y[i] << ' ' << u << '\n';
  }
  out << "e\n";
}

struct Extent {
  double low = INFINITY, high = -INFINITY;
  void include(double value) { low = std::min(low, value), high = std::max(high, value); }
  [[nodiscard]] double length() const { return high - low; }
};

/// The next of 1, 2, 5, 10, 20, ... (times any power of ten) that is not smaller.
double round_step(double least) {
  const double decade = std::pow(10, std::floor(std::log10(least)));
  for (const double step : {1.0, 2.0, 5.0})
    if (step * decade >= least) return step * decade;
  return 10 * decade;
}

/// Between the middles of two figures on the y axis.
constexpr int between_tics_px = 24;

/// The y axis has figures as far apart as they are readable: gnuplot's own choice overlaps in a low picture.
/// 0: as gnuplot likes, where nothing varies or the axis is logarithmic.
double y_tics(const Plot& plot, const std::vector<const Series*>& drawn) {
  Extent y;
  for (const Series* series : drawn)
    for (std::size_t i = 0; i < std::min(series->x.size(), series->y.size()); ++i) {
      const double u = i < series->u.size() && std::isfinite(series->u[i]) ? series->u[i] : 0;
      if (std::isfinite(series->x[i]) && std::isfinite(series->y[i]))
        y.include(series->y[i] - u), y.include(series->y[i] + u);
    }
  // What differs by rounding only does not vary.
  if (plot.log_y || !(y.length() > 1e-9 * std::max(std::abs(y.low), std::abs(y.high)))) return 0;
  constexpr int around_field_px = 170;  // Title, figures of the x axis, its label, key.
  return round_step(between_tics_px * y.length() /
                    std::max(plot.height_px - around_field_px, between_tics_px));
}

/// Whole days between two marks, so that dates do not overlap. In seconds.
double date_tics(const Plot& plot, const std::vector<const Series*>& drawn) {
  constexpr double day_s = 86400, date_px = 110;
  Extent x;
  for (const Series* series : drawn)
    for (const double at : series->x)
      if (std::isfinite(at)) x.include(at);
  const double intervals = std::max(1.0, plot.width_px / date_px - 1);
  return day_s * std::max(1.0, std::ceil(x.length() / intervals / day_s));
}

/// A map has one scale for both axes: marks are apart enough for their figures, and the picture is as high as
/// the scene asks for.
struct MapScale {
  double x_tics, y_tics;  ///< 0: as gnuplot likes.
  int height_px;
};

MapScale map_scale(const Plot& plot, const std::vector<const Series*>& drawn) {
  constexpr int margins_px = 150, least_px = 260, beside_px = 70;
  Extent x, y;
  for (const Series* series : drawn)
    for (std::size_t i = 0; i < std::min(series->x.size(), series->y.size()); ++i)
      if (std::isfinite(series->x[i]) && std::isfinite(series->y[i]))
        x.include(series->x[i]), y.include(series->y[i]);
  if (x.length() <= 0 || y.length() <= 0)
    return {0, 0, plot.height_px};  // One point, or one line along an axis.
  const double width_px = plot.width_px - margins_px;
  const double wanted_px = width_px * y.length() / x.length() + margins_px;
  const int height_px = static_cast<int>(std::clamp<double>(wanted_px, least_px, plot.height_px));
  const double scale = std::max(x.length() / width_px, y.length() / (height_px - margins_px));
  return {round_step(beside_px * scale), round_step(between_tics_px * scale), height_px};
}

std::string script_of(const Plot& plot, const std::vector<const Series*>& drawn) {
  std::ostringstream out;
  const MapScale map =
      plot.equal_axes ? map_scale(plot, drawn) : MapScale{0, y_tics(plot, drawn), plot.height_px};
  // The label stands beside the middle of the axis, which is above the picture's.
  constexpr int letter_px = 7, beside_label_px = 110;
  const auto letters = static_cast<std::size_t>(std::max(10, (map.height_px - beside_label_px) / letter_px));
  out.precision(12);
  out << "set terminal svg size " << plot.width_px << ',' << map.height_px
      << " noenhanced font 'sans-serif,13' background '#ffffff'\n"
      << "set encoding utf8\nset title " << gnuplot_quoted(plot.title) << "\nset xlabel "
      << gnuplot_quoted(plot.x_label) << "\nset ylabel " << gnuplot_quoted(plot.y_label, letters)
      << "\nset grid linecolor '#dddddd'\nset border 3\nset tics nomirror\n"
      << "set key outside bottom center horizontal height 1.2\nset autoscale noextend\n"
      << "set offsets graph 0.02, graph 0.02, graph 0.05, graph 0.05\n"
      << "set bars small\nset style fill solid 0.3 noborder\n";
  if (plot.equal_axes) out << "set size ratio -1\n";
  if (map.x_tics > 0) out << "set xtics " << map.x_tics << '\n';
  if (map.y_tics > 0) out << "set ytics " << map.y_tics << '\n';
  if (plot.log_y) out << "set logscale y\n";
  if (plot.x_is_date)
    out << "set xdata time\nset timefmt '%s'\nset format x '%Y-%m-%d'\nset xtics " << date_tics(plot, drawn)
        << '\n';
  out << "plot ";
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    const Series& series = *drawn[i];
    const auto style = series.style;
    const bool marked = style == Series::Style::points || style == Series::Style::errorbars;
    out << (i ? ", " : "") << "'-' using 1:2" << (three_columns(style) ? ":3" : "") << " with "
        << draw_style(style);
    if (style == Series::Style::band)
      out << " fillstyle transparent solid 0.2 linecolor rgb '" << colours[i % 7] << "'";
    else
      out << " linecolor rgb '" << colours[i % 7] << "'";
    if (marked)
      out << " pointtype " << marks[i % 7] << " pointsize " << (series.x.size() > 300 ? 0.35 : 0.9);
    else if (style == Series::Style::line || style == Series::Style::ellipse || style == Series::Style::steps)
      out << " linewidth 1.6";
    if (series.name.empty())
      out << " notitle";
    else
      out << " title " << gnuplot_quoted(series.name);
  }
  out << '\n';
  for (const Series* series : drawn) write_data(out, *series);
  return out.str();
}

void replace_all(std::string& text, const std::string& from, const std::string& to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
}

Series::Style style_from(const std::string& name) {
  using enum Series::Style;
  if (name == "line") return line;
  if (name == "errorbars") return errorbars;
  if (name == "steps") return steps;
  if (name == "ellipse") return ellipse;
  if (name == "band") return band;
  if (name == "bars") return bars;
  return points;
}

std::vector<double> numbers(const nlohmann::json& object, const char* key) {
  std::vector<double> out;
  if (!object.contains(key)) return out;
  for (const auto& value : object.at(key))
    out.push_back(value.is_number() ? value.get<double>() : std::nan(""));
  return out;
}

/// gnuplot's marker `gpPt<number>` as a shape of its own, about the origin and of unit size.
std::string marker(int number, const std::string& colour) {
  static const std::array<const char*, 8> outlines = {"M-1,0 h2 M0,-1 v2",
                                                      "M-1,-1 L1,1 M1,-1 L-1,1",
                                                      "M-1,0 h2 M0,-1 v2 M-1,-1 L1,1 M-1,1 L1,-1",
                                                      "M-1,-1 h2 v2 h-2 z",
                                                      "M-1,0 a1,1 0 1,0 2,0 a1,1 0 1,0 -2,0 z",
                                                      "M0,-1.33 L-1.33,0.67 h2.66 z",
                                                      "M0,1.33 L-1.33,-0.67 h2.66 z",
                                                      "M0,-1.41 L1.41,0 L0,1.41 L-1.41,0 z"};
  // From 3 on an outline is followed by its filled twin.
  const std::size_t shape =
      number < 3 ? static_cast<std::size_t>(number) : 3 + (static_cast<std::size_t>(number) - 3) / 2;
  const bool filled = number >= 4 && number % 2 == 0;
  return std::string("<path d='") + outlines[std::min(shape, outlines.size() - 1)] + "' " +
         (filled ? "stroke='none' fill='" + colour + "'"
                 : "stroke-width='0.22' fill='none' stroke='" + colour + "'");
}

std::string attribute(std::string_view tag, std::string_view name) {
  const std::string begin = std::string(name) + "='";
  const std::size_t at = tag.find(begin);
  if (at == std::string_view::npos) return "";
  const std::size_t from = at + begin.size();
  return std::string(tag.substr(from, tag.find('\'', from) - from));
}

/// gnuplot hands a marker's colour on as currentColor, on which WeasyPrint 57 fails: every marker gets its
/// own.
std::string with_coloured_markers(const std::string& svg) {
  const std::string begin = "<use xlink:href='#gpPt", end = "/>";
  std::string out;
  std::size_t at = 0;
  for (std::size_t next; (next = svg.find(begin, at)) != std::string::npos;) {
    const std::size_t stop = svg.find(end, next);
    if (stop == std::string::npos) break;
    const std::string_view tag(svg.data() + next, stop - next);
    const std::string colour = attribute(tag, "color");
    out.append(svg, at, next - at);
    if (colour.empty())
      out.append(tag);  // One of gnuplot's definitions.
    else
      out += marker(std::atoi(tag.data() + begin.size()), colour) + " transform='" +
             attribute(tag, "transform") + "'";
    at = stop;
  }
  out.append(svg, at);
  replace_all(out, "currentColor", "#000000");
  return out;
}

}  // namespace

std::string to_svg(const Plot& plot, std::chrono::milliseconds longest) {
  std::vector<const Series*> drawn;
  for (const Series& series : plot.series) {
    const std::size_t n = std::min(series.x.size(), series.y.size());
    bool any = false;
    for (std::size_t i = 0; i < n && !any; ++i)
      any = std::isfinite(series.x[i]) && std::isfinite(series.y[i]);
    if (any) drawn.push_back(&series);
  }
  if (drawn.empty()) return message_svg(plot, "nothing to draw");
  const TemporaryFile script;
  std::ofstream written(script.path);
  written << script_of(plot, drawn);
  written.close();  // gnuplot would draw a part of it without a word.
  if (script.descriptor < 0 || !written)
    return message_svg(plot, "no room for a temporary file, picture left out");
  ChildResult drawing = run_child({"gnuplot", script.path}, longest);
  if (drawing.end == ChildResult::End::hung)
    return message_svg(plot, hung_in_words("gnuplot", longest) + ", picture left out");
  std::string& svg = drawing.output;
  const std::size_t start = svg.find("<svg");
  if (start == std::string::npos || svg.find("</svg>") == std::string::npos)
    return message_svg(plot, drawing.end == ChildResult::End::missing
                                 ? "install gnuplot-nox to see this picture"
                                 : "gnuplot failed, picture left out");
  svg.erase(0, start);  // the XML declaration may not stand inside HTML
  return with_coloured_markers(svg);
}

Plot plot_from_json(const nlohmann::json& document) {
  Plot plot;
  plot.title = document.value("title", "");
  plot.x_label = document.value("x_label", "");
  plot.y_label = document.value("y_label", "");
  plot.equal_axes = document.value("equal_axes", false);
  plot.log_y = document.value("log_y", false);
  if (document.contains("series"))
    for (const auto& entry : document.at("series"))
      plot.series.push_back({entry.value("name", ""), style_from(entry.value("style", "points")),
                             numbers(entry, "x"), numbers(entry, "y"), numbers(entry, "u")});
  if (plot.equal_axes) plot.height_px = 480;
  return plot;
}

}  // namespace rig
