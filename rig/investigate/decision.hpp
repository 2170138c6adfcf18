// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace rig::investigate {

/// How an investigation ends.
enum class End {
  named,            ///< The physics has a name, and what remains is noise.
  nothing_missing,  ///< The bench file explains everything that was examined.
  unknown_physics,  ///< Something is there that no mechanism of the catalogue produces.
  undecidable,      ///< No experiment within the bench's means tells the suspects apart.
  budget_spent,     ///< Experiments that would tell more need more time than there is.
};
[[nodiscard]] const char* name_of(End end);
/// Throws std::invalid_argument for another word.
[[nodiscard]] End end_named(const std::string& name);

/// What all sessions together say so far, as the next step depends on it.
struct Conclusions {
  enum class Verdict { nothing_missing, explained, undecided, unknown_physics };
  Verdict verdict = Verdict::nothing_missing;
  double least_probability = 1;  ///< Of the mechanisms that are named.
};

/// A session that could be recorded next.
struct Possible {
  std::string title;
  double information = 0;  ///< Expected (nats) about which suspect it is; of a survey nobody knows.
  double minutes = 0;      ///< Of stage, scans and operator.
  bool needs_operator = false, done = false;
};

/// What the investigation may spend.
struct Means {
  double minutes_left = 0;
  bool unattended = false;  ///< No operator is there.
  int rounds_left = 1;
};

/// What to do next: record one of the possible sessions, or end.
struct Decision {
  enum class From { experiments, surveys };
  struct Next {
    From from;
    std::size_t index;
  };
  std::optional<Next> next;
  std::string why;  ///< A sentence for the operator.
  End end = End::undecidable;
  std::string needs;  ///< What would tell more, if it is known: "an operator, and 40 min: TITLE".
};

/// Probability from which a name is believed.
constexpr double sure = 0.9;

/// `experiments` separate suspects, `surveys` record what no session has shown yet. While something is in
/// doubt, the session with the most expected information per minute is next; a survey only where no other can
/// be done. While nothing is, surveys that need no operator are, the quickest first.
[[nodiscard]] Decision decide(const Conclusions& conclusions, const std::vector<Possible>& experiments,
                              const std::vector<Possible>& surveys, const Means& means);

/// Whether a recording came out as it was predicted.
struct Outcome {
  long samples = 0;
  double coverage_95 = 0, coverage_95_of_means = 0;
  double rms_of_means_mm = 0, expected_rms_of_means_mm = 0;
  double gain = 0, u_gain = 0;  ///< Log-likelihood of the recording, with what was found less without it.
  /// The recording alone, explained, tells the same: for what no mean and no variance shows (lost echoes,
  /// coarse steps, memory, light beside edges). Asked only where the gain does not tell.
  bool named_again = false;
};
/// Whether the gain tells that what was found is there.
[[nodiscard]] bool gains(const Outcome& outcome);
struct Confirmation {
  bool confirmed = false;
  std::vector<std::string> reasons;  ///< Sentences: what held, or what did not.
};
/// `claims`: physics was named or described, which must make the recording more likely.
[[nodiscard]] Confirmation judge(const Outcome& outcome, bool claims);

}  // namespace rig::investigate
