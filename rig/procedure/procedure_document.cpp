// SPDX-License-Identifier: MIT
#include "rig/procedure/procedure_document.hpp"

#include <yaml-cpp/yaml.h>

#include <set>

#include "fit/bench/json_position.hpp"
#include "fit/numeric/utf8.hpp"

namespace rig {
namespace {

constexpr std::size_t most_nodes =
    20'000;  // Aliases of aliases grow without bound; no procedure needs this many.
constexpr int deepest_document = 40;

FilePosition position_of(const YAML::Mark& mark, const std::string& file) {
  return {file, mark.line + 1, mark.column + 1};
}

/// Copies the parsed document into our own tree, with bounds on its size.
class Copier {
 public:
  explicit Copier(const std::string& file) : file_(file) {}

  Node copy(const YAML::Node& from, int depth = 0) {
    Node node;
    node.position = position_of(from.Mark(), file_);
    if (++nodes_ > most_nodes || depth > deepest_document)
      throw ProcedureError(node.position,
                           "the file is nested too deeply or repeats itself through aliases; write it out "
                           "in fewer levels.");
    if (from.IsScalar()) {
      node.kind = Node::Kind::scalar;
      node.scalar = from.Scalar();
    } else if (from.IsSequence()) {
      node.kind = Node::Kind::list;
      for (const auto& item : from) node.items.push_back(copy(item, depth + 1));
    } else if (from.IsMap()) {
      node.kind = Node::Kind::map;
      copy_members(from, node, depth);
    }
    return node;
  }

 private:
  void copy_members(const YAML::Node& from, Node& node, int depth) {
    std::set<std::string> seen;
    for (const auto& member : from) {
      Node key = copy(member.first, depth + 1);
      if (key.kind != Node::Kind::scalar) throw ProcedureError(key.position, "a key must be a plain word.");
      if (!seen.insert(key.scalar).second)
        throw ProcedureError(key.position, "'" + key.scalar + "' is given twice; remove one.");
      node.members.push_back({std::move(key), copy(member.second, depth + 1)});
    }
  }

  const std::string& file_;
  std::size_t nodes_ = 0;
};

}  // namespace

std::string FilePosition::text() const {
  return file + ":" + std::to_string(line) + ":" + std::to_string(column);
}

const Node* Node::find(const std::string& key) const {
  for (const auto& [name, value] : members)
    if (name.scalar == key) return &value;
  return nullptr;
}

Node read_document(const std::string& text, const std::string& file) {
  if (text.size() > largest_procedure_bytes)
    throw UsageError(file + " is larger than 1 MB, which no procedure is. Check that it is the right file.");
  if (text.find("\"bench/1\"") != std::string::npos && text.find_first_not_of(" \t\r\n") == text.find('{'))
    throw UsageError(
        file + " is a bench file, not a procedure. Give it with --bench, and a procedure in its place.");
  if (const std::size_t foreign = fit::first_beyond_utf8(text); foreign != std::string::npos) {
    const fit::TextPosition at = fit::position_at(text, foreign);
    throw ProcedureError({file, at.line, at.column}, std::string(fit::utf8_remedy) + ".");
  }
  Node root;
  try {
    root = Copier(file).copy(YAML::Load(text));
  } catch (const YAML::Exception& error) {
    throw ProcedureError(
        position_of(error.mark, file),
        "this is not YAML: " + error.msg + ". Check indentation, colons and brackets here and just above.");
  }
  root.position.file = file;
  if (root.position.line < 1) root.position.line = root.position.column = 1;
  return root;
}

}  // namespace rig
