// SPDX-License-Identifier: MIT
#include "lidar/frame_reader.hpp"

#include <catch2/catch.hpp>
#include <string>
#include <vector>

namespace frame_reader_test {

using namespace lidar;

namespace {

/// What comes out of the reader, one text a frame or error.
std::vector<std::string> drain(FrameReader& reader) {
  std::vector<std::string> seen;
  for (;;) {
    const auto frame = reader.next();
    if (!frame) {
      seen.emplace_back(to_string(frame.error()));
      continue;
    }
    if (!*frame) return seen;
    seen.push_back(std::string((**frame).echo) + "|" + std::string((**frame).status) + "|" +
                   std::string((**frame).body));
  }
}

}  // namespace

TEST_CASE("a frame comes out whole wherever the network cuts it") {
  const std::string stream = "\nQT\n00P\n\nTM1;a\n00P\n<SfkP\n\n\nVV\n0Ee\n\nPP\n";
  const std::vector<std::string> expected{"QT|00|", "TM1;a|00|<SfkP", "VV|0E|"};
  for (std::size_t cut = 0; cut <= stream.size(); ++cut) {
    INFO(cut);
    FrameReader reader;
    reader.feed(std::string_view(stream).substr(0, cut));
    std::vector<std::string> seen = drain(reader);
    reader.feed(std::string_view(stream).substr(cut));
    for (const std::string& more : drain(reader)) seen.push_back(more);
    CHECK(seen == expected);
    CHECK(reader.pending() == 3);
  }
}

TEST_CASE("frames come out whole when bytes arrive one by one") {
  const std::string stream = "QT\n00P\n\n\n\nTM1;a\n00P\n<SfkP\n\n";
  FrameReader reader;
  std::vector<std::string> seen;
  for (const char c : stream) {
    reader.feed(std::string_view(&c, 1));
    for (const std::string& more : drain(reader)) seen.push_back(more);
  }
  CHECK(seen == std::vector<std::string>{"QT|00|", "TM1;a|00|<SfkP"});
}

TEST_CASE("a bad frame costs one frame, not the connection") {
  FrameReader reader;
  reader.feed("garbage\n\nQT\n00X\n\nQT\n\n\nQT\n0\n\nQT\n00P\n\n");
  CHECK(drain(reader) == std::vector<std::string>{"an answer without a status line",
                                                  "an answer whose status line is wrong",
                                                  "an answer without a status line",
                                                  "an answer whose status line is wrong", "QT|00|"});
}

TEST_CASE("an endless frame costs one error and bounded memory, and the frame behind it is read") {
  FrameReader reader(1000);
  std::size_t errors = 0;
  for (int i = 0; i < 10000; ++i) {
    reader.feed(std::string(99, 'x') + "\n");
    errors += drain(reader).size();
    REQUIRE(reader.pending() <= 1100);
  }
  CHECK(errors == 1);
  reader.feed("\nQT\n00P\n\n");
  CHECK(drain(reader) == std::vector<std::string>{"QT|00|"});
}

}  // namespace frame_reader_test
