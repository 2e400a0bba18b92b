// A path names a file and a dataset in it, "run.h5:/fields/density". A dataset is an array of any
// number of axes, slowest first: [z][y][x]. The library reads boxes of it ("hyperslabs") and
// converts type and byte order on the way. Opening one takes these steps:
//
//   1. The name is split (hdf5_path.h), and a dataset is found (hdf5_dataset.h).
//   2. All files of the dataset are located (hdf5_storage.h), because the library silently reads
//      fill values in place of a missing file.
//   3. Three axes are chosen (hdf5_coordinates.h): in (1, 93, 64, 1, 64) the axes 1, 2 and 4 are
//      z, y and x.
//   4. For a dataset in chunks the cache is set to one layer of them, and the dataset opened again. So
//      are the caches of a virtual dataset's sources (hdf5_source_caches.h).
//
// The cache makes rows cheap. Chunks are compressed whole, and rows are read in ascending order, so
// a chunk of 32 x 32 x 32 samples is needed for 32 planes. A layer has all chunks of the same z. If
// it fits into the cache (32 MiB; 128 MiB of a far file), it is decoded once; else it is decoded again for each run of
// rows.
//
// Rows [begin, end) are at most three boxes: the rest of a plane, whole planes, the start of a
// plane.
//
//   rows 30 to 170 of planes of 64 rows: rows 30-63 of plane 0, plane 1, rows 0-41 of plane 2

#include "core/formats/hdf5/hdf5_source.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/formats/hdf5/hdf5_links.h"
#include "core/formats/hdf5/hdf5_series.h"
#include "core/formats/hdf5/hdf5_source_caches.h"
#include "core/formats/hdf5/hdf5_storage.h"
#include "core/formats/hdf5/nexus_data.h"
#include "core/io/mounted_file.h"
#include "core/source/child/far_files.h"
#include "core/source/child/walled_source.h"
#include "core/source/grid/axis_order.h"
#include "core/source/hdf5/hdf5_file.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "core/source/hdf5/hdf5_read_ahead.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxChunkCacheBytes = 32 * base::kMiB;
// The library's buffers for type conversion, beside the chunk cache.
constexpr std::int64_t kConversionBytes = 4 * base::kMiB;
// A larger chunk would not fit under a small memory limit.
constexpr std::int64_t kMaxChunkBytes = 256 * base::kMiB;

std::vector<hsize_t> CountsOf(std::size_t rank, const AxisOrder& axes,
                              const volume::GridGeometry& geometry) {
  std::vector<hsize_t> counts(rank, 1);
  counts[axes.z] = static_cast<hsize_t>(geometry.sample_dims.z);
  counts[axes.y] = static_cast<hsize_t>(geometry.sample_dims.y);
  counts[axes.x] = static_cast<hsize_t>(geometry.sample_dims.x);
  return counts;
}

// What the library keeps decoded.
struct ChunkCaches {
  std::int64_t bytes = 0;  // of the dataset's chunks; 0: it has none
  std::optional<Hdf5SourceCaches> of_sources = std::nullopt;  // of a virtual dataset

  [[nodiscard]] std::int64_t all_bytes() const {
    return of_sources.has_value() ? of_sources->max_bytes() : bytes;
  }
};

// Opens the dataset again, with empty caches.
absl::Status OpenWith(const ChunkCaches& caches, NamedHdf5Dataset* named) {
  constexpr std::size_t kSlots = 12421;         // a prime number, far more than chunks
  constexpr std::size_t kSlotsOfSource = 1021;  // there may be many sources
  const Hdf5Handle access(H5Pcreate(H5P_DATASET_ACCESS), H5Pclose);
  if (caches.of_sources.has_value()) {
    H5Pset_chunk_cache(access.get(), kSlotsOfSource,
                       static_cast<std::size_t>(caches.of_sources->cache_bytes()),
                       kChunkPreemption);
  } else {
    H5Pset_chunk_cache(access.get(), kSlots, static_cast<std::size_t>(caches.bytes),
                       kChunkPreemption);
  }
  named->dataset = Hdf5Handle();
  named->dataset =
      Hdf5Handle(H5Dopen2(named->file.get(), named->parts.dataset.c_str(), access.get()), H5Dclose);
  if (!named->dataset.is_valid()) {
    return absl::DataLossError(
        absl::StrCat(named->parts.name(), ": can't be opened again: ", LastHdf5Error()));
  }
  return absl::OkStatus();
}

