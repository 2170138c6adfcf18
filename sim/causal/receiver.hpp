// SPDX-License-Identifier: MIT
#pragma once

#include <span>
#include <vector>

#include "sim/causal/pulse.hpp"
#include "sim/world.hpp"

namespace sim::causal {

/// Light that comes back along one sub-ray.
struct Echo {
  double t_ns = 0;
  double amplitude = 0;  ///< 1: white, square on, at 1 m.
  const Pulse* pulse = nullptr;
};

/// What disturbs one beam's comparator.
struct Disturbance {
  double threshold = 0;  ///< Added to the threshold: noise, wander, interference.
  double peak = 0;       ///< Added to the measured peak.
  double flash = 0;      ///< What the firing itself leaves in the receiver, when the pulse begins.
};

struct Reading {
  bool found = false;
  double t_ns = 0;  ///< Corrected as the firmware does, before counting.
  double peak = 0;
};

/// Detector, amplifier and comparator: the sum of all sub-rays' pulses, clipped, crosses a threshold.
///
/// Range walk, its residue after the firmware's compensation, saturation, merged and split echoes and the
/// growth of noise on weak echoes all follow from this. Sources: fixed thresholds walk and constant fractions
/// do not (Kilpela, Pennala, Kostamovaara, Rev. Sci. Instrum. 69 (1998) 1575); a clipped echo defeats the
/// correction by amplitude (Pesci and Teza, Int. J. Remote Sens. 29 (2008) 5123); timing jitter is noise over
/// slope.
class Receiver {
 public:
  explicit Receiver(const World& world);

  /// `echoes` sorted by time. `gain` multiplies all of them.
  [[nodiscard]] Reading detect(std::span<const Echo> echoes, const Disturbance& disturbance,
                               double gain = 1) const;

  [[nodiscard]] const Pulse& pulse() const { return pulse_; }
  /// Delay (ns, against the pulse's peak) at which a lone echo of that peak is timed, without noise and
  /// clipping.
  [[nodiscard]] double nominal_ns(double peak) const;

 private:
  struct Event {
    double up = 0, down = 0, peak = 0;
  };
  [[nodiscard]] double clipped(double signal) const;
  template <typename Signal>
  [[nodiscard]] bool next_event(const Signal& signal, std::span<const Echo> echoes, double threshold,
                                double& from, Event& event) const;
  template <typename Signal>
  [[nodiscard]] double timed(const Signal& signal, const Event& event, double disturbance) const;
  [[nodiscard]] Reading raw(std::span<const Echo> echoes, const Disturbance& disturbance, double gain) const;

  World::Receiver settings_;
  double flash_decay_ns_;
  Pulse pulse_;
  bool strongest_, fraction_, centre_;
  bool clips_;
  std::vector<double> nominal_;  ///< Over the logarithm of the peak.
  double nominal_first_ = 0, nominal_step_ = 1, reference_ns_ = 0;
};

}  // namespace sim::causal
