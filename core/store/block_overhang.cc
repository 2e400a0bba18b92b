#include "core/store/block_overhang.h"

#include <algorithm>
#include <cstddef>

#include "absl/functional/function_ref.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/status_macros.h"
#include "core/store/block_codec.h"
#include "core/volume/block_samples.h"

namespace isoscope::store {
namespace {

// Calls visit(offset, size) for each run of bytes of the overhang, in the order of the stored samples.
void ForEachRun(const math::IndexBox& stored, const math::IndexBox& part, std::size_t sample_bytes,
                absl::FunctionRef<void(std::size_t offset, std::size_t size)> visit) {
  const math::Index3 dims = stored.dims();
  const auto run = [&](std::int64_t y, std::int64_t z, std::int64_t begin, std::int64_t end) {
    if (begin < end) {
      const std::int64_t first =
          ((z - stored.begin.z) * dims.y + y - stored.begin.y) * dims.x + begin - stored.begin.x;
      visit(static_cast<std::size_t>(first) * sample_bytes,
            static_cast<std::size_t>(end - begin) * sample_bytes);
    }
  };
  for (std::int64_t z = stored.begin.z; z < stored.end.z; ++z) {
    for (std::int64_t y = stored.begin.y; y < stored.end.y; ++y) {
      if (z >= part.begin.z && z < part.end.z && y >= part.begin.y && y < part.end.y) {
        run(y, z, stored.begin.x, part.begin.x);
        run(y, z, part.end.x, stored.end.x);
      } else {
        run(y, z, stored.begin.x, stored.end.x);
      }
    }
  }
}

}  // namespace

math::Index3 UnitOfBlock(const volume::BlockLayout& layout, const SourceSamples& source,
                         volume::BlockId id) {
  const math::Index3 first = layout.OwnSamplesOf(id).begin;
  math::Index3 unit;
  for (int axis = 0; axis < 3; ++axis) {
    unit[axis] = (first[axis] - source.unit_origin[axis]) / source.unit_dims[axis];
  }
  return unit;
}

math::IndexBox PartInUnit(const volume::BlockLayout& layout, const SourceSamples& source,
                          volume::BlockId id) {
  const math::Index3 unit = UnitOfBlock(layout, source, id);
  math::IndexBox part = layout.StoredSamplesOf(id);
  for (int axis = 0; axis < 3; ++axis) {
    const std::int64_t begin = source.unit_origin[axis] + unit[axis] * source.unit_dims[axis];
    part.begin[axis] = std::max(part.begin[axis], begin);
    part.end[axis] = std::min(part.end[axis], begin + source.unit_dims[axis]);
  }
  return part;
}

BlockEncoding EncodeOverhang(const volume::BlockLayout& layout, const SourceSamples& source,
                             volume::ScalarType type, volume::BlockId id, absl::string_view samples,
                             std::string* out) {
  const std::size_t sample_bytes = volume::SizeOf(type);
  std::string overhang;
  ForEachRun(layout.StoredSamplesOf(id), PartInUnit(layout, source, id), sample_bytes,
             [&](std::size_t offset, std::size_t size) {
               overhang.append(samples.data() + offset, size);
             });
  std::string encoded;
  auto encoding = BlockEncoding::kRaw;
  if (!overhang.empty()) {
    const auto count = static_cast<std::int64_t>(overhang.size() / sample_bytes);
    encoding = EncodeBlock(BlockEncoding::kPacked, type, {count, 1, 1}, overhang, &encoded);
  }
  if (kOverhangHeadBytes + encoded.size() >= samples.size()) {
    out->assign(samples.data(), samples.size());
    return BlockEncoding::kRaw;
  }
  out->clear();
  base::AppendLittleEndian(base::Crc32c(samples), out);
  out->push_back(static_cast<char>(encoding));
  out->append(encoded);
  return BlockEncoding::kOverhang;
}

absl::StatusOr<std::uint32_t> DecodeOverhang(const volume::BlockLayout& layout,
                                             const SourceSamples& source, volume::ScalarType type,
                                             volume::BlockId id, absl::string_view stored,
                                             char* samples) {
  const auto is_known = [](char encoding) {
    return encoding >= 0 && static_cast<std::uint32_t>(encoding) <=
                                static_cast<std::uint32_t>(BlockEncoding::kPacked);
  };
  if (stored.size() < kOverhangHeadBytes || !is_known(stored[sizeof(std::uint32_t)])) {
    return absl::DataLossError(
        absl::StrFormat("%d bytes are no overhang of a block", stored.size()));
  }
  const std::size_t sample_bytes = volume::SizeOf(type);
  const math::IndexBox box = layout.StoredSamplesOf(id);
  const math::IndexBox part = PartInUnit(layout, source, id);
  const std::int64_t count = math::Volume(box.dims()) - math::Volume(part.dims());
  std::string overhang(static_cast<std::size_t>(count) * sample_bytes, '\0');
  const absl::string_view encoded = stored.substr(kOverhangHeadBytes);
  if (count == 0) {
    if (!encoded.empty()) {
      return absl::DataLossError(
          absl::StrFormat("%d bytes of an overhang, expected none", encoded.size()));
    }
  } else {
    std::string scratch;
    ISOSCOPE_RETURN_IF_ERROR(DecodeBlock(static_cast<BlockEncoding>(stored[sizeof(std::uint32_t)]),
                                         type, {count, 1, 1}, encoded, &scratch, overhang.data()));
  }
  const char* from = overhang.data();
  ForEachRun(box, part, sample_bytes, [&](std::size_t offset, std::size_t size) {
    std::copy_n(from, size, samples + offset);
    from += size;
  });
  return base::LoadLittleEndian<std::uint32_t>(stored.data());
}

}  // namespace isoscope::store
