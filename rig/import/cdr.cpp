// SPDX-License-Identifier: MIT
#include "rig/import/cdr.hpp"

#include <string>

namespace rig {

CdrReader::CdrReader(std::span<const std::uint8_t> message, Packing packing) : packing_(packing) {
  if (packing == Packing::ros1) {
    swap_ = std::endian::native != std::endian::little;
    body_ = message;
    return;
  }
  if (message.size() < 4)
    throw CdrError("the message is shorter than the 4 bytes that say how it is encoded");
  if (message[0] != 0 || message[1] > 1)
    throw CdrError("the message is not encoded as plain CDR (encapsulation " + std::to_string(message[0]) +
                   " " + std::to_string(message[1]) + ")");
  const bool little = message[1] == 1;
  swap_ = little != (std::endian::native == std::endian::little);
  body_ = message.subspan(4);
}

std::string_view CdrReader::text() {
  const std::size_t bytes = length(1);
  if (bytes == 0) return {};
  const std::string_view all(reinterpret_cast<const char*>(body_.data()) + at_, bytes);
  at_ += bytes;
  return packing_ == Packing::ros1 ? all : all.substr(0, bytes - 1);
}

std::size_t CdrReader::length(std::size_t least_bytes) {
  const std::size_t count = value<std::uint32_t>();
  if (count > (body_.size() - at_) / least_bytes)
    throw CdrError("the message declares " + std::to_string(count) + " elements where " +
                   std::to_string(body_.size() - at_) + " bytes are left");
  return count;
}

void CdrReader::cut_short() const {
  throw CdrError("the message ends after " + std::to_string(body_.size()) + " bytes, within a value");
}

}  // namespace rig
