// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace fit {

/// A bench file's document, with everything that `Bench` does not model (the stage's language, soft limits,
/// the simulator's section, tables ...). It is parsed once, copies share it, and it is always an object. Each
/// part has one reader that gives it a type: accuracy_of(), claimed_intensity(), empirical_functions(), and,
/// beside their users, stage_limits(), stage_options() and simple_options().
class BenchDocument {
 public:
  BenchDocument();
  /// JSON, perhaps with comments. What is none, or no object, counts as an empty object.
  BenchDocument(const std::string& text);  // NOLINT: a text is a document.
  BenchDocument(const char* text);         // NOLINT: likewise.
  explicit BenchDocument(nlohmann::json document);

  [[nodiscard]] const nlohmann::json& json() const { return *value_; }
  /// The object under a key; an empty one where there is none.
  [[nodiscard]] const nlohmann::json& section(const std::string& key) const;
  /// Gives `edit` the document to change; other copies keep theirs.
  void change(const std::function<void(nlohmann::json& document)>& edit);

 private:
  std::shared_ptr<const nlohmann::json> value_;
};

}  // namespace fit
