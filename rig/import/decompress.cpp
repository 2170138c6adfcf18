// SPDX-License-Identifier: MIT
#include "rig/import/decompress.hpp"

#include <bzlib.h>
#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <memory>

#include "rig/errors.hpp"

namespace rig {
namespace {

constexpr std::size_t piece_bytes = 256 * 1024;

struct FreeZstd {
  void operator()(ZSTD_DStream* stream) const { ZSTD_freeDStream(stream); }
};
struct FreeLz4 {
  void operator()(LZ4F_dctx* context) const { LZ4F_freeDecompressionContext(context); }
};

/// Grows by pieces, so that memory follows what really comes out.
std::span<std::uint8_t> grow(std::vector<std::uint8_t>& bytes) {
  const std::size_t before = bytes.size();
  bytes.resize(before + piece_bytes);
  return std::span(bytes).subspan(before);
}

std::unique_ptr<ZSTD_DStream, FreeZstd> zstd_stream() {
  std::unique_ptr<ZSTD_DStream, FreeZstd> stream(ZSTD_createDStream());
  ZSTD_DCtx_setParameter(stream.get(), ZSTD_d_windowLogMax, 27);  // 128 MiB: a frame may ask for more
  return stream;
}

}  // namespace

bool is_zstd(std::span<const std::uint8_t> bytes) {
  return bytes.size() >= 4 && bytes[0] == 0x28 && bytes[1] == 0xb5 && bytes[2] == 0x2f && bytes[3] == 0xfd;
}

Decompressed decompress_zstd(std::span<const std::uint8_t> block, std::size_t limit_bytes) {
  const auto stream = zstd_stream();
  Decompressed result;
  ZSTD_inBuffer in{block.data(), block.size(), 0};
  std::size_t more = 1;
  bool stuck = false;
  while (!stuck && (in.pos < in.size || more != 0) && result.bytes.size() <= limit_bytes) {
    const std::size_t before = result.bytes.size();
    const auto room = grow(result.bytes);
    ZSTD_outBuffer out{room.data(), room.size(), 0};
    more = ZSTD_decompressStream(stream.get(), &out, &in);
    const bool failed = ZSTD_isError(more) != 0;
    result.bytes.resize(before + (failed ? 0 : out.pos));
    if (failed) return result;
    stuck = out.pos == 0 && in.pos == in.size;
  }
  result.whole = more == 0 && in.pos == in.size && result.bytes.size() <= limit_bytes;
  return result;
}

Decompressed decompress_lz4(std::span<const std::uint8_t> block, std::size_t limit_bytes) {
  LZ4F_dctx* raw = nullptr;
  LZ4F_createDecompressionContext(&raw, LZ4F_VERSION);
  const std::unique_ptr<LZ4F_dctx, FreeLz4> context(raw);
  Decompressed result;
  std::size_t at = 0, more = 1;
  while (more != 0 && result.bytes.size() <= limit_bytes) {
    const std::size_t before = result.bytes.size();
    const auto room = grow(result.bytes);
    std::size_t produced = room.size(), consumed = block.size() - at;
    more = LZ4F_decompress(context.get(), room.data(), &produced, block.data() + at, &consumed, nullptr);
    const bool failed = LZ4F_isError(more) != 0;
    result.bytes.resize(before + (failed ? 0 : produced));
    if (failed || (produced == 0 && consumed == 0)) return result;
    at += consumed;
  }
  result.whole = more == 0 && at == block.size() && result.bytes.size() <= limit_bytes;
  return result;
}

Decompressed decompress_bz2(std::span<const std::uint8_t> block, std::size_t limit_bytes) {
  bz_stream stream{};
  Decompressed result;
  if (block.size() > std::numeric_limits<unsigned>::max() || BZ2_bzDecompressInit(&stream, 0, 0) != BZ_OK)
    return result;
  const std::unique_ptr<bz_stream, int (*)(bz_stream*)> ended(&stream, BZ2_bzDecompressEnd);
  stream.next_in = const_cast<char*>(reinterpret_cast<const char*>(block.data()));
  stream.avail_in = static_cast<unsigned>(block.size());
  int status = BZ_OK;
  while (status == BZ_OK && result.bytes.size() <= limit_bytes) {
    const std::size_t before = result.bytes.size();
    const auto room = grow(result.bytes);
    stream.next_out = reinterpret_cast<char*>(room.data());
    stream.avail_out = static_cast<unsigned>(room.size());
    status = BZ2_bzDecompress(&stream);
    const std::size_t made = room.size() - stream.avail_out;
    result.bytes.resize(before + made);
    if (made == 0 && stream.avail_in == 0) break;
  }
  result.whole = status == BZ_STREAM_END && stream.avail_in == 0 && result.bytes.size() <= limit_bytes;
  return result;
}

bool decompress_zstd_file(const std::string& from, const std::string& to) {
  std::ifstream in(from, std::ios::binary);
  if (!in) throw UsageError(from + " cannot be opened. Check the name and the permissions.");
  std::ofstream out(to, std::ios::binary | std::ios::trunc);
  const auto stream = zstd_stream();
  std::vector<char> packed(piece_bytes), unpacked(piece_bytes);
  std::size_t more = 1;
  while (in.read(packed.data(), static_cast<std::streamsize>(packed.size())), in.gcount() > 0) {
    ZSTD_inBuffer piece{packed.data(), static_cast<std::size_t>(in.gcount()), 0};
    ZSTD_outBuffer room{unpacked.data(), unpacked.size(), 0};
    do {
      room.pos = 0;
      more = ZSTD_decompressStream(stream.get(), &room, &piece);
      if (ZSTD_isError(more))
        throw UsageError(from + " is damaged: " + ZSTD_getErrorName(more) +
                         ". Copy it again from where it was recorded.");
      out.write(unpacked.data(), static_cast<std::streamsize>(room.pos));
    } while (piece.pos < piece.size || room.pos == room.size);
  }
  out.close();
  if (!out) throw UsageError(to + " cannot be written: the disk may be full. Free some space and try again.");
  return more == 0;
}

}  // namespace rig
