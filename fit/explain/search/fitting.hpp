// SPDX-License-Identifier: MIT
#pragma once

#include <optional>

#include "fit/explain/candidate.hpp"
#include "fit/explain/hypothesis.hpp"

namespace fit::explain::search {

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
  /// The same hypothesis, fitted, with one more mechanism or unnamed function ...
  [[nodiscard]] Hypothesis extended(const Hypothesis& h, const Candidate& more);
  /// ... or with one less.
  [[nodiscard]] Hypothesis without(const Hypothesis& h, std::size_t term);
  [[nodiscard]] Hypothesis without_shape(const Hypothesis& h, std::size_t shape);

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
  [[nodiscard]] Trial tried(const Hypothesis& h);

  Reduced& reduced_;
  std::optional<double> stops_apart_deg_;
  MeanNoise noise_;
  int fits_ = 0;
  bool cut_short_ = false;
};

}  // namespace fit::explain::search
