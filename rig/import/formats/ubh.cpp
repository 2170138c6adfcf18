// SPDX-License-Identifier: MIT
#include <cmath>
#include <fstream>
#include <map>
#include <memory>

#include "rig/errors.hpp"
#include "rig/import/importer.hpp"
#include "rig/text_lines.hpp"

namespace rig::importers {
namespace {

/// Logs of UrgBenri: lines "[key]", each followed by a line with its value; first the lidar's data, then
/// timestamp (the lidar's milliseconds), logtime and scan, again and again. A scan is RANGE or
/// RANGE|INTENSITY a step, steps separated by ';', several echoes of a step by '&'.
class UbhReader {
 public:
  UbhReader(std::string path, ImportSink& sink) : path_(std::move(path)), sink_(sink) {}

  void read(std::istream& in) {
    std::string line, key;
    bool too_long = false;
    while (sink_.wants_more() && next_line(in, line, too_long)) {
      const std::string_view text = trimmed(line);
      if (text.size() > 2 && text.front() == '[' && text.back() == ']') {
        key = text.substr(1, text.size() - 2);
        continue;
      }
      if (!text.empty() && !key.empty()) value(key, text);
      key.clear();
    }
    if (too_long)
      throw UsageError(path_ + " has a line of more than four million characters: it is not a UrgBenri log.");
    finish();
  }

 private:
  void value(const std::string& key, std::string_view text) {
    if (key == "timestamp") {
      stamp_ms_ = number_in(text);
      if (!stamp_ms_) ++faulty_;
    } else if (key == "scan") {
      scan(text);
      stamp_ms_.reset();
    } else if (key == "logtime") {
      if (!dated_) sink_.property("recorded_local", std::string(text));
      dated_ = true;
    } else if (key != "scanMark" && header_.size() < 100) {
      header_[key] = std::string(text);
    }
  }

  void scan(std::string_view text) {
    if (!stamp_ms_) {
      ++faulty_;
      return;
    }
    if (!geometry_) find_geometry();
    range_mm_.clear();
    intensity_.clear();
    bool with_intensity = false;
    for (const std::string_view step : split(text, ';')) {
      if (range_mm_.size() > 100'000) break;
      const auto echoes = split(step, '&');
      several_ = several_ || echoes.size() > 1;
      const auto parts = split(echoes.empty() ? std::string_view() : echoes.front(), '|');
      range_mm_.push_back(range_of(parts.empty() ? std::nullopt : number_in(parts[0])));
      intensity_.push_back(intensity_of(parts.size() > 1 ? number_in(parts[1]) : std::nullopt));
      with_intensity = with_intensity || parts.size() > 1;
    }
    if (steps_ == 0) steps_ = range_mm_.size();
    if (range_mm_.size() != steps_) {  // the end of a log whose recorder was stopped
      ++faulty_;
      return;
    }
    ImportedScan out;
    out.stamp_ns = unwrapped_ns();
    out.source = "UrgBenri";
    out.frame = "lidar";
    out.geometry = *geometry_;
    if (out.geometry.scan_s) *out.geometry.scan_s *= static_cast<double>(steps_);
    out.range_mm = range_mm_;
    if (with_intensity) out.intensity = intensity_;
    sink_.scan(out);
  }

  [[nodiscard]] std::optional<double> header(const char* key) const {
    const auto found = header_.find(key);
    return found == header_.end() ? std::nullopt : number_in(found->second);
  }

  void find_geometry() {
    for (const auto& [key, label] :
         {std::pair{"model", "model"}, {"serialNumber", "serial"}, {"firmwareVersion", "firmware"}})
      if (header_.contains(key)) sink_.property(label, header_[key]);
    double front = header("frontStep").value_or(-1), total = header("totalSteps").value_or(-1);
    double start = header("startStep").value_or(-1), grouping = header("grouping").value_or(1);
    if (front < 0 || total < 1 || start < 0 || grouping < 1 || grouping > 99) {
      if (header_["model"].find("UST-") == std::string::npos &&
          header_["model"].find("UTM-") == std::string::npos)
        throw UsageError(
            path_ +
            " does not say how the lidar's beams lie (frontStep, totalSteps, startStep), and its "
            "model is not one that rig knows. Add these lines from another log of the same lidar.");
      front = 540, total = 1440, grouping = 1;
      if (start < 0) start = 0;
      sink_.note("The steps of a " + header_["model"] + " were assumed: the log does not say them.");
    }
    const double step = 2 * fit::pi / total;
    fit::ScanGeometry geometry;
    geometry.step_rad = step * grouping;
    geometry.first_rad = (start + 0.5 * (grouping - 1) - front) * step;
    const double rpm = header("motorSpeed").value_or(0);
    const double turn_s = rpm > 1 ? 60 / rpm : header("scanMsec").value_or(0) / 1000;
    if (turn_s > 0)
      geometry.scan_s = turn_s * grouping / total;  // of one beam, until the number of beams is known
    geometry_ = geometry;
  }

  /// The lidar's timer has 24 bits.
  std::int64_t unwrapped_ns() {
    const double now = std::min(std::max(*stamp_ms_, 0.0), 9e12);
    if (last_ms_ && now + 8'388'608 < *last_ms_ && *last_ms_ < 16'777'216) wraps_ += 16'777'216;
    if (last_ms_ && now <= *last_ms_ && wraps_ == 0) ++backwards_;
    last_ms_ = now;
    return static_cast<std::int64_t>((now + wraps_) * 1e6);
  }

  void finish() {
    if (several_) sink_.note("The log holds several echoes a step: the first was used.");
    if (backwards_ > 0)
      sink_.note(std::to_string(backwards_) + " scans carry a time that is not after the one before.");
    if (faulty_ > 0)
      sink_.note(std::to_string(faulty_) + " scans were truncated or implausible and left out.");
  }

  std::string path_;
  ImportSink& sink_;
  std::map<std::string, std::string> header_;
  std::optional<fit::ScanGeometry> geometry_;
  std::optional<double> stamp_ms_, last_ms_;
  double wraps_ = 0;
  std::size_t steps_ = 0;
  std::uint64_t faulty_ = 0, backwards_ = 0;
  bool several_ = false, dated_ = false;
  std::vector<std::uint16_t> range_mm_, intensity_;
};

class Ubh : public Importer {
 public:
  std::string name() const override { return "UrgBenri log (.ubh)"; }

  bool recognises(const std::string& path, std::span<const std::uint8_t> first_bytes) const override {
    const std::string_view text(reinterpret_cast<const char*>(first_bytes.data()), first_bytes.size());
    if (text.empty() || text.find('\0') != text.npos) return false;
    return path.ends_with(".ubh") ? text.find('[') != text.npos
                                  : text.starts_with("[appName]") || text.find("\n[timestamp]") != text.npos;
  }

  void read(const std::string& path, const ImportOptions&, ImportSink& sink) const override {
    std::ifstream in(path, std::ios::binary);
    if (!in) throw UsageError(path + " cannot be opened. Check the name and the permissions.");
    UbhReader(path, sink).read(in);
  }
};

}  // namespace

std::unique_ptr<Importer> make_ubh() { return std::make_unique<Ubh>(); }

}  // namespace rig::importers
