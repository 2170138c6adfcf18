// SPDX-License-Identifier: MIT
#include "fit/explain/model/spans.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

namespace fit::explain::model {
namespace {

/// Sums of the rows before each border between places.
struct Border {
  double place = 0, score = 0, information = 0;
};

std::vector<Border> borders_of(std::vector<RowScore> rows, std::size_t most_places) {
  std::erase_if(rows, [](const RowScore& row) { return !std::isfinite(row.place); });
  std::ranges::sort(rows, {}, &RowScore::place);
  std::vector<double> gaps;
  for (std::size_t i = 1; i < rows.size(); ++i) gaps.push_back(rows[i].place - rows[i - 1].place);
  if (gaps.empty()) return {};
  const std::size_t kept = std::min(most_places, gaps.size());
  std::ranges::nth_element(gaps, gaps.begin() + static_cast<std::ptrdiff_t>(kept) - 1, std::greater<>());
  const double least_gap = std::max(gaps[kept - 1], 1e-9);
  std::vector<Border> borders{{rows.front().place - least_gap, 0, 0}};
  Border sum;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    sum.score += rows[i].score;
    sum.information += rows[i].information;
    const bool is_last = i + 1 == rows.size();
    if (!is_last && rows[i + 1].place - rows[i].place < least_gap) continue;
    sum.place = is_last ? rows[i].place + least_gap : (rows[i].place + rows[i + 1].place) / 2;
    borders.push_back(sum);
  }
  return borders;
}

double gain_of(double score, double information, bool either_sign = false) {
  return (score > 0 || either_sign) && information > 0 ? score * score / information : 0;
}

constexpr std::size_t kept = 6;

/// The best of them, that one first.
template <class Found>
std::vector<Found> best_of(std::vector<std::pair<double, Found>> tried) {
  keep_best(kept, tried, [](const auto& one) { return one.first; });
  std::vector<Found> list;
  for (const auto& [gain, one] : tried) list.push_back(one);
  return list;
}

}  // namespace

std::vector<double> places_between(std::vector<double> places, std::size_t most) {
  std::vector<RowScore> rows;
  for (const double place : places) rows.push_back({place, 0, 0});
  std::vector<double> list;
  for (const Border& border : borders_of(std::move(rows), most)) list.push_back(border.place);
  if (list.size() < 3) return {};
  return {list.begin() + 1, list.end() - 1};
}

Spans spans_in(std::vector<RowScore> rows, bool either_sign, std::size_t most_places) {
  const std::vector<Border> borders = borders_of(std::move(rows), most_places);
  Spans spans;
  std::vector<std::pair<double, Span>> tried;
  for (std::size_t i = 0; i < borders.size(); ++i)
    for (std::size_t j = i + 1; j < borders.size(); ++j) {
      if (i == 0 && j + 1 == borders.size()) continue;
      tried.push_back({gain_of(borders[j].score - borders[i].score,
                               borders[j].information - borders[i].information, either_sign),
                       {borders[i].place, borders[j].place}});
    }
  spans.possible = tried.size();
  spans.likeliest = best_of(std::move(tried));
  // Up to a moment, or from it on: where a nuisance holds the mean of both, the rows say the same of either.
  for (const Span& span : std::vector(spans.likeliest)) {
    std::optional<Span> rest;
    if (span.from == borders.front().place) rest = {span.to, borders.back().place};
    if (span.to == borders.back().place) rest = {borders.front().place, span.from};
    if (rest && !std::ranges::count(spans.likeliest, *rest)) spans.likeliest.push_back(*rest);
  }
  return spans;
}

std::vector<double> thresholds_in(std::vector<RowScore> rows) {
  constexpr std::size_t most_places = 500;
  std::vector<std::pair<double, double>> tried;
  for (const Border& border : borders_of(std::move(rows), most_places))
    tried.emplace_back(gain_of(border.score, border.information), border.place);
  return best_of(std::move(tried));
}

}  // namespace fit::explain::model
