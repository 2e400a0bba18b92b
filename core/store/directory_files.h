// The files of dataset and shard directories, as they are opened: what must be there, of which
// size, and the description that both have.

#ifndef ISOSCOPE_CORE_STORE_DIRECTORY_FILES_H_
#define ISOSCOPE_CORE_STORE_DIRECTORY_FILES_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/io/file.h"
#include "core/store/manifest.h"
#include "core/volume/block_layout.h"
#include "core/volume/range_table.h"

namespace isoscope::store {

using OpenFile =
    std::function<absl::StatusOr<std::unique_ptr<io::RandomAccessFile>>(const std::string& path)>;

std::string PathIn(const std::string& directory, absl::string_view name);

// Opens a file that a finished directory must have: DATA_LOSS if it is missing.
absl::StatusOr<std::unique_ptr<io::RandomAccessFile>> OpenRequired(const std::string& path,
                                                                   const OpenFile& open_file);

// Reads a whole file. DATA_LOSS if it is missing, or does not have exactly `size` bytes.
absl::StatusOr<std::string> ReadRequired(const std::string& path, std::int64_t size,
                                         const OpenFile& open_file);

// Reads a sealed JSON file. DATA_LOSS if it is missing, or has more than `max_size` bytes. The
// caller verifies the seal.
absl::StatusOr<std::string> ReadRequiredJson(const std::string& path, std::int64_t max_size,
                                             const OpenFile& open_file);

struct Descriptions {
  Manifest manifest;
  std::uint32_t manifest_crc32c = 0;  // ManifestCrc32c
  volume::BlockLayout layout;
  volume::RangeTable ranges;
};

// Reads the manifest and the range table, which dataset and shard directories have in common, and
// verifies them. DATA_LOSS if they are damaged or of different datasets.
absl::StatusOr<Descriptions> ReadDescriptions(const std::string& directory,
                                              const OpenFile& open_file);
// Reads the manifest alone: `ranges` stays empty.
absl::StatusOr<Descriptions> ReadManifest(const std::string& directory, const OpenFile& open_file);
// Reads the range table that a manifest describes.
absl::StatusOr<volume::RangeTable> ReadRangeTable(const std::string& directory,
                                                  const Manifest& manifest,
                                                  const volume::BlockLayout& layout,
                                                  const OpenFile& open_file);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_DIRECTORY_FILES_H_
