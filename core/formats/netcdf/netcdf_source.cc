// Rows [begin, end) are at most three boxes of the array, as in hdf5_source.cc. A box is read as it
// is stored, into the tail of the output, and unpacked from front to back.

#include "core/formats/netcdf/netcdf_source.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/mounted_file.h"
#include "core/source/child/far_files.h"
#include "core/source/hdf5/hdf5_far_file.h"
#include "core/source/hdf5/hdf5_file.h"
#include "core/source/hdf5/hdf5_filters.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "core/source/hdf5/hdf5_read_ahead.h"
#include "netcdf.h"
#include "netcdf_filter.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxNetcdfCacheBytes = 32 * base::kMiB;
constexpr std::int64_t kMaxNetcdfChunkBytes = 256 * base::kMiB;
constexpr std::size_t kNetcdfSlots = 12421;  // of that cache: a prime, far more than chunks
constexpr std::int64_t kNetcdfBufferBytes = 4 * base::kMiB;

// `in` may be the tail of `out`: every value is read before it is overwritten.
template <typename Out, typename In>
void UnpackNetcdf(const NetcdfPacking& packing, std::size_t count, const char* in, char* out) {
  const double least = packing.valid_min.value_or(-std::numeric_limits<double>::infinity());
  const double most = packing.valid_max.value_or(std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < count; ++i) {
    const auto stored = static_cast<double>(base::LoadLittleEndian<In>(in + i * sizeof(In)));
    const bool is_missing = std::find(packing.missing.begin(), packing.missing.end(), stored) !=
                                packing.missing.end() ||
                            stored < least || stored > most;
    const double value = stored * packing.slope + packing.intercept;
    base::StoreLittleEndian(
        is_missing ? std::numeric_limits<Out>::quiet_NaN() : static_cast<Out>(value),
        out + i * sizeof(Out));
  }
}

class NetcdfSource final : public VolumeSource {
 public:
  NetcdfSource(std::unique_ptr<NetcdfFile> file, NetcdfVariable variable, NetcdfPacking packing,
               const volume::GridGeometry& geometry, std::vector<std::size_t> start,
               std::int64_t cache_bytes)
      : VolumeSource({.name = absl::StrCat(file->path(), ":", variable.name),
                      .geometry = geometry,
                      .type = TypeOfSamples(variable, packing),
                      .memory_bytes = cache_bytes + kNetcdfBufferBytes +
                                      (io::IsMounted(file->path()) ? kFarAheadBytes : 0)}),
        file_(std::move(file)),
        variable_(std::move(variable)),
        packing_(std::move(packing)),
        start_(std::move(start)) {
    if (io::IsMounted(file_->path())) {
      PrepareReadAhead(cache_bytes);
    }
  }

