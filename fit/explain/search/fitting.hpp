// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <vector>

#include "fit/explain/candidate.hpp"
#include "fit/explain/hypothesis.hpp"

namespace fit::explain::search {

/// A hypothesis with one more mechanism or unnamed function, not fitted.
[[nodiscard]] Hypothesis with(const Hypothesis& h, const Candidate& more);

/// Fits hypotheses to the means of a session. Its cells are left predicted at the last one.
class Fitting {
 public:
  Fitting(Reduced& reduced, MeanNoise noise);

  [[nodiscard]] Reduced& reduced() { return reduced_; }
  [[nodiscard]] const Reduced& reduced() const { return reduced_; }
  [[nodiscard]] const Bench& bench() const { return reduced_.bench; }
  [[nodiscard]] const MeanNoise& noise() const { return noise_; }
  /// Degrees from one stop of the stage to the next.
  [[nodiscard]] std::optional<double> stops_apart_deg() const { return stops_apart_deg_; }
  [[nodiscard]] bool is_larger_than(std::size_t rows) const { return reduced_.smooth_cells() > rows; }

  /// Means scatter so much more than their samples say: factor on their variance.
  void widen_noise(double factor) { noise_.factor *= factor; }

  /// Predicts every cell there.
  void place(const Hypothesis& h, bool may_leave_out = false) { predict_at(reduced_, h, may_leave_out); }
  /// ... and the means as the hypothesis leaves them.
  [[nodiscard]] MeanModel placed_model(const Hypothesis& h);

  /// To its best values, and their evidence.
  void fit(Hypothesis& h);
  /// Every one of them, two at a time. What comes out is the same on any number of cores.
  void fit_all(std::vector<Hypothesis>& list);
  /// A hypothesis without the k-th of its mechanisms and unnamed functions, those behind these, fitted ...
  [[nodiscard]] Hypothesis without(const Hypothesis& h, std::size_t k);
  /// ... for every k.
  [[nodiscard]] std::vector<Hypothesis> without_each(const Hypothesis& h);

  /// A recording that nothing fits well would be searched for many minutes: whether there were not yet too
  /// many fits for that.
  [[nodiscard]] bool has_patience();
  /// Whether patience was ever lost: not everything was tried that might explain more.
  [[nodiscard]] bool is_cut_short() const { return cut_short_; }
  /// By the search of the same session with fewer cells.
  void cut_short_if(bool so) { cut_short_ = cut_short_ || so; }

 private:
  /// A hypothesis as it stands, how well it does there, and where a Gauss-Newton step leads.
  struct Trial {
    Hypothesis here, next;
    double density = 0;  ///< Log, mount, walls and mechanisms as they stand.
  };
  [[nodiscard]] Trial tried(Reduced& reduced, const Hypothesis& h) const;
  /// Fits by these cells; returns how many trials that took.
  int fit_by(Reduced& reduced, Hypothesis& h) const;

  Reduced& reduced_;
  std::optional<double> stops_apart_deg_;
  MeanNoise noise_;
  int fits_ = 0;
  bool cut_short_ = false;
};

}  // namespace fit::explain::search
