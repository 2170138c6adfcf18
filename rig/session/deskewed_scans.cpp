// SPDX-License-Identifier: MIT
#include "rig/session/deskewed_scans.hpp"

#include <SQLiteCpp/SQLiteCpp.h>

#include <bit>
#include <cstring>

#include "fit/numeric/angle.hpp"
#include "rig/session/session_file.hpp"

namespace rig {

struct DeskewedScans::Impl {
  explicit Impl(SQLite::Database& database, std::int64_t capture)
      : rows(database,
             "SELECT seq, x_mm, y_mm, heading_deg, points FROM deskewed WHERE capture = ? ORDER BY seq") {
    rows.bind(1, capture);
    step();
  }

  void step() {
    there = rows.executeStep();
    if (!there) return;
    scan.seq = rows.getColumn(0).getInt64();
    scan.lidar = {rows.getColumn(1).getDouble(), rows.getColumn(2).getDouble(),
                  rows.getColumn(3).getDouble() * fit::rad_per_deg};
    const SQLite::Column blob = rows.getColumn(4);
    const auto count = static_cast<std::size_t>(blob.getBytes()) / sizeof(float);
    std::vector<std::uint32_t> bits(count);
    if (count > 0) std::memcpy(bits.data(), blob.getBlob(), count * sizeof(float));
    scan.points.clear();
    for (std::uint32_t value : bits) {
      if constexpr (std::endian::native == std::endian::big) value = __builtin_bswap32(value);
      scan.points.push_back(std::bit_cast<float>(value));
    }
  }

  SQLite::Statement rows;
  DeskewedScan scan;
  bool there = false;
};

DeskewedScans::DeskewedScans(SQLite::Database& database, std::int64_t capture)
    : impl_(std::make_unique<Impl>(database, capture)) {}
DeskewedScans::~DeskewedScans() = default;

const DeskewedScan* DeskewedScans::of(std::int64_t seq) {
  while (impl_->there && impl_->scan.seq < seq) impl_->step();
  return impl_->there && impl_->scan.seq == seq ? &impl_->scan : nullptr;
}

DeskewedSession::DeskewedSession(const SessionStore& session)
    : database_(open_for_reading(session.path())), any_(database_->tableExists("deskewed")) {}
DeskewedSession::~DeskewedSession() = default;

std::unique_ptr<DeskewedScans> DeskewedSession::scans_of(std::int64_t capture) const {
  return any_ ? std::make_unique<DeskewedScans>(*database_, capture) : nullptr;
}

}  // namespace rig
