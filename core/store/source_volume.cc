#include "core/store/source_volume.h"

#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/store/manifest.h"
#include "core/store/shard_format.h"

namespace isoscope::store {

absl::StatusOr<std::optional<SourceSamples>> SamplesOfVolume(const std::string& shard_directory,
                                                             const ScalarVolumeKey& key) {
  const std::string path =
      absl::StrCat(shard_directory, "/", ScalarVolumeDirectoryName(key), "/", kManifestFileName);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes, io::ReadWholeFile(path, kMaxManifestBytes));
  ISOSCOPE_ASSIGN_OR_RETURN(Manifest manifest, DecodeManifest(bytes, path));
  return std::move(manifest.in_source);
}

}  // namespace isoscope::store
