// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <functional>
#include <utility>
#include <vector>

#include "fit/recording.hpp"

namespace fit::explain {

/// A recording without some of its captures.
class SelectedCaptures : public Forwarded {
 public:
  /// Borrows the recording. Kept are those captures, by their indices, for which `keep` holds.
  SelectedCaptures(const Recording& recording, const std::function<bool(std::size_t index)>& keep)
      : Forwarded(recording) {
    const std::vector<CaptureInfo>& all = recording.captures();
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (!keep(i)) continue;
      captures_.push_back(all[i]);
      kept_.push_back(i);
    }
  }

  [[nodiscard]] const std::vector<CaptureInfo>& captures() const override { return captures_; }
  void for_each_scan(std::size_t index, const std::function<void(const ScanView&)>& visit) const override {
    Forwarded::for_each_scan(kept_[index], visit);
  }
  [[nodiscard]] std::size_t left_out() const { return Forwarded::captures().size() - captures_.size(); }

 private:
  std::vector<CaptureInfo> captures_;
  std::vector<std::size_t> kept_;  ///< Their indices in the recording.
};

}  // namespace fit::explain
