// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <memory>

#include "rig/runner/endpoint.hpp"
#include "rig/runner/lidar_source.hpp"

namespace rig {

/// The SCIP lidar at `address` as the runner's lidar. Every connect() also compares the clocks (TM), where
/// the lidar can. What the driver reports becomes DeviceError.
[[nodiscard]] std::unique_ptr<LidarSource> make_scip_source(boost::asio::any_io_executor executor,
                                                            const Endpoint& address);

}  // namespace rig
