// Writes a volume in this order:
//
// 1. Check the kind of file, the geometry, and the free space.
// 2. Write the header: in front of the samples, or into a .nhdr beside the .raw.
// 3. WriteSamples, as a TBB pipeline: take the next rows, fill them in parallel, append in order.
// 4. Rename the samples' file, then the header's, so that no header names missing samples.
//
// Example, 64 x 64 x 93 int16 as NRRD: "NRRD0004\ntype: int16\n...\n\n", then 761 856 bytes.

#include "core/source/volume_file.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <system_error>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "oneapi/tbb/parallel_pipeline.h"
#include "oneapi/tbb/task_arena.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/atomic_file.h"
#include "core/io/file.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kChunkBytes = 2 * base::kMiB;

struct Ending {
  const char* text;
  VolumeFileKind kind;
};
constexpr std::array<Ending, 4> kEndings{{{".nrrd", VolumeFileKind::kNrrd},
                                          {".nhdr", VolumeFileKind::kDetachedNrrd},
                                          {".mha", VolumeFileKind::kMetaImage},
                                          {".raw", VolumeFileKind::kRaw}}};

std::string BaseName(const std::string& path) { return path.substr(path.rfind('/') + 1); }

const char* MetaImageTypeOf(volume::ScalarType type) {
  switch (type) {
    case volume::ScalarType::kUint8:
      return "MET_UCHAR";
    case volume::ScalarType::kInt8:
      return "MET_CHAR";
    case volume::ScalarType::kUint16:
      return "MET_USHORT";
    case volume::ScalarType::kInt16:
      return "MET_SHORT";
    case volume::ScalarType::kUint32:
      return "MET_UINT";
    case volume::ScalarType::kInt32:
      return "MET_INT";
    case volume::ScalarType::kFloat32:
      return "MET_FLOAT";
    case volume::ScalarType::kFloat64:
      return "MET_DOUBLE";
  }
  return "";
}

std::string NrrdTypeOf(volume::ScalarType type) {
  switch (type) {
    case volume::ScalarType::kFloat32:
      return "float";
    case volume::ScalarType::kFloat64:
      return "double";
    default:
      return std::string(volume::NameOf(type));
  }
}

// NRRD: http://teem.sourceforge.net/nrrd/format.html. `data_file`: "" if the samples follow.
std::string NrrdHeader(const VolumeGenerator& generator, const VolumeFileOptions& options,
                       const std::string& data_file) {
  const math::Index3& dims = generator.dims();
  const math::Vec3d& s = options.spacing;
  const math::Vec3d& o = options.origin;
  return absl::StrFormat(
      "NRRD0004\ntype: %s\ndimension: 3\nspace dimension: 3\nsizes: %d %d %d\n"
      "space directions: (%.17g,0,0) (0,%.17g,0) (0,0,%.17g)\nspace origin: (%.17g,%.17g,%.17g)\n"
      "kinds: domain domain domain\nendian: little\nencoding: raw\n%s\n",
      NrrdTypeOf(generator.type()), dims.x, dims.y, dims.z, s.x, s.y, s.z, o.x, o.y, o.z,
      data_file.empty() ? "" : absl::StrCat("data file: ", data_file, "\n"));
}

// MetaImage: https://itk.org/Wiki/ITK/MetaIO/Documentation.
std::string MetaImageHeader(const VolumeGenerator& generator, const VolumeFileOptions& options) {
  const math::Index3& dims = generator.dims();
  const math::Vec3d& s = options.spacing;
  const math::Vec3d& o = options.origin;
  return absl::StrFormat(
      "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
      "CompressedData = False\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n"
      "Offset = %.17g %.17g %.17g\nElementSpacing = %.17g %.17g %.17g\nDimSize = %d %d %d\n"
      "ElementType = %s\nElementDataFile = LOCAL\n",
      o.x, o.y, o.z, s.x, s.y, s.z, dims.x, dims.y, dims.z, MetaImageTypeOf(generator.type()));
}

absl::StatusOr<std::unique_ptr<io::AtomicFile>> CreateVolumeFile(const std::string& path) {
  if (io::IsDirectory(path)) {
    return absl::FailedPreconditionError(
        absl::StrCat(path, ": is a folder; expected the name of a file"));
  }
  return io::AtomicFile::Create(path);
}

absl::Status CheckFreeSpace(const std::string& path, std::int64_t bytes) {
  std::filesystem::path parent = std::filesystem::path(path).parent_path();
  std::error_code error;
  const std::filesystem::space_info space =
      std::filesystem::space(parent.empty() ? "." : parent, error);
  if (!error && space.available < static_cast<std::uintmax_t>(bytes)) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("%s: needs %d bytes, its file system has %d left: free some, or give "
                        "smaller --dims or a smaller --type",
                        path, bytes, space.available));
  }
  return absl::OkStatus();
}

