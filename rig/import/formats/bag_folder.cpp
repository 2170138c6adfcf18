// SPDX-License-Identifier: MIT
#include <stdlib.h>
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <memory>

#include "rig/errors.hpp"
#include "rig/import/decompress.hpp"
#include "rig/import/importer.hpp"
#include "rig/output_place.hpp"

namespace rig::importers {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view packed_suffix = ".zstd";

/// A new file beside the system's temporary files that goes away with the object.
class TemporaryFile {
 public:
  /// `ending` says what it will hold. Throws UsageError when it cannot be made.
  explicit TemporaryFile(const std::string& ending)
      : path_((fs::temp_directory_path() / "rig-import-XXXXXX").string() + ending) {
    const int made = ::mkstemps(path_.data(), static_cast<int>(ending.size()));
    if (made < 0) throw UsageError("cannot write " + path_ + ": " + why_not_written(path_, errno));
    ::close(made);
  }
  ~TemporaryFile() {
    std::error_code ignored;
    fs::remove(path_, ignored);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

bool is_bag_file(const fs::path& path) {
  std::string name = path.filename().string();
  if (name.ends_with(packed_suffix)) name.resize(name.size() - packed_suffix.size());
  return name.ends_with(".mcap") || name.ends_with(".db3");
}

/// The bag's files in their order: as metadata.yaml lists them, or, without it (the recorder was killed), all
/// bag files of the folder by name.
std::vector<fs::path> bag_files(const fs::path& folder, ImportSink& sink) {
  std::vector<fs::path> files;
  const fs::path metadata = folder / "metadata.yaml";
  if (fs::exists(metadata)) {
    try {
      const YAML::Node root = YAML::LoadFile(metadata.string());
      for (const auto& name : root["rosbag2_bagfile_information"]["relative_file_paths"]) {
        // Only what lies in the folder: a bag from elsewhere must not name files of this machine.
        const fs::path inside = fs::path(name.as<std::string>()).filename();
        if (is_bag_file(inside) && fs::is_regular_file(folder / inside))
          files.push_back(folder / inside);
        else
          sink.note("metadata.yaml names '" + name.as<std::string>() +
                    "', which is no bag file in the folder.");
      }
    } catch (const YAML::Exception& error) {
      sink.note(std::string("metadata.yaml cannot be read (") + error.what() +
                "): the bag files were read in the order of their names.");
    }
  } else {
    sink.note(
        "The folder has no metadata.yaml, as when the recorder was killed: its bag files were read in the "
        "order of their names.");
  }
  if (files.empty()) {
    for (const auto& entry : fs::directory_iterator(folder))
      if (entry.is_regular_file() && is_bag_file(entry.path())) files.push_back(entry.path());
    std::sort(files.begin(), files.end());
  }
  return files;
}

void read_one(const fs::path& file, const ImportOptions& options, ImportSink& sink) {
  const std::string path = file.string();
  if (!path.ends_with(packed_suffix)) return importer_for(path)->read(path, options, sink);
  const TemporaryFile unpacked("-" + file.stem().string());
  if (!decompress_zstd_file(path, unpacked.path()))
    sink.note(path + " is cut off: what came before the cut was kept.");
  importer_for(unpacked.path())->read(unpacked.path(), options, sink);
}

/// A folder as `ros2 bag record` makes it, and bag files packed whole (compression mode FILE).
class BagFolder : public Importer {
 public:
  std::string name() const override { return "ROS 2 bag folder, or packed bag file (.zstd)"; }

  bool recognises(const std::string& path, std::span<const std::uint8_t> first_bytes) const override {
    if (is_zstd(first_bytes)) return is_bag_file(path);
    if (!fs::is_directory(path)) return false;
    if (fs::exists(fs::path(path) / "metadata.yaml")) return true;
    return std::any_of(fs::directory_iterator(path), fs::directory_iterator(),
                       [](const auto& entry) { return is_bag_file(entry.path()); });
  }

  void read(const std::string& path, const ImportOptions& options, ImportSink& sink) const override {
    if (!fs::is_directory(path)) return read_one(path, options, sink);
    const auto files = bag_files(path, sink);
    if (files.empty())
      throw UsageError(path + " is a bag folder without bag files (*.mcap, *.db3). Copy the whole folder.");
    for (const auto& file : files) {
      if (!sink.wants_more()) return;
      read_one(file, options, sink);
    }
  }
};

}  // namespace

std::unique_ptr<Importer> make_bag_folder() { return std::make_unique<BagFolder>(); }

}  // namespace rig::importers
