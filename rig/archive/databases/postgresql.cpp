// SPDX-License-Identifier: MIT
// A server for laboratories whose rigs stand on several computers, through libpq.
#include <libpq-fe.h>

#include <boost/algorithm/string/trim.hpp>
#include <unordered_map>

#include "rig/archive/archive_database.hpp"
#include "rig/errors.hpp"

namespace rig {
namespace {

using Connection = std::unique_ptr<PGconn, decltype(&PQfinish)>;
using Answer = std::unique_ptr<PGresult, decltype(&PQclear)>;

class PostgresqlArchive final : public ArchiveDatabase {
 public:
  PostgresqlArchive(const std::string& location, bool to_write) : connection_(connect(location)) {
    if (PQstatus(connection_.get()) != CONNECTION_OK)
      throw UsageError("the archive's index cannot be reached: " + words() +
                       ". Check --index (postgresql://USER@HOST/DATABASE) and that the server runs.");
    PQsetNoticeProcessor(
        connection_.get(), [](void*, const char*) {}, nullptr);
    // Nobody waits for ever: for another's lock, or for a server that is gone.
    run("SET lock_timeout = '10s'", {});
    run("SET statement_timeout = '120s'", {});
    if (!to_write) run("SET default_transaction_read_only = on", {});
  }

  std::vector<Row> run(const std::string& statement, const Row& values) override {
    std::vector<const char*> texts;
    for (const Value& value : values) texts.push_back(value ? value->c_str() : nullptr);
    const auto count = static_cast<int>(texts.size());
    Answer answer(nullptr, &PQclear);
    if (values.empty()) {
      answer.reset(PQexec(connection_.get(), statement.c_str()));
    } else {
      const std::string& name = prepared_name(statement, count);
      answer.reset(PQexecPrepared(connection_.get(), name.c_str(), count, texts.data(), nullptr, nullptr, 0));
    }
    demand_success(answer.get());
    std::vector<Row> rows(static_cast<std::size_t>(PQntuples(answer.get())));
    for (int i = 0; i < PQntuples(answer.get()); ++i)
      for (int k = 0; k < PQnfields(answer.get()); ++k)
        rows[static_cast<std::size_t>(i)].push_back(
            PQgetisnull(answer.get(), i, k) ? Value() : Value(PQgetvalue(answer.get(), i, k)));
    return rows;
  }

  bool has_table(const std::string& name) override {
    return !run("SELECT 1 FROM information_schema.tables WHERE table_schema = current_schema() AND "
                "table_name = $1",
                {name})
                .empty();
  }

 private:
  static Connection connect(const std::string& location) {
    const char* keys[] = {"dbname", "connect_timeout", "application_name", "client_encoding", nullptr};
    const char* given[] = {location.c_str(), "10", "rig archive", "UTF8", nullptr};
    return {PQconnectdbParams(keys, given, 1), &PQfinish};
  }

  [[nodiscard]] std::string words() const {
    return boost::algorithm::trim_copy(std::string(PQerrorMessage(connection_.get())));
  }

  void demand_success(const PGresult* answer) const {
    const ExecStatusType status = PQresultStatus(answer);
    if (status != PGRES_COMMAND_OK && status != PGRES_TUPLES_OK)
      throw MeasurementError("the archive's index (PostgreSQL): " + words());
  }

  const std::string& prepared_name(const std::string& statement, int count) {
    std::string& name = prepared_[statement];
    if (!name.empty()) return name;
    const std::string made = "s" + std::to_string(prepared_.size());
    const Answer answer(PQprepare(connection_.get(), made.c_str(), statement.c_str(), count, nullptr),
                        &PQclear);
    demand_success(answer.get());
    return name = made;
  }

  Connection connection_;
  std::unordered_map<std::string, std::string> prepared_;
};

}  // namespace

namespace archive_databases {

ArchiveDatabaseKind make_postgresql() {
  return {"postgresql://",
          [](const std::string& location) {
            return location.starts_with("postgresql://") || location.starts_with("postgres://");
          },
          [](const std::string& location, bool to_write) -> std::unique_ptr<ArchiveDatabase> {
            return std::make_unique<PostgresqlArchive>(location, to_write);
          }};
}

}  // namespace archive_databases
}  // namespace rig
