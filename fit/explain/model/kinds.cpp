// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <functional>

#include "fit/explain/model/spans.hpp"
#include "fit/explain/model/term.hpp"
#include "fit/explain/numbers.hpp"
#include "fit/explain/scene/stated_noise.hpp"

namespace fit::explain::model {
namespace {

using Eigen::Index;
using Role = Parameter::Role;
using ListOfChannels = std::vector<std::unique_ptr<ChannelRows>>;

constexpr std::size_t most_starts = 2000;

bool bench_knows(const Bench& bench, const Mechanism& m, int target) {
  return std::ranges::any_of(bench.known, [&](const KnownMechanism& known) {
    if (known.mechanism != m.id) return false;
    const auto of = known.texts.find("target");
    if (of == known.texts.end()) return !m.one_target;
    return target >= 0 && of->second == bench.target_at(target).name;
  });
}

/// Places of a shape, spread over its bounds.
std::vector<double> places_of_shape(const Parameter& p) {
  if (p.scale == Parameter::Scale::count || p.scale == Parameter::Scale::choice) {
    std::vector<double> whole;
    for (double n = p.lower; n <= p.upper; ++n) whole.push_back(n);
    return whole;
  }
  if (p.scale == Parameter::Scale::gear) {
    std::vector<double> turns;
    for (int teeth = 1; 360.0 / teeth >= p.lower; ++teeth) turns.push_back(360.0 / teeth);
    return turns;
  }
  const int count = std::max(2, p.starts);
  std::vector<double> list;
  for (int i = 0; i < count; ++i) {
    const double share = (i + 0.5) / count;
    list.push_back(p.logarithmic ? p.lower * std::pow(p.upper / p.lower, share)
                                 : p.lower + share * (p.upper - p.lower));
  }
  return list;
}

/// Between recorded times, where most time was between them.
std::vector<double> moments_in(const ListOfChannels& channels) {
  constexpr std::size_t most_moments = 60;
  std::vector<double> times;
  for (const auto& channel : channels)
    for (Index i = 0; channel && channel->sees(Coordinate::time) && i < channel->rows(); ++i)
      if (const double clock_s = channel->at(i).clock_s; std::isfinite(clock_s)) times.push_back(clock_s);
  return places_between(std::move(times), most_moments);
}

/// Whether the target is a round one.
bool is_round(const ListOfChannels& channels, int target) {
  for (const auto& channel : channels)
    for (Index i = 0; target >= 0 && channel && i < channel->rows(); ++i)
      if (channel->at(i).target == target) return channel->at(i).round;
  return false;
}

std::vector<std::vector<double>> grid_of(const Kind& kind, bool round, const ListOfChannels& channels) {
  std::vector<double> first;
  for (const Parameter& p : kind.mechanism->parameters)
    first.push_back(p.role == Role::size ? p.typical : p.role == Role::phase ? 0 : p.left_out());
  if (kind.size)
    for (std::size_t k = 0; k < first.size(); ++k)
      if (kind.mechanism->parameters[k].role == Role::size && k != kind.size) first[k] = 0;
  for (std::size_t k = 0; k < first.size(); ++k)
    if (!suits(kind.mechanism->parameters[k].targets, round)) first[k] = 0;
  std::vector<std::vector<double>> grid{first};
  for (const std::size_t k : shapes_of(kind)) {
    const Parameter& p = kind.mechanism->parameters[k];
    const std::vector<double> places = k == kind.bins ? std::vector{std::sqrt(p.lower * p.upper)}
                                       : p.scale == Parameter::Scale::moment ? moments_in(channels)
                                                                             : places_of_shape(p);
    if (grid.size() * places.size() > most_starts) return {};
    std::vector<std::vector<double>> finer;
    for (const auto& values : grid)
      for (const double place : places) {
        finer.push_back(values);
        finer.back()[k] = place;
      }
    grid = std::move(finer);
  }
  for (std::size_t k = 0; k < first.size(); ++k) {
    const Parameter& p = kind.mechanism->parameters[k];
    if (p.role != Role::size || p.also == 0 || first[k] == 0) continue;
    const std::size_t asked = grid.size();
    for (std::size_t i = 0; i < asked; ++i) {
      grid.push_back(grid[i]);
      grid.back()[k] = p.also;
    }
  }
  return grid;
}

/// Rows at which a mechanism is asked what it does in a channel at all.
template <class Ask>
bool any_row(const ChannelRows& channel, const Kind& kind, const Ask& ask) {
  const Index step = std::max<Index>(1, channel.rows() / 300);
  for (Index i = 0; i < channel.rows(); i += step)
    if (kind.target < 0 || channel.at(i).target == kind.target)
      if (ask(i)) return true;
  return false;
}

/// A dozen of its starts: at one alone a threshold may lie below every echo.
template <class Ask>
bool any_start(const Kind& kind, const Ask& ask) {
  const std::size_t step = std::max<std::size_t>(1, kind.starts.size() / 12);
  for (std::size_t s = 0; s < kind.starts.size(); s += step)
    if (ask(kind.starts[s])) return true;
  return false;
}

/// Each size by itself where it may be missing without the others; else none: all of them.
std::vector<std::optional<std::size_t>> sizes_of(const Mechanism& m) {
  std::vector<std::optional<std::size_t>> list;
  for (std::size_t k = 0; m.sizes_apart && k < m.parameters.size(); ++k)
    if (m.parameters[k].role == Role::size) list.emplace_back(k);
  if (list.empty()) list.emplace_back();
  return list;
}

/// With that size as the catalogue has it, and no other.
std::vector<double> with_one_size(const Kind& kind, const std::vector<double>& start, std::size_t size) {
  std::vector<double> values = without_size(kind, start);
  values[size] = kind.mechanism->parameters[size].typical;
  return values;
}

/// What of it acts in a channel: each size by itself, and what needs none.
Kind::Acting acting_in(const ChannelRows& channel, const Kind& kind) {
  Kind::Acting acting{std::vector<bool>(kind.coefficients.size(), false)};
  if ((channel.sees_only_combs() && !kind.bins) || !channel.sees(kind.mechanism->coordinate)) return acting;
  const auto acts = [&](const auto& changed) {
    return any_start(kind, [&](const std::vector<double>& start) {
      const std::vector<double> values = changed(start);
      return any_row(channel, kind, [&](Index i) {
        const double r = channel.response(i, effect_at(channel, i, kind, values));
        return std::isfinite(r) && std::abs(r) > 1e-9;
      });
    });
  };
  if (!acts(std::identity())) return acting;
  acting.without_size = !kind.is_form() && acts([&](const auto& start) { return without_size(kind, start); });
  const bool only_one = acting.sizes.size() == 1 && !acting.without_size;
  for (std::size_t k = 0; k < acting.sizes.size(); ++k)
    acting.sizes[k] = only_one || acts([&](const auto& start) {
                        return with_one_size(kind, start, kind.coefficients[k].parameter);
                      });
  return acting;
}

std::vector<Kind::Acting> acting_in(const ListOfChannels& channels, const Kind& kind) {
  std::vector<Kind::Acting> list;
  for (const auto& channel : channels) list.push_back(channel ? acting_in(*channel, kind) : Kind::Acting());
  return list;
}

/// Whether so much of its coordinate was recorded that what is local there can be told from what is
/// everywhere.
bool can_be_local(const Mechanism& m, const ListOfChannels& channels) {
  const auto width = m.parameter_of(Parameter::Scale::width);
  if (!width) return true;
  Extent recorded;
  for (const auto& channel : channels)
    for (Index i = 0; channel && i < channel->rows(); ++i)
      recorded.add(coordinate_of(m.coordinate, channel->at(i)));
  return recorded.length() > 2 * m.parameters[*width].lower;
}

/// The power of a size that the effect goes with: variances go with the square of a deviation.
int power_of(const Kind& kind, std::size_t k, const ListOfChannels& channels) {
  for (const std::vector<double>& start : kind.starts) {
    const std::vector<double> small = with_one_size(kind, start, k);
    std::vector<double> twice = small;
    twice[k] *= 2;
    double ratio = 0;
    for (const auto& channel : channels)
      if (channel && channel->sees(kind.mechanism->coordinate))
        any_row(*channel, kind, [&](Index i) {
          const double one = channel->response(i, kind.mechanism->act(channel->at(i), small)),
                       two = channel->response(i, kind.mechanism->act(channel->at(i), twice));
          if (std::abs(one) > 1e-12) ratio = std::max(ratio, two / one);
          return std::abs(one) > 1e-12;
        });
    if (ratio > 0) return ratio > 3 ? 2 : 1;
  }
  return 1;
}

/// Ways in which it acts at one of its starts.
std::vector<double Effect::*> ways_of(const Kind& kind, const ListOfChannels& channels) {
  std::vector<double Effect::*> unseen(ways_to_act().begin(), ways_to_act().end()), list;
  const auto take_seen = [&](const Effect& e) {
    std::erase_if(unseen, [&](const auto way) { return e.*way != 0; });
    return unseen.empty();
  };
  any_start(kind, [&](const std::vector<double>& values) {
    return std::ranges::any_of(channels, [&](const auto& channel) {
      return channel && any_row(*channel, kind, [&](Index i) {
               return take_seen(kind.mechanism->act(channel->at(i), values));
             });
    });
  });
  std::ranges::copy_if(ways_to_act(), std::back_inserter(list),
                       [&](const auto way) { return !std::ranges::count(unseen, way); });
  return list;
}

}  // namespace

std::span<double Effect::*const> ways_to_act() {
  static constexpr double Effect::*all[] = {&Effect::range_mm,
                                            &Effect::beam_rad,
                                            &Effect::stage_rad,
                                            &Effect::variance_mm2,
                                            &Effect::scan_angle_variance_rad2,
                                            &Effect::beam_angle_variance_rad2,
                                            &Effect::lost,
                                            &Effect::stray,
                                            &Effect::late,
                                            &Effect::early,
                                            &Effect::log_echo,
                                            &Effect::log_intensity};
  return all;
}

Kind kind_without_channels(const Mechanism& m, int target) {
  Kind kind;
  kind.mechanism = not_owned(m);
  kind.target = target;
  kind.bins = m.parameter_of(Parameter::Scale::bin);
  kind.threshold = m.parameter_of(Parameter::Scale::threshold);
  kind.begins = m.parameter_of(Parameter::Scale::from);
  kind.choice = m.parameter_of(Parameter::Scale::choice);
  kind.refines = !m.parameter_of(Parameter::Scale::moment) && !m.parameter_of(Parameter::Scale::count);
  return kind;
}

Kind kind_of(const Mechanism& m, int target, const ListOfChannels& channels, std::optional<std::size_t> size,
             bool is_plain) {
  Kind kind = kind_without_channels(m, target);
  const bool round = is_round(channels, target);
  if (!suits(m.targets, round)) return kind;
  kind.size = size;
  kind.is_plain = is_plain;
  kind.starts = grid_of(kind, round, channels);
  if (kind.starts.empty()) return kind;
  kind.coefficients = coefficients_of(m, [&](std::size_t k) { return power_of(kind, k, channels); });
  std::erase_if(kind.coefficients, [&](const Coefficient& c) {
    return (size && c.parameter != *size) || !suits(m.parameters[c.parameter].targets, round);
  });
  kind.acts_in = acting_in(channels, kind);
  kind.acts_without_size = std::ranges::any_of(kind.acts_in, &Kind::Acting::without_size);
  if (m.formula_error > 0 || m.any_curve || (size && m.parameters[*size].any_curve))
    kind.ways = ways_of(kind, channels);
  return kind;
}

std::vector<Kind> kinds_of(const Reduced& reduced, const ListOfChannels& channels) {
  std::vector<Kind> kinds;
  const auto catalogued = static_cast<double>(catalogue().size());
  for (const Mechanism& m : catalogue()) {
    std::vector<Kind> of_it;
    const int targets = static_cast<int>(reduced.bench.targets.size());
    for (int target = m.one_target ? 0 : -1; target < (m.one_target || m.of_surfaces ? targets : 0);
         ++target) {
      if (target >= 0 && reduced.same_as[static_cast<std::size_t>(target)] != target) continue;
      if (!m.corrects_a_statement && bench_knows(reduced.bench, m, target)) continue;
      if (!can_be_local(m, channels)) continue;
      for (const std::optional<std::size_t> size : sizes_of(m))
        for (const bool is_plain : {true, false})
          if (is_plain || std::ranges::any_of(m.parameters, &Parameter::generalises))
            of_it.push_back(kind_of(m, target, channels, size, is_plain));
    }
    std::erase_if(of_it, [](const Kind& kind) { return kind.starts.empty(); });
    for (Kind& kind : of_it) {
      kind.log_prior =
          std::log(numbers::mechanisms_expected / catalogued) - std::log(static_cast<double>(of_it.size()));
      kinds.push_back(std::move(kind));
    }
  }
  add_forms(channel_kinds(), channels, kinds);
  for (Kind& kind : kinds)
    if (kind.is_form()) kind.acts_in = acting_in(channels, kind);
  std::erase_if(kinds, [](const Kind& kind) {
    return std::ranges::none_of(kind.acts_in, &Kind::Acting::operator bool);
  });
  return kinds;
}

}  // namespace fit::explain::model
