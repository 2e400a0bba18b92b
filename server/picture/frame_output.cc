// A pixel of the image is a key, depth << 32 | owner, and a colour or a normal. Its outputs:
//
//   output          bytes   of a surface                          of the background
//   picture         4       its colour, before compression        the background colour
//   depth           4       float: distance from its depth        infinity
//   surface_index   1       the surface of its owner              255
//   position        12      three floats: point at its distance   NaN
//   normal          12      three floats: its coded normal        NaN
//   depth_bounds    8       (not from the image: distances of the bounds, infinity for none)
//
// All are little-endian, row by row. Rows are filled in parallel. PointAt computes the same values
// for one pixel.

#include "server/picture/frame_output.h"

#include <array>
#include <cstddef>
#include <cstring>
#include <limits>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/coding.h"
#include "core/base/no_memory.h"
#include "core/image/jpeg_codec.h"
#include "core/image/normal_code.h"
#include "core/image/png_codec.h"
#include "core/view/unprojection.h"

namespace isoscope::server {
namespace {

constexpr float kNoDistance = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

// Calls fn(y) for every row, in parallel.
template <typename Fn>
void ForEachRow(const image::FrameImage& image, const Fn& fn) {
  constexpr int kRowsPerTask = 16;
  tbb::parallel_for(tbb::blocked_range<int>(0, image.height, kRowsPerTask),
                    [&](const tbb::blocked_range<int>& rows) {
                      for (int y = rows.begin(); y < rows.end(); ++y) {
                        fn(y);
                      }
                    });
}

// Calls fn(pixel index, x, y) for every pixel, rows in parallel.
template <typename Fn>
void ForEachPixel(const image::FrameImage& image, const Fn& fn) {
  ForEachRow(image, [&](int y) {
    std::size_t i = image.IndexOf(0, y);
    for (int x = 0; x < image.width; ++x, ++i) {
      fn(i, x, y);
    }
  });
}

void StoreVector(const std::array<float, 3>& v, std::size_t pixel, std::string* plane) {
  std::memcpy(plane->data() + pixel * sizeof(v), v.data(), sizeof(v));
}

bool IsBackground(std::uint64_t key) { return image::OwnerOf(key) == image::kNoOwner; }

// Without branches, so that compilers vectorise it.
void FillDepthRow(const image::FrameImage& image, int y, const view::Unprojection& unprojection,
                  std::string* plane) {
  const std::size_t begin = image.IndexOf(0, y);
  const std::uint64_t* keys = image.keys.data() + begin;
  char* to = plane->data() + begin * frame::kDepthBytes;
  for (int x = 0; x < image.width; ++x) {
    const float distance = unprojection.DistanceOf(image::DepthOf(keys[x]));
    const float shown = IsBackground(keys[x]) ? kNoDistance : distance;
    base::StoreLittleEndian(shown, to + static_cast<std::size_t>(x) * frame::kDepthBytes);
  }
}

std::array<float, 3> ToFloats(const math::Vec3d& v) {
  return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}

std::string RawRgba(const image::FrameImage& image, image::Rgba8 background) {
  std::string bytes(image.pixel_count() * frame::kRgba8Bytes, '\0');
  ForEachPixel(image, [&](std::size_t i, int /*x*/, int /*y*/) {
    const image::Rgba8 color = image.colors[i].a == 0 ? background : image.colors[i];
    std::memcpy(bytes.data() + i * sizeof(color), &color, sizeof(color));
  });
  return bytes;
}

absl::StatusOr<std::string> TryEncodePicture(const image::FrameImage& image,
                                             const frame::FrameSpec& spec) {
  switch (spec.output.image_format) {
    case frame::ImageFormat::kPng:
      return image::EncodePng(image.width, image.height, image.colors, spec.background_color);
    case frame::ImageFormat::kJpeg:
      return image::EncodeJpeg(image.width, image.height, image.colors, spec.background_color,
                               spec.output.jpeg_quality);
    case frame::ImageFormat::kRgba8:
      return RawRgba(image, spec.background_color);
    case frame::ImageFormat::kNone:
      break;
  }
  return std::string();
}

}  // namespace

absl::StatusOr<std::string> EncodePicture(const image::FrameImage& image,
                                          const frame::FrameSpec& spec) {
  return base::OrNoMemory("the bytes of the picture",
                          [&] { return TryEncodePicture(image, spec); });
}

void FillPlanes(const image::FrameImage& image, const frame::FrameSpec& spec,
                const view::View& view, const image::FragmentOrder& order, FrameOutput* output) {
  const frame::OutputSpec& wanted = spec.output;
  if (!wanted.depth && !wanted.surface_index && !wanted.position) {
    return;
  }
  output->depth.resize(wanted.depth ? image.pixel_count() * frame::kDepthBytes : 0);
  output->surface_index.resize(wanted.surface_index ? image.pixel_count() : 0);
  output->position.resize(wanted.position ? image.pixel_count() * frame::kPositionBytes : 0);
  const view::Unprojection unprojection(view);
  if (wanted.depth) {
    ForEachRow(image, [&](int y) { FillDepthRow(image, y, unprojection, &output->depth); });
  }
  if (!wanted.surface_index && !wanted.position) {
    return;
  }
  ForEachPixel(image, [&](std::size_t i, int x, int y) {
    const std::uint64_t key = image.keys[i];
    const bool is_background = IsBackground(key);
    const float distance =
        is_background ? kNoDistance : unprojection.DistanceOf(image::DepthOf(key));
    if (wanted.surface_index) {
      output->surface_index[i] = static_cast<char>(
          is_background ? kBackgroundSurface : order.SurfaceOf(image::OwnerOf(key)));
    }
    if (wanted.position) {
      StoreVector(is_background ? std::array{kNan, kNan, kNan}
                                : ToFloats(unprojection.PositionOf(x, y, distance)),
                  i, &output->position);
    }
  });
}

std::string NormalPlane(const image::FrameImage& image) {
  std::string plane(image.pixel_count() * frame::kNormalBytes, '\0');
  ForEachPixel(image, [&](std::size_t i, int /*x*/, int /*y*/) {
    StoreVector(IsBackground(image.keys[i]) ? std::array{kNan, kNan, kNan}
                                            : image::DecodeNormal(image.colors[i]),
                i, &plane);
  });
  return plane;
}

void AppendBounds(const visibility::DepthBounds& bounds, const view::View& view,
                  std::string* plane) {
  const view::Unprojection unprojection(view);
  const std::size_t begin = plane->size();
  const std::size_t pixel_count = bounds.nearest().size();
  plane->resize(begin + pixel_count * frame::kDepthBoundsBytes);
  char* to = plane->data() + begin;
  for (std::size_t i = 0; i < pixel_count; ++i) {
    const bool is_background = bounds.IsBackground(i);
    for (const float depth : {bounds.nearest()[i], bounds.farthest()[i]}) {
      base::StoreLittleEndian(is_background ? kNoDistance : unprojection.DistanceOf(depth), to);
      to += frame::kDepthBytes;
    }
  }
}

std::optional<PixelPoint> PointAt(const image::FrameImage& image, int x, int y,
                                  const view::View& view, const image::FragmentOrder& order,
                                  bool carries_normals) {
  const std::size_t i = image.IndexOf(x, y);
  const std::uint64_t key = image.keys[i];
  if (IsBackground(key)) {
    return std::nullopt;
  }
  const view::Unprojection unprojection(view);
  PixelPoint point;
  point.distance = unprojection.DistanceOf(image::DepthOf(key));
  point.position = unprojection.PositionOf(x, y, point.distance);
  point.surface_index = order.SurfaceOf(image::OwnerOf(key));
  point.block_id = image::OwnerOf(key) % order.block_count;
  if (carries_normals && image.colors[i] != image::kNoNormal) {
    const auto [nx, ny, nz] = image::DecodeNormal(image.colors[i]);
    point.normal = {static_cast<double>(nx), static_cast<double>(ny), static_cast<double>(nz)};
  }
  return point;
}

}  // namespace isoscope::server
