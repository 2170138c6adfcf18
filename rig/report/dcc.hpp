// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace rig {

/// The certificate (make_certificate) as PTB's Digital Calibration Certificate, schema 3.2.1: administrative
/// data, and every value with an uncertainty as D-SI quantity with its expanded uncertainty. What the bench
/// file does not state is written as "not stated".
[[nodiscard]] std::string to_dcc(const nlohmann::json& certificate);

}  // namespace rig
