// SPDX-License-Identifier: MIT
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string_view>
#include <type_traits>
#include <vector>

namespace rig {

/// A message that does not hold what its type promises: cut short, or a length that cannot be.
class CdrError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// How a message lies in its bytes. cdr, of ROS 2 (OMG DDSI-RTPS 2.5 section 10): 4 bytes of encapsulation,
/// then values aligned to their own size, counted from behind those 4 bytes; texts end with a zero, which is
/// counted. ros1: the same values one behind the other, little-endian, without encapsulation, alignment and
/// zeros.
enum class Packing { cdr, ros1 };

/// Reads the values of one ROS message in the order of its definition.
/// Every length is checked against what is left before anything is allocated. Borrows the bytes.
///
///   CdrReader in(message);
///   const auto sec = in.value<std::int32_t>();
///   const auto frame = in.text();
///   const auto ranges = in.sequence<float>();
class CdrReader {
 public:
  /// Throws CdrError for anything but plain CDR of either byte order (parameter lists and XCDR2 are not used
  /// by rosbag2).
  explicit CdrReader(std::span<const std::uint8_t> message, Packing packing = Packing::cdr);
  [[nodiscard]] Packing packing() const { return packing_; }

  template <class T>
  [[nodiscard]] T value() {
    static_assert(std::is_arithmetic_v<T>);
    align(sizeof(T));
    return swapped(take<T>());
  }
  [[nodiscard]] std::string_view text();
  template <class T>
  [[nodiscard]] std::vector<T> sequence() {
    const std::size_t count = length(sizeof(T));
    if (count == 0) return {};
    align(sizeof(T));
    need(count * sizeof(T));
    std::vector<T> values(count);
    std::memcpy(values.data(), body_.data() + at_, count * sizeof(T));
    at_ += count * sizeof(T);
    if (swap_)
      for (auto& item : values) item = swapped(item);
    return values;
  }
  /// Number of elements of a sequence whose elements take at least `least_bytes` each; the caller reads them.
  [[nodiscard]] std::size_t length(std::size_t least_bytes);
  /// Passes over `count` values of type T.
  template <class T>
  void skip(std::size_t count) {
    align(sizeof(T));
    if (count > (body_.size() - at_) / sizeof(T)) cut_short();
    at_ += count * sizeof(T);
  }

 private:
  void align(std::size_t size) {
    if (packing_ == Packing::ros1) return;
    const std::size_t padding = (size - at_ % size) % size;
    need(padding);
    at_ += padding;
  }
  void need(std::size_t bytes) const {
    if (bytes > body_.size() - at_) cut_short();
  }
  [[noreturn]] void cut_short() const;
  template <class T>
  T take() {
    need(sizeof(T));
    T result;
    std::memcpy(&result, body_.data() + at_, sizeof(T));
    at_ += sizeof(T);
    return result;
  }
  template <class T>
  [[nodiscard]] T swapped(T value) const {
    if (!swap_ || sizeof(T) == 1) return value;
    std::uint8_t bytes[sizeof(T)];
    std::memcpy(bytes, &value, sizeof(T));
    for (std::size_t i = 0; i < sizeof(T) / 2; ++i) std::swap(bytes[i], bytes[sizeof(T) - 1 - i]);
    std::memcpy(&value, bytes, sizeof(T));
    return value;
  }

  std::span<const std::uint8_t> body_;
  std::size_t at_ = 0;
  Packing packing_;
  bool swap_ = false;
};

}  // namespace rig
