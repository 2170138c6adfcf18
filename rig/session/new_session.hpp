// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <string>

#include "rig/output_place.hpp"

namespace rig {

/// Has `make` make a session under another name in the folder of `place`, and gives it its name when it is
/// whole and on the disk: a session that exists is a whole one. If that fails nothing is left; after a kill
/// or a power failure a file `PATH.unfinished-NUMBER`, which no command mistakes for PATH.
///
/// What is there already is never replaced, unless it is empty: refused (UsageError) before `make` is called,
/// and again at the end, if it has appeared meanwhile; what was made is then kept under its unfinished name.
/// Throws what `make` throws, an SQLite::Exception as MeasurementError or UsageError in the operator's words.
void make_session(const OutputPlace& place, const std::function<void(const std::string& unfinished)>& make);

/// A whole copy of a session by SQLite itself, which also carries what other programs keep in it. Throws
/// UsageError or, as other work on databases may inside make_session(), SQLite::Exception.
void copy_session(const std::string& from, const std::string& to);

}  // namespace rig
