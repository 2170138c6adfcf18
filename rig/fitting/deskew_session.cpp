// SPDX-License-Identifier: MIT
#include "rig/fitting/deskew_session.hpp"

#include <nlohmann/json.hpp>

#include "rig/session/new_session.hpp"
#include "rig/session/session_store.hpp"

namespace rig {

nlohmann::json deskew_session(const std::string& input, const OutputPlace& output,
                              const DeskewOptions& options) {
  nlohmann::json result;
  make_session(output, [&](const std::string& unfinished) {
    const SessionStore session(input, SessionStore::Mode::read);
    const Deskewing deskewing(options, *session.recording(), input);
    result = deskewing.document();
    copy_session(input, unfinished);
    deskewing.write(unfinished);
    SessionStore store(unfinished, SessionStore::Mode::append);
    store.add_result("deskew", result.dump());
    store.finish();
  });
  return result;
}

}  // namespace rig
