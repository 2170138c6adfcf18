// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "fit/explain/model/columns.hpp"
#include "fit/explain/model/extent.hpp"

namespace fit::explain {

struct Form;

/// An unnamed function of one coordinate: what physics outside the catalogue looks like.
struct Shape {
  const Form* form = nullptr;
  Coordinate coordinate = Coordinate::beam;
  Channel channel = Channel::range;
  /// Of this one alone, or all; where the coordinate is the target, it is the place on it, mm from its
  /// middle.
  int target = -1;
  double at = 0;                    ///< Place or period, file unit of the coordinate.
  double length = 0;                ///< Extent, or where it ends, as its form has it.
  double size = 1;                  ///< Standard size of the prior: mm or rad.
  std::vector<double> places = {};  ///< Of a form with a value for each of them.
  std::vector<double> values = {};  ///< Coefficients, after a fit ...
  std::vector<double> u = {};       ///< ... and their standard uncertainties where the form is.

  [[nodiscard]] Estimate coefficient(std::size_t k) const { return {values[k], k < u.size() ? u[k] : 0}; }
  [[nodiscard]] bool is_along_one_target() const { return coordinate == Coordinate::target && target >= 0; }
};

/// An unnamed function as it came out, so that it says the same of other recordings. A form that is scaled to
/// its recording is kept as a table over the coordinate: linear between, and outside held as at its ends.
struct SeenShape {
  Shape shape;
  std::vector<double> at, value;  ///< Empty if the form is not scaled; file unit, and mm or rad.
};

/// A coordinate as a recording samples it.
struct Axis {
  Coordinate coordinate = Coordinate::beam;
  Channel channel = Channel::range;
  bool expects_nothing = false;  ///< Of what is there: to be the same everywhere is something, too.
  double low = 0, high = 0;      ///< File unit.
  std::vector<double> values;    ///< Different ones, the first few hundred.
  std::vector<double> between;   ///< Places that halve, quarter, ... its cells; between two values each.
};

/// What a fitted function does over the coordinate's extent, for people; `what` is "range" or an angle.
struct Course : Extent {
  std::string what, unit, coordinate, unit_of_coordinate;
  std::string target;  ///< Its name, of a function of one.
  double scale = 1;    ///< From the coefficients' unit to `unit`.
  double least = 1e300, most = -1e300, least_at = 0, most_at = 0;

  void add_value(double at, double value) {
    if (value < least) least = value, least_at = at;
    if (value > most) most = value, most_at = at;
  }
  /// A figure in the coefficients' unit, with its expanded uncertainty (k = 2).
  [[nodiscard]] std::string in_words(const Estimate& estimate) const;
};

struct Described {
  std::string text;
  double from = 0, to = 0;  ///< Where on the coordinate it acts.
};

/// One kind of unnamed function: a sum of basis functions with a normal prior each.
struct Form {
  std::string id;
  bool is_constant = false;     ///< Needs no coordinate that varies.
  bool scaled = false;          ///< Its functions are of the coordinate scaled to -1 .. 1 over the recording.
  bool of_all_targets = false;  ///< Of the place along every target, a function for each.
  bool happened_then = false;   ///< What happened then, happens in no other recording.
  std::function<int(const Shape&)> terms = [](const Shape&) { return 1; };
  std::function<double(const Shape&, double x, int term)> basis;
  /// Standard sizes of the coefficients where the whole has that of 1; empty: all 1.
  std::function<std::vector<double>(const Shape&)> shares;
  bool from_to = false;       ///< Acts between two places, wherever these are.
  bool whole_places = false;  ///< Between the places to look for there are no others.
  /// Those to look for along a coordinate: places, extents and prior odds.
  std::function<std::vector<Shape>(const Axis&)> along;
  std::function<Described(const Shape&, const Course&)> says;
};

/// All forms there are, one file each in fit/forms.
[[nodiscard]] const std::vector<Form>& all_forms();

/// The targets along which it acts, one by one; -1 where it is of no target's place.
[[nodiscard]] std::vector<int> along_targets(const Shape& shape, const Bench& bench);
/// Columns of the basis functions, mm, and their prior around zero.
[[nodiscard]] Columns columns_of(const MeanModel& model, const Shape& shape);
/// What a fitted one does to every mean, mm.
[[nodiscard]] Eigen::VectorXd effect_of(const MeanModel& model, const Shape& shape);
/// What a fitted one came out as.
[[nodiscard]] SeenShape seen(const Shape& shape, const MeanModel& model);
/// What it does to every mean of that or another recording, mm.
[[nodiscard]] Eigen::VectorXd effect_of(const MeanModel& model, const SeenShape& seen);
/// Columns of the functions that could be it in that or another recording, as stiff over the coordinate.
[[nodiscard]] Columns columns_of(const MeanModel& model, const SeenShape& seen);
/// A fitted one in words.
[[nodiscard]] Described describe(const Shape& shape, const MeanModel& model);

}  // namespace fit::explain
