// SPDX-License-Identifier: MIT
#include <SQLiteCpp/SQLiteCpp.h>

#include <map>
#include <optional>
#include <string>

#include "rig/export/bag_messages.hpp"
#include "rig/export/exporter.hpp"
#include "rig/whole_file.hpp"

namespace rig::exporters {
namespace {

/// Late subscribers get the last message too (rosbag2's form of it).
constexpr const char* latched_profile =
    "- history: 3\n  depth: 0\n  reliability: 1\n  durability: 1\n  deadline:\n    sec: 2147483647\n"
    "    nsec: 4294967295\n  lifespan:\n    sec: 2147483647\n    nsec: 4294967295\n  liveliness: 1\n"
    "  liveliness_lease_duration:\n    sec: 2147483647\n    nsec: 4294967295\n"
    "  avoid_ros_namespace_conventions: false\n";

/// The SQLite storage of rosbag2, in the tables that every version of it reads.
class Db3Writer : public BagSink {
 public:
  explicit Db3Writer(const std::string& path)
      : database_(path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE) {
    database_.exec("PRAGMA journal_mode = MEMORY");
    transaction_.emplace(database_);
    database_.exec(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
        "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)");
    database_.exec(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT "
        "NULL, "
        "data BLOB NOT NULL)");
    insert_.emplace(database_, "INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)");
  }

  std::uint16_t add_channel(const Channel& channel) override {
    passed_on([&] {
      SQLite::Statement row(database_, "INSERT INTO topics VALUES(?, ?, ?, 'cdr', ?)");
      row.bind(1, ++channels_);
      row.bind(2, channel.topic);
      row.bind(3, channel.type);
      row.bind(4, channel.latched ? latched_profile : "");
      row.exec();
    });
    return static_cast<std::uint16_t>(channels_);
  }

  void add_message(std::uint16_t channel, std::uint64_t time_ns, const std::string& cdr) override {
    passed_on([&] {
      insert_->reset();
      insert_->bind(1, static_cast<int>(channel));
      insert_->bind(2, static_cast<std::int64_t>(time_ns));
      insert_->bindNoCopy(3, cdr.data(), static_cast<int>(cdr.size()));
      insert_->exec();
    });
  }

  void close() {
    insert_.reset();
    database_.exec("CREATE INDEX timestamp_idx ON messages(timestamp ASC)");
    transaction_->commit();
  }

 private:
  /// What this database complains of is not the session's, which is being read meanwhile.
  static void passed_on(const auto& work) {
    try {
      work();
    } catch (const SQLite::Exception& error) {
      throw DiskFailure(error.what());
    }
  }

  SQLite::Database database_;
  std::optional<SQLite::Transaction> transaction_;
  std::optional<SQLite::Statement> insert_;
  int channels_ = 0;
};

/// What it holds is in rig/export/bag_messages.hpp.
class Db3 : public Exporter {
 public:
  std::string format() const override { return "db3"; }
  std::string describes() const override { return "ROS 2 bag (sqlite3), with the same topics as mcap"; }

  void write(const ExportSource& source, const std::string& output) const override {
    try {
      Db3Writer out(output);
      write_bag(*source.session, out);
      out.close();
    } catch (const SQLite::Exception& error) {
      throw DiskFailure(error.what());
    }
  }
};

}  // namespace

std::unique_ptr<Exporter> make_db3() { return std::make_unique<Db3>(); }

}  // namespace rig::exporters
