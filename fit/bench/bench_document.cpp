// SPDX-License-Identifier: MIT
#include "fit/bench/bench_document.hpp"

#include <nlohmann/json.hpp>

namespace fit {
namespace {

std::shared_ptr<const nlohmann::json> object_of(nlohmann::json document) {
  if (!document.is_object()) document = nlohmann::json::object();
  return std::make_shared<const nlohmann::json>(std::move(document));
}

}  // namespace

BenchDocument::BenchDocument() : BenchDocument(nlohmann::json::object()) {}

BenchDocument::BenchDocument(const std::string& text)
    : BenchDocument(nlohmann::json::parse(text, nullptr, false, true)) {}

BenchDocument::BenchDocument(const char* text) : BenchDocument(std::string(text)) {}

BenchDocument::BenchDocument(nlohmann::json document) : value_(object_of(std::move(document))) {}

const nlohmann::json& BenchDocument::section(const std::string& key) const {
  static const nlohmann::json none = nlohmann::json::object();
  const auto found = value_->find(key);
  return found != value_->end() && found->is_object() ? *found : none;
}

void BenchDocument::change(const std::function<void(nlohmann::json& document)>& edit) {
  nlohmann::json document = *value_;
  edit(document);
  value_ = object_of(std::move(document));
}

}  // namespace fit
