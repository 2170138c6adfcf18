// SPDX-License-Identifier: MIT
#include "rig/import/ros1_bag.hpp"

#include <algorithm>
#include <array>
#include <istream>
#include <limits>
#include <map>
#include <optional>
#include <string_view>

#include "rig/errors.hpp"
#include "rig/import/decompress.hpp"

namespace rig {
namespace {

constexpr std::string_view bag_mark = "#ROSBAG V";
constexpr std::string_view known_version = "#ROSBAG V2.0\n";
constexpr std::uint32_t largest_header = 1 << 20;
constexpr std::uint32_t largest_content = 512u << 20;

using BagBytes = std::span<const std::uint8_t>;

std::uint64_t little_endian(BagBytes bytes) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < std::min<std::size_t>(bytes.size(), 8); ++i)
    value |= std::uint64_t{bytes[i]} << (8 * i);
  return value;
}

/// The fields NAME=VALUE of a record's or a connection's header, each behind its length. Borrows the bytes.
class HeaderFields {
 public:
  explicit HeaderFields(BagBytes bytes) {
    while (bytes.size() >= 4) {
      const auto length = static_cast<std::size_t>(little_endian(bytes.first(4)));
      bytes = bytes.subspan(4);
      if (length > bytes.size()) return;
      const auto field = bytes.first(length);
      const auto equals = std::find(field.begin(), field.end(), '=');
      if (equals == field.end()) return;
      const auto name_size = static_cast<std::size_t>(equals - field.begin());
      fields_[std::string(field.begin(), equals)] = field.subspan(name_size + 1);
      bytes = bytes.subspan(length);
    }
    whole_ = bytes.empty();
  }
  [[nodiscard]] bool whole() const { return whole_; }
  [[nodiscard]] std::optional<std::uint64_t> number(const char* name, std::size_t size) const {
    const auto found = fields_.find(name);
    if (found == fields_.end() || found->second.size() != size) return std::nullopt;
    return little_endian(found->second);
  }
  [[nodiscard]] std::string text(const char* name) const {
    const auto found = fields_.find(name);
    return found == fields_.end() ? std::string() : std::string(found->second.begin(), found->second.end());
  }

 private:
  std::map<std::string, BagBytes, std::less<>> fields_;
  bool whole_ = false;
};

enum RecordKind : std::uint8_t { message_data = 2, bag_header = 3, chunk_data = 5, connection_data = 7 };

struct Connection {
  std::string topic, type;
};

class BagReader {
 public:
  BagReader(std::istream& in, const std::function<bool(const Ros1Message&)>& visit)
      : in_(in), visit_(visit) {}

  Ros1Summary read() {
    check_version();
    while (!summary_.stopped && !summary_.truncated && read_record()) {
    }
    if (summary_.truncated)
      summary_.notes.push_back(
          "The bag is cut off: it ends within a record, as when the recorder was killed. The " +
          std::to_string(summary_.messages) + " complete messages before that were kept.");
    return std::move(summary_);
  }

 private:
  void check_version() {
    std::array<char, known_version.size()> first{};
    in_.read(first.data(), first.size());
    const std::string_view begin(first.data(), static_cast<std::size_t>(in_.gcount()));
    if (begin == known_version) return;
    if (begin.starts_with(bag_mark))
      throw UsageError("a ROS 1 bag of version " + std::string(begin.substr(bag_mark.size(), 3)) +
                       ", where 2.0 is expected. Convert it on a computer with ROS 1: rosbag migrate.");
    throw UsageError(
        "not a ROS 1 bag (it does not begin with #ROSBAG V2.0). Check the right file was given.");
  }

  bool truncated() {
    summary_.truncated = true;
    return false;
  }

  /// A length of 4 bytes; nothing at the end of the file.
  std::optional<std::uint32_t> length(bool& at_end) {
    std::array<std::uint8_t, 4> bytes{};
    in_.read(reinterpret_cast<char*>(bytes.data()), bytes.size());
    at_end = in_.gcount() == 0;
    if (in_.gcount() < std::streamsize{4}) return std::nullopt;
    return static_cast<std::uint32_t>(little_endian(bytes));
  }

  /// Loads by pieces, so that a length that lies costs no memory. False when cut; what there is stays.
  bool load(std::vector<std::uint8_t>& into, std::uint32_t size) {
    constexpr std::size_t piece = 1 << 20;
    into.clear();
    while (into.size() < size) {
      const std::size_t before = into.size();
      into.resize(before + std::min<std::size_t>(piece, size - before));
      in_.read(reinterpret_cast<char*>(into.data() + before),
               static_cast<std::streamsize>(into.size() - before));
      const auto got = static_cast<std::size_t>(in_.gcount());
      if (before + got < into.size()) {
        into.resize(before + got);
        return false;
      }
    }
    return true;
  }

