// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "rig/session/session_store.hpp"

namespace rig {

/// Under which number a certificate is issued. What a session's certificates said is kept in its key
/// `certificates`: the same contents keep their number, other contents are an amendment with a number of its
/// own.
struct Issue {
  std::string number;
  int amendment = 0;     ///< 0: the first issue.
  std::string replaces;  ///< Number of the one before; empty for the first.
  std::string digest;    ///< SHA-256 of what it says, without its dates.
};

/// `first_number`: of the session's first certificate; `contents`: what makes it this certificate.
[[nodiscard]] Issue issue_of(const SessionStore& session, const std::string& first_number,
                             const nlohmann::json& contents);

/// The key `certificates` with this issue in it, written to `file`.
[[nodiscard]] std::string register_with(const SessionStore& session, const nlohmann::json& certificate,
                                        const std::string& file);

/// Where a certificate goes that was to go to `wanted`: there, if nothing is there or this very certificate
/// was issued there before; else beside it, under a name with its number. Nothing is overwritten by another
/// one.
[[nodiscard]] std::string place_for(const SessionStore& session, const nlohmann::json& certificate,
                                    const std::string& wanted);

/// Throws UsageError if `path` holds another certificate as JSON.
void refuse_other_certificate(const std::string& path, const nlohmann::json& certificate);

}  // namespace rig
