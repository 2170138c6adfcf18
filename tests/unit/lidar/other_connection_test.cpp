// SPDX-License-Identifier: MIT
#include "lidar/other_connection.hpp"

#include <catch2/catch.hpp>

namespace other_connection_test {

TEST_CASE("another program's connection to the lidar is found in the list of connections") {
  const std::string list =
      "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n"
      "   0: 0100007F:2ABC 00000000:0000 0A 00000000:00000000 00:00000000 00000000     0        0 11 1 0 100 "
      "0 0 10 0\n"
      "   1: 0B00A8C0:D431 0A00A8C0:2ABC 01 00000000:00000000 02:000AFC80 00000000  1000        0 4711 2 0 "
      "20 4 0 10 -1\n"
      "   2: 0B00A8C0:D433 0A00A8C0:2ABC 06 00000000:00000000 02:000AFC80 00000000  1000        0 12 2 0 20 "
      "4 0 10 -1\n"
      "   3: 0B00A8C0:D435 0A00A8C0:2ABD 01 nonsense\n";
  constexpr std::uint32_t lidar = 0xC0A8000A;  // 192.168.0.10
  const auto found = lidar::connection_in(list, lidar, 10940, 1);
  REQUIRE(found);
  CHECK(found->local_port == 0xD431);
  CHECK(found->inode == 4711);
  CHECK_FALSE(lidar::connection_in(list, lidar, 10940, 0xD431));  // Our own.
  CHECK_FALSE(lidar::connection_in(list, lidar, 10941, 1));
  CHECK_FALSE(lidar::connection_in(list, lidar + 1, 10940, 1));
  CHECK_FALSE(lidar::connection_in("", lidar, 10940, 1));
}

}  // namespace other_connection_test