class Hdf5Source final : public VolumeSource {
 public:
  // `start` is the box of one element that is read, but for the axes z, y and x.
  Hdf5Source(const volume::GridGeometry& geometry, Hdf5SampleType type, const std::string& name,
             std::vector<hsize_t> start, const AxisOrder& axes, ChunkCaches caches,
             std::int64_t ahead_bytes, NamedHdf5Dataset named)
      : VolumeSource({.name = name,
                      .geometry = geometry,
                      .type = type.scalar,
                      .memory_bytes = caches.all_bytes() + kConversionBytes + ahead_bytes}),
        type_(std::move(type)),
        start_(std::move(start)),
        axes_(axes),
        caches_(std::move(caches)),
        named_(std::move(named)),
        read_ahead_(named_.dataset.get(), start_, CountsOf(start_.size(), axes, geometry), axes.z,
                    caches_.bytes) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = info().geometry.sample_dims;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    const std::int64_t row_bytes = info().row_bytes();
    // Part of a plane, whole planes, part of a plane.
    while (begin_row < end_row) {
      const std::int64_t z = begin_row / dims.y;
      const std::int64_t y = begin_row % dims.y;
      std::int64_t planes = 1;
      std::int64_t rows = std::min(dims.y - y, end_row - begin_row);
      if (y == 0 && rows == dims.y) {
        planes = (end_row - begin_row) / dims.y;
      }
      if (caches_.of_sources.has_value()) {
        const Hdf5SourceCaches::Step step = caches_.of_sources->Next(z, z + planes, y, y + rows);
        planes = step.end_z - z;
        if (step.must_reopen) {
          ISOSCOPE_RETURN_IF_ERROR(OpenWith(caches_, &named_));
        }
      }
      ISOSCOPE_RETURN_IF_ERROR(ReadPlanes(z, planes, y, rows, out));
      out += planes * rows * row_bytes;
      begin_row += planes * rows;
    }
    return absl::OkStatus();
  }

 private:
  absl::Status ReadPlanes(std::int64_t z, std::int64_t planes, std::int64_t y, std::int64_t rows,
                          char* out) {
    std::vector<hsize_t> start = start_;
    std::vector<hsize_t> count(start_.size(), 1);
    start[axes_.z] = static_cast<hsize_t>(z);
    start[axes_.y] = static_cast<hsize_t>(y);
    count[axes_.z] = static_cast<hsize_t>(planes);
    count[axes_.y] = static_cast<hsize_t>(rows);
    count[axes_.x] = static_cast<hsize_t>(info().geometry.sample_dims.x);
    read_ahead_.BeforePlanes(z, z + planes);
    // The library leaves memory as it is where nothing was written and no fill value is defined.
    std::fill_n(out, planes * rows * info().row_bytes(), '\0');
    const Hdf5Handle file_space(H5Dget_space(named_.dataset.get()), H5Sclose);
    const Hdf5Handle memory_space(
        H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr), H5Sclose);
    if (!file_space.is_valid() || !memory_space.is_valid() ||
        H5Sselect_hyperslab(file_space.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(),
                            nullptr) < 0 ||
        H5Dread(named_.dataset.get(), type_.memory_type.get(), memory_space.get(), file_space.get(),
                H5P_DEFAULT, out) < 0) {
      return absl::DataLossError(
          absl::StrFormat("%s: planes %d to %d can't be read: %s: the file is damaged or cut",
                          info().name, z, z + planes - 1, LastHdf5Error()));
    }
    return absl::OkStatus();
  }

  const Hdf5SampleType type_;
  const std::vector<hsize_t> start_;  // by axis of the dataset
  const AxisOrder axes_;
  ChunkCaches caches_;
  NamedHdf5Dataset named_;
  Hdf5ReadAhead read_ahead_;  // of datasets in chunks, which are not opened again
};

