// The output of a frame: the format of the picture, and the planes sent with it.

#ifndef ISOSCOPE_CORE_FRAME_OUTPUT_SPEC_H_
#define ISOSCOPE_CORE_FRAME_OUTPUT_SPEC_H_

#include <cstddef>

namespace isoscope::frame {

enum class ImageFormat { kPng, kJpeg, kRgba8, kNone };

inline constexpr int kDefaultJpegQuality = 90;

struct OutputSpec {
  ImageFormat image_format = ImageFormat::kPng;
  int jpeg_quality = kDefaultJpegQuality;  // 1 to 100
  bool depth = false;
  bool surface_index = false;
  bool position = false;
  bool normal = false;
  bool depth_bounds = false;

  // Whether planes are wanted that come from drawn pixels: all but depth_bounds.
  [[nodiscard]] bool any_drawn_plane() const {
    return depth || surface_index || position || normal;
  }
  [[nodiscard]] bool any_plane() const { return any_drawn_plane() || depth_bounds; }
  // Whether the frame is drawn at all.
  [[nodiscard]] bool is_drawn() const {
    return image_format != ImageFormat::kNone || any_drawn_plane();
  }

  friend bool operator==(const OutputSpec&, const OutputSpec&) = default;
};

// Bytes of a pixel in each plane (isoscope.v1.RenderIsosurfaceResponse).
inline constexpr std::size_t kDepthBytes = 4;
inline constexpr std::size_t kSurfaceIndexBytes = 1;
inline constexpr std::size_t kPositionBytes = 12;
inline constexpr std::size_t kNormalBytes = 12;
inline constexpr std::size_t kDepthBoundsBytes = 8;
// The most pixels of bounds that all agents together are asked for at a time, and that one is: they
// take 4 MiB.
inline constexpr std::size_t kMaxBoundsPixels = std::size_t{1} << 19;
inline constexpr std::size_t kRgba8Bytes = 4;

// Returns the bytes of a pixel in all that is sent without compression.
constexpr std::size_t RawBytesPerPixel(const OutputSpec& output) {
  return (output.image_format == ImageFormat::kRgba8 ? kRgba8Bytes : 0) +
         (output.depth ? kDepthBytes : 0) + (output.surface_index ? kSurfaceIndexBytes : 0) +
         (output.position ? kPositionBytes : 0) + (output.normal ? kNormalBytes : 0) +
         (output.depth_bounds ? kDepthBoundsBytes : 0);
}

}  // namespace isoscope::frame

#endif  // ISOSCOPE_CORE_FRAME_OUTPUT_SPEC_H_
