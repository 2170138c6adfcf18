// SPDX-License-Identifier: MIT
#include "fit/explain/model/readings.hpp"

#include <algorithm>
#include <catch2/catch.hpp>

#include "../../support/imagined_room.hpp"

namespace readings_test {

TEST_CASE("a few beams of one capture stay apart beside many captures of everything") {
  ImaginedRoom room;
  room.captures = 20;
  const SyntheticRecording whole = room.record();
  SyntheticRecording recording(whole.bench(), whole.maker());
  for (const fit::CaptureInfo& info : whole.captures()) recording.add(info, room.scans);
  fit::CaptureInfo few = whole.captures().front();
  few.first_step = 130;
  few.last_step = 146;
  recording.add(few, room.scans);
  const fit::explain::Reduced reduced = fit::explain::reduce(recording, {});
  const auto of_few = std::ranges::count_if(reduced.cells, [&](const fit::explain::Cell& cell) {
    return cell.usable && reduced.groups[static_cast<std::size_t>(cell.group)].capture == room.captures;
  });
  REQUIRE(of_few > 10);
  constexpr std::size_t most = 1000;  // of more than five thousand cells
  const auto readings = fit::explain::model::readings_of(reduced, {}, most);
  CHECK(readings.size() < most * 6 / 5);  // Rows end where a surface does.
  CHECK(std::ranges::count(readings, room.captures, &fit::explain::model::Reading::capture) == of_few);
}

}  // namespace readings_test