  [[nodiscard]] bool is_plain() const { return packing_.is_plain(); }

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = info().geometry.sample_dims;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    // Part of a plane, whole planes, part of a plane.
    while (begin_row < end_row) {
      const std::int64_t z = begin_row / dims.y;
      const std::int64_t y = begin_row % dims.y;
      std::int64_t planes = 1;
      std::int64_t rows = std::min(dims.y - y, end_row - begin_row);
      if (y == 0 && rows == dims.y) {
        planes = (end_row - begin_row) / dims.y;
      }
      ISOSCOPE_RETURN_IF_ERROR(ReadPart(z, planes, y, rows, out));
      out += planes * rows * info().row_bytes();
      begin_row += planes * rows;
    }
    return absl::OkStatus();
  }

 private:
  static volume::ScalarType TypeOfSamples(const NetcdfVariable& variable,
                                          const NetcdfPacking& packing) {
    if (packing.is_plain()) {
      return variable.stored;
    }
    switch (variable.stored) {
      case volume::ScalarType::kUint32:
      case volume::ScalarType::kInt32:
      case volume::ScalarType::kFloat64:
        return volume::ScalarType::kFloat64;
      default:
        return volume::ScalarType::kFloat32;
    }
  }

  // Opens the variable's dataset once more: the library opens each object once for all, so that its
  // cache of chunks must be that of netCDF.
  void PrepareReadAhead(std::int64_t cache_bytes) {
    const Hdf5Handle access(H5Pcreate(H5P_DATASET_ACCESS), H5Pclose);
    H5Pset_chunk_cache(access.get(), kNetcdfSlots, static_cast<std::size_t>(cache_bytes),
                       kChunkPreemption);
    far_file_ = OpenHdf5ToRead(file_->path());
    far_dataset_ =
        Hdf5Handle(H5Dopen2(far_file_.get(), variable_.name.c_str(), access.get()), H5Dclose);
    if (!far_dataset_.is_valid()) {
      return;  // under another name, or in no HDF5 file
    }
    std::vector<hsize_t> counts(start_.size(), 1);
    const math::Index3& dims = info().geometry.sample_dims;
    counts[variable_.roles.space[0]] = static_cast<hsize_t>(dims.z);
    counts[variable_.roles.space[1]] = static_cast<hsize_t>(dims.y);
    counts[variable_.roles.space[2]] = static_cast<hsize_t>(dims.x);
    read_ahead_.emplace(far_dataset_.get(), std::vector<hsize_t>(start_.begin(), start_.end()),
                        std::move(counts), variable_.roles.space[0], cache_bytes);
  }

  absl::Status ReadPart(std::int64_t z, std::int64_t planes, std::int64_t y, std::int64_t rows,
                        char* out) {
    const std::array<std::size_t, 3>& space = variable_.roles.space;
    std::vector<std::size_t> start = start_;
    std::vector<std::size_t> count(start_.size(), 1);
    start[space[0]] = static_cast<std::size_t>(z);
    start[space[1]] = static_cast<std::size_t>(y);
    count[space[0]] = static_cast<std::size_t>(planes);
    count[space[1]] = static_cast<std::size_t>(rows);
    count[space[2]] = static_cast<std::size_t>(info().geometry.sample_dims.x);
    const std::size_t samples = count[space[0]] * count[space[1]] * count[space[2]];
    char* const stored =
        out + samples * (volume::SizeOf(info().type) - volume::SizeOf(variable_.stored));
    if (read_ahead_.has_value()) {
      read_ahead_->BeforePlanes(z, z + planes);
    }
    const int status =
        nc_get_vara(variable_.group, variable_.id, start.data(), count.data(), stored);
    if (status != NC_NOERR) {
      return absl::DataLossError(
          absl::StrFormat("%s: planes %d to %d can't be read: %s: the file is damaged or cut",
                          info().name, z, z + planes - 1, nc_strerror(status)));
    }
    if (!packing_.is_plain()) {
      VisitNetcdfType(variable_, [&]<typename In>() {
        if (info().type == volume::ScalarType::kFloat32) {
          UnpackNetcdf<float, In>(packing_, samples, stored, out);
        } else {
          UnpackNetcdf<double, In>(packing_, samples, stored, out);
        }
      });
    }
    return absl::OkStatus();
  }

  const std::unique_ptr<NetcdfFile> file_;
  const NetcdfVariable variable_;
  const NetcdfPacking packing_;
  const std::vector<std::size_t> start_;  // by axis of the variable
  Hdf5Handle far_file_;                   // of a far file
  Hdf5Handle far_dataset_;
  std::optional<Hdf5ReadAhead> read_ahead_;
};

// INVALID_ARGUMENT: a filter of HDF5 that compresses the variable is not installed.
absl::Status CheckNetcdfFilters(const NetcdfVariable& variable) {
  std::size_t count = 0;
  if (nc_inq_var_filter_ids(variable.group, variable.id, &count, nullptr) != NC_NOERR) {
    return absl::OkStatus();  // a classic file
  }
  std::vector<unsigned int> ids(count);
  nc_inq_var_filter_ids(variable.group, variable.id, &count, ids.data());
  for (const unsigned int id : ids) {
    ISOSCOPE_RETURN_IF_ERROR(CheckHdf5Filter(id));
  }
  return absl::OkStatus();
}

