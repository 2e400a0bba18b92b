#include "wire/depth_bounds_convert.h"

#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

#include "core/base/coding.h"
#include "core/base/compression.h"
#include "core/base/status_macros.h"
#include "wire/frame_convert.h"
#include "wire/known_fields.h"

namespace isoscope::wire {
namespace {

namespace internal = isoscope::internal::v1;

std::size_t BoundsPixelsOf(const view::Viewport& size) {
  return static_cast<std::size_t>(size.width_px) * static_cast<std::size_t>(size.height_px);
}

std::string CompressPlane(std::span<const float> plane) {
  std::string bytes(plane.size_bytes(), '\0');
  for (std::size_t i = 0; i < plane.size(); ++i) {
    base::StoreLittleEndian(plane[i], bytes.data() + i * sizeof(float));
  }
  return base::Compress(bytes);
}

absl::StatusOr<std::vector<float>> DecompressPlane(absl::string_view compressed,
                                                   std::size_t pixel_count,
                                                   absl::string_view name) {
  const std::size_t size = pixel_count * sizeof(float);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes, base::Decompress(compressed, size));
  if (bytes.size() != size) {
    return absl::DataLossError(absl::StrCat(name, " has ", bytes.size(), " bytes; expected ", size,
                                            ", 4 for each of ", pixel_count, " pixels"));
  }
  std::vector<float> plane(pixel_count);
  for (std::size_t i = 0; i < pixel_count; ++i) {
    plane[i] = base::LoadLittleEndian<float>(bytes.data() + i * sizeof(float));
  }
  return plane;
}

}  // namespace

absl::StatusOr<DepthBoundsQuery> DepthBoundsQueryFromProto(
    const internal::GetDepthBoundsRequest& request) {
  ISOSCOPE_RETURN_IF_ERROR(CheckKnownFields(request));
  DepthBoundsQuery query;
  ISOSCOPE_ASSIGN_OR_RETURN(query.spec, FrameSpecFromProto(request.frame()));
  if (!query.spec.camera.has_value()) {
    return absl::InvalidArgumentError("frame.camera is not set: required");
  }
  if (query.spec.level != 0) {
    return absl::InvalidArgumentError(absl::StrCat("frame.level is ", query.spec.level,
                                                   ": must be 0, whose depths are the exact ones"));
  }
  const std::size_t pixels = BoundsPixelsOf(frame::ImageSizeOf(query.spec));
  if (pixels > frame::kMaxBoundsPixels) {
    return absl::InvalidArgumentError(absl::StrCat("frame has a picture of ", pixels,
                                                   " pixels: must be at most ",
                                                   frame::kMaxBoundsPixels, "; ask for a region"));
  }
  query.part_index = request.part_index();
  query.part_count = request.part_count();
  if (query.part_count < 1 || query.part_count > kMaxBoundsParts || query.part_index < 0 ||
      query.part_index >= query.part_count) {
    return absl::InvalidArgumentError(
        absl::StrCat("part_index is ", query.part_index, " of part_count ", query.part_count,
                     ": must lie in [0, part_count), of 1 to ", kMaxBoundsParts));
  }
  return query;
}

internal::GetDepthBoundsResponse ToProto(const visibility::DepthBounds& bounds) {
  internal::GetDepthBoundsResponse proto;
  proto.set_nearest(CompressPlane(bounds.nearest()));
  proto.set_farthest(CompressPlane(bounds.farthest()));
  return proto;
}

absl::StatusOr<visibility::DepthBounds> DepthBoundsFromProto(
    const internal::GetDepthBoundsResponse& proto, const view::Viewport& size) {
  const std::size_t pixels = BoundsPixelsOf(size);
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<float> nearest,
                            DecompressPlane(proto.nearest(), pixels, "nearest"));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<float> farthest,
                            DecompressPlane(proto.farthest(), pixels, "farthest"));
  for (std::size_t i = 0; i < pixels; ++i) {
    if (!visibility::DepthBounds::AreValid(nearest[i], farthest[i])) {
      return absl::InvalidArgumentError(absl::StrCat("pixel ", i, " has the nearest depth ",
                                                     nearest[i], " and the farthest ", farthest[i],
                                                     ": must be ascending in [0, 1], or 2 and -1"));
    }
  }
  return visibility::DepthBounds(size.width_px, size.height_px, std::move(nearest),
                                 std::move(farthest));
}

}  // namespace isoscope::wire
