#include "core/source/bytes/raw_file.h"

#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/source/bytes/file_source.h"
#include "core/source/bytes/named_files.h"
#include "core/source/bytes/sample_location.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenRawFile(const std::string& path,
                                                          const RawFormat& format) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(path));
  if (format.header_bytes < 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: --header-bytes %d: expected 0 or more", path, format.header_bytes));
  }
  const volume::GridGeometry geometry{
      .sample_dims = format.dims, .spacing = {1, 1, 1}, .origin = {}, .direction = {}};
  return MakeFileSource(geometry,
                        {.files = {path},
                         .offset = format.header_bytes,
                         .is_big_endian = format.is_big_endian,
                         .stored_type = format.type},
                        path);
}

}  // namespace isoscope::source
