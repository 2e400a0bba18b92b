// Rows [begin, end) are at most three boxes of the array: part of a plane, whole planes, part of a
// plane. A box is read as it is stored, into the tail of the output, and unpacked from front to
// back.

#include "core/formats/zarr/zarr_source.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "core/base/cancellation.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/adapt/wide_source.h"
#include "core/source/chunks/chunk_cache.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxZarrCacheBytes = 256 * base::kMiB;

// The chunks that one plane meets.
std::int64_t LayerBytesOf(const ChunkedArrayInfo& array, const ZarrPart& part) {
  auto bytes = static_cast<std::int64_t>(SizeOf(array.type));
  for (const std::int64_t size : array.chunk_dims) {
    bytes *= size;
  }
  const ChunkGrid grid(array.dims, array.chunk_dims);
  for (const std::size_t axis : {part.space[1], part.space[2]}) {
    const std::int64_t count = grid.counts()[axis];
    bytes = bytes > kMaxZarrCacheBytes / std::max<std::int64_t>(count, 1) ? kMaxZarrCacheBytes
                                                                          : bytes * count;
  }
  return std::min(bytes, kMaxZarrCacheBytes);
}

class ZarrSource final : public VolumeSource {
 public:
  ZarrSource(SourceInfo info, std::shared_ptr<const ChunkedArray> array, ZarrPart part,
             ZarrPacking packing, std::int64_t cache_bytes)
      : VolumeSource(std::move(info)),
        array_(std::move(array)),
        part_(std::move(part)),
        packing_(std::move(packing)),
        cache_(part_.space[0], cache_bytes) {}

  absl::Status ReadBand(std::int64_t begin_z, std::int64_t end_z, std::int64_t begin_y,
                        std::int64_t end_y, char* out) override {
    const std::int64_t row_samples = info().geometry.sample_dims.x;
    return ReadSpace({.begin = {0, begin_y, begin_z}, .end = {row_samples, end_y, end_z}}, out,
                     &cache_, *cancellation_);
  }

  void HeedCancellation(const base::Cancellation* cancellation) override {
    cancellation_ = cancellation == nullptr ? &never_ : cancellation;
  }

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = info().geometry.sample_dims;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    while (begin_row < end_row) {
      const std::int64_t z = begin_row / dims.y;
      const std::int64_t y = begin_row % dims.y;
      std::int64_t planes = 1;
      std::int64_t rows = std::min(dims.y - y, end_row - begin_row);
      if (y == 0 && rows == dims.y) {
        planes = (end_row - begin_row) / dims.y;
      }
      ISOSCOPE_RETURN_IF_ERROR(
          ReadSpace({.begin = {0, y, z}, .end = {dims.x, y + rows, z + planes}}, out, &cache_,
                    *cancellation_));
      out += planes * rows * info().row_bytes();
      begin_row += planes * rows;
    }
    return absl::OkStatus();
  }

  [[nodiscard]] std::optional<BoxGrid> box_grid() const override {
    const ChunkIndex& chunk = array_->info().chunk_dims;
    return BoxGrid{
        .origin = {0, 0, 0},
        .box_dims = {chunk[part_.space[2]], chunk[part_.space[1]], chunk[part_.space[0]]}};
  }
  // Chunks of several channels or steps are decoded whole for each of them.
  [[nodiscard]] std::int64_t decoding_factor() const override {
    const ChunkIndex& chunk = array_->info().chunk_dims;
    std::int64_t factor = 1;
    for (std::size_t axis = 0; axis < chunk.size(); ++axis) {
      const bool is_space =
          std::find(part_.space.begin(), part_.space.end(), axis) != part_.space.end();
      factor *= is_space ? 1 : chunk[axis];
    }
    return factor;
  }
  [[nodiscard]] absl::Status ReadBox(const math::IndexBox& box, char* out,
                                     const base::Cancellation& cancellation) const override {
    return ReadSpace(box, out, nullptr, cancellation);
  }

 private:
  absl::Status ReadSpace(const math::IndexBox& space, char* out, ChunkCache* cache,
                         const base::Cancellation& cancellation) const {
    ChunkBox box{.begin = part_.index, .end = part_.index};
    for (std::int64_t& end : box.end) {
      ++end;
    }
    for (std::size_t i = 0; i < part_.space.size(); ++i) {
      const int axis = 2 - static_cast<int>(i);
      box.begin[part_.space[i]] = space.begin[axis];
      box.end[part_.space[i]] = space.end[axis];
    }
    const auto samples = static_cast<std::size_t>(math::Volume(space.dims()));
    char* const stored =
        out + samples * (volume::SizeOf(info().type) - SizeOf(array_->info().type));
    ISOSCOPE_RETURN_IF_ERROR(array_->ReadBox(box, stored, cache, cancellation));
    if (!packing_.is_plain()) {
      UnpackZarr(packing_, array_->info().type, samples, stored, out);
    }
    return absl::OkStatus();
  }

  const std::shared_ptr<const ChunkedArray> array_;
  const ZarrPart part_;
  const ZarrPacking packing_;
  ChunkCache cache_;
  const base::Cancellation never_;
  const base::Cancellation* cancellation_ = &never_;
};

}  // namespace

std::unique_ptr<VolumeSource> MakeZarrSource(SourceInfo info,
                                             std::shared_ptr<const ChunkedArray> array,
                                             ZarrPart part, ZarrPacking packing) {
  const math::Index3& dims = info.geometry.sample_dims;
  const ChunkIndex& sizes = array->info().dims;
  ISOSCOPE_CHECK(dims.z == sizes[part.space[0]] && dims.y == sizes[part.space[1]] &&
                 dims.x == sizes[part.space[2]]);
  const SampleType type = SampleTypeOf(array->info().type);
  const bool is_plain = packing.is_plain();
  const std::int64_t cache_bytes = LayerBytesOf(array->info(), part);
  info.type = is_plain ? type.stored : UnpackedType(array->info().type);
  info.memory_bytes = array->info().memory_bytes + cache_bytes;
  info.planes_at_once = array->info().chunk_dims[part.space[0]];
  auto source = std::make_unique<ZarrSource>(std::move(info), std::move(array), std::move(part),
                                             std::move(packing), cache_bytes);
  if (is_plain && type.wide.has_value()) {
    return MakeWideSource(std::move(source), *type.wide);
  }
  return source;
}

}  // namespace isoscope::source
