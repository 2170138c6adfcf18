// SPDX-License-Identifier: MIT
#include "rig/archive/unknown_shapes.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <set>

namespace rig {
namespace {

constexpr double alike_correlation = 0.8, alike_factor = 2;
constexpr std::size_t grid_points = 120;

/// The description without its figures, and they.
struct Words {
  std::string form;
  std::vector<double> figures;
};

Words words_of(const std::string& describes) {
  Words out;
  // What comes after the first clause is a second shape.
  const std::string text = describes.substr(0, describes.find("; and "));
  for (std::size_t i = 0; i < text.size();) {
    const bool begins = std::isdigit(static_cast<unsigned char>(text[i])) != 0 &&
                        (i == 0 || std::isalpha(static_cast<unsigned char>(text[i - 1])) == 0);
    if (!begins) {
      out.form += text[i++];
      continue;
    }
    char* end = nullptr;
    out.figures.push_back(std::strtod(text.c_str() + i, &end));
    i = static_cast<std::size_t>(end - text.c_str());
    out.form += '#';
  }
  return out;
}

/// The form in a word or two, for people.
std::string form_name(const std::string& form) {
  for (const auto& [part, name] :
       {std::pair{" waves ", "wave"}, std::pair{" has a bump ", "bump"}, std::pair{" steps ", "step"},
        std::pair{" smooth function ", "smooth function"}})
    if (form.find(part) != std::string::npos) return name;
  return "other";
}

double value_at(const std::vector<double>& at, const std::vector<double>& values, double x) {
  const auto right = std::ranges::lower_bound(at, x);
  if (right == at.begin()) return values.front();
  if (right == at.end()) return values.back();
  const auto i = static_cast<std::size_t>(right - at.begin());
  const double width = at[i] - at[i - 1];
  const double share = width > 0 ? (x - at[i - 1]) / width : 0;
  return values[i - 1] + share * (values[i] - values[i - 1]);
}

struct Curve {
  std::vector<double> at, values;
  [[nodiscard]] bool usable() const {
    return at.size() >= 3 && at.size() == values.size() && std::ranges::is_sorted(at) &&
           at.back() > at.front();
  }
};

/// Both on the part of the coordinate that they share, without their means; empty if that is less than half
/// of either.
bool sample_both(const Curve& a, const Curve& b, std::vector<double>& x, std::vector<double>& y) {
  const double low = std::max(a.at.front(), b.at.front()), high = std::min(a.at.back(), b.at.back());
  const double longer = std::max(a.at.back() - a.at.front(), b.at.back() - b.at.front());
  if (!(high - low > longer / 2)) return false;
  double mean_x = 0, mean_y = 0;
  for (std::size_t i = 0; i < grid_points; ++i) {
    const double at = low + (high - low) * static_cast<double>(i) / (grid_points - 1);
    x.push_back(value_at(a.at, a.values, at));
    y.push_back(value_at(b.at, b.values, at));
    mean_x += x.back() / grid_points;
    mean_y += y.back() / grid_points;
  }
  for (double& v : x) v -= mean_x;
  for (double& v : y) v -= mean_y;
  return true;
}

double product(const std::vector<double>& x, const std::vector<double>& y) {
  double sum = 0;
  for (std::size_t i = 0; i < x.size(); ++i) sum += x[i] * y[i];
  return sum;
}

bool within_factor(double a, double b) {
  if (a == b) return true;
  return a > 0 && b > 0 && std::max(a, b) / std::min(a, b) < alike_factor;
}

bool are_alike(const Curve& a, const Curve& b) {
  std::vector<double> x, y;
  if (!sample_both(a, b, x, y)) return false;
  const double xx = product(x, x), yy = product(y, y);
  return xx > 0 && yy > 0 && product(x, y) / std::sqrt(xx * yy) > alike_correlation &&
         within_factor(std::sqrt(xx), std::sqrt(yy));
}

double size_of(const Curve& c) {
  double mean = 0, squares = 0;
  std::vector<double> values;
  for (std::size_t i = 0; i < grid_points; ++i)
    values.push_back(
        value_at(c.at, c.values,
                 c.at.front() + (c.at.back() - c.at.front()) * static_cast<double>(i) / (grid_points - 1)));
  for (const double v : values) mean += v / grid_points;
  for (const double v : values) squares += (v - mean) * (v - mean) / grid_points;
  return std::sqrt(squares);
}

struct Case {
  const SessionRecord* session = nullptr;
  Curve curve;
  Words words;
};

bool are_alike(const Case& a, const Case& b) {
  const ArchivedExplanation &x = *a.session->explanation, &y = *b.session->explanation;
  if (x.unknown_coordinate != y.unknown_coordinate || x.unknown_observable != y.unknown_observable ||
      x.unknown_channel != y.unknown_channel)
    return false;
  if (a.curve.usable() && b.curve.usable()) return are_alike(a.curve, b.curve);
  return a.words.form == b.words.form && a.words.figures.size() == b.words.figures.size() &&
         std::ranges::equal(a.words.figures, b.words.figures, within_factor);
}

/// The mean of curves that are alike, on the part of the coordinate that all of them have.
Curve mean_of(const std::vector<const Case*>& cases) {
  double low = -INFINITY, high = INFINITY;
  for (const Case* c : cases) {
    if (!c->curve.usable()) return {};
    low = std::max(low, c->curve.at.front());
    high = std::min(high, c->curve.at.back());
  }
  Curve out;
  if (!(high > low)) return out;
  for (std::size_t i = 0; i < grid_points; ++i) {
    const double at = low + (high - low) * static_cast<double>(i) / (grid_points - 1);
    double sum = 0;
    for (const Case* c : cases) sum += value_at(c->curve.at, c->curve.values, at);
    out.at.push_back(at);
    out.values.push_back(sum / static_cast<double>(cases.size()));
  }
  return out;
}

UnknownShape shape_of(const std::vector<const Case*>& cases) {
  const ArchivedExplanation& first = *cases.front()->session->explanation;
  UnknownShape out;
  out.coordinate = first.unknown_coordinate;
  out.observable = first.unknown_observable;
  out.channel = first.unknown_channel;
  out.form = form_name(cases.front()->words.form);
  const Curve mean = mean_of(cases);
  out.at = mean.at;
  out.curve = mean.values;
  if (mean.usable()) {
    out.size = size_of(mean);
  } else if (!cases.front()->words.figures.empty()) {
    out.size = std::ranges::max(cases.front()->words.figures);
  }
  for (const Case* c : cases) out.sessions.push_back(c->session);
  return out;
}

}  // namespace

std::vector<std::string> UnknownShape::serials() const {
  std::set<std::string> all;
  for (const SessionRecord* s : sessions) all.insert(s->serial);
  return {all.begin(), all.end()};
}

std::vector<UnknownShape> unknown_shapes(std::span<const SessionRecord> archive) {
  std::vector<Case> cases;
  for (const SessionRecord& r : archive)
    if (r.explanation && !r.explanation->unknown_describes.empty())
      cases.push_back(
          {&r, {r.explanation->curve_at, r.explanation->curve}, words_of(r.explanation->unknown_describes)});
  // Whoever has the most that are like it is the middle of a group; what is left is put together in the same
  // way.
  std::vector<std::vector<std::size_t>> alike(cases.size());
  for (std::size_t i = 0; i < cases.size(); ++i)
    for (std::size_t k = 0; k < cases.size(); ++k)
      if (i == k || are_alike(cases[i], cases[k])) alike[i].push_back(k);
  std::vector<bool> taken(cases.size(), false);
  std::vector<UnknownShape> out;
  while (true) {
    std::size_t middle = cases.size(), most = 0;
    for (std::size_t i = 0; i < cases.size(); ++i) {
      if (taken[i]) continue;
      const auto free =
          static_cast<std::size_t>(std::ranges::count_if(alike[i], [&](std::size_t k) { return !taken[k]; }));
      if (free > most) most = free, middle = i;
    }
    if (middle == cases.size()) break;
    std::vector<const Case*> group = {&cases[middle]};
    taken[middle] = true;
    for (const std::size_t k : alike[middle])
      if (!taken[k]) group.push_back(&cases[k]), taken[k] = true;
    out.push_back(shape_of(group));
  }
  return out;
}

}  // namespace rig
