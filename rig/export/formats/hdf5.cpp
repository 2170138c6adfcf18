// SPDX-License-Identifier: MIT
#include <hdf5.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "fit/numeric/angle.hpp"
#include "rig/export/exporter.hpp"
#include "rig/session/deskewed_scans.hpp"
#include "rig/whole_file.hpp"

namespace rig::exporters {
namespace {

constexpr hsize_t scans_in_a_chunk = 256;

/// An HDF5 handle that closes itself; making one from a failed call throws.
class Handle {
 public:
  Handle(hid_t id, herr_t (*close)(hid_t), const char* what) : id_(id), close_(close) {
    if (id < 0) throw DiskFailure(std::string("HDF5 cannot ") + what);
  }
  ~Handle() { close_(id_); }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  operator hid_t() const { return id_; }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

void check(herr_t status, const char* what) {
  if (status < 0) throw DiskFailure(std::string("HDF5 cannot ") + what);
}

void set_text(hid_t where, const char* name, const std::string& text) {
  const Handle type(H5Tcopy(H5T_C_S1), H5Tclose, "make a text type");
  check(H5Tset_size(type, std::max<std::size_t>(text.size(), 1)), "make a text type");
  check(H5Tset_cset(type, H5T_CSET_UTF8), "make a text type");
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose, "make a space");
  // Long texts (a procedure, a bench) are datasets: an attribute holds 64 kB at most.
  const std::string padded = text.empty() ? std::string(1, '\0') : text;
  const Handle data(H5Dcreate2(where, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Dclose,
                    "make a text");
  check(H5Dwrite(data, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, padded.data()), "write a text");
}

template <class T>
void set_number(hid_t where, const char* name, T value) {
  const hid_t type = std::is_floating_point_v<T> ? H5T_NATIVE_DOUBLE : H5T_NATIVE_INT64;
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose, "make a space");
  const Handle attribute(H5Acreate2(where, name, type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose,
                         "make an attribute");
  check(H5Awrite(attribute, type, &value), "write an attribute");
}

/// A table of `width` columns (0: a plain list) that grows by rows, compressed.
template <class T>
class Column {
 public:
  Column(hid_t group, const char* name, hid_t type, hsize_t width)
      : type_(type), width_(width), data_(make(group, name, type, width), H5Dclose, "make a dataset") {}

  void add(const T* values) {
    buffer_.insert(buffer_.end(), values, values + std::max<hsize_t>(width_, 1));
    if (++buffered_ == scans_in_a_chunk) flush();
  }

  void flush() {
    if (buffered_ == 0) return;
    const int rank = width_ ? 2 : 1;
    const hsize_t size[2] = {rows_ + buffered_, width_}, start[2] = {rows_, 0},
                  count[2] = {buffered_, width_};
    check(H5Dset_extent(data_, size), "grow a dataset");
    const Handle file_space(H5Dget_space(data_), H5Sclose, "make a space");
    const Handle memory_space(H5Screate_simple(rank, count, nullptr), H5Sclose, "make a space");
    check(H5Sselect_hyperslab(file_space, H5S_SELECT_SET, start, nullptr, count, nullptr), "select rows");
    check(H5Dwrite(data_, type_, memory_space, file_space, H5P_DEFAULT, buffer_.data()), "write rows");
    rows_ += buffered_;
    buffered_ = 0;
    buffer_.clear();
  }

 private:
  static hid_t make(hid_t group, const char* name, hid_t type, hsize_t width) {
    const int rank = width ? 2 : 1;
    const hsize_t none[2] = {0, width}, most[2] = {H5S_UNLIMITED, width},
                  chunk[2] = {scans_in_a_chunk, width};
    const Handle space(H5Screate_simple(rank, none, most), H5Sclose, "make a space");
    const Handle list(H5Pcreate(H5P_DATASET_CREATE), H5Pclose, "make a property list");
    check(H5Pset_chunk(list, rank, chunk), "set chunks");
    check(H5Pset_shuffle(list), "set the shuffle filter");
    check(H5Pset_deflate(list, 1), "set compression");
    return H5Dcreate2(group, name, type, space, H5P_DEFAULT, list, H5P_DEFAULT);
  }

