// SPDX-License-Identifier: MIT
#include "rig/import/mcap.hpp"

#include <algorithm>
#include <array>
#include <istream>
#include <limits>
#include <map>
#include <optional>

#include "rig/crc32.hpp"
#include "rig/errors.hpp"
#include "rig/import/decompress.hpp"

namespace rig {
namespace {

constexpr std::array<std::uint8_t, 8> magic{0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};
constexpr std::uint64_t largest_record = 512ull << 20;

// The records that matter here (mcap.dev/spec); all others are passed over by their length.
enum Opcode : std::uint8_t {
  schema_record = 3,
  channel_record = 4,
  message_record = 5,
  chunk_record = 6,
  data_end = 15
};

/// Reads little-endian fields; `whole()` turns false instead of reading past the end.
class Fields {
 public:
  explicit Fields(std::span<const std::uint8_t> bytes) : rest_(bytes) {}

  std::uint64_t number(std::size_t bytes) {
    std::uint64_t value = 0;
    const auto raw = take(bytes);
    for (std::size_t i = 0; i < raw.size(); ++i) value |= std::uint64_t{raw[i]} << (8 * i);
    return value;
  }
  std::string text() {
    const auto raw = take(number(4));
    return {raw.begin(), raw.end()};
  }
  std::span<const std::uint8_t> rest() { return take(rest_.size()); }
  [[nodiscard]] bool whole() const { return whole_; }

 private:
  std::span<const std::uint8_t> take(std::uint64_t bytes) {
    if (bytes > rest_.size()) {
      whole_ = false;
      return {};
    }
    const auto taken = rest_.first(bytes);
    rest_ = rest_.subspan(bytes);
    return taken;
  }
  std::span<const std::uint8_t> rest_;
  bool whole_ = true;
};

struct Channel {
  std::uint16_t schema = 0;
  std::string topic, encoding;
};

class Reader {
 public:
  Reader(std::istream& in, const std::function<bool(const McapMessage&)>& visit) : in_(in), visit_(visit) {}

  McapSummary read() {
    check_magic();
    while (!summary_.stopped && !summary_.truncated && read_record()) {
    }
    if (summary_.truncated)
      summary_.notes.push_back(
          "The file is cut off: it ends within a record, as when the recorder was killed. The " +
          std::to_string(summary_.messages) + " complete messages before that were kept.");
    return std::move(summary_);
  }

 private:
  void check_magic() {
    std::array<std::uint8_t, 8> first{};
    if (fill(first) < first.size() || first != magic)
      throw UsageError(
          "not an MCAP file (its first 8 bytes are others). Check that the right file was given.");
  }

  std::size_t fill(std::span<std::uint8_t> room) {
    in_.read(reinterpret_cast<char*>(room.data()), static_cast<std::streamsize>(room.size()));
    return static_cast<std::size_t>(in_.gcount());
  }

  /// One record of the file; false at the data's end.
  bool read_record() {
    std::array<std::uint8_t, 9> head{};
    const std::size_t got = fill(head);
    // The end mark repeats the magic; a file without DataEnd record is one whose recorder did not finish.
    if (got < head.size()) return truncated();
    const std::uint8_t opcode = head[0];
    const std::uint64_t length = Fields(std::span(head).subspan(1)).number(8);
    if (opcode == data_end) return false;
    if (opcode != schema_record && opcode != channel_record && opcode != message_record &&
        opcode != chunk_record)
      return pass_over(length);
    if (length > largest_record) {
      summary_.notes.push_back("A record claims " + std::to_string(length) +
                               " bytes, more than 512 MiB: the rest of the file was not read.");
      return truncated();
    }
    if (!load(length)) {
      if (opcode == chunk_record) chunk(record_, true);
      return truncated();
    }
    if (opcode == chunk_record)
      chunk(record_, false);
    else
      simple_record(opcode, record_);
    return true;
  }

  bool truncated() {
    summary_.truncated = true;
    return false;
  }

  bool pass_over(std::uint64_t length) {
    if (length > static_cast<std::uint64_t>(std::numeric_limits<std::streamsize>::max())) return truncated();
    in_.ignore(static_cast<std::streamsize>(length));
    return static_cast<std::uint64_t>(in_.gcount()) == length || truncated();
  }

  /// Loads a record's content by pieces, so that a length that lies costs no memory. False when cut.
  bool load(std::uint64_t length) {
    constexpr std::uint64_t piece = 1 << 20;
    record_.clear();
    while (record_.size() < length) {
      const std::size_t before = record_.size();
      record_.resize(before + static_cast<std::size_t>(std::min(piece, length - before)));
      const std::size_t got = fill(std::span(record_).subspan(before));
      if (before + got < record_.size()) {
        record_.resize(before + got);
        return false;
      }
    }
    return true;
  }

