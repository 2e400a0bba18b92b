#include "core/store/directory_files.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/crc32c.h"
#include "core/base/status_macros.h"
#include "core/store/shard_format.h"
#include "core/store/shard_writer.h"

namespace isoscope::store {

std::string PathIn(const std::string& directory, absl::string_view name) {
  return absl::StrCat(directory, "/", name);
}

absl::StatusOr<std::unique_ptr<io::RandomAccessFile>> OpenRequired(const std::string& path,
                                                                   const OpenFile& open_file) {
  auto file = open_file(path);
  if (absl::IsNotFound(file.status())) {
    return absl::DataLossError(
        absl::StrCat(path, ": is missing; copy the directory again or partition anew"));
  }
  return file;
}

absl::StatusOr<std::string> ReadRequired(const std::string& path, std::int64_t size,
                                         const OpenFile& open_file) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, OpenRequired(path, open_file));
  if (file->size_bytes() != size) {
    return absl::DataLossError(
        absl::StrFormat("%s: %d bytes, expected %d", path, file->size_bytes(), size));
  }
  return io::ReadWholeFile(*file, size);
}

absl::StatusOr<std::string> ReadRequiredJson(const std::string& path, std::int64_t max_size,
                                             const OpenFile& open_file) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, OpenRequired(path, open_file));
  if (file->size_bytes() > max_size) {
    return absl::DataLossError(
        absl::StrFormat("%s: %d bytes, expected at most %d", path, file->size_bytes(), max_size));
  }
  return io::ReadWholeFile(*file, max_size);
}

absl::StatusOr<Descriptions> ReadManifest(const std::string& directory, const OpenFile& open_file) {
  Descriptions descriptions;
  const std::string manifest_path = PathIn(directory, kManifestFileName);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string manifest_bytes,
                            ReadRequiredJson(manifest_path, kMaxManifestBytes, open_file));
  ISOSCOPE_ASSIGN_OR_RETURN(descriptions.manifest_crc32c,
                            ManifestCrc32c(manifest_bytes, manifest_path));
  ISOSCOPE_ASSIGN_OR_RETURN(descriptions.manifest, DecodeManifest(manifest_bytes, manifest_path));
  const Manifest& manifest = descriptions.manifest;
  ISOSCOPE_ASSIGN_OR_RETURN(
      descriptions.layout,
      volume::BlockLayout::Make(manifest.geometry.sample_dims, manifest.block_cells));
  return descriptions;
}

absl::StatusOr<volume::RangeTable> ReadRangeTable(const std::string& directory,
                                                  const Manifest& manifest,
                                                  const volume::BlockLayout& layout,
                                                  const OpenFile& open_file) {
  const std::string ranges_path = PathIn(directory, kRangeTableFileName);
  const auto entry_size = static_cast<std::int64_t>(2 * volume::SizeOf(manifest.scalar_type));
  const std::int64_t ranges_size =
      static_cast<std::int64_t>(kBinaryHeaderBytes) + entry_size * layout.block_count();
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string ranges_bytes,
                            ReadRequired(ranges_path, ranges_size, open_file));
  ISOSCOPE_ASSIGN_OR_RETURN(volume::RangeTable ranges, DecodeRangeTable(ranges_bytes, ranges_path));
  const std::uint32_t ranges_crc32c = base::Crc32c(ranges_bytes);
  if (ranges_crc32c != manifest.range_table_crc32c) {
    return absl::DataLossError(absl::StrFormat(
        "%s: crc32c of the file 0x%08x, the manifest expects 0x%08x: it is of another dataset",
        ranges_path, ranges_crc32c, manifest.range_table_crc32c));
  }
  if (ranges.type() != manifest.scalar_type || ranges.block_count() != layout.block_count()) {
    return absl::DataLossError(absl::StrFormat(
        "%s: %d blocks of %s, the manifest expects %d of %s", ranges_path, ranges.block_count(),
        volume::NameOf(ranges.type()), layout.block_count(), volume::NameOf(manifest.scalar_type)));
  }
  return ranges;
}

absl::StatusOr<Descriptions> ReadDescriptions(const std::string& directory,
                                              const OpenFile& open_file) {
  ISOSCOPE_ASSIGN_OR_RETURN(Descriptions descriptions, ReadManifest(directory, open_file));
  ISOSCOPE_ASSIGN_OR_RETURN(descriptions.ranges, ReadRangeTable(directory, descriptions.manifest,
                                                                descriptions.layout, open_file));
  return descriptions;
}

}  // namespace isoscope::store
