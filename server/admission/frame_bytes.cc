// FrameBytes adds up the peak of one frame. 1024 x 1024 pixels as a PNG in one message take 26 MiB
// drawn (26 bytes a pixel), 4 MiB encoded, 4 MiB of gRPC's copy and 1 MiB besides: 35 MiB. Each of
// max_layers + 1 layers would add 20 MiB.
//
// In bands, 8192 x 8192 pixels as an opaque PNG take 193 MiB at the end of its encoding row by row,
// and as much again while it is sent in one message. A band has a share of what is left meanwhile.

#include "server/admission/frame_bytes.h"

#include <algorithm>

#include "core/base/units.h"
#include "core/frame/drawn_window.h"
#include "server/admission/band_grid.h"

namespace isoscope::server {
namespace {

// Bytes for a pixel, or for a translucent fragment of one: pixel bands that have arrived and wait
// to be composited.
constexpr std::size_t kBandBytesPerPixel = 8;
// Bytes for a pixel: 12 for the image (key and colour), 6 for the occlusion map, and its bands.
constexpr std::size_t kFrameBytesPerPixel = 12 + 6 + kBandBytesPerPixel;
// Bytes for a translucent fragment of a pixel: 12 for key and colour, and its bands.
constexpr std::size_t kLayerBytesPerPixel = 12 + kBandBytesPerPixel;
// A picture that differs from the drawn pixels has an image of its own (key and colour). It is
// allocated after occlusion map and bands are freed; its effects reuse their bytes.
constexpr std::size_t kPictureImageBytesPerPixel = 12;
// An encoded picture of noise is as large as its pixels, and a little more.
constexpr std::size_t kPictureBytesPerPixel = frame::kRgba8Bytes;
// A PNG over an opaque background has three channels; a 64th is more than a little.
constexpr std::size_t OpaquePngBytes(std::size_t pixels) { return 3 * pixels + pixels / 64; }
// Every frame needs this much besides: messages, lists of blocks.
constexpr std::size_t kLeastFrameBytes = base::kMiB;

std::size_t PixelsOf(const view::Viewport& size) {
  return static_cast<std::size_t>(size.width_px) * static_cast<std::size_t>(size.height_px);
}

std::size_t LayerCountOf(const frame::FrameSpec& spec) {
  return frame::HasLayers(spec) ? static_cast<std::size_t>(spec.max_layers + 1) : 0;
}

bool IsCompressed(const frame::OutputSpec& output) {
  return output.image_format == frame::ImageFormat::kPng ||
         output.image_format == frame::ImageFormat::kJpeg;
}

// The bytes of an encoded picture of noise.
std::size_t CompressedBytes(const frame::FrameSpec& spec) {
  if (!IsCompressed(spec.output)) {
    return 0;
  }
  const std::size_t pixels = PixelsOf(frame::ImageSizeOf(spec));
  return spec.output.image_format == frame::ImageFormat::kPng && IsEncodedByRows(spec)
             ? OpaquePngBytes(pixels)
             : pixels * kPictureBytesPerPixel;
}

// While agents answer for the plane of bounds: their answers, one of them unpacked, and the union.
std::size_t BoundsBytes(const frame::FrameSpec& spec) {
  constexpr std::size_t kCopies = 3;
  return spec.output.depth_bounds
             ? std::min(PixelsOf(frame::ImageSizeOf(spec)), frame::kMaxBoundsPixels) * kCopies *
                   frame::kDepthBoundsBytes
             : 0;
}

// The images of a frame that is drawn at once. They are gone before bounds are asked for, which take
// less.
std::size_t DrawnBytes(const frame::FrameSpec& spec) {
  const frame::DrawnWindow window = frame::DrawnWindowOf(spec);
  return PixelsOf(window.image_size()) *
             (kFrameBytesPerPixel + LayerCountOf(spec) * kLayerBytesPerPixel) +
         (window.is_picture_of(spec)
              ? 0
              : PixelsOf(frame::ImageSizeOf(spec)) * kPictureImageBytesPerPixel);
}

std::size_t ResponseBytesPerPixel(const frame::OutputSpec& output) {
  return frame::RawBytesPerPixel(output) + (IsCompressed(output) ? kPictureBytesPerPixel : 0);
}

}  // namespace

std::size_t FrameBytes(const frame::FrameSpec& spec, Delivery delivery) {
  const std::size_t response = ResponseBytesPerPixel(spec.output);
  // Stripes are joined into a compressed picture, and gRPC copies a whole response. The two never
  // happen at the same time.
  const std::size_t copies = delivery == Delivery::kWhole ? response
                             : IsCompressed(spec.output)  ? kPictureBytesPerPixel
                                                          : 0;
  return DrawnBytes(spec) + PixelsOf(frame::ImageSizeOf(spec)) * (response + copies) +
         kLeastFrameBytes;
}

std::size_t WaitingBandBytes(const frame::FrameSpec& spec) {
  return std::max(PixelsOf(frame::DrawnWindowOf(spec).image_size()) * (1 + LayerCountOf(spec)) *
                      kBandBytesPerPixel,
                  kLeastFrameBytes);
}

bool IsEncodedByRows(const frame::FrameSpec& spec) {
  // Over an opaque background all pixels are opaque, so that the first row of bands tells the
  // channels of the PNG. A JPEG always has three.
  return spec.output.image_format == frame::ImageFormat::kJpeg ||
         (spec.output.image_format == frame::ImageFormat::kPng && spec.background_color.a == 255);
}

std::size_t BandedBytes::most() const { return std::max({kept + band, encode, send}); }

BandedBytes BandedBytesOf(const frame::FrameSpec& spec, const view::Viewport& band,
                          Delivery delivery) {
  const view::Viewport picture = frame::ImageSizeOf(spec);
  const std::size_t pixels = PixelsOf(picture);
  const std::size_t raw = frame::RawBytesPerPixel(spec.output);
  const bool is_by_rows = IsEncodedByRows(spec);
  const std::size_t compressed = CompressedBytes(spec);
  const std::size_t response = pixels * raw + compressed;
  BandedBytes bytes;
  bytes.kept = response + kLeastFrameBytes;
  // Its images, its planes, and the pixels of its row of bands.
  bytes.band = DrawnBytes(BandInTheMiddle(spec, band)) + PixelsOf(band) * raw +
               (is_by_rows ? PixelsOf({picture.width_px, band.height_px}) * frame::kRgba8Bytes : 0);
  // Pixels, stripes, and the picture that is made of these; encoded rows are freed as they are
  // joined. Then the bounds.
  bytes.encode =
      response + std::max(is_by_rows ? 0 : 2 * compressed, BoundsBytes(spec)) + kLeastFrameBytes;
  bytes.send = (delivery == Delivery::kWhole ? 2 * response : response) + kLeastFrameBytes;
  return bytes;
}

}  // namespace isoscope::server