  hid_t type_;
  hsize_t width_, rows_ = 0, buffered_ = 0;
  std::vector<T> buffer_;
  Handle data_;
};

Handle group_in(hid_t where, const std::string& name) {
  return {H5Gcreate2(where, name.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose, "make a group"};
}

/// The layout is in docs/reference/export.md.
class Hdf5 : public Exporter {
 public:
  std::string format() const override { return "hdf5"; }
  std::string describes() const override {
    return "one HDF5 file: a group for each capture (docs/reference/export.md)";
  }

  void write(const ExportSource& source, const std::string& output) const override {
    // A file that could not be flushed stays half open inside the library, which then crashes at exit;
    // and all handles close themselves.
    [[maybe_unused]] static const herr_t once = H5dont_atexit();
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // failures are reported by exceptions, not by the library
    const SessionStore& session = *source.session;
    const auto recording = session.recording();
    const Handle file(H5Fcreate(output.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose,
                      "create the file");
    set_text(file, "schema", "rig-hdf5/1");
    const Handle about = group_in(file, "session");
    for (const char* key : {"kind", "created_utc", "recorded_utc", "epoch_unix_us", "lidar_restarts",
                            "software", "lidar", "stage", "bench", "procedure_name", "procedure"})
      if (const auto value = session.get(key)) set_text(about, key, *value);
    const Handle results = group_in(file, "results");
    for (const auto& result : session.latest_results())
      if (result.kind.find('/') == std::string::npos) set_text(results, result.kind.c_str(), result.json);
    const Handle captures = group_in(file, "captures");
    const DeskewedSession deskewed(session);
    for (std::size_t i = 0; i < recording->captures().size(); ++i) {
      const std::int64_t id = recording->captures()[i].id;
      const Handle group = group_in(captures, std::to_string(id));
      const hsize_t width = add_capture(group, *recording, i);
      if (const auto straight = deskewed.scans_of(id)) add_deskewed(group, *recording, i, *straight, width);
    }
    if (!recording->track().empty()) add_track(file, recording->track());
    check(H5Fflush(file, H5F_SCOPE_GLOBAL), "finish the file");
  }

 private:
  /// Returns the number of beams of its longest scan.
  static hsize_t add_capture(hid_t group, const fit::Recording& recording, std::size_t index) {
    const fit::CaptureInfo& capture = recording.captures()[index];
    set_circumstances(group, capture);
    hsize_t width = static_cast<hsize_t>(capture.beams());
    bool with_intensity = false;
    recording.for_each_scan(index, [&](const fit::ScanView& scan) {
      width = std::max<hsize_t>(width, scan.range_mm.size());
      with_intensity = with_intensity || !scan.intensity.empty();
    });
    Column<std::int64_t> seq(group, "seq", H5T_NATIVE_INT64, 0),
        device(group, "device_ms", H5T_NATIVE_INT64, 0), host(group, "host_us", H5T_NATIVE_INT64, 0);
    Column<std::uint16_t> range(group, "range_mm", H5T_NATIVE_UINT16, width);
    std::unique_ptr<Column<std::uint16_t>> intensity;
    if (with_intensity)
      intensity = std::make_unique<Column<std::uint16_t>>(group, "intensity", H5T_NATIVE_UINT16, width);
    std::vector<std::uint16_t> row;
    const auto padded = [&](std::span<const std::uint16_t> values) {
      row.assign(values.begin(), values.end());
      row.resize(width, 0);
      return row.data();
    };
    recording.for_each_scan(index, [&](const fit::ScanView& scan) {
      seq.add(&scan.seq);
      device.add(&scan.device_ms);
      host.add(&scan.host_us);
      range.add(padded(scan.range_mm));
      if (intensity) intensity->add(padded(scan.intensity));
    });
    for (auto* column : {&seq, &device, &host}) column->flush();
    range.flush();
    if (intensity) intensity->flush();
    return width;
  }

  /// What rig deskew made, row by row as the scans; NaN where a scan or a beam has none.
  static void add_deskewed(hid_t group, const fit::Recording& recording, std::size_t index,
                           DeskewedScans& deskewed, hsize_t width) {
    Column<double> pose(group, "deskewed_pose", H5T_NATIVE_DOUBLE, 3);
    Column<float> x(group, "deskewed_x_mm", H5T_NATIVE_FLOAT, width),
        y(group, "deskewed_y_mm", H5T_NATIVE_FLOAT, width);
    std::vector<float> xs, ys;
    recording.for_each_scan(index, [&](const fit::ScanView& scan) {
      const DeskewedScan* at = deskewed.of(scan.seq);
      xs.assign(width, std::nanf("")), ys = xs;
      std::array<double, 3> row{std::nan(""), std::nan(""), std::nan("")};
      if (at) {
        row = {at->lidar.x_mm, at->lidar.y_mm, at->lidar.heading_rad * fit::deg_per_rad};
        for (std::size_t k = 0; k < std::min<std::size_t>(width, at->points.size() / 2); ++k)
          xs[k] = at->points[2 * k], ys[k] = at->points[2 * k + 1];
      }
      pose.add(row.data());
      x.add(xs.data());
      y.add(ys.data());
    });
    pose.flush();
    x.flush();
    y.flush();
  }

  static void add_track(hid_t file, const std::vector<fit::TrackPose>& track) {
    const Handle group = group_in(file, "track");
    Column<std::int64_t> host(group, "host_us", H5T_NATIVE_INT64, 0);
    Column<double> poses(group, "pose", H5T_NATIVE_DOUBLE, 3),
        wheels(group, "wheels_rad", H5T_NATIVE_DOUBLE, 2);
    for (const fit::TrackPose& at : track) {
      const double none = std::nan("");
      const double pose[3] = {at.x_mm.value_or(none), at.y_mm.value_or(none),
                              at.heading_rad.value_or(none) * fit::deg_per_rad};
      const double wheel[2] = {at.wheel_left_rad.value_or(none), at.wheel_right_rad.value_or(none)};
      host.add(&at.host_us);
      poses.add(pose);
      wheels.add(wheel);
    }
    host.flush();
    poses.flush();
    wheels.flush();
  }

  static void set_circumstances(hid_t group, const fit::CaptureInfo& capture) {
    set_text(group, "step", capture.step);
    set_text(group, "target", capture.target.value_or(""));
    set_number<std::int64_t>(group, "started_us", capture.started_us);
    set_number(group, "stage_deg", capture.stage_rad * fit::deg_per_rad);
    if (capture.stage_readback_rad)
      set_number(group, "stage_readback_deg", *capture.stage_readback_rad * fit::deg_per_rad);
    set_number<std::int64_t>(group, "approach", capture.approach);
    set_number(group, "target_shift_mm", capture.target_shift_mm);
    if (capture.reflectance) set_number(group, "reflectance", *capture.reflectance);
    if (capture.temperature_c) set_number(group, "temperature_c", *capture.temperature_c);
    if (capture.since_power_on_s) set_number(group, "since_power_on_s", *capture.since_power_on_s);
    set_number(group, "stage_rate_deg_s", capture.stage_rate_rad_s * fit::deg_per_rad);
    set_number<std::int64_t>(group, "first_step", capture.first_step);
    set_number<std::int64_t>(group, "last_step", capture.last_step);
    set_number<std::int64_t>(group, "cluster", capture.cluster);
  }
};

}  // namespace

std::unique_ptr<Exporter> make_hdf5() { return std::make_unique<Hdf5>(); }

}  // namespace rig::exporters
