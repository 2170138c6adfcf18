// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "rig/errors.hpp"
#include "rig/procedure/procedure_value.hpp"

namespace rig {

class StepKind;

/// Where something stands in a procedure file; lines and columns count from 1.
struct FilePosition {
  std::string file;
  int line = 0, column = 0;
  [[nodiscard]] std::string text() const;
};

/// A procedure file that cannot be used: "FILE:LINE:COLUMN: what is wrong; what was expected; what to do".
class ProcedureError : public UsageError {
 public:
  ProcedureError(const FilePosition& position, const std::string& what)
      : UsageError(position.text() + ": " + what) {}
};

/// One value of a procedure file with its position: text, list or map (in the file's order).
struct Node {
  enum class Kind { nothing, scalar, list, map };
  Kind kind = Kind::nothing;
  FilePosition position;
  std::string scalar;
  std::vector<Node> items;
  struct Member;
  std::vector<Member> members;

  [[nodiscard]] const Node* find(const std::string& key) const;
};

struct Node::Member {
  Node first, second;  ///< Key and value.
};

/// One option of a step: what it is called, what it takes, and what a person needs to know. From these come
/// the checks, the schema and the documentation.
struct Option {
  enum class Type { number, integer, text, flag, numbers, map, choice, path };
  std::string name = {};
  Type type = Type::number;
  std::string about = {};
  bool required = false;
  std::optional<double> min = {}, max = {};
  std::vector<std::string> choices = {};  ///< For choice.
  std::vector<Option> members = {};       ///< For map; empty: any key is allowed.
};

/// A step's options with their expressions evaluated. Getters check type and range and throw ProcedureError;
/// a number that depends on something Unknown is NaN.
class Arguments {
 public:
  Arguments(const Node& options, const std::vector<Option>& known, const Variables& variables)
      : options_(&options), known_(&known), variables_(&variables) {}

  [[nodiscard]] bool has(const std::string& name) const { return options_->find(name) != nullptr; }
  [[nodiscard]] double number(const std::string& name) const;
  [[nodiscard]] double number_or(const std::string& name, double otherwise) const;
  [[nodiscard]] std::optional<double> maybe_number(const std::string& name) const;
  [[nodiscard]] int integer_or(const std::string& name, int otherwise) const;
  [[nodiscard]] std::string text_or(const std::string& name, const std::string& otherwise) const;
  [[nodiscard]] bool flag_or(const std::string& name, bool otherwise) const;
  /// Exactly two numbers, ascending, or nothing.
  [[nodiscard]] std::optional<std::pair<double, double>> interval(const std::string& name) const;
  /// The members of a map option, empty if it is absent.
  [[nodiscard]] Arguments map(const std::string& name) const;
  /// Any value as JSON with its expressions evaluated.
  [[nodiscard]] nlohmann::json json(const std::string& name) const;
  [[nodiscard]] const FilePosition& position() const { return options_->position; }
  [[nodiscard]] const FilePosition& position_of(const std::string& name) const;
  [[nodiscard]] const Node& node() const { return *options_; }
  [[nodiscard]] const Variables& variables() const { return *variables_; }
  [[nodiscard]] Value value(const Node& scalar) const;

 private:
  [[nodiscard]] double checked_number(const Node& scalar, const std::string& name) const;
  [[nodiscard]] const Option* option(const std::string& name) const;

  const Node* options_;
  const std::vector<Option>* known_;
  const Variables* variables_;
};

/// One step as written. `steps` are those of a for-each.
struct Step {
  const StepKind* kind = nullptr;
  FilePosition position;
  std::string name;     ///< As written, may hold expressions; empty if none was given.
  std::string ordinal;  ///< Its place in the file's order: "3", "4.1".
  Node options;
  std::vector<Step> steps;
};

/// What a result must satisfy.
struct Limit {
  std::string name;
  std::string kind, value;  ///< Value VALUE of the newest result KIND (written `of: KIND.VALUE`).
  std::optional<double> min, max;
  std::optional<double> max_expanded;  ///< Largest expanded uncertainty (k = 2) allowed.
  bool guarded = false;                ///< Guard band as wide as the expanded uncertainty (ILAC-G8:09/2019).
  double guard_band = 0;               ///< Or of this fixed width.
  FilePosition position = {};          ///< Of what it is about.
};

/// How the stage is to be moved, unless a step says otherwise.
struct StageRules {
  int approach = +1;        ///< Sign of the last move before every stop; 0: the shortest way.
  double margin_deg = 0.5;  ///< Run-up that takes up the backlash (0.1 deg on cheap stages, design notes).
  double tolerance_deg = 0.02;  ///< Largest difference between command and read-back.
  double settle_s = 0;          ///< Extra wait after the stage says that it stands.
  bool unhomed = false;         ///< Moving before homing is allowed.
};

/// A procedure file, checked in all that can be checked without devices.
struct Procedure {
  std::string file, name, title, about, source;
  StageRules stage;
  Variables variables;
  std::vector<Limit> limits;
  std::vector<Step> steps;
  std::string text;  ///< The file as it was read.
};

/// Reads a procedure. `overrides` replace variables of the file (command line). Throws ProcedureError.
Procedure parse_procedure(const std::string& text, const std::string& file, const Variables& overrides = {});
/// Finds the file: a path, or a bare name looked up in `procedures/` of the source tree and the install
/// prefix.
std::string find_procedure(const std::string& path_or_name);
Procedure read_procedure(const std::string& path, const Variables& overrides = {});

/// The JSON Schema that editors use, made from the same option lists that the checks use.
std::string procedure_schema();

}  // namespace rig
