// SPDX-License-Identifier: MIT
#pragma once

#include <lz4frame.h>
#include <zstd.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "rig/crc32.hpp"
#include "rig/import/mcap.hpp"

// Small ROS 2 bags made by the tests themselves.
namespace bags {

using Bytes = std::vector<std::uint8_t>;

/// Writes CDR, little-endian, aligned as ROS 2 does.
class Cdr {
 public:
  Cdr() : bytes_{0, 1, 0, 0} {}
  template <class T>
  Cdr& value(T v) {
    while ((bytes_.size() - 4) % sizeof(T) != 0) bytes_.push_back(0);
    const auto* raw = reinterpret_cast<const std::uint8_t*>(&v);
    bytes_.insert(bytes_.end(), raw, raw + sizeof(T));
    return *this;
  }
  Cdr& text(const std::string& t) {
    value(static_cast<std::uint32_t>(t.size() + 1));
    bytes_.insert(bytes_.end(), t.begin(), t.end());
    bytes_.push_back(0);
    return *this;
  }
  template <class T>
  Cdr& sequence(const std::vector<T>& items) {
    value(static_cast<std::uint32_t>(items.size()));
    for (const T item : items) value(item);
    return *this;
  }
  Cdr& header(std::int64_t ns, const std::string& frame) {
    value(static_cast<std::int32_t>(ns / 1'000'000'000));
    value(static_cast<std::uint32_t>(ns % 1'000'000'000));
    return text(frame);
  }
  [[nodiscard]] const Bytes& bytes() const { return bytes_; }

 private:
  Bytes bytes_;
};

inline Bytes laser_scan(std::int64_t ns, const std::vector<float>& ranges,
                        const std::vector<float>& intensities, float first = -0.5f, float step = 0.25f) {
  return Cdr()
      .header(ns, "base_scan")
      .value(first)
      .value(first + step * static_cast<float>(ranges.size()))
      .value(step)
      .value(0.001f)
      .value(0.1f)
      .value(0.05f)
      .value(12.0f)
      .sequence(ranges)
      .sequence(intensities)
      .bytes();
}

inline Bytes odometry(std::int64_t ns, double x_m, double y_m, double yaw) {
  Cdr cdr;
  cdr.header(ns, "odom").text("base_footprint").value(x_m).value(y_m).value(0.0);
  cdr.value(0.0).value(0.0).value(std::sin(yaw / 2)).value(std::cos(yaw / 2));
  for (int i = 0; i < 36 + 6 + 36; ++i) cdr.value(0.0);
  return cdr.bytes();
}

inline Bytes joint_state(std::int64_t ns, double left, double right) {
  Cdr cdr;
  cdr.header(ns, "base_link").value(std::uint32_t{2}).text("wheel_right_joint").text("wheel_left_joint");
  return cdr.sequence<double>({right, left}).sequence<double>({}).sequence<double>({}).bytes();
}

inline Bytes imu(std::int64_t ns, double yaw, double rate) {
  Cdr cdr;
  cdr.header(ns, "imu_link").value(0.0).value(0.0).value(std::sin(yaw / 2)).value(std::cos(yaw / 2));
  for (int i = 0; i < 9; ++i) cdr.value(0.0);
  cdr.value(0.0).value(0.0).value(rate);
  for (int i = 0; i < 9 + 3 + 9; ++i) cdr.value(0.0);
  return cdr.bytes();
}

inline Bytes lidar_place(double x_m, double yaw) {
  Cdr cdr;
  cdr.value(std::uint32_t{1}).header(1'000'000'000, "base_footprint").text("base_scan");
  cdr.value(x_m)
      .value(0.0)
      .value(0.1)
      .value(0.0)
      .value(0.0)
      .value(std::sin(yaw / 2))
      .value(std::cos(yaw / 2));
  return cdr.bytes();
}

struct Message {
  std::string topic, type;
  std::int64_t log_ns = 0;
  Bytes data;
};

/// Builds an MCAP file: one chunk for every `per_chunk` messages, compressed with "", "lz4" or "zstd".
class McapWriter {
 public:
  explicit McapWriter(std::string compression = "", std::size_t per_chunk = 4)
      : compression_(std::move(compression)), per_chunk_(per_chunk) {
    file_ = {0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};
    record(file_, 1, Bytes(8, 0));
  }
  void add(const Message& message) {
    const std::uint16_t id = channel(message);
    Bytes body;
    number(body, id, 2);
    number(body, 0, 4);
    number(body, static_cast<std::uint64_t>(message.log_ns), 8);
    number(body, static_cast<std::uint64_t>(message.log_ns), 8);
    body.insert(body.end(), message.data.begin(), message.data.end());
    record(chunk_, 5, body);
    if (++waiting_ == per_chunk_) flush();
  }
  Bytes finish() {
    if (waiting_ > 0) flush();
    Bytes crc;
    number(crc, 0, 4);
    record(file_, 15, crc);
    record(file_, 2, Bytes(20, 0));
    for (const std::uint8_t byte :
         std::initializer_list<std::uint8_t>{0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'})
      file_.push_back(static_cast<std::uint8_t>(byte));
    return file_;
  }

 private:
  static void number(Bytes& to, std::uint64_t value, int bytes) {
    for (int i = 0; i < bytes; ++i) to.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
  }
  static void text(Bytes& to, const std::string& value) {
    number(to, value.size(), 4);
    to.insert(to.end(), value.begin(), value.end());
  }
  static void record(Bytes& to, std::uint8_t opcode, const Bytes& body) {
    to.push_back(opcode);
    number(to, body.size(), 8);
    to.insert(to.end(), body.begin(), body.end());
  }
  std::uint16_t channel(const Message& message) {
    for (std::size_t i = 0; i < topics_.size(); ++i)
      if (topics_[i] == message.topic) return static_cast<std::uint16_t>(i + 1);
    topics_.push_back(message.topic);
    const auto id = static_cast<std::uint16_t>(topics_.size());
    Bytes schema, body;
    number(schema, id, 2);
    text(schema, message.type);
    text(schema, "ros2msg");
    text(schema, "");
    record(chunk_, 3, schema);
    number(body, id, 2);
    number(body, id, 2);
    text(body, message.topic);
    text(body, "cdr");
    number(body, 0, 4);
    record(chunk_, 4, body);
    return id;
  }
  void flush() {
    Bytes packed = chunk_;
    if (compression_ == "zstd") {
      packed.resize(ZSTD_compressBound(chunk_.size()));
      packed.resize(ZSTD_compress(packed.data(), packed.size(), chunk_.data(), chunk_.size(), 3));
    } else if (compression_ == "lz4") {
      packed.resize(LZ4F_compressFrameBound(chunk_.size(), nullptr));
      packed.resize(LZ4F_compressFrame(packed.data(), packed.size(), chunk_.data(), chunk_.size(), nullptr));
    }
    Bytes body;
    number(body, 0, 8);
    number(body, 0, 8);
    number(body, chunk_.size(), 8);
    number(body, rig::crc32(chunk_), 4);
    text(body, compression_);
    number(body, packed.size(), 8);
    body.insert(body.end(), packed.begin(), packed.end());
    record(file_, 6, body);
    chunk_.clear();
    waiting_ = 0;
  }

  std::string compression_;
  std::size_t per_chunk_, waiting_ = 0;
  Bytes file_, chunk_;
  std::vector<std::string> topics_;
};

}  // namespace bags
