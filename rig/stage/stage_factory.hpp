// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/awaitable.hpp>
#include <limits>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "rig/stage/stage.hpp"

namespace rig {

/// What the operator knows of the stage: the "stage" object of a bench file (docs/operate/stages.md), or its
/// URL. Zeros and empty texts mean: ask the device, or take what is usual for the language.
struct StageOptions {
  StageOptions() {}
  std::string language;      ///< "zaber", "shot", "gsc", "falcon"; empty: find out by asking.
  std::string model;         ///< "X-RSW60A" ...; gives the units per degree when the device cannot.
  double units_per_deg = 0;  ///< Device units in a degree.
  std::optional<double>
      zero_deg;       ///< The rig's zero on the stage's own scale; usual for the language: 0, falcon 180.
  int direction = 1;  ///< -1: the stage counts clockwise; angles are counter-clockwise everywhere else.
  double min_deg =
      -std::numeric_limits<double>::infinity();  ///< Soft limits: nothing is commanded beyond them.
  double max_deg = std::numeric_limits<double>::infinity();
  double speed_deg_s = 0, acceleration_deg_s2 = 0;
  double tolerance_deg = 0.02;  ///< A read-back farther from the target than this is an error, not a result.
  double settle_s = 0.1;        ///< Waited after "done" before the position is read.
  double reply_s = 0.5;         ///< How long one reply may take.
  double home_s = 180;          ///< How long homing may take.
  bool needs_homing = true;     ///< Refuse to move before home(); false: decided otherwise by the operator.
  int baud = 0;
  int address = 1;  ///< On a shared line (Zaber).
  int axis = 1;
};

/// Reads the bench's "stage" object; keys it does not know are left to others. Throws UsageError naming the
/// key, what was expected and what to do.
StageOptions stage_options(const nlohmann::json& stage);

/// Opens the stage at `url`, "serial:PATH[?language=zaber&baud=9600&address=1...]"; every key of the bench's
/// "stage" object may follow and overrides it. Finds out the language if none is given, identifies the device
/// and stops it if it is found moving. Throws UsageError (the URL) or StageError (the device: no permission,
/// busy, not there, silent).
boost::asio::awaitable<std::unique_ptr<Stage>> open_stage(boost::asio::any_io_executor executor,
                                                          std::string url, StageOptions options);

/// A serial port of this computer.
struct SerialPortInfo {
  std::string path, description;
  std::string usb_id;  ///< "0403:6001"; empty: not USB.
  std::string usb_product, usb_serial;
};
std::vector<SerialPortInfo> list_serial_ports();

/// What came from a port when it was asked in each language.
struct StageProbe {
  StageProbe() {}
  std::optional<StageIdentity> identity;  ///< Who answers in one that the rig speaks.
  std::string heard;                      ///< Else the first bytes that came, if any.
  int baud = 0;                           ///< At which they came.
  std::string refused;                    ///< Else why one who answers in such a language was not taken.
  [[nodiscard]] std::string why_nobody() const;  ///< In words, with what came and what to do.
};

/// Asks in each language (at its usual baud rate, or the one in the url) who is at `url`, as open_stage() has
/// it. Sends only queries, nothing moves. Throws UsageError (the URL), StageError when the port cannot be
/// opened.
boost::asio::awaitable<StageProbe> probe_stage(boost::asio::any_io_executor executor, std::string url);

}  // namespace rig
