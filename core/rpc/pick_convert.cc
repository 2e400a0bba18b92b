#include "core/rpc/pick_convert.h"

#include <algorithm>
#include <cstddef>
#include <string>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/rpc/frame_convert.h"
#include "core/rpc/known_fields.h"
#include "core/rpc/proto_convert.h"

namespace isoscope::rpc {
namespace {

// Returns the smallest region that holds all pixels. REQUIRES: at least one.
view::Region RegionAround(const std::vector<PixelPosition>& pixels) {
  PixelPosition low = pixels.front();
  PixelPosition high = low;
  for (const PixelPosition& pixel : pixels) {
    low = {std::min(low.x, pixel.x), std::min(low.y, pixel.y)};
    high = {std::max(high.x, pixel.x), std::max(high.y, pixel.y)};
  }
  return {low.x, low.y, high.x - low.x + 1, high.y - low.y + 1};
}

absl::Status CheckCoordinate(absl::string_view name, int index, int value, int size_px) {
  if (value < 0 || value >= size_px) {
    return absl::InvalidArgumentError(absl::StrCat("pixels[", index, "].", name, " is ", value,
                                                   ": must be in [0, ", size_px - 1, "]"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<PickSpec> PickSpecFromProto(const isoscope::v1::PickSurfaceRequest& proto) {
  ISOSCOPE_RETURN_IF_ERROR(CheckKnownFields(proto));
  if (proto.frame().has_region() || proto.frame().has_output()) {
    return absl::InvalidArgumentError(
        absl::StrCat("frame.", proto.frame().has_region() ? "region" : "output",
                     " is set: must not be; pixels are those of the whole viewport"));
  }
  if (!proto.frame().has_viewport()) {
    return absl::InvalidArgumentError(
        "frame.viewport is not set: must say the size of the image whose pixels are meant");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      const view::Viewport viewport,
      ViewportFromProto(proto.frame().viewport(), "frame.viewport", view::kMaxWholeViewportPx));
  if (proto.pixels_size() < 1 || proto.pixels_size() > kMaxPickedPixels) {
    return absl::InvalidArgumentError(absl::StrCat("pixels has ", proto.pixels_size(),
                                                   " elements: must have 1 to ", kMaxPickedPixels));
  }
  PickSpec spec;
  for (int i = 0; i < proto.pixels_size(); ++i) {
    const isoscope::v1::Pixel& pixel = proto.pixels(i);
    ISOSCOPE_RETURN_IF_ERROR(CheckCoordinate("x", i, pixel.x(), viewport.width_px));
    ISOSCOPE_RETURN_IF_ERROR(CheckCoordinate("y", i, pixel.y(), viewport.height_px));
    spec.pixels.push_back({pixel.x(), pixel.y()});
  }
  const view::Region region = RegionAround(spec.pixels);
  if (std::max(region.width_px, region.height_px) > view::kMaxViewportPx) {
    return absl::InvalidArgumentError(absl::StrCat(
        "pixels lie in a window of ", region.width_px, " x ", region.height_px,
        " pixels: must lie in one of at most ", view::kMaxViewportPx, " a side; ask in parts"));
  }
  spec.request = proto.frame();
  *spec.request.mutable_region() = ToProto(region);
  spec.request.set_culling(isoscope::v1::CULLING_DEPTH);
  // Checked before it is replaced, so that no wrong value goes unnoticed.
  ISOSCOPE_RETURN_IF_ERROR(CullingFromProto(proto.frame().culling(), "frame.culling").status());
  ISOSCOPE_ASSIGN_OR_RETURN(spec.frame, FrameSpecFromProto(spec.request));
  spec.request.clear_samples();
  spec.request.clear_ambient_occlusion();
  spec.request.clear_silhouette();
  spec.frame.effects = {};
  return spec;
}

absl::StatusOr<std::vector<math::Vec3d>> PickedPointsFromProto(
    const isoscope::internal::v1::GetGradientsRequest& proto) {
  if (proto.points_size() > kMaxPickedPixels) {
    return absl::InvalidArgumentError(absl::StrCat(
        "points has ", proto.points_size(), " elements: must have at most ", kMaxPickedPixels));
  }
  std::vector<math::Vec3d> points;
  for (int i = 0; i < proto.points_size(); ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(points.emplace_back(),
                              VectorFromProto(proto.points(i), absl::StrCat("points[", i, "]")));
  }
  return points;
}

absl::Status AddGradients(const isoscope::internal::v1::GetGradientsResponse& proto,
                          std::vector<std::optional<math::Vec3d>>* gradients) {
  for (int i = 0; i < proto.gradients_size(); ++i) {
    const isoscope::internal::v1::PointGradient& gradient = proto.gradients(i);
    const std::string path = absl::StrCat("gradients[", i, "]");
    if (gradient.point_index() < 0 ||
        static_cast<std::size_t>(gradient.point_index()) >= gradients->size()) {
      return absl::InvalidArgumentError(absl::StrCat(path, ".point_index is ",
                                                     gradient.point_index(), ": must be in [0, ",
                                                     gradients->size(), ")"));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(
        (*gradients)[static_cast<std::size_t>(gradient.point_index())],
        VectorFromProto(gradient.gradient(), absl::StrCat(path, ".gradient")));
  }
  return absl::OkStatus();
}

}  // namespace isoscope::rpc
