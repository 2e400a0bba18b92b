// The output of a drawn frame: its picture in the requested format, and its planes. No gRPC types.

#ifndef ISOSCOPE_SERVER_PICTURE_FRAME_OUTPUT_H_
#define ISOSCOPE_SERVER_PICTURE_FRAME_OUTPUT_H_

#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/statusor.h"

#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/math/vec.h"
#include "core/view/view.h"
#include "core/visibility/depth_bounds.h"

namespace isoscope::server {

// Bytes as isoscope.v1.RenderIsosurfaceResponse describes them. Outputs that were not requested are
// empty.
struct FrameOutput {
  std::string image;  // in the format of the spec
  std::string depth;
  std::string surface_index;
  std::string position;
  std::string normal;
  std::string depth_bounds;

  [[nodiscard]] std::size_t size_bytes() const {
    return image.size() + depth.size() + surface_index.size() + position.size() + normal.size() +
           depth_bounds.size();
  }
};

// The surface index of the background.
inline constexpr std::uint8_t kBackgroundSurface = 255;

// Encodes the picture, over the spec's background colour. Works in parallel, in the tbb::task_arena
// of the caller. REQUIRES: the image carries colours. RESOURCE_EXHAUSTED if memory runs out. Empty
// for ImageFormat::kNone.
absl::StatusOr<std::string> EncodePicture(const image::FrameImage& image,
                                          const frame::FrameSpec& spec);

// Fills the planes that the spec asks for, except normals and bounds, from depths and owners. Works in
// parallel, as EncodePicture. Throws std::bad_alloc if memory runs out; so does NormalPlane.
void FillPlanes(const image::FrameImage& image, const frame::FrameSpec& spec,
                const view::View& view, const image::FragmentOrder& order, FrameOutput* output);

// Returns the plane of normals of an image that carries them (FrameSpec::sends_normals).
std::string NormalPlane(const image::FrameImage& image);

// Appends rows of the plane of bounds, from window depths: two distances a pixel, both infinite
// where no block is.
void AppendBounds(const visibility::DepthBounds& bounds, const view::View& view,
                  std::string* plane);

// The surface point at one pixel.
struct PixelPoint {
  float distance = 0;
  math::Vec3d position;  // rounded to float32
  std::uint32_t surface_index = 0;
  std::uint32_t block_id = 0;
  std::optional<math::Vec3d> normal;  // not set if the surface has none, or the image carries none
};

// Returns the values that the planes have at pixel (x, y) of the picture; none for the background.
// `carries_normals`: the image carries normals in place of colours.
std::optional<PixelPoint> PointAt(const image::FrameImage& image, int x, int y,
                                  const view::View& view, const image::FragmentOrder& order,
                                  bool carries_normals);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_PICTURE_FRAME_OUTPUT_H_
