// SPDX-License-Identifier: MIT
#include <SQLiteCpp/SQLiteCpp.h>

#include <algorithm>
#include <map>
#include <memory>
#include <string_view>

#include "rig/errors.hpp"
#include "rig/import/decompress.hpp"
#include "rig/import/ros_messages.hpp"

namespace rig::importers {
namespace {

constexpr std::size_t largest_message = 256u << 20;

struct Topic {
  std::string name, type;
};

std::map<std::int64_t, Topic> read_topics(SQLite::Database& bag, ImportSink& sink) {
  std::map<std::int64_t, Topic> topics;
  SQLite::Statement row(bag, "SELECT id, name, type, serialization_format FROM topics");
  while (row.executeStep()) {
    if (row.getColumn(3).getString() == "cdr")
      topics[row.getColumn(0).getInt64()] = {row.getColumn(1).getString(), row.getColumn(2).getString()};
    else
      sink.note("Topic " + row.getColumn(1).getString() + " was left out: it is not CDR.");
  }
  return topics;
}

void read_messages(SQLite::Database& bag, const ImportOptions& options, ImportSink& sink) {
  const auto topics = read_topics(bag, sink);
  RosMessages messages(sink, options);
  std::uint64_t read = 0;
  try {
    SQLite::Statement row(bag, "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id");
    while (sink.wants_more() && row.executeStep()) {
      const auto topic = topics.find(row.getColumn(0).getInt64());
      if (topic == topics.end()) continue;
      const SQLite::Column column = row.getColumn(2);
      const auto* bytes = static_cast<const std::uint8_t*>(column.getBlob());
      std::span<const std::uint8_t> data(bytes, static_cast<std::size_t>(column.getBytes()));
      Decompressed unpacked;
      // A recorder in compression mode MESSAGE packs every blob; CDR itself begins with a zero byte.
      if (is_zstd(data)) {
        unpacked = decompress_zstd(data, largest_message);
        data = unpacked.bytes;
      }
      messages.message(topic->second.name, topic->second.type, row.getColumn(1).getInt64(), data);
      ++read;
    }
  } catch (const SQLite::Exception& error) {
    if (read == 0) throw;
    sink.note(std::string("The bag is damaged (") + error.what() + "): the " + std::to_string(read) +
              " messages before the damage were kept.");
  }
  messages.finish();
}

class Db3 : public Importer {
 public:
  std::string name() const override { return "ROS 2 bag (sqlite3)"; }

  bool recognises(const std::string& path, std::span<const std::uint8_t> first_bytes) const override {
    constexpr std::string_view magic("SQLite format 3\0", 16);
    const bool database =
        first_bytes.size() >= magic.size() && std::equal(magic.begin(), magic.end(), first_bytes.begin());
    return (database && !path.ends_with(".rig")) || (path.ends_with(".db3") && !first_bytes.empty());
  }

  void read(const std::string& path, const ImportOptions& options, ImportSink& sink) const override {
    try {
      // Immutable: a bag may lie on read-only media, and must never be changed by reading it.
      std::string uri = "file:";
      for (const char c : path)
        uri += c == '%' ? "%25" : c == '?' ? "%3f" : c == '#' ? "%23" : std::string(1, c);
      SQLite::Database bag(uri + "?immutable=1", SQLite::OPEN_READONLY | SQLite::OPEN_URI);
      if (!bag.tableExists("topics") || !bag.tableExists("messages"))
        throw UsageError(
            path + " is an SQLite database but not a ROS 2 bag: it lacks the tables topics and messages.");
      read_messages(bag, options, sink);
    } catch (const SQLite::Exception& error) {
      throw UsageError(
          path + " cannot be read as a ROS 2 bag (" + error.what() +
          "). It is damaged or was cut while copying: copy it again from where it was recorded.");
    }
  }
};

}  // namespace

std::unique_ptr<Importer> make_db3() { return std::make_unique<Db3>(); }

}  // namespace rig::importers
