// SPDX-License-Identifier: MIT
#include "fit/explain/search/candidates.hpp"

#include <algorithm>
#include <functional>
#include <numeric>
#include <optional>

#include "fit/explain/odds.hpp"
#include "fit/explain/search/two_cores.hpp"

namespace fit::explain::search {
namespace {

constexpr std::size_t rows_of_last_search = 30000;

bool is_known(const Bench& bench, const Term& term) {
  for (const KnownMechanism& known : bench.known) {
    if (known.mechanism != term.mechanism->id) continue;
    if (!term.mechanism->one_target) return true;
    const auto target = known.texts.find("target");
    if (target != known.texts.end() && term.target >= 0 &&
        target->second == bench.targets[static_cast<std::size_t>(term.target)].name)
      return true;
  }
  return false;
}

/// Every mechanism that is neither in `h` nor `but` nor known, for every target that it may act on.
std::vector<Term> terms_to_try(const Bench& bench, const Hypothesis& h, const Term* but) {
  std::vector<Term> terms;
  for (const Mechanism& m : catalogue()) {
    if (!moves_means(m)) continue;
    const int first = m.one_target ? 0 : -1, end = m.one_target ? static_cast<int>(bench.targets.size()) : 0;
    for (int target = first; target < end; ++target) {
      Term term{&m, target, std::vector<double>(m.parameters.size(), 0.0), {}};
      if (h.has(term) || (but && but->same(term)) || is_known(bench, term)) continue;
      terms.push_back(term);
    }
  }
  return terms;
}

/// How many places of its shape parameters are looked at: what takes the time.
int places_of(const Term& term) {
  int product = 1;
  for (const Parameter& p : term.mechanism->parameters)
    if (p.role == Parameter::Role::shape) product *= std::max(2, p.starts);
  return product;
}

/// Terms and forms by their numbers, forms behind terms; those first that take longest.
std::vector<std::size_t> longest_first(const std::vector<Term>& terms, std::size_t forms) {
  std::vector<int> places(terms.size() + forms, 1);
  std::ranges::transform(terms, places.begin(), places_of);
  std::vector<std::size_t> order(places.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, std::greater<>(), [&](std::size_t i) { return places[i]; });
  return order;
}

}  // namespace

std::vector<Candidate> candidates(Fitting& fitting, const Hypothesis& h, const Asked& asked) {
  fitting.place(h);
  const Reduced& reduced = fitting.reduced();
  std::optional<Reduced> few;
  if (fitting.is_larger_than(rows_of_last_search)) few = merged(reduced, rows_of_last_search);
  const MeanModel model = model_of(few ? *few : reduced, fitting.noise(), h);
  const std::vector<Term> terms =
      asked.named ? terms_to_try(reduced.bench, h, asked.but) : std::vector<Term>();
  const std::vector<Shape> shapes = asked.unnamed ? forms_to_try(model) : std::vector<Shape>();
  // Fine combs are gone where neighbouring beams are taken together.
  std::optional<MeanModel> every;
  if (few && std::ranges::any_of(terms, [](const Term& term) { return is_comb(*term.mechanism); }))
    every = model_of(reduced, fitting.noise(), h);
  const auto model_for = [&](const Term& term) -> const MeanModel& {
    return every && is_comb(*term.mechanism) ? *every : model;
  };
  std::vector<Candidate> list(terms.size() + shapes.size());
  const std::vector<std::size_t> order = longest_first(terms, shapes.size());
  on_two_cores(list.size(), [&](std::size_t k) {
    const std::size_t i = order[k];
    if (i >= terms.size())
      list[i] = look(model, shapes[i - terms.size()]);
    else
      list[i] = look(model_for(terms[i]), terms[i], fitting.stops_apart_deg());
  });
  std::erase_if(list, [](const Candidate& s) { return !(s.evidence > odds::worth_fitting); });
  std::ranges::sort(list, [](const Candidate& a, const Candidate& b) { return a.evidence > b.evidence; });
  return list;
}

bool shows_a_comb(Fitting& fitting, const Hypothesis& h) {
  if (std::ranges::any_of(h.terms, [](const Term& term) { return is_comb(*term.mechanism); })) return true;
  const MeanModel model = fitting.placed_model(h);
  return std::ranges::any_of(terms_to_try(fitting.bench(), h, nullptr), [&](const Term& term) {
    return is_comb(*term.mechanism) &&
           look(model, term, fitting.stops_apart_deg()).evidence > odds::worth_fitting;
  });
}

}  // namespace fit::explain::search
