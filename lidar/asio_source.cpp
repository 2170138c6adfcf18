// SPDX-License-Identifier: MIT
// Asio's own code, compiled once: every file that includes it would compile it again
// (BOOST_ASIO_SEPARATE_COMPILATION).
#include <boost/asio/impl/src.hpp>
