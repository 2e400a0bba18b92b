// The flags for reading a source volume.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_SOURCE_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_SOURCE_FLAGS_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/cli/flag_set.h"
#include "core/math/vec.h"
#include "core/source/volume_source.h"
#include "core/volume/scalar_type.h"

namespace isoscope::cli {

// Raw files need dims and type; other files must not have any of these flags.
struct SourceFlags {
  std::optional<math::Index3> dims;
  std::optional<volume::ScalarType> type;
  std::optional<math::Vec3d> spacing;
  std::optional<math::Vec3d> origin;
  std::optional<bool> is_big_endian;
  std::optional<std::int64_t> header_bytes;

  // The first flag given, "--dims" for instance, or null.
  [[nodiscard]] const char* FirstGiven() const;
};

// `flags` must outlive the parsing.
void AddSourceFlags(FlagSet* set, SourceFlags* flags);

// Returns true if the suffix is that of a format with its own dimensions and type.
bool HasSelfDescribingName(const std::string& path);

// UsageError if the flags do not fit each other, the file's name, or a folder.
absl::Status CheckUsage(const SourceFlags& flags, const std::string& path);

// Opens the volume as a raw file if --dims is given, else by its format. Errors as
// source::OpenRawFile and source::OpenVolumeFile.
absl::StatusOr<std::unique_ptr<source::VolumeSource>> OpenSource(const SourceFlags& flags,
                                                                 const std::string& path);

// Returns the files of the volume. Errors as source::FilesOfVolume; NOT_FOUND if it is a folder
// that holds no volume.
absl::StatusOr<std::vector<std::string>> SourceFiles(const SourceFlags& flags,
                                                     const std::string& path);

// Returns all flags as canonical text: part of the key of a cached dataset.
std::string DescribeForKey(const SourceFlags& flags);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_SOURCE_FLAGS_H_
