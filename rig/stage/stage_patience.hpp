// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/awaitable.hpp>
#include <memory>
#include <string>

#include "rig/stage/stage_factory.hpp"

namespace rig {

/// open_stage(), but a port that is in use is waited for some seconds: the guard of a run that died holds it
/// until it has stopped the stage.
boost::asio::awaitable<std::unique_ptr<Stage>> open_stage_patiently(boost::asio::any_io_executor executor,
                                                                    std::string url, StageOptions options);

}  // namespace rig