// Bytes of chunk cache: a layer of chunks. 0 for a dataset without chunks.
absl::StatusOr<std::int64_t> ChunkCacheBytes(hid_t dataset, const std::vector<std::int64_t>& dims,
                                             const AxisOrder& axes, std::size_t sample_size,
                                             std::int64_t max_bytes, const std::string& name) {
  const Hdf5Handle properties(H5Dget_create_plist(dataset), H5Pclose);
  if (H5Pget_layout(properties.get()) != H5D_CHUNKED) {
    return 0;
  }
  std::vector<hsize_t> chunk(dims.size());
  if (H5Pget_chunk(properties.get(), static_cast<int>(chunk.size()), chunk.data()) < 0) {
    return absl::DataLossError(absl::StrCat(name, ": its chunks can't be read: ", LastHdf5Error()));
  }
  double chunk_bytes = static_cast<double>(sample_size);
  double chunks = 1;
  for (std::size_t axis = 0; axis < dims.size(); ++axis) {
    chunk_bytes *= static_cast<double>(chunk[axis]);
    if (axis == axes.y || axis == axes.x) {
      const hsize_t along_axis = (static_cast<hsize_t>(dims[axis]) + chunk[axis] - 1) / chunk[axis];
      chunks *= static_cast<double>(along_axis);
    }
  }
  if (chunk_bytes > static_cast<double>(kMaxChunkBytes)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: chunks of %.0f bytes; expected at most %d: write it with smaller chunks (h5repack)",
        name, chunk_bytes, kMaxChunkBytes));
  }
  const double layer_bytes = chunk_bytes * chunks;
  return std::max(static_cast<std::int64_t>(chunk_bytes),
                  static_cast<std::int64_t>(std::min(layer_bytes, static_cast<double>(max_bytes))));
}

absl::StatusOr<std::vector<std::string>> FindFiles(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const NamedHdf5Dataset named, OpenHdf5ByName(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> of_samples,
                            FindHdf5Files(named.dataset.get(), named.parts.name()));
  // Begins with the file that the path names, and has those that only lead to the samples, too.
  std::vector<std::string> files = FindHdf5LinkedFiles(named.parts.file, named.parts.dataset);
  for (const std::string& file : of_samples) {
    if (std::find(files.begin(), files.end(), file) == files.end()) {
      files.push_back(file);
    }
  }
  // A plot of NeXus has its coordinates beside it.
  const std::string folder =
      named.parts.dataset.substr(0, std::max<std::size_t>(named.parts.dataset.rfind('/'), 1));
  const Hdf5Handle group(H5Gopen2(named.file.get(), folder.c_str(), H5P_DEFAULT), H5Gclose);
  if (group.is_valid() && !FindNexusSignal(group.get()).empty()) {
    for (const std::string& file : FindHdf5LinkedFiles(named.parts.file, folder)) {
      if (std::find(files.begin(), files.end(), file) == files.end()) {
        files.push_back(file);
      }
    }
  }
  return files;
}

constexpr WalledLibrary kHdf5 = {
    .name = "HDF5", .open = nullptr, .find_files = FindFiles, .describe = nullptr};

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenHdf5Volume(
    NamedHdf5Dataset named, Hdf5SampleType type, const AxisOrder& axes, std::int64_t step,
    std::int64_t component, const volume::GridGeometry& geometry) {
  const std::string name = named.parts.name();
  const hid_t dataset = named.dataset.get();
  const std::vector<std::int64_t> dims = Hdf5DimsOf(dataset);
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(name, ": ", valid.message()));
  }
  const bool is_far = io::IsMounted(named.parts.file);
  if (is_far) {
    ISOSCOPE_RETURN_IF_ERROR(FindHdf5Files(dataset, name).status());  // other files of it
  }
  std::vector<hsize_t> start(dims.size(), 0);
  if (axes.t.has_value()) {
    start[*axes.t] = static_cast<hsize_t>(step);
  }
  if (axes.c.has_value()) {
    start[*axes.c] = static_cast<hsize_t>(component);
  }
  const std::int64_t max_bytes = is_far ? kFarChunkCacheBytes : kMaxChunkCacheBytes;
  ChunkCaches caches;
  ISOSCOPE_ASSIGN_OR_RETURN(
      caches.bytes,
      ChunkCacheBytes(dataset, dims, axes, volume::SizeOf(type.scalar), max_bytes, name));
  caches.of_sources = Hdf5SourceCaches::Find(dataset, start, CountsOf(dims.size(), axes, geometry),
                                             axes, max_bytes);
  if (caches.all_bytes() > 0) {
    ISOSCOPE_RETURN_IF_ERROR(OpenWith(caches, &named));
  }
  const std::optional<WideType> wide = type.wide;
  std::unique_ptr<VolumeSource> source = std::make_unique<Hdf5Source>(
      geometry, std::move(type), name, std::move(start), axes, std::move(caches),
      is_far ? kFarAheadBytes : 0, std::move(named));
  if (wide.has_value()) {
    return MakeWideSource(std::move(source), *wide);
  }
  return source;
}

absl::StatusOr<std::vector<std::string>> FilesOfHdf5Dataset(const std::string& path) {
  return FindFilesWalled(kHdf5, {path});
}

}  // namespace isoscope::source