  void chunk(std::span<const std::uint8_t> content, bool cut) {
    Fields fields(content);
    (void)fields.number(8);
    (void)fields.number(8);
    const std::uint64_t size = fields.number(8);
    const auto crc = static_cast<std::uint32_t>(fields.number(4));
    const std::string compression = fields.text();
    const std::uint64_t packed_size = fields.number(8);
    if (!fields.whole()) return damaged("it is shorter than its own header", cut);
    auto packed = fields.rest();
    if (!cut && packed_size > packed.size()) return damaged("its length field does not fit", cut);
    packed = packed.first(std::min<std::size_t>(packed.size(), packed_size));
    if (size > largest_record) return damaged("it claims " + std::to_string(size) + " bytes", cut);
    if (compression.empty()) {
      if (!cut && crc != 0 && crc32(packed) != crc) return damaged("its checksum is wrong", cut);
      return records(packed, cut);
    }
    if (compression != "zstd" && compression != "lz4")
      return damaged("its compression '" + compression + "' is unknown", cut);
    const Decompressed unpacked =
        compression == "zstd" ? decompress_zstd(packed, size) : decompress_lz4(packed, size);
    if (!cut && (!unpacked.whole || unpacked.bytes.size() != size))
      return damaged("it cannot be decompressed", cut);
    if (!cut && crc != 0 && crc32(unpacked.bytes) != crc) return damaged("its checksum is wrong", cut);
    records(unpacked.bytes, cut);
  }

  void damaged(const std::string& why, bool cut) {
    if (cut) return;
    ++summary_.bad_chunks;
    const std::string note = "A chunk of messages was left out because " + why + "; the others were kept.";
    if (std::ranges::find(summary_.notes, note) == summary_.notes.end()) summary_.notes.push_back(note);
  }

  /// The records within a chunk.
  void records(std::span<const std::uint8_t> bytes, bool cut) {
    while (!bytes.empty() && !summary_.stopped) {
      Fields head(bytes);
      const auto opcode = static_cast<std::uint8_t>(head.number(1));
      const std::uint64_t length = head.number(8);
      if (!head.whole() || length > bytes.size() - 9) return damaged("a record in it is truncated", cut);
      simple_record(opcode, bytes.subspan(9, static_cast<std::size_t>(length)));
      bytes = bytes.subspan(9 + static_cast<std::size_t>(length));
    }
  }

  void simple_record(std::uint8_t opcode, std::span<const std::uint8_t> content) {
    Fields fields(content);
    if (opcode == schema_record) {
      const auto id = static_cast<std::uint16_t>(fields.number(2));
      const std::string name = fields.text();
      if (fields.whole()) schemas_[id] = name;
    } else if (opcode == channel_record) {
      const auto id = static_cast<std::uint16_t>(fields.number(2));
      Channel channel;
      channel.schema = static_cast<std::uint16_t>(fields.number(2));
      channel.topic = fields.text();
      channel.encoding = fields.text();
      if (fields.whole()) channels_[id] = channel;
    } else if (opcode == message_record) {
      message(fields);
    }
  }

  void message(Fields& fields) {
    const auto id = static_cast<std::uint16_t>(fields.number(2));
    (void)fields.number(4);
    const std::uint64_t log_time = fields.number(8);
    (void)fields.number(8);
    const auto channel = channels_.find(id);
    if (!fields.whole() || channel == channels_.end()) return;
    ++summary_.messages;
    const McapMessage found{channel->second.topic, schemas_[channel->second.schema], channel->second.encoding,
                            log_time, fields.rest()};
    if (!visit_(found)) summary_.stopped = true;
  }

  std::istream& in_;
  const std::function<bool(const McapMessage&)>& visit_;
  std::vector<std::uint8_t> record_;
  std::map<std::uint16_t, std::string> schemas_;
  std::map<std::uint16_t, Channel> channels_;
  McapSummary summary_;
};

}  // namespace

McapSummary read_mcap(std::istream& in, const std::function<bool(const McapMessage&)>& visit) {
  return Reader(in, visit).read();
}

bool is_mcap(std::span<const std::uint8_t> first_bytes) {
  return first_bytes.size() >= magic.size() && std::equal(magic.begin(), magic.end(), first_bytes.begin());
}

}  // namespace rig
