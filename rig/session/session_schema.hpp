// SPDX-License-Identifier: MIT
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>

#include <string>

namespace rig {

/// Makes an empty database a session without captures (docs/reference/session.md), in one transaction.
void make_schema(SQLite::Database& database);

/// Adds the tables that sessions of earlier versions lack, before one of them is written.
void complete_schema(SQLite::Database& database);

/// Throws UsageError unless the database is a session of this version or an earlier one.
void check_identity(SQLite::Database& database, const std::string& path);

/// Throws UsageError unless the tables that every session has are there.
void check_tables(SQLite::Database& database, const std::string& path);

/// Sets a key of the table `session`.
void put_key(SQLite::Database& database, const std::string& key, const std::string& value);

}  // namespace rig