// Fills rows in parallel, and writes them to the file in order.
absl::Status WriteSamples(const VolumeGenerator& generator, const VolumeFileOptions& options,
                          const base::Cancellation& cancellation, io::AtomicFile* file) {
  const std::int64_t row_bytes =
      generator.dims().x * static_cast<std::int64_t>(volume::SizeOf(generator.type()));
  const std::int64_t total_bytes = row_bytes * generator.row_count();
  const std::int64_t chunk_rows = std::max<std::int64_t>(kChunkBytes / row_bytes / 4 * 4, 4);
  const auto tokens = 2 * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());

  struct Chunk {
    std::int64_t begin = 0;
    std::int64_t end = 0;
    std::string bytes;
  };
  // One chunk for each token of the pipeline: its buffer is free again after it was written.
  std::vector<Chunk> chunks(tokens);
  std::size_t next_chunk = 0;
  std::int64_t next_row = 0;
  std::int64_t done_bytes = 0;
  absl::Status status;  // the reading filter's and the writing filter's, which exclude each other
  std::atomic<bool> is_stopped{false};

  const auto take = [&](tbb::flow_control& control) -> Chunk* {
    if (next_row >= generator.row_count() || is_stopped || cancellation.is_cancelled()) {
      control.stop();
      return nullptr;
    }
    Chunk& chunk = chunks[next_chunk];
    next_chunk = (next_chunk + 1) % chunks.size();
    chunk.begin = next_row;
    chunk.end = next_row = std::min(next_row + chunk_rows, generator.row_count());
    return &chunk;
  };
  const auto fill = [&](Chunk* chunk) {
    chunk->bytes.resize(static_cast<std::size_t>((chunk->end - chunk->begin) * row_bytes));
    generator.FillRows(chunk->begin, chunk->end, chunk->bytes.data());
    return chunk;
  };
  const auto write = [&](const Chunk* chunk) {
    if (is_stopped) {
      return;
    }
    status = file->Append(chunk->bytes);
    is_stopped = !status.ok();
    done_bytes += static_cast<std::int64_t>(chunk->bytes.size());
    if (options.progress) {
      options.progress(done_bytes, total_bytes);
    }
  };
  tbb::parallel_pipeline(
      tokens, tbb::make_filter<void, Chunk*>(tbb::filter_mode::serial_in_order, take) &
                  tbb::make_filter<Chunk*, Chunk*>(tbb::filter_mode::parallel, fill) &
                  tbb::make_filter<Chunk*, void>(tbb::filter_mode::serial_in_order, write));
  ISOSCOPE_RETURN_IF_ERROR(status);
  return cancellation.Check();
}

}  // namespace

absl::StatusOr<VolumeFileKind> VolumeFileKindOf(const std::string& path) {
  for (const Ending& ending : kEndings) {
    if (absl::EndsWithIgnoreCase(path, ending.text) && BaseName(path) != ending.text) {
      return ending.kind;
    }
  }
  return absl::InvalidArgumentError(absl::StrCat(
      path,
      ": unknown kind of volume file; expected a name that ends in .nrrd, .nhdr (with the "
      "samples in a .raw beside it), .mha or .raw"));
}

absl::StatusOr<std::int64_t> WriteVolumeFile(const VolumeGenerator& generator,
                                             const VolumeFileOptions& options,
                                             const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(const VolumeFileKind kind, VolumeFileKindOf(options.path));
  volume::GridGeometry geometry;
  geometry.sample_dims = generator.dims();
  geometry.spacing = options.spacing;
  geometry.origin = options.origin;
  ISOSCOPE_RETURN_IF_ERROR(volume::Validate(geometry));
  const std::int64_t sample_bytes =
      math::Volume(generator.dims()) * static_cast<std::int64_t>(volume::SizeOf(generator.type()));
  ISOSCOPE_RETURN_IF_ERROR(CheckFreeSpace(options.path, sample_bytes));

  std::string data_path = options.path;
  std::unique_ptr<io::AtomicFile> header;
  if (kind == VolumeFileKind::kDetachedNrrd) {
    data_path = options.path.substr(0, options.path.size() - 5) + ".raw";
    ISOSCOPE_ASSIGN_OR_RETURN(header, CreateVolumeFile(options.path));
    ISOSCOPE_RETURN_IF_ERROR(header->Append(NrrdHeader(generator, options, BaseName(data_path))));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::AtomicFile> data,
                            CreateVolumeFile(data_path));
  if (kind == VolumeFileKind::kNrrd) {
    ISOSCOPE_RETURN_IF_ERROR(data->Append(NrrdHeader(generator, options, "")));
  } else if (kind == VolumeFileKind::kMetaImage) {
    ISOSCOPE_RETURN_IF_ERROR(data->Append(MetaImageHeader(generator, options)));
  }
  ISOSCOPE_RETURN_IF_ERROR(WriteSamples(generator, options, cancellation, data.get()));
  ISOSCOPE_RETURN_IF_ERROR(data->Commit());
  if (header != nullptr) {
    ISOSCOPE_RETURN_IF_ERROR(header->Commit());
  }
  return sample_bytes;
}

}  // namespace isoscope::source
