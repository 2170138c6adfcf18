// SPDX-License-Identifier: MIT
// Large headers that many files need, precompiled in the sanitizer and fuzz builds only: every file includes
// what it uses.
#if __has_include(<Eigen/Dense>)  // The lidar driver does without.
#include <Eigen/Dense>
#endif
#include <algorithm>
#include <boost/asio.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <span>
#include <sstream>
#include <string>
#include <vector>
