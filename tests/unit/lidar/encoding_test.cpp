// SPDX-License-Identifier: MIT
#include "lidar/encoding.hpp"

#include <rapidcheck.h>

#include <catch2/catch.hpp>

namespace encoding_test {

using namespace lidar;

TEST_CASE("the checksum of known lines is what real sensors send") {
  CHECK(checksum("00") == 'P');
  CHECK(checksum("99") == 'b');
  CHECK(checksum("0E") == 'e');
  CHECK(checksum("0L") == 'l');
  CHECK(checksum("<Sfk") == 'P');
  CHECK(checksum("PROT:SCIP 2.0") == 'N');
}

TEST_CASE("known values decode: the examples of the SCIP specification") {
  CHECK(decode_value("CB") == 1234);
  CHECK(decode_value("1Dh") == 5432);
  CHECK(decode_value("m2@0") == 16000000);
  CHECK_FALSE(decode_value(""));
  CHECK_FALSE(decode_value("12p"));
  CHECK_FALSE(decode_value("1/"));
  CHECK_FALSE(decode_value("000000000000"));
  CHECK_FALSE(decode_value("o0000000000"));
}

TEST_CASE("every value survives encoding and decoding in any length that can hold it") {
  CHECK(rc::check([] {
    const int characters = *rc::gen::inRange(1, 12);
    const std::uint64_t mask = characters == 11 ? ~0ull : (1ull << 6 * characters) - 1;
    const std::uint64_t value = *rc::gen::arbitrary<std::uint64_t>() & mask;
    std::string text;
    append_value(text, value, characters);
    RC_ASSERT(text.size() == static_cast<std::size_t>(characters));
    RC_ASSERT(decode_value(text) == value);
  }));
}

}  // namespace encoding_test
