// SPDX-License-Identifier: MIT
// Large headers that most tests read, precompiled. Every test still includes what it uses.
#pragma once

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <span>
#include <sstream>
#include <string>
#include <vector>

#if __has_include(<Eigen/Core>)  // The lidar driver does without.
#include <Eigen/Core>
#endif
#if __has_include(<nlohmann/json.hpp>)
#include <nlohmann/json.hpp>
#endif
