// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <memory>

#include "rig/runner/endpoint.hpp"
#include "rig/runner/runner.hpp"

namespace rig {

/// The computer's clocks.
[[nodiscard]] std::unique_ptr<RunClock> make_real_clock();

/// Confirms every prompt at once, with the default answer where it has a question: `--yes`.
[[nodiscard]] std::unique_ptr<Operator> make_absent_operator();

/// A simulated bench that does itself what prompts ask for, through its operator port
/// (docs/develop/simulator.md).
[[nodiscard]] std::unique_ptr<Operator> make_bench_operator(const boost::asio::any_io_executor& executor,
                                                            const Endpoint& address);

/// A person who reads prompts on standard error and types answers on standard input. When standard input has
/// ended it waits for the live page if there is one (`others_answer`), else it throws UsageError.
[[nodiscard]] std::unique_ptr<Operator> make_terminal_operator(const boost::asio::any_io_executor& executor,
                                                               bool others_answer);

}  // namespace rig
