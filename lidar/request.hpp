// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>

namespace lidar {

/// Everything a host can ask of a SCIP 2.x sensor.
enum class Command {
  version,           ///< VV
  parameters,        ///< PP
  information,       ///< II
  laser_on,          ///< BM
  quit,              ///< QT
  reset,             ///< RS
  reset_keep_speed,  ///< RT
  reboot,            ///< RB, twice within a second
  time_enter,        ///< TM0
  time_read,         ///< TM1, or %TM1 in microseconds
  time_leave,        ///< TM2
  state,             ///< %ST
  sleep,             ///< %SL
  scan,              ///< GS GD GE HD HE (one scan) and MS MD ME ND NE (continuous): see ScanCommand
  motor_speed,       ///< CRnn
  sensitivity,       ///< HSn
  bit_rate,          ///< SSnnnnnn
  simulate_fault,    ///< DBnn
  switch_scip2,      ///< SCIP2.0
  set_address,       ///< $IP and 36 digits
};

/// What one value of a scan is made of.
enum class ScanFormat {
  distance2,           ///< Two characters: 12 bits, GS and MS.
  distance3,           ///< Three characters: 18 bits, GD, MD, HD, ND.
  distance_intensity,  ///< Three and three: GE, ME, HE, NE.
};

/// The parameters of a scan command, as they stand on the wire.
struct ScanCommand {
  bool continuous = true;  ///< M* and N*: an acknowledgement, then scans; else G* and H*: one answer.
  bool multi_echo = false;
  bool microseconds = false;  ///< %MD, %ME: 11-character stamps.
  ScanFormat format = ScanFormat::distance_intensity;
  int first_step = 0, last_step = 1080;
  int cluster = 1;  ///< Steps merged into one value; 0 on the wire means 1.
  int skip = 0;     ///< Continuous only: scans left out between two sent ones, 0 to 9.
  int count = 0;    ///< Continuous only: scans wanted, 0 = until QT. In a scan's echo: scans that remain.

  /// Values in one scan: one for each cluster, the last of which may be short.
  [[nodiscard]] int values() const {
    const int merged = cluster > 0 ? cluster : 1;
    return (last_step - first_step) / merged + 1;
  }
  friend bool operator==(const ScanCommand&, const ScanCommand&) = default;
};

/// One request. `text` is the optional string behind ';' (at most 16 characters), which the sensor repeats in
/// its echo.
struct Request {
  Command command = Command::version;
  ScanCommand scan;           ///< For Command::scan.
  bool microseconds = false;  ///< For Command::time_read: %TM1.
  std::string argument;       ///< Digits of CR, HS, SS, DB and $IP.
  std::string text;

  Request() = default;
  Request(Command command_, std::string text_ = {})
      : command(command_), text(std::move(text_)) {}         // NOLINT: implicit
  Request(const ScanCommand& scan_, std::string text_ = {})  // NOLINT: implicit
      : command(Command::scan), scan(scan_), text(std::move(text_)) {}
  friend bool operator==(const Request&, const Request&) = default;
};

/// Why a line is no valid request, in the order in which a sensor finds it.
enum class RequestError {
  undefined_command,
  string_too_long,       ///< More than 16 characters behind ';'.
  bad_string_character,  ///< A control character or a byte above 0x7E behind ';'.
  too_short,
  too_long,
  bad_argument,  ///< TM with another digit than 0, 1, 2; a letter in the argument of CR, HS, SS, DB, $IP.
  first_not_a_number,
  last_not_a_number,
  cluster_not_a_number,
  skip_not_a_number,
  count_not_a_number,
  last_before_first,
};

/// The line of a request without its LF, e.g. "ME0000108001000;a7".
[[nodiscard]] std::string build_line(const Request& request);
/// The same with LF: what goes on the wire.
[[nodiscard]] std::string build_request(const Request& request);

/// Reads a request line (without LF): the inverse of build_line, for the simulator and for echoes.
[[nodiscard]] tl::expected<Request, RequestError> parse_request(std::string_view line);

/// The status with which a UST-generation sensor refuses such a line ("0E" ...).
[[nodiscard]] std::string_view status_of(RequestError error);

/// Cuts what a host sends into request lines. LF, CR and CR LF end a line; empty lines say nothing; a line
/// longer than 128 bytes is dropped to its end and comes out as an empty optional's error, so memory stays
/// bounded.
///
///   reader.feed("VV\r\nQ");  reader.next() -> "VV"; then nothing until the rest of QT is fed
class RequestReader {
 public:
  enum class Error { too_long };
  void feed(std::string_view bytes);
  /// The next line, valid until the next call of feed; an empty optional when more bytes are needed.
  [[nodiscard]] tl::expected<std::optional<std::string_view>, Error> next();

 private:
  static constexpr std::size_t max_line = 128;
  std::string buffer_;
  std::size_t begin_ = 0;
  bool skipping_ = false;
};

}  // namespace lidar
