// SPDX-License-Identifier: MIT
// The stream of scans: from the request to measure to scans with their times.
#include <algorithm>
#include <cmath>

#include "lidar/client_impl.hpp"
#include "lidar/reply.hpp"
#include "lidar/status.hpp"

namespace lidar {
namespace {

/// What a scan's stamp and values become for users: codes and values that are no range are 0.
Scan scan_from(const RawScan& raw, const Identity& identity) {
  Scan scan;
  scan.range_mm.reserve(raw.range_mm.size());
  const auto least = static_cast<std::uint32_t>(identity.min_range_mm),
             most = std::uint32_t{largest_range_mm(identity.max_range_mm)};
  for (const std::uint32_t range : raw.range_mm)
    scan.range_mm.push_back(range < least || range > most ? std::uint16_t{0}
                                                          : static_cast<std::uint16_t>(range));
  scan.intensity.reserve(raw.intensity.size());
  for (const std::uint32_t value : raw.intensity)
    scan.intensity.push_back(static_cast<std::uint16_t>(std::min<std::uint32_t>(value, 65535)));
  return scan;
}

}  // namespace

awaitable<void> Client::Impl::start(StreamRequest wanted) {
  if (wanted.first_step < identity.min_step || wanted.last_step > identity.max_step ||
      wanted.first_step > wanted.last_step || wanted.cluster < 1 || wanted.cluster > 99 || wanted.skip < 0 ||
      wanted.skip > 9)
    fail(Kind::wrong_use,
         "steps " + std::to_string(wanted.first_step) + " to " + std::to_string(wanted.last_step) +
             " in clusters of " + std::to_string(wanted.cluster) + ", skipping " +
             std::to_string(wanted.skip) + ": this lidar has steps " + std::to_string(identity.min_step) +
             " to " + std::to_string(identity.max_step) + ", clusters of 1 to 99 and skips of 0 to 9");
  if (streaming) co_await stop();
  request = wanted;
  stream_command = ScanCommand();
  stream_command.format = wanted.with_intensity ? ScanFormat::distance_intensity : ScanFormat::distance3;
  stream_command.first_step = wanted.first_step;
  stream_command.last_step = wanted.last_step;
  stream_command.cluster = wanted.cluster;
  stream_command.skip = wanted.skip;
  const Request asked(stream_command);
  for (int attempt = 0; attempt < attempts; ++attempt) {
    const std::optional<Answer> answer = co_await exchange(asked);
    if (!answer) {  // it may stream all the same: end it before asking again
      co_await end_stream();
      continue;
    }
    const StatusKind kind = kind_of(answer->status, asked);
    if (kind == StatusKind::scan_data) {  // it streams, but its acknowledgement was spoilt on the way
      co_await end_stream();
      continue;
    }
    const bool is_refused = kind != StatusKind::done && kind != StatusKind::already;
    if (answer->status == "0E" || answer->status == "0F")
      fail(Kind::unknown_command,
           "the lidar at " + address() + " does not know " + build_line(asked).substr(0, 2) + " (status " +
               answer->status + ": " + meaning_of(answer->status, asked) + "). " +
               (wanted.with_intensity ? "It sends no intensities: ask for distances alone"
                                      : "It sends no continuous scans, so this driver cannot use it"));
    if (is_refused && kind != StatusKind::hardware_fault && attempt + 1 < attempts) {
      co_await end_stream();  // Whatever state it is in, QT leads out of it.
      continue;
    }
    if (is_refused)
      fail(kind == StatusKind::hardware_fault ? Kind::hardware_fault : Kind::refused,
           "the lidar at " + address() + " refuses to measure: status " + answer->status + ", " +
               meaning_of(answer->status, asked) + ". Switch it off and on if this persists");
    stream_tag = ";r" + std::to_string((requests + 999999) % 1000000);
    receiver =
        ScanReceiver(stream_command, stream_tag.substr(1), identity.min_range_mm, identity.max_range_mm);
    stream_echo = build_line(asked);
    stream_echo.resize(stream_echo.size() - 2);  // the number of scans that remain changes
    streaming = true;
    bad_in_a_row = repeated_in_a_row = 0;
    scan_seen = false;
    last_stray.clear();
    clock.begin_stream();
    co_return;
  }
  fail(Kind::no_answer, "the lidar at " + address() + " did not answer the request to measure");
}

void Client::Impl::count_damage(const std::string& what) {
  ++statistics.bad;
  if (++bad_in_a_row < options.max_bad_scans) return;
  fail(Kind::bad_answer, std::to_string(bad_in_a_row) + " scans in a row from the lidar at " + address() +
                             " arrived damaged (the last: " + what +
                             "). Check the network cable; reconnecting may help");
}

/// A message of the stream that is not a scan: a check of itself, or a fault.
void Client::Impl::judge_stream_status(const Frame& frame) {
  const Request asked(stream_command);
  const StatusKind kind = kind_of(frame.status, asked);
  last_stray = "status " + std::string(frame.status) + ", " + meaning_of(frame.status, asked);
  if (kind != StatusKind::hardware_fault) return;  // checking and resumed: wait on
  streaming = false;
  fail(Kind::hardware_fault, "the lidar at " + address() + " stopped measuring: status " +
                                 std::string(frame.status) + ", " + meaning_of(frame.status, asked) +
                                 ". Switch it off and on; if the fault persists, it needs service");
}

/// The last scan in a message that lost its beginning, or its end to the next: one loss should not cost two.
std::optional<Frame> Client::Impl::scan_frame_in_damaged(std::string_view bytes) const {
  const std::size_t at = bytes.rfind(stream_echo);
  if (at == std::string_view::npos || at == 0) return std::nullopt;
  const auto frame = parse_frame(bytes.substr(at));
  return frame ? std::optional(*frame) : std::nullopt;
}

/// The scan that a message of this stream carries; nothing for any other message.
std::optional<Scan> Client::Impl::scan_in(const Frame& frame) {
  const bool ours = frame.echo.starts_with(stream_echo) && frame.echo.ends_with(stream_tag) &&
                    frame.echo.size() == stream_echo.size() + 2 + stream_tag.size();
  if (!ours) {
    const bool a_scan = frame.status == "99";
    ++(a_scan ? statistics.stale : statistics.strays);
    last_stray = "an answer to " + std::string(frame.echo.substr(0, 40)) + ", which was not asked for";
    return std::nullopt;
  }
  if (kind_of(frame.status, Request(stream_command)) != StatusKind::scan_data) {
    judge_stream_status(frame);
    return std::nullopt;
  }
  auto raw = decode_scan(frame.body, stream_command);
  if (!raw) {
    count_damage(std::string(to_string(raw.error())));
    const auto inner = scan_frame_in_damaged(frame.body);
    return inner ? scan_in(*inner) : std::nullopt;
  }
  Scan scan = scan_from(*raw, identity);
  if (!place_in_time(scan, static_cast<std::uint32_t>(raw->stamp & 0xFFFFFF))) return std::nullopt;
  return scan;
}

/// A scan whose stamp is not later than that of the one before is the same again, or one from before.
void Client::Impl::count_repetition() {
  ++statistics.repeated;
  if (++repeated_in_a_row < options.max_bad_scans) return;
  fail(Kind::bad_answer, "the time stamps of " + std::to_string(repeated_in_a_row) +
                             " scans in a row from the lidar at " + address() +
                             " do not advance: its timer has stopped or was set back, or it repeats scans. "
                             "None of them was delivered. Reconnect; switch it off and on if this persists");
}

/// Completes a good scan with what is known of it beside its values, and counts it; false when it is a
/// repetition.
bool Client::Impl::place_in_time(Scan& scan, std::uint32_t stamp) {
  bad_in_a_row = 0;
  scan.first_step = request.first_step;
  scan.last_step = request.last_step;
  scan.cluster = request.cluster;
  // Not even of another connection: a timer that stands still would else be taken for one that restarted.
  if (last_stamp == stamp) {
    count_repetition();
    return false;
  }
  last_stamp = stamp;
  scan.device_ms = clock.unwrap(stamp, static_cast<double>(arrived_us));
  if (scan_seen && scan.device_ms <= last_scan_ms) {
    count_repetition();
    return false;
  }
  repeated_in_a_row = 0;
  scan.host_us = static_cast<std::int64_t>(
      std::llround(clock.add_scan(scan.device_ms, static_cast<double>(arrived_us))));
  if (scan_seen) {
    const double period_ms = identity.scan_period_s * 1000 * (request.skip + 1);
    const auto passed = std::llround(static_cast<double>(scan.device_ms - last_scan_ms) / period_ms);
    if (passed > 1) statistics.lost += static_cast<std::uint64_t>(passed - 1);
  }
  scan_seen = true;
  last_scan_ms = scan.device_ms;
  ++statistics.scans;
  return true;
}

/// The next scan in the waiting bytes, for as long as they are as expected.
std::optional<Scan> Client::Impl::scan_at_hand() {
  std::optional<Scan> scan(std::move(spare));
  while (const auto stamp = receiver.take(reader.waiting(), *scan)) {
    reader.consume(receiver.message_bytes());
    if (place_in_time(*scan, *stamp)) return scan;
  }
  spare = std::move(*scan);
  return std::nullopt;
}

/// Most scans of a fast stream came with the one before: those take neither the clock nor a wait.
awaitable<Scan> Client::Impl::next() {
  if (!streaming) fail(Kind::wrong_use, "no stream is running: call start() first");
  if (std::optional<Scan> scan = scan_at_hand()) co_return std::move(*scan);
  co_return co_await ending_in_silence(*this, next_to_come());
}

awaitable<Scan> Client::Impl::next_to_come() {
  const auto until = steady_clock::now() + options.scan_timeout;
  while (true) {
    if (std::optional<Scan> scan = scan_at_hand()) co_return std::move(*scan);
    const auto frame = reader.next();
    if (!frame) {
      ++statistics.resynchronised;
      count_damage(std::string(to_string(frame.error())));
      if (const auto whole = scan_frame_in_damaged(reader.last_bytes()))
        if (std::optional<Scan> scan = scan_in(*whole)) co_return std::move(*scan);
    } else if (frame->has_value()) {
      if (std::optional<Scan> scan = scan_in(**frame)) co_return std::move(*scan);
    } else {
      const bool arrived = co_await fill(until, "waiting for a scan");
      if (!arrived) co_await no_scan_came();
    }
  }
}

/// What a lidar that sends nothing says of itself, to be read behind "; ".
awaitable<std::string> Client::Impl::state_of_lidar() {
  const std::optional<Answer> answer = co_await exchange(Request(Command::information));
  if (!answer) co_return "it does not answer queries either";
  const auto values = decode_key_values(answer->body);
  if (!values || values->empty()) co_return "its status query (II) returned status " + answer->status;
  co_return "it reports laser " + value_of(*values, "LASR") + ", " + value_of(*values, "MESM") + ", " +
      value_of(*values, "STAT");
}

awaitable<void> Client::Impl::no_scan_came() {
  const std::string limit = std::to_string(options.scan_timeout.count()) + " ms";
  if (bad_in_a_row > 0)
    fail(Kind::bad_answer, "only damaged scans (" + std::to_string(bad_in_a_row) +
                               ") arrived from the lidar at " + address() + " in " + limit +
                               ". Check the network cable; reconnecting may help");
  std::string what = "the lidar at " + address() + " sent no scan for " + limit;
  if (!last_stray.empty()) what += "; the last it sent was " + last_stray;
  const std::string state = co_await state_of_lidar();
  what += "; " + state;
  fail(Kind::no_answer, what + ". Check its power and network cable; reconnecting may help");
}

awaitable<void> Client::Impl::stop() {
  if (!streaming || !connected) co_return;
  co_await end_stream();
}

}  // namespace lidar
