// SPDX-License-Identifier: MIT
#include <zstd.h>

#include <array>
#include <bit>
#include <cstring>
#include <fstream>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "rig/crc32.hpp"
#include "rig/errors.hpp"
#include "rig/export/bag_messages.hpp"
#include "rig/export/exporter.hpp"
#include "rig/whole_file.hpp"

namespace rig::exporters {
namespace {

static_assert(std::endian::native == std::endian::little, "MCAP is little-endian");

using Bytes = std::string;

template <class T>
void put(Bytes& out, T value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

void put_text(Bytes& out, const std::string& text) {
  put(out, static_cast<std::uint32_t>(text.size()));
  out += text;
}

/// One record: opcode, length, content (mcap.dev/spec).
Bytes record(std::uint8_t opcode, const Bytes& content) {
  Bytes out;
  put(out, opcode);
  put(out, static_cast<std::uint64_t>(content.size()));
  return out + content;
}

std::span<const std::uint8_t> octets(const Bytes& bytes) {
  return {reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()};
}

/// An indexed MCAP file with one zstd-compressed chunk for about a megabyte of messages.
class McapWriter : public BagSink {
 public:
  explicit McapWriter(const std::string& path) : out_(path, std::ios::binary) {
    if (!out_) throw UsageError("cannot write " + path + ": check the folder and the permission");
    emit(Bytes("\x89MCAP0\r\n", 8));
    Bytes header;
    put_text(header, "ros2");
    put_text(header, "rig " RIG_VERSION);
    emit(record(0x01, header));
  }

  std::uint16_t add_channel(const Channel& about) override {
    const auto id = static_cast<std::uint16_t>(channels_ + 1);
    ++channels_;
    Bytes schema;
    put(schema, id);
    put_text(schema, about.type);
    put_text(schema, "ros2msg");
    put_text(schema, about.definition);
    Bytes channel;
    put(channel, id);
    put(channel, id);
    put_text(channel, about.topic);
    put_text(channel, "cdr");
    put(channel, std::uint32_t{0});  // no metadata
    descriptions_ += record(0x03, schema) + record(0x04, channel);
    chunk_ += record(0x03, schema) + record(0x04, channel);
    return id;
  }

  void add_message(std::uint16_t channel, std::uint64_t time_ns, const Bytes& data) override {
    index_[channel].push_back({time_ns, chunk_.size()});
    Bytes message;
    put(message, channel);
    put(message, static_cast<std::uint32_t>(counts_[channel]++));
    put(message, time_ns);
    put(message, time_ns);
    chunk_ += record(0x05, message + data);
    first_ = std::min(first_, time_ns);
    last_ = std::max(last_, time_ns);
    chunk_first_ = std::min(chunk_first_, time_ns);
    chunk_last_ = std::max(chunk_last_, time_ns);
    if (chunk_.size() > 1'000'000) end_chunk();
  }

  void close() {
    end_chunk();
    emit(record(0x0F, Bytes(4, '\0')));  // data end, without a checksum of the whole
    const std::uint64_t summary_start = at_;
    emit(descriptions_);
    emit(chunk_indexes_);
    emit(record(0x0B, statistics()));
    Bytes footer;
    put(footer, summary_start);
    put(footer, std::uint64_t{0});
    put(footer, std::uint32_t{0});
    emit(record(0x02, footer));
    emit(Bytes("\x89MCAP0\r\n", 8));
    out_.close();
    if (!out_) throw DiskFailure("the bag is cut");
  }

 private:
  struct IndexEntry {
    std::uint64_t time_ns, offset;
  };

  void emit(const Bytes& bytes) {
    out_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    at_ += bytes.size();
  }

  void end_chunk() {
    if (index_.empty()) return;
    Bytes packed(ZSTD_compressBound(chunk_.size()), '\0');
    const std::size_t size = ZSTD_compress(packed.data(), packed.size(), chunk_.data(), chunk_.size(), 1);
    if (ZSTD_isError(size)) throw MeasurementError("zstd cannot compress a chunk of the export");
    packed.resize(size);
    Bytes content;
    put(content, chunk_first_);
    put(content, chunk_last_);
    put(content, static_cast<std::uint64_t>(chunk_.size()));
    put(content, crc32(octets(chunk_)));
    put_text(content, "zstd");
    put(content, static_cast<std::uint64_t>(packed.size()));
    const std::uint64_t chunk_start = at_;
    emit(record(0x06, content + packed));
    index_chunk(chunk_start, packed.size());
    chunk_.clear();
    index_.clear();
    chunk_first_ = ~std::uint64_t{0};
    chunk_last_ = 0;
  }

  void index_chunk(std::uint64_t chunk_start, std::uint64_t packed) {
    const std::uint64_t chunk_length = at_ - chunk_start, indexes_start = at_;
    Bytes offsets;
    for (const auto& [channel, entries_of_channel] : index_) {
      put(offsets, channel);
      put(offsets, at_);
      Bytes entries, index;
      for (const IndexEntry& entry : entries_of_channel) {
        put(entries, entry.time_ns);
        put(entries, entry.offset);
      }
      put(index, channel);
      put_text(index, entries);
      emit(record(0x07, index));
    }
    Bytes content;
    put(content, chunk_first_);
    put(content, chunk_last_);
    put(content, chunk_start);
    put(content, chunk_length);
    put_text(content, offsets);
    put(content, at_ - indexes_start);
    put_text(content, "zstd");
    put(content, packed);
    put(content, static_cast<std::uint64_t>(chunk_.size()));
    chunk_indexes_ += record(0x08, content);
    ++chunks_;
  }

  Bytes statistics() const {
    std::uint64_t messages = 0;
    Bytes counts, content;
    for (const auto& [channel, count] : counts_) {
      put(counts, channel);
      put(counts, count);
      messages += count;
    }
    put(content, messages);
    put(content, channels_);
    put(content, static_cast<std::uint32_t>(channels_));
    put(content, std::uint32_t{0});
    put(content, std::uint32_t{0});
    put(content, chunks_);
    put(content, messages ? first_ : std::uint64_t{0});
    put(content, last_);
    put_text(content, counts);
    return content;
  }

  std::ofstream out_;
  std::uint64_t at_ = 0;
  std::uint16_t channels_ = 0;
  std::uint32_t chunks_ = 0;
  Bytes chunk_, descriptions_, chunk_indexes_;
  std::map<std::uint16_t, std::vector<IndexEntry>> index_;
  std::map<std::uint16_t, std::uint64_t> counts_;
  std::uint64_t first_ = ~std::uint64_t{0}, last_ = 0, chunk_first_ = ~std::uint64_t{0}, chunk_last_ = 0;
};

/// A ROS 2 bag: what it holds is in rig/export/bag_messages.hpp.
class Mcap : public Exporter {
 public:
  std::string format() const override { return "mcap"; }
  std::string describes() const override {
    return "ROS 2 bag (MCAP): /scan, /joint_states, /tf and /odom of a track, /points of a deskewed session";
  }

  void write(const ExportSource& source, const std::string& output) const override {
    McapWriter out(output);
    write_bag(*source.session, out);
    out.close();
  }
};

}  // namespace

std::unique_ptr<Exporter> make_mcap() { return std::make_unique<Mcap>(); }

}  // namespace rig::exporters
