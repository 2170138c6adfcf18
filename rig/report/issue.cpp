// SPDX-License-Identifier: MIT
#include "rig/report/issue.hpp"

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"
#include "rig/json_fields.hpp"
#include "rig/output_place.hpp"
#include "rig/session/sha256.hpp"

namespace rig {
namespace {

using nlohmann::json;

json issued(const SessionStore& session) {
  json all = json::parse(session.get("certificates").value_or("[]"), nullptr, false);
  return all.is_array() ? all : json::array();
}

std::string name_of(const std::string& file) { return std::filesystem::path(file).filename().string(); }

}  // namespace

Issue issue_of(const SessionStore& session, const std::string& first_number, const json& contents) {
  Sha256 hash;
  hash.feed(contents.dump(-1, ' ', false, json::error_handler_t::replace));
  Issue out{first_number, 0, "", hash.hex()};
  for (const json& earlier : issued(session)) {
    if (text_of(earlier, "digest") == out.digest)
      return {text_of(earlier, "number"), earlier.value("amendment", 0), text_of(earlier, "replaces"),
              out.digest};
    out.replaces = text_of(earlier, "number");
    ++out.amendment;
  }
  if (out.amendment > 0) out.number += "-A" + std::to_string(out.amendment);
  return out;
}

std::string register_with(const SessionStore& session, const json& certificate, const std::string& file) {
  json all = issued(session);
  const std::string name = file == "-" ? "standard output" : name_of(file);
  for (json& earlier : all) {
    if (text_of(earlier, "number") != text_of(certificate, "number")) continue;
    for (const json& known : list_of(earlier, "files"))
      if (known == name) return all.dump();
    earlier["files"].push_back(name);
    return all.dump();
  }
  all.push_back({{"number", text_of(certificate, "number")},
                 {"amendment", certificate.value("amendment", 0)},
                 {"replaces", text_of(certificate, "replaces")},
                 {"digest", text_of(certificate, "digest")},
                 {"issued_utc", text_of(certificate, "issued_utc")},
                 {"files", {name}}});
  return all.dump();
}

void refuse_other_certificate(const std::string& path, const json& certificate) {
  if (path == "-" || kind_of_file(path) != "certificate") return;
  std::ifstream file(path);
  const json there = json::parse(file, nullptr, false);
  const std::string number = text_of(there, "number");
  if (number != text_of(certificate, "number"))
    throw UsageError("cannot write " + path + ": it is the certificate " + number +
                     ", and no other replaces one. Give the output another name.");
}

std::string place_for(const SessionStore& session, const json& certificate, const std::string& wanted) {
  std::error_code ignored;
  if (!std::filesystem::exists(wanted, ignored)) return wanted;
  for (const json& earlier : issued(session)) {
    if (text_of(earlier, "number") != text_of(certificate, "number")) continue;
    for (const json& known : list_of(earlier, "files"))
      if (known == name_of(wanted)) return wanted;
  }
  const std::filesystem::path path(wanted);
  std::string stem = path.stem().string(), ending = path.extension().string();
  if (stem.ends_with(".dcc")) stem.resize(stem.size() - 4), ending = ".dcc" + ending;
  return (path.parent_path() / (stem + "-" + text_of(certificate, "number") + ending)).string();
}

}  // namespace rig
