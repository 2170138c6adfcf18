// SPDX-License-Identifier: MIT
#include "rig/fitting/tuple_file.hpp"

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"

namespace rig {

using nlohmann::json;

void read_tuples(const std::string& path, const fit::Steering& steering, Tuples& out) {
  std::ifstream in(path);
  if (!in) throw UsageError(path + " cannot be opened. Check the name and the permissions.");
  const bool tricycle = steering.id == "tricycle";
  std::size_t object = 0;
  double last_s = -1e300;
  const auto demand = [&](bool good, const std::string& what) {
    if (!good) throw UsageError(path + ", object " + std::to_string(object) + ": " + what);
  };
  try {
    while (in >> std::ws && !in.eof()) {
      ++object;
      json line;
      in >> line;
      const json& match = line.at("sm");
      fit::WheelSample sample;
      sample.interval_s = line.at("T");
      demand(sample.interval_s > 0, "T is not above 0. It is the time, s, from one scan to the next.");
      if (tricycle) {
        sample.left_rad_s = line.at("phi");
        sample.pieces = {{sample.left_rad_s * sample.interval_s, line.at("steer").get<double>()}};
      } else {
        sample.left_rad_s = line.at("phi_l");
        sample.right_rad_s = line.at("phi_r");
      }
      sample.match = {1000 * match.at(0).get<double>(), 1000 * match.at(1).get<double>(), match.at(2)};
      sample.run = out.runs.size();
      if (line.contains("t")) {
        sample.begin_s = line.at("t");
        demand(sample.begin_s > last_s, "t does not grow. Every file is one drive, in order of time.");
        last_s = sample.begin_s;
      } else {
        out.timed = false;
      }
      out.samples.push_back(std::move(sample));
    }
  } catch (const json::exception& error) {
    demand(false,
           std::string(error.what()) +
               (tricycle
                    ? ". A tuple file of a tricycle holds objects like {\"T\": 0.8, \"phi\": 4.9, \"steer\": "
                      "-0.1, \"sm\": [0.2, -0.001, -0.02]}: s, rad/s, rad, and the scan match in m, m, rad."
                    : ". A tuple file holds objects like {\"T\": 0.8, \"phi_l\": 0.49, \"phi_r\": -0.51, "
                      "\"sm\": [0.001, -0.0005, -0.18]}: s, rad/s, rad/s, and the scan match in m, m, rad."));
  }
  out.runs.push_back(std::filesystem::path(path).filename().string());
}

}  // namespace rig
