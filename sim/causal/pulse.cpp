// SPDX-License-Identifier: MIT
// Shapes of laser pulses after the receiver's filter. A Gaussian is the usual model of lidar waveforms
// (Wagner et al., ISPRS J. Photogramm. 60 (2006) 100); two equal RC stages and a raised cosine have the
// finite start that makes real range walk end at some delay. Translucent targets answer with an exponential
// tail (see physics-depth R15 and its sources).
#include "sim/causal/pulse.hpp"

#include <cmath>
#include <stdexcept>

namespace sim::causal {
namespace {

double shape_at(const std::string& shape, double rise, double t) {
  if (shape == "gaussian") return std::exp(-0.5 * t * t / (rise * rise));
  if (shape == "raised-cosine") {
    const double x = t / (2.5 * rise);
    return std::abs(x) < 1 ? 0.5 * (1 + std::cos(3.14159265358979323846 * x)) : 0;
  }
  if (shape == "two-pole") {
    const double u = t / (1.5 * rise) + 1;
    return u > 0 ? u * std::exp(1 - u) : 0;
  }
  throw std::invalid_argument("pulse shape \"" + shape + "\" is not known");
}

}  // namespace

Pulse::Pulse(const std::string& shape, double rise_ns, double tail_ns) : rise_(rise_ns) {
  begin_ = shape == "gaussian" ? -4.5 * rise_ns : shape == "two-pole" ? -1.5 * rise_ns : -2.5 * rise_ns;
  end_ = shape == "gaussian" ? 4.5 * rise_ns : shape == "two-pole" ? 14 * rise_ns : 2.5 * rise_ns;
  end_ += 6 * tail_ns;
  const double step = rise_ns / 64;
  const auto count = static_cast<std::size_t>((end_ - begin_) / step) + 2;
  table_.resize(count);
  double delayed = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double now = shape_at(shape, rise_ns, begin_ + static_cast<double>(i) * step);
    // One-pole recursion: a discrete exponential of unit area and the right mean.
    delayed += tail_ns > 0 ? (now - delayed) * step / (tail_ns + step) : 0;
    table_[i] = tail_ns > 0 ? delayed : now;
  }
  table_.front() = 0;
  table_.back() = 0;
  scale_ = 1 / step;
  last_ = static_cast<double>(count - 1);
}

}  // namespace sim::causal