// Sets the cache of chunks to a layer of them; 0 if there are none.
absl::StatusOr<std::int64_t> SetNetcdfCache(const NetcdfVariable& variable,
                                            std::int64_t max_bytes) {
  std::vector<std::size_t> chunk(variable.axes.size());
  int storage = NC_CONTIGUOUS;
  if (nc_inq_var_chunking(variable.group, variable.id, &storage, chunk.data()) != NC_NOERR ||
      storage != NC_CHUNKED) {
    return 0;
  }
  auto chunk_bytes = static_cast<double>(volume::SizeOf(variable.stored));
  double chunks = 1;
  for (std::size_t axis = 0; axis < chunk.size(); ++axis) {
    chunk_bytes *= static_cast<double>(chunk[axis]);
    if (axis == variable.roles.space[1] || axis == variable.roles.space[2]) {
      chunks *= std::ceil(static_cast<double>(variable.axes[axis].size) /
                          static_cast<double>(std::max<std::size_t>(chunk[axis], 1)));
    }
  }
  if (chunk_bytes > static_cast<double>(kMaxNetcdfChunkBytes)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "chunks of %.0f bytes; expected at most %d: write it with smaller chunks (nccopy -c)",
        chunk_bytes, kMaxNetcdfChunkBytes));
  }
  const auto cache_bytes = static_cast<std::int64_t>(
      std::max(chunk_bytes, std::min(chunk_bytes * chunks, static_cast<double>(max_bytes))));
  nc_set_var_chunk_cache(variable.group, variable.id, static_cast<std::size_t>(cache_bytes),
                         kNetcdfSlots, static_cast<float>(kChunkPreemption));
  return cache_bytes;
}

absl::Status NamedNetcdf(const absl::Status& status, const NetcdfFile& file,
                         const NetcdfVariable& variable) {
  return absl::Status(status.code(),
                      absl::StrCat(file.path(), ":", variable.name, ": ", status.message()));
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenOnGrid(
    std::unique_ptr<NetcdfFile> file, const NetcdfVariable& variable, NetcdfPacking packing,
    const volume::GridGeometry& geometry, std::int64_t step, std::int64_t component) {
  if (const absl::Status valid = volume::Validate(geometry); !valid.ok()) {
    return NamedNetcdf(valid, *file, variable);
  }
  if (const absl::Status filters = CheckNetcdfFilters(variable); !filters.ok()) {
    return NamedNetcdf(filters, *file, variable);
  }
  const auto cache_bytes = SetNetcdfCache(
      variable, io::IsMounted(file->path()) ? kFarChunkCacheBytes : kMaxNetcdfCacheBytes);
  if (!cache_bytes.ok()) {
    return NamedNetcdf(cache_bytes.status(), *file, variable);
  }
  std::vector<std::size_t> start(variable.axes.size(), 0);
  if (variable.roles.time.has_value()) {
    start[*variable.roles.time] = static_cast<std::size_t>(step);
  }
  if (variable.roles.component.has_value()) {
    start[*variable.roles.component] = static_cast<std::size_t>(component);
  }
  auto source = std::make_unique<NetcdfSource>(std::move(file), variable, std::move(packing),
                                               geometry, std::move(start), *cache_bytes);
  if (variable.wide.has_value() && source->is_plain()) {
    return MakeWideSource(std::move(source), *variable.wide);
  }
  return source;
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenNetcdfVolume(std::unique_ptr<NetcdfFile> file,
                                                               const NetcdfVariable& variable,
                                                               std::int64_t step,
                                                               std::int64_t component,
                                                               const GridRules& rules) {
  auto geometry = absl::StatusOr<volume::GridGeometry>(absl::UnknownError(""));
  if (rules.resamples) {
    const auto grid = CfUnevenGridOf(variable.axes, variable.roles, rules);
    geometry = grid.ok() ? absl::StatusOr<volume::GridGeometry>(grid->geometry) : grid.status();
  } else {
    geometry = CfGridOf(variable.axes, variable.roles, rules);
  }
  if (!geometry.ok()) {
    return NamedNetcdf(geometry.status(), *file, variable);
  }
  auto packing = NetcdfFile::PackingOf(variable);
  if (!packing.ok()) {
    return NamedNetcdf(packing.status(), *file, variable);
  }
  return OpenOnGrid(std::move(file), variable, *std::move(packing), *geometry, step, component);
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenStoredNetcdf(std::unique_ptr<NetcdfFile> file,
                                                               const NetcdfVariable& variable,
                                                               const volume::GridGeometry& geometry,
                                                               std::int64_t step) {
  return OpenOnGrid(std::move(file), variable, {}, geometry, step, 0);
}

}  // namespace isoscope::source