  /// One record of the file; false at its end.
  bool read_record() {
    bool at_end = false;
    const auto header_size = length(at_end);
    if (!header_size) return at_end ? false : truncated();
    if (*header_size > largest_header)
      return absurd("a header of " + std::to_string(*header_size) + " bytes");
    if (!load(header_, *header_size)) return truncated();
    const HeaderFields fields(header_);
    const auto op = fields.number("op", 1);
    const auto content_size = length(at_end);
    if (!content_size) return truncated();
    if (!fields.whole() || !op) return absurd("an invalid header");
    if (op != chunk_data && op != message_data && op != connection_data) {
      if (op == bag_header && !fields.text("encryptor").empty())
        throw UsageError("the bag is encrypted (" + fields.text("encryptor") + "). Decrypt it first.");
      in_.ignore(*content_size);
      return static_cast<std::uint32_t>(in_.gcount()) == *content_size || truncated();
    }
    if (*content_size > largest_content)
      return absurd("a record of " + std::to_string(*content_size) + " bytes, more than 512 MiB");
    const bool whole = load(content_, *content_size);
    if (op == chunk_data)
      chunk(fields, content_, !whole);
    else if (whole)
      record(*op, fields, content_);
    return whole || truncated();
  }

  /// Lengths are all that tells where a record ends: behind one that cannot be, nothing can be found.
  bool absurd(const std::string& what) {
    summary_.notes.push_back("The bag is damaged (" + what + "): the rest of it was not read. The " +
                             std::to_string(summary_.messages) + " messages before that were kept.");
    return false;
  }

  void chunk(const HeaderFields& fields, BagBytes packed, bool cut) {
    const std::string compression = fields.text("compression");
    const std::uint64_t size = fields.number("size", 4).value_or(0);
    if (size > largest_content) return damaged("it claims " + std::to_string(size) + " bytes");
    if (compression == "none") return records(packed, cut);
    if (compression != "bz2" && compression != "lz4")
      return damaged("its compression '" + compression + "' is unknown");
    const Decompressed unpacked =
        compression == "bz2" ? decompress_bz2(packed, size) : decompress_lz4(packed, size);
    const bool whole = unpacked.whole && unpacked.bytes.size() == size;
    if (!cut && !whole) damaged("it cannot be decompressed completely");
    records(unpacked.bytes, cut || !whole);
  }

  void damaged(const std::string& why) {
    ++summary_.bad_chunks;
    const std::string note =
        "A chunk of messages is damaged (" + why + "): its intact part and the other chunks were kept.";
    if (std::ranges::find(summary_.notes, note) == summary_.notes.end()) summary_.notes.push_back(note);
  }

  /// The records within a chunk.
  void records(BagBytes bytes, bool cut) {
    while (!bytes.empty() && !summary_.stopped) {
      const auto header = piece(bytes);
      const auto content = header ? piece(bytes) : std::nullopt;
      if (!content) {
        if (!cut) damaged("a record in it is truncated");
        return;
      }
      const HeaderFields fields(*header);
      const auto op = fields.number("op", 1);
      if (!fields.whole() || !op) return damaged("a record in it has no header");
      record(*op, fields, *content);
    }
  }

  static std::optional<BagBytes> piece(BagBytes& bytes) {
    if (bytes.size() < 4) return std::nullopt;
    const auto size = static_cast<std::size_t>(little_endian(bytes.first(4)));
    if (size > bytes.size() - 4) return std::nullopt;
    const auto result = bytes.subspan(4, size);
    bytes = bytes.subspan(4 + size);
    return result;
  }

  void record(std::uint64_t op, const HeaderFields& fields, BagBytes content) {
    const auto id = fields.number("conn", 4);
    if (!id) return;
    if (op == connection_data) {
      const HeaderFields about(content);
      if (connections_.size() < 100'000) connections_[*id] = {fields.text("topic"), about.text("type")};
      return;
    }
    const auto connection = connections_.find(*id);
    const auto time = fields.number("time", 8);
    if (op != message_data || connection == connections_.end() || !time) return;
    ++summary_.messages;
    const auto stamp_ns = static_cast<std::int64_t>(*time & 0xFFFFFFFF) * 1'000'000'000 +
                          static_cast<std::int64_t>(*time >> 32);
    if (!visit_({connection->second.topic, connection->second.type, stamp_ns, content}))
      summary_.stopped = true;
  }

  std::istream& in_;
  const std::function<bool(const Ros1Message&)>& visit_;
  std::vector<std::uint8_t> header_, content_;
  std::map<std::uint64_t, Connection> connections_;
  Ros1Summary summary_;
};

}  // namespace

Ros1Summary read_ros1_bag(std::istream& in, const std::function<bool(const Ros1Message&)>& visit) {
  return BagReader(in, visit).read();
}

bool is_ros1_bag(std::span<const std::uint8_t> first_bytes) {
  return first_bytes.size() >= bag_mark.size() &&
         std::equal(bag_mark.begin(), bag_mark.end(), first_bytes.begin());
}

}  // namespace rig
