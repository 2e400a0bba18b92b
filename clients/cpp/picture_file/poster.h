// A picture that is too large to be drawn at once: regions of its viewport go into
// a PNG as soon as a strip of them is whole. Memory holds one strip.

#ifndef ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_POSTER_H_
#define ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_POSTER_H_

#include <cstdint>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/image/png_codec.h"
#include "core/view/camera.h"

namespace isoscope::client {

// A picture of more pixels is drawn region by region.
inline constexpr std::int64_t kMaxSinglePixels = std::int64_t{4096} * 4096;
// A strip of regions takes at most this many bytes, or the bytes of one stripe of a PNG.
inline constexpr std::int64_t kMaxStripBytes = std::int64_t{64} * 1024 * 1024;

bool NeedsRegions(const view::Viewport& viewport);

// The size of a region; those at the right and at the bottom may be smaller. About as many pixels
// as view::kCommonViewport has, and at most `max_side_px` >= view::kCommonViewport.height_px a
// side.
view::Viewport RegionSizeOf(const view::Viewport& viewport, int max_side_px = view::kMaxViewportPx);

// Asks `render` for the regions, row by row from the top left, and writes the picture to `path`,
// which appears whole or not at all. The pixels, and the bytes if the picture is opaque, are those
// of image::EncodePng for the whole. `progress` hears of each region.
//
// region_size: RegionSizeOf(viewport, ...)
// is_opaque:   whether all alphas are 1
//
// Returns the size of the file in bytes. Errors of `render`, and as io::CreateWritableFile.
absl::StatusOr<std::int64_t> WritePoster(
    const view::Viewport& viewport, const view::Viewport& region_size, bool is_opaque,
    const std::string& path,
    absl::FunctionRef<absl::StatusOr<image::RgbaImage>(const view::Region& region)> render,
    absl::FunctionRef<void(absl::string_view)> progress);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_POSTER_H_
